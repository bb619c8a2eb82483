"""Volumes of other lattices brought onto the finest one, wherever in the scene they are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_volume.files.memory import require_memory
from resample_volume.media.recordings import linear_colors
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Step, as_array
from resample_volume.voxels.visible import finite_range, lattice_of

SAME = 1e-3  # voxels by which lattices may differ that are taken for one
HALF = 0.5 + SAME  # voxels around a voxel's place that it stands for
SLAB = 1 << 22  # voxels that are resampled together
BYTES_PER_RESAMPLED = 16  # of a voxel before and after it
EVEN = 1.01  # steps of the other lattice in voxels, up to which nothing is smoothed


class Lattice(NamedTuple):
    """A lattice as large as several volumes together."""

    steps: Doubles  # (3, 3) columns are the steps to the next place along x, y, z; scene units
    origin: Doubles  # (3,) scene position of the first place
    size: NDArray[np.int64]  # (3,) places along x, y, z

    @property
    def middle(self) -> Doubles:
        """Scene position (3,) of its middle."""
        return self.origin + self.steps @ (self.size - 1.0) / 2

    def volume(self) -> Volume:
        """Volume of zeros on it, which takes no memory."""
        spacing = np.linalg.norm(self.steps, axis=0)
        nothing = np.broadcast_to(np.uint8(0), tuple(self.size[::-1]))
        return Volume(nothing, spacing, self.origin, self.steps / spacing, "scene")


def common_lattice(volumes: Sequence[Volume]) -> Lattice:
    """Lattice of the finest of some volumes, extended to where all of them are.

    The finest has the smallest voxels. Between equals, the order of the volumes does not matter.
    """
    finest = min(volumes, key=_fineness)
    steps = lattice_of(finest)
    boxes = [_box(volume, steps, finest.origin) for volume in volumes]
    first = np.min([box[0] for box in boxes], axis=0)
    last = np.max([box[1] for box in boxes], axis=0)
    return Lattice(steps, finest.origin + steps @ first, last - first + 1)


def first_in(volume: Volume, lattice: Lattice) -> Step | None:
    """Place (z, y, x) of a lattice that the first voxel is at; None if voxels are beside them."""
    to_index = np.linalg.inv(lattice_of(volume))
    start = to_index @ (lattice.origin - volume.origin)
    if not _is_same(to_index @ lattice.steps, start, volume):
        return None
    x, y, z = (-int(n) for n in np.round(start))
    return z, y, x


def onto(volume: Volume, lattice: Lattice) -> Volume:
    """Volume resampled to the places of a lattice that lie in it.

    What has these places already is passed on as it is. Else values are those of a cubic spline
    through the voxels, kept within their range; along axes on which the lattice is coarser they
    are smoothed before. Where values are missing, what is left is interpolated linearly.

    Raises
    ------
    ValueError
        The result does not fit in memory.
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
    each = BYTES_PER_RESAMPLED * (1 if volume.colors is None else 4)
    require_memory(
        each * (int(size.prod()) + volume.values.size),
        f"{volume.name} on the finest lattice, {listed} voxels,",
    )
    values = _resampled(volume.values, matrix, start + matrix @ first, tuple(size[::-1]))
    colors = volume.colors
    if colors is not None:
        colors = _in_between(colors, matrix, start + matrix @ first, tuple(size[::-1]))
    spacing = np.linalg.norm(lattice.steps, axis=0)
    origin = lattice.origin + lattice.steps @ first
    return Volume(
        values, spacing, origin, lattice.steps / spacing, volume.name, volume.units, colors
    )


def _in_between(
    colors: NDArray[Any], matrix: Doubles, start: Doubles, shape: tuple[int, ...]
) -> Floats:
    """Linear colors (Z, Y, X, 3) at the places of `_resampled`, weighed by their opacities."""
    light, weight = linear_colors(colors), np.ones(1, np.float32)
    if colors.shape[-1] == 4:
        weight = _resampled(colors[..., 3], matrix, start, shape)
        light = light * colors[..., 3:].astype(np.float32)
    parts = [_resampled(light[..., c], matrix, start, shape) for c in range(3)]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.stack([part / weight for part in parts], axis=-1), posinf=0.0)


