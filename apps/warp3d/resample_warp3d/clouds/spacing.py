"""Points of a cloud made ready for rendering: in an order of their own, with normals and discs.

Done once per cloud; the result serves every camera.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_warp3d.clouds.cloud import Cloud, checked, some_of

NEIGHBOURS = 13  # with the point itself
MORE_NEIGHBOURS = 41  # of points around which those leave a gap
LARGEST = 1.75  # times the upper quartile of the sizes around it a disc may be large
TOGETHER = 256  # points that are compared at a time
CROWDED = 0.1  # share of the blocks that begin where the one before does

Indices = NDArray[np.int64]
Codes = NDArray[np.uint64]


class Surfels(NamedTuple):
    """N discs of surfaces, in an order that does not depend on the one they were given in."""

    origin: (
        Doubles  # (3,) scene units; positions are relative to it, so that float32 tells them apart
    )
    position: Floats  # (N, 3) scene units
    axes: Floats  # (N, 2, 3) scene units, half axes; first × second is along the normal
    color: Floats  # (N, 3) linear light; or (0, 3)
    is_oriented: bool  # normals are known to point outward


def prepare_cloud(
    cloud: Cloud,
    *,
    radius: float | None = None,
    largest: float = LARGEST,
    threads: int | None = None,
    cache: bool = False,
) -> Surfels:
    """Prepare a point cloud.

    Parameters
    ----------
    cloud
        Points; those whose place or color is not finite, or whose radius is not above 0, are left
        out. Normals that are unknown are
        fitted to the neighbours.
    radius
        Of all discs, scene units. Left out, it is the cloud's own; where there is none, each disc
        is the least ellipse about its point that contains the part of the surface which is nearer
        to it than to its neighbours: discs then meet, and leave no gaps.
    largest
        How many times the upper quartile of its 12 neighbours' sizes a disc may be large; that of a
        stray point, of whose neighbours at most one is half as lonely, at most once. Infinity lifts
        both. Of discs whose radius is not known.
    threads
        At most this many. Discs do not depend on it.
    cache
        Keep what the neighbours say in the user's cache, and take it from there if it is; see
        `resample_warp3d.clouds.storing`.

    Returns
    -------
    Discs in the order of a curve through space.

    Raises
    ------
    ValueError
        Lengths do not fit, or no radius is known and all points are in one place.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Cloud, prepare_cloud
    >>> x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    >>> place = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3)
    >>> discs = prepare_cloud(Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)))
    >>> round(float(np.median(np.linalg.norm(discs.axes, axis=2))), 1)  # half a diagonal
    0.7
    """
    points = checked(cloud)
    if not largest > 0:
        raise ValueError(f"discs of at most {largest:g} times their neighbours'; give above 0")
    if radius is not None:
        if not (np.isfinite(radius) and radius > 0):
            raise ValueError(f"a radius of {radius}; give a length above 0")
        points = points._replace(radius=np.full(len(points.position), radius, np.float32))
    origin = _middle(points.position)
    position = (points.position - origin).astype(np.float32)
    order = _canonical(points._replace(position=position))
    from resample.engine import jit

    with jit.threads(jit.workers() if threads is None else threads):
        ordered = some_of(points._replace(position=position), order)
        return _discs(origin, ordered, largest, cache)


def _middle(position: Floats | Doubles) -> Doubles:
    """Middle of the box around all points."""
    if not len(position):
        return np.zeros(3)
    low, high = _corners(position)
    return np.asarray(0.5 * low + 0.5 * high, np.float64)


def _corners(position: Floats | Doubles) -> tuple[Floats | Doubles, Floats | Doubles]:
    """Least and greatest coordinates (3,) of points, of which there is one at least."""
    whole = len(position) // TOGETHER * TOGETHER
    if not whole:
        return position.min(axis=0), position.max(axis=0)
    rows = position[:whole].reshape(-1, 3 * TOGETHER)  # long ones are compared quickly
    low, high = rows.min(axis=0).reshape(-1, 3), rows.max(axis=0).reshape(-1, 3)
    rest = position[whole:]
    return np.concatenate([low, rest]).min(axis=0), np.concatenate([high, rest]).max(axis=0)


def _canonical(cloud: Cloud) -> Indices:
    """Order along a curve through space; points on one place of it by all that they are."""
    code = _codes(cloud.position)
    order = np.argsort(code)  # in any order where codes are equal, as that is settled below
    ordered = code[order]
    again = np.concatenate([[False], ordered[1:] == ordered[:-1]])
    shared = np.flatnonzero(again | np.concatenate([again[1:], [False]]))
    if shared.size:
        among = order[shared]
        columns = [part[among].reshape(among.size, -1).T for part in cloud[3::-1] if len(part)]
        keys = [column for columns_of in columns for column in columns_of[::-1]]
        order[shared] = among[np.lexsort([*keys, code[among]])]
    return order


def _codes(position: Floats | Doubles) -> Codes:
    """Places along a Morton curve with 2²¹ steps per axis, (N,)."""
    if not len(position):
        return np.zeros(0, np.uint64)
    from resample_warp3d.clouds.kernels.curve import codes

    place = np.ascontiguousarray(position, np.float32)
    low, high = np.asarray(_corners(place), np.float32)
    extent = float((high - low).max()) or 1.0
    code: Codes = np.empty(len(place), np.uint64)
    codes(place, low, (2**21 - 1) / extent, code)
    return code


def _discs(origin: Doubles, cloud: Cloud, largest: float, cache: bool) -> Surfels:
    """Discs of points that are in order and relative to an origin."""
    count = len(cloud.position)
    normal = cloud.normal.copy() if len(cloud.normal) else np.zeros((count, 3), np.float32)
    is_oriented = bool(count) and bool(normal.any(axis=1).all())
    axes = np.zeros((count, 2, 3), np.float32)
    if count and not (is_oriented and len(cloud.radius)):
        position = np.asarray(cloud.position, np.float32)
        if len(cloud.radius) or not cache:
            _measured(position, normal, axes, None if len(cloud.radius) else largest)
        else:
            from resample_warp3d.clouds.storing import measured_once

            measure = partial(_measured, position, normal, axes, largest)
            measured_once(position, normal, axes, largest, measure)
    if count and len(cloud.radius):
        from resample_warp3d.clouds.kernels.cells import lay

        lay(normal, cloud.radius, axes)
    return Surfels(origin, np.asarray(cloud.position, np.float32), axes, cloud.color, is_oriented)


def _measured(position: Floats, normal: Floats, axes: Floats, largest: float | None) -> None:
    """Fill in normals and discs by the neighbours of each point; None: discs are not needed."""
    from resample_warp3d.clouds.kernels.neighbours import BLOCK

    is_first = np.ones(len(position), np.bool_)
    is_first[1:] = _differ(position[1:], position[:-1])
    place = position if is_first.all() else np.ascontiguousarray(position[is_first])
    if len(place) == 1 and largest is not None:
        raise ValueError("all points are in one place, so their size is unknown; give a radius")
    is_crowded = _is_crowded(place[::BLOCK])
    if place is position and not is_crowded:
        _measured_places(place, normal, axes, largest)
        return
    owner, upward = np.cumsum(is_first) - 1, normal[is_first]
    if is_crowded:
        along = np.argsort(_codes(_ranks(place)), kind="stable")
        place, upward, owner = place[along], upward[along], np.argsort(along)[owner]
    found = np.zeros((len(place), 2, 3), np.float32)
    _measured_places(place, upward, found, largest)
    normal[:], axes[:] = upward[owner], found[owner]


def _measured_places(position: Floats, normal: Floats, axes: Floats, largest: float | None) -> None:
    """Fill in normals and discs of points that lie along a curve, no two in one place."""
    from resample_warp3d.clouds.kernels.cells import Spaced, limit
    from resample_warp3d.clouds.kernels.measuring import Wanted, measure_all
    from resample_warp3d.clouds.kernels.neighbours import blocks_of

    count = len(position)
    discs = Spaced(axes, np.zeros(count, np.float32))
    wanted = Wanted(min(NEIGHBOURS, count), min(MORE_NEIGHBOURS, count))
    nearest = np.empty((count, wanted.few - 1), np.int32)
    measure_all(blocks_of(position), wanted, normal, discs, nearest)
    if count > 1 and largest is not None and np.isfinite(largest):
        limit(nearest, discs.spacing, _sizes(axes), float(largest), axes)


def _sizes(axes: Floats) -> Floats:
    """Lengths (N,) of the longer half axes."""
    square = axes[:, :, 0] * axes[:, :, 0]
    for c in (1, 2):
        square += axes[:, :, c] * axes[:, :, c]
    size: Floats = np.sqrt(np.maximum(square[:, 0], square[:, 1]))
    return size


def _differ(position: Floats, other: Floats) -> NDArray[np.bool_]:
    """Which points (N,) are not where others are."""
    x, y, z = (position[:, axis] != other[:, axis] for axis in range(3))
    differ: NDArray[np.bool_] = x | y | z
    return differ


def _is_crowded(position: Floats) -> bool:
    """Whether many places of a sorted cloud share a step of the curve, as far strays leave few."""
    code = _codes(position)
    return bool((code[1:] == code[:-1]).mean() > CROWDED) if len(code) > 1 else False


def _ranks(position: Floats) -> Floats:
    """Places (N, 3) by how many have lesser coordinates, of each axis by itself."""
    ranks = np.empty(position.shape, np.float32)
    for axis in range(3):
        ranks[np.argsort(position[:, axis], kind="stable"), axis] = np.arange(len(position))
    return ranks
