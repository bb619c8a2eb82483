"""Crop and clip a volume: planes of a box of voxels and planes given by normals."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, product
from math import prod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import MARGIN, Orbit, Sphere
from resample.memory import require_memory
from resample.memory.mapped import is_in_file
from resample.messages import parts_of
from resample.types import Doubles, Floats, Indices, View
from resample_volume.classification.transfer import Transfer, visible_places
from resample_volume.classification.value_statistics import ends, survey
from resample_volume.data.scanning import step_of
from resample_volume.data.values import SHARE, slabs, values_of
from resample_volume.types import Volume
from resample_volume.voxels.shading import along
from resample_volume.voxels.visible import Voxels, finite_range, lattice_of, positions_at

CUT = 3.0  # voxels that a cut is thick
STEEPER = 1e-3  # of the steepest gradient: above the threshold for homogeneous regions

CROP_FORM = "give ranges of voxels along x, y and z, such as 64:192,:,10:"
CLIP_FORM = "give a normal, perhaps with an offset from the center, such as 1,0,-1 or 1,0,-1,20"


def planes(
    volume: Volume, crop: str | None = None, clip: Sequence[str] = (), name: str = "clip"
) -> Doubles:
    """Return the planes (M, 4) that bound the shown part of a volume.

    A point p is kept where n·p + d >= 0 for all (n, d); |n| = 1. `crop` has ranges of voxels along
    x, y and z as in NumPy, `64:192,:,10:`; voxel i extends from i - 1/2 to i + 1/2. `clip` has
    normals n, perhaps with an offset: planes through the volume's center, shifted along n.
    """
    rows, parts = [], [] if crop is None else crop.split(",")
    if crop is not None and len(parts) != 3:
        raise ValueError(f"crop {crop!r}; {CROP_FORM}")
    to_index = np.linalg.inv(lattice_of(volume))
    for axis, part in enumerate(parts):
        size, where = volume.values.shape[2 - axis], f"crop {crop!r}, {'xyz'[axis]}"
        try:
            numbers = [int(word) if word.strip() else None for word in part.split(":")]
        except ValueError:
            numbers = []
        if len(numbers) == 1 and numbers[0] is not None:
            numbers.append(numbers[0] + 1 if numbers[0] != -1 else None)
        if len(numbers) != 2:
            raise ValueError(f"{where}: {part!r} is not a range; {CROP_FORM}")
        start, stop, _ = slice(*numbers).indices(size)
        if start >= stop:
            raise ValueError(f"{where}: {part!r} holds none of the {size} voxels")
        # The index, `row` times p - origin, is at least so much
        ends = ((to_index[axis], start - 0.5), (-to_index[axis], 0.5 - stop))
        for (row, least), is_cut in zip(ends, (start > 0, stop < size), strict=True):
            if is_cut:
                rows.append(np.append(row, -row @ volume.origin - least) / np.linalg.norm(row))
    rows += [_plane(volume, text, name) for text in clip]
    return np.array(rows, np.float64).reshape(-1, 4)


def inside(position: Floats, lattice: Doubles, planes: Doubles, radius: float) -> NDArray[np.bool_]:
    """Return whether kernels of voxels (N, 3) may extend into what planes keep, (N,)."""
    is_near = np.ones(len(position), bool)
    for plane in planes:
        normal = plane[:3]
        reach = radius * np.linalg.norm(normal @ lattice)  # of an ellipsoid along the normal
        is_near &= along(position, normal) + plane[3] > -reach
    return is_near


def keep(voxels: Voxels, planes: Doubles, radius: float = 2.0) -> Voxels:
    """Remove voxels that are wholly cut away; see `inside`."""
    if not len(planes):
        return voxels
    index = np.flatnonzero(inside(voxels.position, voxels.lattice, planes, radius))
    of_each = ((name, array) for name, array in voxels._asdict().items() if name != "lattice")
    return voxels._replace(**{name: array[index] for name, array in of_each if len(array)})


def faced(voxels: Voxels, planes: Doubles) -> Voxels:
    """Replace gradients near a cut by the cut's normal, keeping their lengths.

    A cut through homogeneous tissue meets only noise, so it is shaded as a plane (Weiskopf, Engel
    and Ertl, Interactive Clipping Techniques, 2003).
    """
    if not len(planes) or not len(voxels.gradient):
        return voxels
    normal = planes[:, :3]
    away = np.column_stack([along(voxels.position, one) for one in normal]).astype(np.float64)
    away += planes[:, 3]
    away /= np.linalg.norm(normal @ voxels.lattice, axis=1)
    near, nearest = np.flatnonzero(away.min(axis=1) < CUT), away.argmin(axis=1)
    length = np.linalg.norm(voxels.gradient, axis=1)
    # Homogeneous regions have no normal.
    least = np.float32(STEEPER) * length.max()
    gradient = voxels.gradient.copy()
    gradient[near] = normal[nearest[near]] * np.maximum(length[near], least)[:, np.newaxis]
    return voxels._replace(gradient=gradient)


def _plane(volume: Volume, text: str, name: str) -> Doubles:
    """Parse a plane through the volume's center, or shifted from it."""
    try:
        numbers = [float(part) for part in parts_of(text)]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 4) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} {text!r}; {CLIP_FORM}")
    largest = max(map(abs, numbers[:3]))
    if not largest:
        raise ValueError(f"{name} {text!r}: the normal must not be 0,0,0; {CLIP_FORM}")
    normal = np.array(numbers[:3]) / largest
    normal /= np.linalg.norm(normal)
    last = np.array(volume.values.shape[::-1]) - 1.0
    middle = volume.origin + lattice_of(volume) @ last / 2
    offset = numbers[3] if len(numbers) == 4 else 0.0
    return np.append(normal, -normal @ middle - offset)


