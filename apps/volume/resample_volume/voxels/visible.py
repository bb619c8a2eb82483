"""Which voxels are seen: the transfer function applied, the transparent ones left out."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_volume.data.bricks import Bricks, Values
from resample_volume.data.keeping import found_once
from resample_volume.data.memory import require_memory
from resample_volume.data.parts import side_by_side, slabs
from resample_volume.data.recordings import linear_colors
from resample_volume.looks.regions import Faded
from resample_volume.looks.transfer import (
    DataRange,
    Looks,
    Transfer,
    evaluated,
    extinction,
    places_seen,
)
from resample_volume.types import Volume
from resample_volume.voxels.streaming import (
    Candidates,
    Looked,
    seen_in_bricks,
    slopes_at,
)

if TYPE_CHECKING:
    from resample_volume.looks.labels import Labels

GRADIENTS = {"central": 0, "sobel": 1}  # voxels to either side over which slopes are smoothed
STEEP = 99  # percentile of the gradients' lengths that counts as a full surface

BYTES_PER_CANDIDATE = 60  # of a voxel that may turn out to be transparent
BYTES_PER_VOXEL = 200  # of a kept voxel, from here to the picture

ALL_REACHED = np.empty((0, 2), np.float32)  # nothing is in the way of light

Indices = NDArray[np.int64]
NO_SLOPE = np.empty((0, 3), np.float32)


class Voxels(NamedTuple):
    """The N voxels of a volume that are not transparent, in the order z, y, x."""

    position: Floats  # (N, 3) scene units
    color: Floats  # (N, 3) linear light, unlit
    extinction: Floats  # (N,) optical depth per scene unit, > 0
    gradient: Floats  # (N, 3) data units per scene unit, along the scene's axes; or (0, 3)
    lattice: Doubles  # (3, 3) columns are the steps from a voxel to its neighbours, scene units
    reached: Floats = ALL_REACHED  # (N, 2) shares of light that gets there; see `reaching`

    @property
    def parts(self) -> tuple["Voxels", ...]:
        """Those of each volume, of which there is one; as of `Mixed`."""
        return (self,)


def classify(
    volume: Volume,
    transfer: Transfer,
    *,
    gradient: str | None = "central",
    gradient_opacity: tuple[float, float] | None = None,
    labels: "Labels | None" = None,
) -> Voxels:
    """Voxels that the transfer function lets be seen.

    Parameters
    ----------
    volume
        Any of its types, also mapped from a file: it is read in chunks and not copied.
    transfer
        Gives colors and opacities. Where it makes all transparent, no voxel is returned.
    gradient
        One of `GRADIENTS`: differences of neighbours, or the same smoothed across (1-2-1) for
        noisy data; None for none, when voxels will not be lit. Values that are missing or infinite
        take no part.
    gradient_opacity
        Opacity is multiplied by a ramp that rises from 0 to 1 between these two lengths of the
        gradient, as fractions of their 99th percentile; so surfaces stay and even regions vanish.
    labels
        What is changed for voxels of some labels, after all of the above.

    Raises
    ------
    ValueError
        The gradient is unknown or missing, the ramp descends, the labels are of another shape, or
        the voxels do not fit in memory.
    """
    whole = transfer if gradient_opacity is None else Faded(transfer, gradient_opacity)
    check_gradient(whole, gradient)
    if labels is not None:
        labels.check(volume)
    data_range = finite_range(volume.values) if transfer.normalized else (0.0, 1.0)
    seen = seen_with_slopes(volume, whole, data_range, gradient)
    slope = seen.slope
    length = np.linalg.norm(slope, axis=1) if whole.needs_gradient else None
    color, opacity = looks_of(whole, seen.value, length, data_range, steepness(length))
    if volume.colors is not None:
        color = linear_colors(volume.colors.reshape(-1, volume.colors.shape[-1])[seen.place])
    if labels is not None:
        color, opacity = labels.applied(seen.place, color, opacity)
    place, kept = seen.place, np.flatnonzero(opacity > 0)
    if not isinstance(volume.values, Bricks):
        what = f"{volume.name} with {kept.size} visible voxels"
        require_memory(BYTES_PER_VOXEL * kept.size, what)
    if kept.size < place.size:
        place, color, opacity = place[kept], color[kept], opacity[kept]
        slope = slope if gradient is None else slope[kept]
    lattice = lattice_of(volume)
    unit = unit_of(transfer, volume)
    if whole.needs_gradient or labels is not None:
        thickness = extinction(opacity, unit)
    else:
        value = seen.value if kept.size == seen.value.size else seen.value[kept]
        thickness = extinctions_of(whole, value, data_range, unit)
    return Voxels(positions_at(volume, place), color, thickness, slope, lattice)


def extinctions_of(
    transfer: Transfer, value: NDArray[Any], data_range: DataRange, unit: float
) -> Floats:
    """Optical depths (N,) per scene unit of values, whose slopes make no difference."""

    def thickness(values: NDArray[Any], data_range: DataRange) -> Floats:
        return extinction(transfer.looks(values, None, data_range, 0.0)[1], unit)

    found = np.empty(value.size, np.float32)

    def find(share: slice) -> None:
        found[share] = evaluated(thickness, value[share], data_range)

    side_by_side(find, value.size)
    return found


def looks_of(
    transfer: Transfer,
    value: NDArray[Any],
    length: Floats | None,
    data_range: DataRange,
    steep: float,
) -> tuple[Floats, Floats]:
    """Colors (N, 3) and opacities (N,) of values and lengths of gradients; see `Transfer`."""
    color, opacity = np.empty((value.size, 3), np.float32), np.empty(value.size, np.float32)

    def find(share: slice) -> None:
        slopes = None if length is None else length[share]
        color[share], opacity[share] = transfer.looks(value[share], slopes, data_range, steep)

    side_by_side(find, value.size)
    return color, opacity


def steepness(length: Floats | None) -> float:
    """Length of the gradient of a full surface.

    Parameters
    ----------
    length
        (N,) data units per scene unit, of the voxels whose value the transfer function can show.
        Without any it is 0.
    """
    if length is None or not length.size:
        return 0.0
    first, share = steep_rank(length.size)
    last = min(first + 1, length.size - 1)
    ordered = np.partition(length, [first, last])
    return steep_between(float(ordered[first]), float(ordered[last]), share)


def steep_rank(count: int) -> tuple[int, float]:
    """Of so many ascending lengths, after which a full surface's is, and how far on to the next."""
    place = (count - 1) * STEEP / 100
    return int(place), place - int(place)


