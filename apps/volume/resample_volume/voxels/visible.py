"""Classify voxels: apply the transfer function, leave transparent voxels out."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.passes import memoized
from resample.types import Doubles, Floats, Indices
from resample_volume.classification.transfer import (
    DataRange,
    Faded,
    Transfer,
    evaluated,
    extinction,
    visible_places,
)
from resample_volume.data import values as stored
from resample_volume.data.recordings import linear_colors
from resample_volume.types import Volume

if TYPE_CHECKING:
    from resample_volume.classification.labels import Labels

GRADIENTS = {"central": 0, "sobel": 1}  # voxels on each side over which slopes are smoothed
STEEP = 99  # percentile of the gradients' lengths that counts as a full surface

BYTES_PER_CANDIDATE = 60  # bytes of a voxel that may turn out to be transparent
BYTES_PER_VOXEL = 200  # bytes of a kept voxel, from here to the picture

ALL_REACHED = np.empty((0, 2), np.float32)  # no shadows
NO_SLOPE = np.empty((0, 3), np.float32)


class Voxels(NamedTuple):
    """The N voxels of a volume that are not transparent, in the order z, y, x."""

    position: Floats  # (N, 3) scene units
    color: Floats  # (N, 3) linear light, unlit
    extinction: Floats  # (N,) optical depth per scene unit, > 0
    gradient: Floats  # (N, 3) data units per scene unit, along the scene's axes; or (0, 3)
    lattice: Doubles  # (3, 3) columns are the steps from a voxel to its neighbours, scene units
    reached: Floats = ALL_REACHED  # (N, 2) fractions of light that reach them; see `transmittance`


def classify(
    volume: Volume, transfer: Transfer, *, gradient: str | None = "central",
    gradient_opacity: tuple[float, float] | None = None, labels: "Labels | None" = None,
) -> Voxels:  # fmt: skip
    """Apply a transfer function, and return the visible voxels.

    Values in a file are read in chunks. `gradient` is one of `GRADIENTS`: central differences, or
    these smoothed across (1-2-1) for noisy data; None if voxels will not be shaded. Missing and
    infinite values take no part. `gradient_opacity` multiplies opacity by a ramp between two
    gradient lengths, as fractions of their 99th percentile. Labels are applied last.
    """
    whole = transfer if gradient_opacity is None else Faded(transfer, gradient_opacity)
    if gradient is not None and gradient not in GRADIENTS:
        raise ValueError(f"unknown gradient {gradient!r}; known: {', '.join(GRADIENTS)}, None")
    if gradient is None and whole.needs_gradient:
        known = " or ".join(GRADIENTS)
        raise ValueError(f"regions or gradient_opacity: either needs a gradient; choose {known}")
    if labels is not None:
        labels.check(volume)
    data_range = finite_range(volume.values) if transfer.normalized else (0.0, 1.0)
    place, value, slope = visible_with_slopes(volume, whole, data_range, gradient)
    length = np.linalg.norm(slope, axis=1) if whole.needs_gradient else None
    steep, count = max_gradient(length), value.size
    color, opacity = np.empty((count, 3), np.float32), np.empty(count, np.float32)

    def look(share: slice) -> None:
        slopes = None if length is None else length[share]
        color[share], opacity[share] = whole.classify(value[share], slopes, data_range, steep)

    stored.side_by_side(look, count)
    if volume.colors is not None:
        color = linear_colors(volume.colors.reshape(-1, volume.colors.shape[-1])[place])
    if labels is not None:
        color, opacity = labels.applied(place, color, opacity)
    kept = np.flatnonzero(opacity > 0)
    what = f"{volume.name} with {kept.size} visible voxels"
    stored.require_memory(BYTES_PER_VOXEL * kept.size, what)
    if kept.size < place.size:
        place, color, opacity = place[kept], color[kept], opacity[kept]
        slope = slope if gradient is None else slope[kept]
    lattice = lattice_of(volume)
    unit = unit_of(transfer, volume)
    if whole.needs_gradient or labels is not None:
        thickness = extinction(opacity, unit)
    else:
        shown, thickness = value[kept], np.empty(kept.size, np.float32)

        def thick(values: NDArray[Any], data_range: DataRange) -> Floats:
            return extinction(whole.classify(values, None, data_range, 0.0)[1], unit)

        def find(share: slice) -> None:
            thickness[share] = evaluated(thick, shown[share], data_range)

        stored.side_by_side(find, shown.size)
    return Voxels(positions_at(volume, place), color, thickness, slope, lattice)


def max_gradient(length: Floats | None) -> float:
    """Return the gradient length of a full surface, of lengths (N,); 0 without any."""
    if length is None or not length.size:
        return 0.0
    return steep_of(length.size, lambda ranks: np.partition(length, ranks)[ranks].tolist())


def steep_of(count: int, lengths_at: Callable[[list[int]], list[float]]) -> float:
    """Return the length of a full surface, interpolated between two ranks of ascending lengths."""
    place = (count - 1) * STEEP / 100
    first = int(place)
    low, high = lengths_at([first, min(first + 1, count - 1)])
    return low if low == high else low + (place - first) * (high - low)


def unit_of(transfer: Transfer, volume: Volume) -> float:
    """Return the thickness that opacities refer to, scene units."""
    own = transfer.opacity_unit or volume.thickness
    return own or float(np.cbrt(abs(np.linalg.det(lattice_of(volume)))))


@memoized(lambda values: values)
def finite_range(values: stored.Stored) -> DataRange:
    """Return the least and greatest finite value; (0, 1) if none is finite."""
    low, high = stored.values_of(values).range()
    return (low, high) if low <= high else (0.0, 1.0)


def lattice_of(volume: Volume) -> Doubles:
    """Return the lattice matrix: its columns are the steps along x, y and z, scene units."""
    return np.ascontiguousarray(volume.direction * volume.spacing, np.float64)


def gradients_at(volume: Volume, voxel: Indices, gradient: str) -> Floats:
    """Return gradients (N, 3) of voxels by flat index, data units per scene unit."""
    from resample_volume.kernels.voxels import find_gradients

    to_scene = np.ascontiguousarray(np.linalg.inv(lattice_of(volume)).T)  # from slopes per voxel
    slope, is_smooth = np.empty((voxel.size, 3), np.float32), gradient == "sobel"
    for voxels, near, first in stored.kernel_layers(np.asarray(volume.values), voxel):
        place, found = voxel[voxels] - first if first else voxel[voxels], slope[voxels]

        def fill(share: slice, near: Any = near, place: Any = place, found: Any = found) -> None:
            find_gradients(near, place[share], to_scene, is_smooth, found[share])

        stored.side_by_side(fill, place.size)
    return slope


def positions_at(volume: Volume, voxel: Indices) -> Floats:
    """Return scene positions (N, 3) of voxels by flat index (N,), z slowest."""
    from resample_volume.kernels.voxels import place

    position = np.empty((voxel.size, 3), np.float32)
    origin = np.asarray(volume.origin, np.float64)
    lattice, shape = lattice_of(volume), volume.values.shape

    def find(share: slice) -> None:
        place(voxel[share], shape, lattice, origin, position[share])

    stored.side_by_side(find, voxel.size)
    return position


def visible_with_slopes(
    volume: Volume, transfer: Transfer, data_range: DataRange, gradient: str | None
) -> tuple[Indices, NDArray[Any], Floats]:
    """Return flat indices (N,), values (N,) and slopes (N, 3) of the visible voxels.

    They may be visible at some slope, and come in the order of the painter's bricks.
    """
    from resample_volume.kernels.voxels import brick_order

    volume = stored.as_array(volume)
    size = BYTES_PER_CANDIDATE if transfer.needs_gradient else BYTES_PER_VOXEL
    parts = []
    start = count = 0
    for chunk in stored.slabs(volume.values):
        value = chunk.reshape(-1)
        index = visible_places(transfer, value, data_range)
        parts.append((index + start, value[index]))
        start, count = start + value.size, count + index.size
        what = f"{volume.name} with {count} visible voxels"
        stored.require_beside(volume.values, size * count, what)
    place, found = map(np.concatenate, zip(*parts, strict=True))
    order = np.empty(place.size, np.int64)
    brick_order(place, volume.values.shape, order)
    place = place[order]
    slope = NO_SLOPE if gradient is None else gradients_at(volume, place, gradient)
    return place, found[order], slope
