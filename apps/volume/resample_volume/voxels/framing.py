"""Volumes around the scene's origin, and the ball around what of them is visible."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import MARGIN, Orbit, Sphere
from resample.memory import require_memory
from resample.types import Doubles, Floats, View
from resample_volume.data.parts import slabs
from resample_volume.looks.surveys import ends
from resample_volume.looks.transfer import Transfer, places_seen
from resample_volume.types import Volume
from resample_volume.voxels.cropping import inside
from resample_volume.voxels.visible import finite_range, lattice_of, positions_at

FARTHEST = 1e15  # scene units from the origin; its square, in px, is still a float32
BYTES_PER_PLACE = 32  # of a voxel, until a ball around all is found
ROW = 512  # places looked at together

SOME = 64  # one of so many voxels is asked first whether there can be strays
FEW, STRAY_SHARE = 4, 1e-4  # visible voxels that may be strays at one end of an axis
STRAY_GAP, STRAY_VOXELS = 0.05, 3.0  # of the extent, and voxels: so far are they from the others
REACH = 2.0  # voxels, beyond the outermost, that what kernels make of them is seen
BINS = 4096  # along an axis


class Placed(Protocol):
    """Role of what lies on a lattice."""

    @property
    def position(self) -> Floats:
        """(N, 3) scene units."""

    @property
    def lattice(self) -> Doubles:
        """(3, 3) columns are the steps to the neighbours, scene units."""


class Shown(NamedTuple):
    """Voxels that a camera looks at."""

    position: Floats  # (N, 3) scene units
    lattice: Doubles  # (3, 3) columns are the steps to the neighbours, scene units


def shown_by(
    volume: Volume, transfer: Transfer, planes: Doubles, radius: float, iso: float | None = None
) -> Shown:
    """Voxels that are seen when they are composited, whatever is made of them.

    Parameters
    ----------
    volume
        Whose voxels.
    transfer
        Gives them an opacity.
    planes
        (M, 4) which cut some of them away, as from `cropping.planes`.
    radius
        Of the kernels around voxels, voxels.
    iso
        What is at or above this value is seen, too.

    Raises
    ------
    ValueError
        They are more than fit in memory.
    """
    data_range = finite_range(volume.values) if transfer.normalized else (0.0, 1.0)
    places, start, count = [], 0, 0
    for slab in slabs(volume.values):
        value = slab.reshape(-1)
        seen = places_seen(transfer, value, data_range)
        if iso is not None:
            seen = np.union1d(seen, np.flatnonzero(value >= iso))
        places.append(start + seen)
        start, count = start + value.size, count + seen.size
        require_memory(
            BYTES_PER_PLACE * count,
            f"{volume.name}, around whose visible voxels, {count} or more, a camera is to stand,",
            "place it around the whole (--fit volume), or show less of it",
        )
    shown = Shown(positions_at(volume, np.concatenate(places)), lattice_of(volume))
    if not len(planes):
        return shown
    kept = inside(shown.position, shown.lattice, planes, radius)
    return shown._replace(position=shown.position[kept])


def corners(volume: Volume) -> Doubles:
    """Corners (8, 3) of the box around a volume's voxels, scene units; x changes slowest."""
    ends = np.stack([np.full(3, -0.5), np.array(volume.values.shape[::-1]) - 0.5])
    index = np.array(
        [[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in product((0, 1), repeat=3)]
    )
    return np.asarray(volume.origin + index @ lattice_of(volume).T)


def ball_around(volume: Volume) -> Sphere:
    """Ball around a volume's voxels, whatever is seen of them."""
    corner = corners(volume)
    center = corner.mean(axis=0)
    return Sphere(center, float(np.linalg.norm(corner - center, axis=1).max()))


def sphere_around(voxels: Placed, volume: Volume) -> Sphere:
    """Ball around all visible voxels, or around the volume where none is visible.

    A few that are far away from all others do not count: they would make these small.

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
    position = _without_strays(position, voxel)
    return sphere_of(*bounds(position), voxel, partial(farthest_from, position))


def sphere_of(
    low: Doubles, high: Doubles, voxel: float, farthest: Callable[[Doubles], float]
) -> Sphere:
    """Ball around voxels.

    Parameters
    ----------
    low, high
        (3,) their least and greatest coordinates, scene units.
    voxel
        Longest step of the lattice, scene units.
    farthest
        Gives the distance of the farthest one from a place.

    Raises
    ------
    ValueError
        It is larger than float32 can reckon with.
    """
    if not np.abs([low, high]).max() < FARTHEST:
        raise ValueError(
            f"the volume reaches from {low} to {high} scene units; {FARTHEST:g} is the most, so "
            "give another spacing"
        )
    center = (low + high) / 2
    return Sphere(center, farthest(center) + REACH * voxel)


def farthest_from(position: Floats, center: Doubles) -> float:
    """Distance of the farthest of places (N, 3) from one."""
    away = position - center.astype(np.float32)
    return float(np.sqrt(np.einsum("nd,nd->n", away, away).max()))


NO_CORNERS = np.zeros((0, 3))


def around_both(ball: Sphere, corner: Doubles) -> Sphere:
    """Ball around a ball and places (N, 3), which is the same one where these lie in it."""
    if not corner.size or np.linalg.norm(corner - ball.center, axis=1).max() <= ball.radius:
        return ball
    low = np.minimum(corner.min(axis=0), ball.center - ball.radius)
    high = np.maximum(corner.max(axis=0), ball.center + ball.radius)
    center = (low + high) / 2
    away = float(np.linalg.norm(corner - center, axis=1).max())
    return Sphere(center, max(away, float(np.linalg.norm(ball.center - center)) + ball.radius))


def filling(
    orbit: Orbit,
    sphere: Sphere,
    shown: Placed,
    size: tuple[int, int],
    corner: Doubles = NO_CORNERS,
) -> Orbit:
    """The same view of a ball, zoomed and panned so that what is seen from there fills a picture.

    Parameters
    ----------
    orbit
        Whose zoom multiplies the one that fills the picture.
    sphere
        That it goes around.
    shown
        What is seen; strays as of `sphere_around` do not count.
    size
        Height and width of the picture, px.
    corner
        (N, 3) of meshes, which are in the picture, too.
    """
    voxel = float(np.linalg.norm(shown.lattice, axis=0).max())
    position = _without_strays(shown.position, voxel) if len(shown.position) else shown.position
    position = np.concatenate([position, corner.astype(np.float32)])
    view = replace(orbit, zoom=1.0, pan=(0.0, 0.0)).around(sphere, *size).view()
    # Right, down and ahead of the ball's middle, and how far kernels reach around.
    place = (position - sphere.center.astype(np.float32)) @ view.rotation.T.astype(np.float32)
    reach, distance = REACH * voxel, float((view.rotation @ sphere.center + view.translation)[2])
    half = np.maximum(np.array(size[::-1]) / 2 - MARGIN, 0.25 * min(size))
    shorter = min(size)
    if not view.perspective:
        low, high = bounds(place)
        focal = float(view.focal[0])
        zoom = float(np.min(2 * half / (high - low + 2 * reach)[:2] / focal))
        shift = (low + high)[:2] / 2 * focal * zoom / shorter
    else:
        slope = half / view.focal  # of the rays at the picture's sides
        along = place[:, 2] - reach
        ends = np.empty((2, 2))
        for axis in range(2):
            for n, sign in enumerate((1, -1)):
                away = (sign * place[:, axis] + reach) / slope[axis]
                ends[axis, n] = float((away - along).max())
        nearest = float(ends.mean(axis=1).max())
        zoom = distance / nearest
        shift = (ends[:, 0] - ends[:, 1]) / 2 * slope * view.focal / nearest / shorter
    pan = (orbit.pan[0] - float(shift[0]) * orbit.zoom, orbit.pan[1] + float(shift[1]) * orbit.zoom)
    return replace(orbit, zoom=zoom * orbit.zoom, pan=pan)


def _without_strays(position: Floats, voxel: float) -> Floats:
    """Places (N, 3) without the few that are far away from all others along an axis."""
    most = most_strays(len(position))
    low, high = bounds(position)
    extent = high - low
    if not most or not np.isfinite(extent).all() or _is_filled(position, low, extent, most):
        return position
    kept = np.ones(len(position), bool)
    for axis in wide_axes(extent):
        code = codes_along(position, low, extent, axis)
        count = np.bincount(code, minlength=BINS)
        first, last = full_codes(count, float(extent[axis]), most, voxel)
        kept &= (code >= first) & (code <= last)
    return position if kept.all() else position[kept]


def most_strays(count: int) -> int:
    """How many of so many visible voxels may be strays at one end of an axis."""
    return max(min(FEW, count // 500), int(STRAY_SHARE * count))


def wide_axes(extent: Doubles) -> list[int]:
    """Axes along which there is more than one place."""
    return [axis for axis in range(3) if extent[axis] > 0]


def codes_along(position: Floats, low: Doubles, extent: Doubles, axis: int) -> NDArray[np.int64]:
    """Bins (N,) of places (N, 3) along an axis, from the least to the greatest."""
    along = position[:, axis] - np.float32(low[axis])
    return np.minimum((along * np.float32(BINS / extent[axis])).astype(np.int64), BINS - 1)


def full_codes(count: NDArray[np.int64], size: float, most: int, voxel: float) -> tuple[int, int]:
    """First and last bin that has no strays, where bins (BINS,) have so many voxels."""
    full = np.flatnonzero(count)
    gap = max(STRAY_GAP, STRAY_VOXELS * voxel / size)
    first, last = ends((full + 0.5) * np.float64(size / BINS), count[full], most, gap)
    return int(full[first]), int(full[last])


def _is_filled(position: Floats, low: Doubles, extent: Doubles, most: int) -> bool:
    """Whether more voxels than strays can be are near all six sides of their box, as some show."""
    near = near_ends(position[SOME // 2 :: SOME], low, extent)
    return bool(near.min() > least_near(most))


def least_near(most: int) -> int:
    """Voxels of one in so many that have to be near a side, if there may be so many strays."""
    return 2 + 2 * most // SOME


def near_ends(some: Floats, low: Doubles, extent: Doubles) -> NDArray[np.int64]:
    """How many places are near the low sides of their box, and near the high ones, (2, 3)."""
    near_low = (some <= low + STRAY_GAP * extent).sum(axis=0)
    near_high = (some >= low + (1 - STRAY_GAP) * extent).sum(axis=0)
    return np.stack([near_low, near_high])


def bounds(position: Floats) -> tuple[Doubles, Doubles]:
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