def steep_between(low: float, high: float, share: float) -> float:
    """Length of a full surface, a share of the way between two."""
    return low if low == high else low + share * (high - low)


def unit_of(transfer: Transfer, volume: Volume) -> float:
    """Thickness that opacities hold for, scene units."""
    own = transfer.opacity_unit or volume.thickness
    return own or float(np.cbrt(abs(np.linalg.det(lattice_of(volume)))))


@found_once(lambda values: values)
def finite_range(values: Values) -> DataRange:
    """Least and greatest value that is neither NaN nor infinite; (0, 1) where there is none."""
    if isinstance(values, Bricks):
        least, greatest = values.ends
        low, high = float(least.min()), float(greatest.max())
        return (low, high) if low <= high else (0.0, 1.0)
    low, high = np.inf, -np.inf
    for chunk in slabs(values):
        finite = chunk if values.dtype.kind in "iu" else chunk[np.isfinite(chunk)]
        if finite.size:
            low, high = min(low, float(finite.min())), max(high, float(finite.max()))
    return (low, high) if low <= high else (0.0, 1.0)


def lattice_of(volume: Volume) -> Doubles:
    """Matrix whose columns are the steps to the next voxel along x, y and z, scene units."""
    return np.ascontiguousarray(volume.direction * volume.spacing, np.float64)


def gradients_at(volume: Volume, voxel: Indices, gradient: str) -> Floats:
    """Gradients (N, 3) of voxels, data units per scene unit, along the scene's axes.

    Parameters
    ----------
    volume
        Whose values.
    voxel
        (N,) indices into the flat volume, z slowest, in the order of it or of the painter's bricks.
    gradient
        One of `GRADIENTS`; see `classify`.
    """
    return slopes_at(np.asarray(volume.values), voxel, gradient, to_scene_of(volume))


def to_scene_of(volume: Volume) -> Doubles:
    """Matrix (3, 3) that takes slopes per voxel to slopes per scene unit."""
    return np.ascontiguousarray(np.linalg.inv(lattice_of(volume)).T)


def positions_at(volume: Volume, voxel: Indices) -> Floats:
    """Scene positions (N, 3) of voxels that are given by their flat index (N,), z slowest."""
    from resample_volume.data.kernels.gradients import place

    position = np.empty((voxel.size, 3), np.float32)
    origin = np.asarray(volume.origin, np.float64)
    lattice, shape = lattice_of(volume), volume.values.shape

    def find(share: slice) -> None:
        place(voxel[share], shape, lattice, origin, position[share])

    side_by_side(find, voxel.size)
    return position


