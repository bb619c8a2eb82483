"""A knotted tube, as textured triangles and as points."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.samples import SampleFiles
from resample.samples.pictures import mixed
from resample.types import Doubles


class MeshSample(NamedTuple):
    """A closed surface with its texture."""

    position: Doubles  # (N, 3)
    normal: Doubles  # (N, 3)
    place: Doubles  # (N, 2) on the texture, from the bottom left
    triangle: NDArray[np.int64]  # (T, 3) indices of vertices
    texture: NDArray[np.uint8]  # (H, W, 3) sRGB

    def stored(self, folder: Path, name: str) -> SampleFiles:
        from resample.samples.writing import write_obj

        write_obj(folder / f"{name}.obj", self)
        return SampleFiles([f"{name}.obj"])


class PointSample(NamedTuple):
    """Points on a surface."""

    position: Doubles  # (N, 3)
    normal: Doubles  # (N, 3)
    color: NDArray[np.uint8]  # (N, 3) sRGB

    def stored(self, folder: Path, name: str) -> SampleFiles:
        parts = np.hstack([self.position, self.normal]).astype(np.float32)
        columns = dict(zip(("x", "y", "z", "nx", "ny", "nz"), parts.T, strict=True))
        colors = dict(zip(("red", "green", "blue"), self.color.T, strict=True))
        from resample.samples.writing import write_ply

        write_ply(folder / f"{name}.ply", columns | colors)
        return SampleFiles([f"{name}.ply"])


def knot(along: int = 360, around: int = 36) -> MeshSample:
    """A knotted tube with a brick texture."""
    from resample.samples.pictures import bricks

    if along < 8 or around < 3:
        raise ValueError(f"knot: at least 8 vertices along and 3 around, not {along} and {around}")
    u: Doubles = np.repeat(np.linspace(0, 1, along + 1), around + 1)
    v: Doubles = np.tile(np.linspace(0, 1, around + 1), along + 1)
    position, normal = _tube(u, v)
    row, column = (part.ravel() for part in np.mgrid[:along, :around])
    first = row * (around + 1) + column
    ahead = first + around + 1
    triangle = np.stack([first, ahead, first + 1, first + 1, ahead, ahead + 1], axis=1)
    place = np.stack([8 * u, v], axis=1)
    return MeshSample(position, normal, place, triangle.reshape(-1, 3), bricks(512))


def knot_points(count: int = 60000) -> PointSample:
    """Points on a knotted tube, with normals and colors."""
    if not 16 <= count <= 10_000_000:
        raise ValueError(f"knot-points: count is 16 to 10000000, not {count}")
    number = np.arange(count)
    u = np.asarray((number + 0.5) / count, np.float64)
    v = np.asarray((number * 0.6180339887498949) % 1, np.float64)  # uniform, without visible rows
    position, normal = _tube(u, v)
    turn = 2 * np.pi * (3 * u[:, None] + np.array([0.0, 1 / 3, 2 / 3]))
    band = np.where((48 * u + 2 * v) % 1 < 0.16, 0.45, 1.0)[:, None]
    color = (0.56 + 0.34 * np.cos(turn)) * band
    color *= 0.94 + 0.12 * mixed(number, number, 3)[:, None]
    return PointSample(position, normal, np.clip(255 * color + 0.5, 0, 255).astype(np.uint8))


def _tube(u: Doubles, v: Doubles) -> tuple[Doubles, Doubles]:
    """Positions and normals of a tube around a trefoil knot; u along it, v around it, 0..1."""
    t = 2 * np.pi * u
    way = 2 + np.cos(3 * t)
    center = np.stack([way * np.cos(2 * t), way * np.sin(2 * t), 1.2 * np.sin(3 * t)], axis=1)
    bend = -3 * np.sin(3 * t)
    ahead = np.stack(
        [
            bend * np.cos(2 * t) - 2 * way * np.sin(2 * t),
            bend * np.sin(2 * t) + 2 * way * np.cos(2 * t),
            3.6 * np.cos(3 * t),
        ],
        axis=1,
    )
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    out = np.stack([np.cos(2 * t), np.sin(2 * t), np.zeros_like(t)], axis=1)
    side = out - ahead * (out * ahead).sum(axis=1, keepdims=True)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(ahead, side)
    angle = 2 * np.pi * v[:, None]
    normal = np.cos(angle) * side + np.sin(angle) * up
    return center + 0.52 * normal, normal