FARTHEST = 1e15  # scene units from the origin; its square, in px, is still a float32
BYTES_PER_PLACE = 32  # bytes per voxel, until the bounding sphere is found
ROW = 512  # points processed together

SOME = 64  # stride of the sample that tests first whether there can be outliers
FEW, STRAY_SHARE = 4, 1e-4  # fraction of visible voxels that may be outliers at one end of an axis
STRAY_GAP, STRAY_VOXELS = 0.05, 3.0  # of outliers from others: fraction of the extent, and voxels
FLESH = -200.0  # HU, from which on voxels are a body's
REACH = 2.0  # voxels by which kernels extend beyond the outermost voxels
BINS = 4096  # along an axis


# What a camera frames of a volume: the largest connected parts.
CELLS = 64  # along the longest axis, in which connections are looked for
LEAST_PART, MOST_LEFT_OUT = 0.005, 0.02  # of the largest part; of the visible part
BODY_CELLS = 48  # along the shortest side of a CT scan, at least, in which bodies are looked for
THIN, LEAST_BODY = 5.0, 0.05  # mm off a body's surface; smallest body, of the largest

Parts = Callable[[], Iterable[Floats]]  # positions (N, 3) of some voxels after others, each time


class FramedVoxels(NamedTuple):
    """Voxels that a camera frames; of a volume in a file they are found anew each time."""

    parts: Parts  # scene units
    lattice: Doubles  # (3, 3) columns are the steps to the neighbours, scene units


# Cells (Z, Y, X) with the visible voxels that count for a camera, and voxels along their sides.
Counting = tuple[NDArray[np.bool_], int]


