"""A lattice that covers several volumes: the finest one, extended."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.types import Volume
from resample_volume.voxels.visible import lattice_of

SAME = 1e-3  # voxels by which the ends of volumes may differ from places of the lattice


class CommonLattice(NamedTuple):
    """A lattice that covers several volumes."""

    steps: Doubles  # (3, 3) columns are the steps to the next place along x, y, z; scene units
    origin: Doubles  # (3,) scene position of the first place
    size: NDArray[np.int64]  # (3,) places along x, y, z

    @property
    def middle(self) -> Doubles:
        """Scene position (3,) of its center."""
        return self.origin + self.steps @ (self.size - 1.0) / 2

    def volume(self) -> Volume:
        """A volume of zeros on it, which takes no memory."""
        spacing = np.linalg.norm(self.steps, axis=0)
        nothing = np.broadcast_to(np.uint8(0), tuple(self.size[::-1]))
        return Volume(nothing, spacing, self.origin, self.steps / spacing, "scene")


def common_lattice(volumes: Sequence[Volume]) -> CommonLattice:
    """Return the lattice of the finest volume, extended to cover all.

    The finest has the smallest voxels. The result does not depend on the order of the volumes.
    """
    finest = min(volumes, key=_fineness)
    steps = lattice_of(finest)
    boxes = [_box(volume, steps, finest.origin) for volume in volumes]
    first = np.min([box[0] for box in boxes], axis=0)
    last = np.max([box[1] for box in boxes], axis=0)
    return CommonLattice(steps, finest.origin + steps @ first, last - first + 1)


def _fineness(volume: Volume) -> tuple[float, ...]:
    """Sort key that puts the finest volume first."""
    steps = lattice_of(volume)
    size = round(float(abs(np.linalg.det(steps))), 9)
    return (size, *steps.ravel(), *volume.origin, *volume.values.shape)


def _box(
    volume: Volume, steps: Doubles, origin: Doubles
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first and last index (3,) of a lattice that a volume covers, with half voxels."""
    ends = np.array([[-0.5] * 3, np.array(volume.values.shape[::-1]) - 0.5])
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij")).reshape(3, 8)
    away = lattice_of(volume) @ corners + (volume.origin - origin)[:, np.newaxis]
    place = np.linalg.solve(steps, away)
    first = np.ceil(place.min(axis=1) - SAME).astype(np.int64)
    return first, np.maximum(first, np.floor(place.max(axis=1) + SAME).astype(np.int64))
