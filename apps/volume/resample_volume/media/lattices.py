"""Resample volumes of different lattices onto the finest one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import is_in_file
from resample.outofcore.bricks import Step
from resample.types import Doubles
from resample_volume.data.memory import require_memory
from resample_volume.data.values import as_array
from resample_volume.media.resampling import in_between, resampled
from resample_volume.types import Volume
from resample_volume.voxels.visible import lattice_of

SAME = 1e-3  # voxels by which lattices may differ and still count as equal
BYTES_PER_RESAMPLED = 16  # bytes per voxel before and after resampling


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


def first_in(volume: Volume, lattice: CommonLattice) -> Step | None:
    """Return the index (z, y, x) of the first voxel in a lattice; None if voxels are off it."""
    to_index = np.linalg.inv(lattice_of(volume))
    start = to_index @ (lattice.origin - volume.origin)
    if not _is_same(to_index @ lattice.steps, start, volume):
        return None
    x, y, z = (-int(n) for n in np.round(start))
    return z, y, x


def onto(volume: Volume, lattice: CommonLattice) -> Volume:
    """Resample a volume to the part of a lattice that it covers.

    A volume that is on the lattice already is returned unchanged. Otherwise values are interpolated
    by a cubic spline and clamped to their range; along axes on which the lattice is coarser they
    are smoothed first. Next to missing values, interpolation is linear.
    """
    to_index = np.linalg.inv(lattice_of(volume))
    matrix = to_index @ lattice.steps
    start = to_index @ (lattice.origin - volume.origin)
    if _is_same(matrix, start, volume):
        return volume
    volume = as_array(volume)
    first, last = _box(volume, lattice.steps, lattice.origin)
    size = np.maximum(last - first + 1, 1)
    listed = " x ".join(map(str, size))
    if not is_in_file(volume.values):
        what = f"{volume.name} on the finest lattice, {listed} voxels,"
        require_memory(bytes_onto(volume, lattice), what)
    values = resampled(volume.values, matrix, start + matrix @ first, tuple(size[::-1]))
    colors = volume.colors
    if colors is not None:
        colors = in_between(colors, matrix, start + matrix @ first, tuple(size[::-1]))
    spacing = np.linalg.norm(lattice.steps, axis=0)
    origin = lattice.origin + lattice.steps @ first
    return Volume(
        values, spacing, origin, lattice.steps / spacing, volume.name, volume.units, colors
    )


def bytes_onto(volume: Volume, lattice: CommonLattice) -> int:
    """Return the bytes needed to resample a volume to a lattice."""
    first, last = _box(volume, lattice.steps, lattice.origin)
    count = int(np.maximum(last - first + 1, 1).prod()) + volume.values.size
    return BYTES_PER_RESAMPLED * (1 if volume.colors is None else 4) * count


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


def _is_same(matrix: Doubles, start: Doubles, volume: Volume) -> bool:
    """Return whether a lattice's points are voxels of a volume."""
    reach = max(volume.values.shape)
    is_turned = np.abs(matrix - np.eye(3)).max() * reach > SAME
    return not is_turned and bool(np.abs(start - np.round(start)).max() <= SAME)