def _fineness(volume: Volume) -> tuple[float, ...]:
    """Sort key by which the finest volume is the first."""
    steps = lattice_of(volume)
    size = round(float(abs(np.linalg.det(steps))), 9)
    return (size, *steps.ravel(), *volume.origin, *volume.values.shape)


def _box(
    volume: Volume, steps: Doubles, origin: Doubles
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last place (3,) of another lattice that a volume reaches, half voxels included."""
    ends = np.array([[-0.5] * 3, np.array(volume.values.shape[::-1]) - 0.5])
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij")).reshape(3, 8)
    away = lattice_of(volume) @ corners + (volume.origin - origin)[:, np.newaxis]
    place = np.linalg.solve(steps, away)
    first = np.ceil(place.min(axis=1) - SAME).astype(np.int64)
    return first, np.maximum(first, np.floor(place.max(axis=1) + SAME).astype(np.int64))


def _is_same(matrix: Doubles, start: Doubles, volume: Volume) -> bool:
    """Whether a lattice's places, as indices into a volume, are its voxels."""
    reach = max(volume.values.shape)
    is_turned = np.abs(matrix - np.eye(3)).max() * reach > SAME
    return not is_turned and bool(np.abs(start - np.round(start)).max() <= SAME)


def _resampled(
    values: NDArray[Any], matrix: Doubles, start: Doubles, shape: tuple[int, ...]
) -> Floats:
    """Values (Z, Y, X) at places whose indices are `matrix` times theirs, from a start on."""
    from scipy.ndimage import spline_filter

    low, high = finite_range(values)
    given = np.asarray(values, np.float32)
    known = np.isfinite(given)
    widths = np.linalg.norm(matrix, axis=1)[::-1]
    if known.all():
        smooth = _smoothed(given, widths)
        sheet = spline_filter(smooth, 3, np.float32, mode="mirror")
        found = _read(sheet, matrix, start, shape, order=3)
        return np.clip(found, low, high, out=found)
    weight = _smoothed(known.astype(np.float32), widths)
    total = _read(_smoothed(np.where(known, given, 0), widths), matrix, start, shape, order=1)
    share = _read(weight, matrix, start, shape, order=1)
    with np.errstate(invalid="ignore"):
        return np.where(share >= 0.5, total / np.maximum(share, 0.5), np.float32(np.nan))


def _smoothed(values: Floats, widths: Doubles) -> Floats:
    """Values whose details are as coarse as steps of so many voxels along z, y and x."""
    from scipy.ndimage import gaussian_filter1d

    for axis, width in enumerate(widths):
        if width > EVEN:
            sigma = 0.5 * np.sqrt(width**2 - 1)
            values = gaussian_filter1d(values, sigma, axis, mode="mirror")
    return values


def _read(
    values: Floats, matrix: Doubles, start: Doubles, shape: tuple[int, ...], *, order: int
) -> Floats:
    """Values at the places of `_resampled`; NaN where there are no voxels."""
    from scipy.ndimage import affine_transform

    across = np.ascontiguousarray(matrix[::-1, ::-1])
    is_straight = not np.any(across - np.diag(np.diag(across)))
    steps = np.diag(across).copy() if is_straight else across
    found = np.empty(shape, np.float32)
    count = max(1, SLAB // max(1, shape[1] * shape[2]))
    for z in range(0, shape[0], count):
        part = found[z : z + count]
        begin = start[::-1] + across[:, 0] * z
        affine_transform(
            values, steps, begin, part.shape, part, order=order, mode="mirror", prefilter=False
        )
        if not is_straight:
            part[~_is_inside(values.shape, across, begin, part.shape)] = np.nan
    return found


def _is_inside(
    size: tuple[int, ...], across: Doubles, begin: Doubles, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Which places lie within half a voxel of a volume of that size."""
    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
    inside = np.ones(shape, bool)
    for axis in range(3):
        place = begin[axis] + across[axis, 0] * z + across[axis, 1] * y + across[axis, 2] * x
        inside &= (place >= -HALF) & (place <= size[axis] - 1 + HALF)
    return inside