def shown_by(
    volume: Volume, transfer: Transfer, planes: Doubles, radius: float, iso: float | None = None
) -> FramedVoxels:
    """Return the voxels that are visible when composited, under any projection."""
    data_range = finite_range(volume.values) if transfer.normalized else (0.0, 1.0)
    lattice = lattice_of(volume)
    shape = volume.values.shape

    def indices() -> Iterator[Indices]:
        start = 0
        for slab in slabs(volume.values, SHARE):
            value = slab.reshape(-1)
            seen = visible_places(transfer, value, data_range)
            if iso is not None:
                seen = np.union1d(seen, np.flatnonzero(value >= iso))
            yield start + seen
            start += value.size

    kept: Callable[[], Iterable[Indices]] = indices
    if not is_in_file(volume.values):
        found, count = [], 0
        for seen in indices():
            found.append(seen)
            count += seen.size
            require_memory(
                BYTES_PER_PLACE * count,
                f"a camera around the {count} or more visible voxels of {volume.name}",
                "fit it to the whole volume (--fit volume), or show less of it",
            )
        kept = partial(iter, (np.concatenate(found),))
    counting = None if len(planes) else _body(volume) or _main_parts(kept(), shape)

    def placed() -> Iterator[Floats]:
        for place in kept():
            if counting is not None:
                cells, side = counting
                place = place[cells.reshape(-1)[_cells_at(place, shape, side)]]  # noqa: PLW2901
            position = positions_at(volume, place)
            yield position[inside(position, lattice, planes, radius)] if len(planes) else position

    if is_in_file(volume.values):
        return FramedVoxels(placed, lattice)
    return FramedVoxels(partial(iter, tuple(placed())), lattice)


