"""Scattered data: 3D Gaussians on a knotted tube, and the particles of a galaxy's halo."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resample.samples import SampleFiles
from resample.samples.shapes import knot_points
from resample.samples.writing import write_ply
from resample.types import Doubles

TUBE = 108.3  # area of the knotted tube, scene units²
FLATNESS = 0.2  # thickness of a Gaussian relative to its width
HARMONIC = 0.28209479177387814  # the constant spherical harmonic
CLUMPS = 24  # small halos around the large one
NEIGHBOURS = 32  # particles within a smoothing length


@dataclass(frozen=True)
class GaussianSample:
    """3D Gaussians as trainers store them."""

    position: Doubles  # (N, 3)
    scale: Doubles  # (N, 3) standard deviations along the own axes
    rotation: Doubles  # (N, 4) unit quaternions w, x, y, z
    opacity: Doubles  # (N,)
    color: Doubles  # (N, 3) sRGB, 0 to 1

    def stored(self, folder: Path, name: str) -> SampleFiles:
        parts = {
            "x y z": self.position,
            "f_dc_0 f_dc_1 f_dc_2": (self.color - 0.5) / HARMONIC,
            "opacity": np.log(self.opacity / (1 - self.opacity))[:, None],
            "scale_0 scale_1 scale_2": np.log(self.scale),
            "rot_0 rot_1 rot_2 rot_3": self.rotation,
        }
        columns = {
            column: values.astype(np.float32)
            for names, table in parts.items()
            for column, values in zip(names.split(), table.T, strict=True)
        }
        write_ply(folder / f"{name}.ply", columns)
        return SampleFiles([f"{name}.ply"])


@dataclass(frozen=True)
class ParticleSample:
    """Particles of a simulation."""

    position: Doubles  # (N, 3)
    mass: Doubles  # (N,)
    smoothing: Doubles  # (N,) smoothing lengths

    def stored(self, folder: Path, name: str) -> SampleFiles:
        table = np.column_stack([self.position, self.mass, self.smoothing])
        rows = (",".join(f"{value:.5g}" for value in row) for row in table.tolist())
        (folder / f"{name}.csv").write_text("\n".join(["x,y,z,mass,h", *rows, ""]), "utf-8")
        return SampleFiles([f"{name}.csv"])


def knot_gaussians(count: int = 12000) -> GaussianSample:
    """3D Gaussians that cover a knotted tube."""
    points = knot_points(count)
    width = np.sqrt(TUBE / count)
    x, y, z = points.normal.T
    rotation = np.stack([1 + z, -y, x, np.zeros_like(x)], axis=1)  # turns the z axis there
    rotation[rotation[:, 0] < 1e-6] = 0, 1, 0, 0
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    scale = np.tile([width, width, FLATNESS * width], (count, 1))
    return GaussianSample(
        points.position, scale, rotation, np.full(count, 0.9), points.color / 255.0
    )


def halo(count: int = 20000) -> ParticleSample:
    """Particles of a galaxy's halo of mass 1, with smaller ones around it."""
    from scipy.spatial import KDTree

    if not 100 <= count <= 1_000_000:
        raise ValueError(f"halo: count is 100 to 1000000, not {count}")
    rng = np.random.default_rng(2003)
    center = np.vstack([np.zeros((1, 3)), _around(rng.random((CLUMPS, 3)))])
    size = np.concatenate([[0.5], 0.03 + 0.1 * rng.random(CLUMPS)])
    clump = np.where(rng.random(count) < 0.6, 0, 1 + (CLUMPS * rng.random(count)).astype(int))
    position = center[clump] + size[clump, None] * _around(rng.random((count, 3)))
    distance, _ = KDTree(position).query(position, NEIGHBOURS)
    return ParticleSample(position, np.full(count, 1 / count), distance[:, -1])


def _around(share: Doubles) -> Doubles:
    """Positions of Plummer's sphere of radius 1, cut off at 4, for uniform numbers (N, 3)."""
    radius = 1 / np.sqrt((0.02 + 0.89 * share[:, 0]) ** (-2 / 3) - 1 + 1e-9)
    height, angle = 2 * share[:, 1] - 1, 2 * np.pi * share[:, 2]
    level = np.sqrt(1 - height**2)
    way = np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=1)
    return np.asarray(radius[:, None] * way)
