"""Volumes around the scene's origin, and the ball around what of them is visible."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Sphere
from resample.types import Doubles, Floats, View
from resample_volume.types import Volume

FARTHEST = 1e15  # scene units from the origin; its square, in px, is still a float32
ROW = 512  # places looked at together


class Placed(Protocol):
    """Role of what lies on a lattice."""

    @property
    def position(self) -> Floats:
        """(N, 3) scene units."""

    @property
    def lattice(self) -> Doubles:
        """(3, 3) columns are the steps to the neighbours, scene units."""


def sphere_around(voxels: Placed, volume: Volume) -> Sphere:
    """Ball around all visible voxels, or around the volume where none is visible.

    Raises
    ------
    ValueError
        It is larger than float32 can reckon with.
    """
    voxel = float(np.linalg.norm(voxels.lattice, axis=0).max())
    position = voxels.position
    if not position.size:
        last = np.array(volume.values.shape[::-1]) - 1
        ends = volume.origin + np.stack([last * 0, last]) @ voxels.lattice.T
        position = ends.astype(np.float32)
    low, high = _bounds(position)
    if not np.abs([low, high]).max() < FARTHEST:
        raise ValueError(
            f"the volume reaches from {low} to {high} scene units; {FARTHEST:g} is the most, so "
            "give another spacing"
        )
    center = (low + high) / 2
    away = position - center.astype(np.float32)
    farthest = float(np.sqrt(np.einsum("nd,nd->n", away, away).max()))
    return Sphere(center, farthest + voxel)


def _bounds(position: Floats) -> tuple[Doubles, Doubles]:
    """Least and greatest coordinates of places (N, 3); in two steps, as NumPy likes long rows."""
    whole = len(position) // ROW * ROW
    some = position[whole:]
    if whole:
        rows = position[:whole].reshape(-1, 3 * ROW)
        ends = [end.reshape(-1, 3) for end in (rows.min(axis=0), rows.max(axis=0))]
        some = np.concatenate([some, *ends])
    return some.min(axis=0).astype(np.float64), some.max(axis=0).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Shifted:
    """A camera in a scene whose origin was moved to `origin`, (3,) in the camera's own scene."""

    camera: AnyCamera
    origin: Doubles

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(translation=view.translation + view.rotation @ self.origin)


def centered(volume: Volume) -> tuple[Volume, Doubles]:
    """Volume around the scene's origin, and where its middle was, (3,) scene units.

    Far from the origin, float32 would not tell neighbouring voxels apart.
    """
    last = np.array(volume.values.shape[::-1]) - 1.0
    half = volume.direction @ (volume.spacing * last) / 2
    return volume._replace(origin=-half), volume.origin + half