def _cells_at(place: Indices, shape: tuple[int, ...], side: int) -> Indices:
    """Return flat indices of the cells that hold voxels, by flat indices of these."""
    (depth, height, width), down, across = shape, -(-shape[1] // side), -(-shape[2] // side)
    row = np.arange(depth)[:, None] // side * down + np.arange(height) // side
    first, column = (row * across).reshape(-1), np.arange(width) // side
    line = place // width
    found: Indices = first[line] + column[place - line * width]
    return found


def _body(volume: Volume) -> Counting | None:
    """Return the bodies in a CT scan that are more than `THIN` thick, or None."""
    known = survey(volume)
    if known.units.added is None:
        return None
    from scipy.ndimage import label, maximum_filter, minimum_filter

    some, step = values_of(volume.values).sample(), step_of(volume.values.size)
    coarser = max(1, min(some.shape) // BODY_CELLS)
    some, step = some[(slice(None, None, coarser),) * 3], step * coarser
    worn = np.ceil(THIN / (volume.spacing[::-1] * step)).astype(np.int64)
    thick = minimum_filter(some > FLESH + known.units.added, tuple(2 * worn + 1), mode="nearest")
    part, count = label(thick, np.ones((3, 3, 3)))
    if not count:
        return None
    sizes = np.bincount(part.ravel())
    sizes[0] = 0
    bodies = (sizes >= LEAST_BODY * sizes.max())[part]
    return maximum_filter(bodies, tuple(2 * worn + 3)), step


def _main_parts(indices: Iterable[Indices], shape: tuple[int, ...]) -> Counting | None:
    """Return the large visible parts; None if small ones are too many to be left out."""
    from resample.engine.rays.coefficients import number_parts

    side = -(-max(shape) // CELLS)
    cells = tuple(-(-size // side) for size in shape)
    number = np.zeros(prod(cells), np.int64)
    for place in indices:
        number += np.bincount(_cells_at(place, shape, side), minlength=number.size)
    part = -(number.reshape(cells) > 0).astype(np.int64)
    number_parts(part)
    sizes = np.bincount(part.ravel(), number)
    is_small = sizes < LEAST_PART * sizes[1:].max(initial=0)
    is_small[0] = False
    if not 0 < sizes[is_small].sum() <= MOST_LEFT_OUT * sizes.sum():
        return None
    return ~is_small[part], side


def corners(volume: Volume) -> Doubles:
    """Return the corners (8, 3) of a volume's box, scene units; x changes slowest."""
    index = np.array(list(product(*((-0.5, count - 0.5) for count in volume.values.shape[::-1]))))
    return np.asarray(volume.origin + index @ lattice_of(volume).T)


def bounding_sphere(volume: Volume) -> Sphere:
    """Return the bounding sphere of all voxels, visible or not."""
    corner = corners(volume)
    center = corner.mean(axis=0)
    return Sphere(center, float(np.linalg.norm(corner - center, axis=1).max()))


def sphere_around(voxels: Voxels | FramedVoxels, volume: Volume) -> Sphere:
    """Return the bounding sphere of the visible voxels without outliers, or of the volume."""
    voxel = float(np.linalg.norm(voxels.lattice, axis=0).max())
    parts = voxels.parts if isinstance(voxels, FramedVoxels) else partial(iter, (voxels.position,))
    count, low, high = _extent(parts)
    if not count:
        last = np.array(volume.values.shape[::-1]) - 1
        box = volume.origin + np.stack([last * 0, last]) @ voxels.lattice.T
        parts = partial(iter, (box.astype(np.float32),))
        count, low, high = _extent(parts)
    shown = _without_strays(parts, voxel, (count, low, high))
    if shown is not parts:
        _, low, high = _extent(shown)
    if not np.abs([low, high]).max() < FARTHEST:
        raise ValueError(
            f"the volume extends from {low} to {high} scene units; {FARTHEST:g} is the limit, so "
            "give another spacing"
        )
    center = (low + high) / 2
    farthest = 0.0
    for position in shown():
        away = position - center.astype(np.float32)
        square = np.einsum("nd,nd->n", away, away).max(initial=np.float32(0.0))
        farthest = max(farthest, float(np.sqrt(square)))
    return Sphere(center, farthest + REACH * voxel)


NO_CORNERS = np.zeros((0, 3))


def around_both(ball: Sphere, corner: Doubles) -> Sphere:
    """Enlarge a sphere to contain points (N, 3); unchanged if it contains them."""
    if not corner.size or np.linalg.norm(corner - ball.center, axis=1).max() <= ball.radius:
        return ball
    low = np.minimum(corner.min(axis=0), ball.center - ball.radius)
    high = np.maximum(corner.max(axis=0), ball.center + ball.radius)
    center = (low + high) / 2
    away = float(np.linalg.norm(corner - center, axis=1).max())
    return Sphere(center, max(away, float(np.linalg.norm(ball.center - center)) + ball.radius))


def filling(
    orbit: Orbit, sphere: Sphere, shown: Voxels | FramedVoxels, size: tuple[int, int],
    corner: Doubles = NO_CORNERS, around: float = 0.0,
) -> Orbit:  # fmt: skip
    """Zoom and pan an orbit so that everything visible fills the picture (height, width).

    Vertices of meshes, `corner` (N, 3), are framed, too. `around` is the fraction of the sphere's
    radius that is left free on each side.
    """
    voxel = float(np.linalg.norm(shown.lattice, axis=0).max())
    parts = shown.parts if isinstance(shown, FramedVoxels) else partial(iter, (shown.position,))
    kept = _without_strays(parts, voxel)
    view = replace(orbit, zoom=1.0, pan=(0.0, 0.0)).around(sphere, *size).view()

    def offsets() -> Iterator[Floats]:
        """Yield offsets to the right, below and ahead of the sphere's center."""
        for position in chain(kept(), (corner.astype(np.float32),)):
            away = position - sphere.center.astype(np.float32)
            yield away @ view.rotation.T.astype(np.float32)

    count, low, high = _extent(offsets)
    if not count:
        return orbit
    # The radius of kernels.
    reach = max(REACH * voxel, around * sphere.radius)
    distance = float((view.rotation @ sphere.center + view.translation)[2])
    half = np.maximum(np.array(size[::-1]) / 2 - MARGIN, 0.25 * min(size))
    shorter = min(size)
    if not view.perspective:
        focal = float(view.focal[0])
        zoom = float(np.min(2 * half / (high - low + 2 * reach)[:2] / focal))
        shift = (low + high)[:2] / 2 * focal * zoom / shorter
    else:
        slope = half / view.focal  # of the rays at the picture's sides
        ends = np.full((2, 2), -np.inf)
        for place in offsets():
            along = place[:, 2] - reach
            for axis in range(2):
                for n, sign in enumerate((1, -1)):
                    away = (sign * place[:, axis] + reach) / slope[axis]
                    ends[axis, n] = (away - along).max(initial=ends[axis, n])
        nearest = float(ends.mean(axis=1).max())
        zoom = distance / nearest
        shift = (ends[:, 0] - ends[:, 1]) / 2 * slope * view.focal / nearest / shorter
    pan = (orbit.pan[0] - float(shift[0]) * orbit.zoom, orbit.pan[1] + float(shift[1]) * orbit.zoom)
    return replace(orbit, zoom=zoom * orbit.zoom, pan=pan)


def _extent(parts: Parts) -> tuple[int, Doubles, Doubles]:
    """Return the number of points, and their least and greatest coordinates (3,)."""
    count, low, high = 0, np.full(3, np.inf), np.full(3, -np.inf)
    for position in parts():
        if len(position):
            count += len(position)
            least, greatest = bounds(position)
            low, high = np.minimum(low, least), np.maximum(high, greatest)
    return count, low, high


def _without_strays(
    parts: Parts, voxel: float, known: tuple[int, Doubles, Doubles] | None = None
) -> Parts:
    """Remove the few outliers of points far from all others along an axis."""
    total, low, high = known or _extent(parts)
    # At one end of an axis so many may be outliers.
    most, extent = max(min(FEW, total // 500), int(STRAY_SHARE * total)), high - low
    if not most or not np.isfinite(extent).all():
        return parts
    # Are there, in a sample, too many voxels near all six sides for outliers?
    near, first = np.zeros((2, 3), np.int64), SOME // 2
    for position in parts():
        some = position[first::SOME]
        near[0] += (some <= low + STRAY_GAP * extent).sum(axis=0)
        near[1] += (some >= low + (1 - STRAY_GAP) * extent).sum(axis=0)
        first = (first - len(position)) % SOME
    if near.min() > 2 + 2 * most // SOME:
        return parts
    axes = np.flatnonzero(extent > 0).tolist()
    count = np.zeros((3, BINS), np.int64)
    for position in parts():
        for axis in axes:
            code = _codes(position, low, extent, axis)
            count[axis] += np.bincount(code, minlength=BINS)
    codes = {}  # first and last bin without outliers
    for axis in axes:
        full, size = np.flatnonzero(count[axis]), float(extent[axis])
        gap = max(STRAY_GAP, STRAY_VOXELS * voxel / size)
        place = (full + 0.5) * np.float64(size / BINS)
        first, last = ends(place, count[axis][full], most, gap)
        codes[axis] = int(full[first]), int(full[last])
    if all(count[axis, a : b + 1].sum() == total for axis, (a, b) in codes.items()):
        return parts

    def kept() -> Iterator[Floats]:
        for position in parts():
            is_kept = np.ones(len(position), bool)
            for axis, (first, last) in codes.items():
                code = _codes(position, low, extent, axis)
                is_kept &= (code >= first) & (code <= last)
            yield position[is_kept]

    return kept


def _codes(position: Floats, low: Doubles, extent: Doubles, axis: int) -> NDArray[np.int64]:
    """Return bins (N,) of points (N, 3) along an axis, from the least to the greatest."""
    along = position[:, axis] - np.float32(low[axis])
    return np.minimum((along * np.float32(BINS / extent[axis])).astype(np.int64), BINS - 1)


def bounds(position: Floats) -> tuple[Doubles, Doubles]:
    """Return least and greatest coordinates of points (N, 3); two steps, for speed in NumPy."""
    whole = len(position) // ROW * ROW
    some = position[whole:]
    if whole:
        rows = position[:whole].reshape(-1, 3 * ROW)
        ends = [end.reshape(-1, 3) for end in (rows.min(axis=0), rows.max(axis=0))]
        some = np.concatenate([some, *ends])
    return some.min(axis=0).astype(np.float64), some.max(axis=0).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Shifted:
    """A camera for a scene moved so that `origin`, (3,) in the camera's scene, is its origin."""

    camera: AnyCamera
    origin: Doubles

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(translation=view.translation + view.rotation @ self.origin)


def centered(volume: Volume) -> tuple[Volume, Doubles]:
    """Center a volume at the scene's origin, for float32; also return its former center (3,)."""
    last = np.array(volume.values.shape[::-1]) - 1.0
    half = volume.direction @ (volume.spacing * last) / 2
    return volume._replace(origin=-half), volume.origin + half