def reachable(volume: Volume, looks: Looks, radius: float = 2.0) -> Indices:
    """Voxels without which a reconstructed field would look different, flat indices (N,).

    The value at a point is a mean of those around it or, where the volume ends, lies between that
    and `looks.low`; so it can be seen only if one of them is beyond all that is transparent from
    `looks.low` on. Who shares a point with such a voxel is less than two radii away from it. All
    others can be left out: points that they have part in are transparent with and without them.

    Parameters
    ----------
    volume
        Any of its types. Voxels that are missing or infinite are left out.
    looks
        What is between its columns is interpolated; what is seen under some slope is seen.
    radius
        Distance from which on kernels are zero, voxels; and, where values are means over a length
        such as a ray's way through a slab, half that length more.
    """
    is_known = np.empty(volume.values.shape, bool)
    is_beyond = np.empty(volume.values.shape, np.uint8)
    limit = _transparent_up_to(looks)
    start = 0
    for chunk in slabs(volume.values):
        part = slice(start, start + len(chunk))
        is_known[part] = np.isfinite(chunk)
        is_beyond[part] = is_known[part] & (chunk > limit)
        start += len(chunk)
    return np.flatnonzero(is_known & (_nearer(is_beyond, 2 * radius) > 0))


def _transparent_up_to(looks: Looks) -> np.float64:
    """Greatest value up to which all is transparent, from the lowest on."""
    seen = np.flatnonzero(looks.table[..., 3].max(axis=0) > 0)
    if not seen.size:
        return np.float64(np.inf)
    if not seen[0]:
        return np.float64(-np.inf)
    step = (looks.high - looks.low) / (looks.table.shape[1] - 1)
    return np.float64(looks.low + step * (seen[0] - 1))


def _nearer(marked: NDArray[np.uint8], distance: float) -> NDArray[np.uint8]:
    """1 for all voxels (Z, Y, X) that are nearer than a distance, voxels, to one that is marked."""
    import cv2

    reach = int(np.ceil(distance)) - 1
    place = np.arange(-reach, reach + 1.0)
    ball = place**2 + place[:, np.newaxis] ** 2 + place[:, np.newaxis, np.newaxis] ** 2
    ball = (ball < distance**2).astype(np.uint8)
    near = np.zeros_like(marked)
    for z in np.flatnonzero(marked.any(axis=(1, 2))):
        for away in range(reach + 1):
            spread = cv2.dilate(marked[z], ball[reach + away])
            for target in {z - away, z + away}:
                if 0 <= target < len(near):
                    np.maximum(near[target], spread, out=near[target])
    return near


def check_gradient(transfer: Transfer, gradient: str | None) -> None:
    """Refuse gradients that are unknown, or missing where a look needs them."""
    if gradient is not None and gradient not in GRADIENTS:
        raise ValueError(f"unknown gradient {gradient!r}; known: {', '.join(GRADIENTS)}, None")
    if gradient is None and transfer.needs_gradient:
        known = " or ".join(GRADIENTS)
        raise ValueError(f"regions or gradient_opacity: either needs a gradient; choose {known}")


def seen_with_slopes(
    volume: Volume, transfer: Transfer, data_range: DataRange, gradient: str | None
) -> Candidates:
    """Voxels whose value has some opacity, with neighbours close to each other.

    Parameters and errors as of `classify`, values in the order of the painter's bricks.
    """
    values: Values = volume.values
    if isinstance(values, Bricks):
        wanted = Looked(transfer, data_range, gradient, to_scene_of(volume))
        return seen_in_bricks(values, wanted, volume.name)
    seen = _in_bricks(_seen(volume, transfer, data_range), volume)
    if gradient is None:
        return seen
    return seen._replace(slope=gradients_at(volume, seen.place, gradient))


def _in_bricks(seen: Candidates, volume: Volume) -> Candidates:
    """Voxels with neighbours close to each other, which painters are quicker with."""
    from resample_volume.data.kernels.gradients import brick_order

    order = np.empty(seen.place.size, np.int64)
    brick_order(seen.place, volume.values.shape, order)
    return Candidates(seen.place[order], seen.value[order], NO_SLOPE)


def _seen(volume: Volume, transfer: Transfer, data_range: DataRange) -> Candidates:
    """Voxels whose value has some opacity, whatever the slope."""
    size = BYTES_PER_CANDIDATE if transfer.needs_gradient else BYTES_PER_VOXEL
    parts = []
    start = count = 0
    for chunk in slabs(volume.values):
        value = chunk.reshape(-1)
        index = places_seen(transfer, value, data_range)
        parts.append((index + start, value[index]))
        start, count = start + value.size, count + index.size
        require_memory(size * count, f"{volume.name} with {count} visible voxels")
    place, found = map(np.concatenate, zip(*parts, strict=True))
    return Candidates(place, found, NO_SLOPE)
