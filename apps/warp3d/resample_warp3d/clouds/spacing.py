"""Points of a cloud made ready for rendering: in an order of their own, with normals and discs.

Done once per cloud; the result serves every camera.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory import amount
from resample.memory.mapped import is_in_file
from resample.types import Doubles, Floats
from resample.watching import portion
from resample_warp3d.clouds.cloud import Cloud
from resample_warp3d.clouds.parts import memory_left, room_beside, rows_of
from resample_warp3d.clouds.sorting import Ordered, curve_through, in_order

NEIGHBOURS = 13  # with the point itself
MORE_NEIGHBOURS = 41  # of points around which those leave a gap
LARGEST = 1.75  # times the upper quartile of the sizes around it a disc may be large
F4 = np.float32
SORTING, MEASURING = 0.2, 0.95  # shares of the work, of all and of what comes after sorting
RANKED = 48  # bytes that a point takes while it is put in order by ranks
CROWDED = 0.1  # share of the blocks that begin on the step that the one before begins on

Indices = NDArray[np.int64]


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
    if not largest > 0:
        raise ValueError(f"discs of at most {largest:g} times their neighbours'; give above 0")
    if radius is not None and not (np.isfinite(radius) and radius > 0):
        raise ValueError(f"a radius of {radius}; give a length above 0")
    from resample.engine import jit

    with jit.threads(jit.workers() if threads is None else threads):
        with portion(0.0, SORTING):
            ordered = in_order(cloud, radius)
        with portion(SORTING, 1.0):
            return _discs(ordered, largest, cache)


def _discs(ordered: Ordered, largest: float, cache: bool) -> Surfels:
    """Discs of points that are in order."""
    cloud = ordered.cloud
    position = np.asarray(cloud.position, F4)
    count = len(position)
    normal, axes = room_beside(position, (count, 3), F4), room_beside(position, (count, 2, 3), F4)
    is_oriented = bool(count) and len(cloud.normal) > 0
    if len(cloud.normal):
        for rows in rows_of(position):
            normal[rows] = cloud.normal[rows]
            is_oriented = is_oriented and bool(normal[rows].any(axis=1).all())
    if count and not (is_oriented and len(cloud.radius)):
        if len(cloud.radius) or not cache or is_in_file(position):
            _measured(position, normal, axes, None if len(cloud.radius) else largest)
        else:
            from resample_warp3d.clouds.storing import measured_once

            measure = partial(_measured, position, normal, axes, largest)
            measured_once(position, normal, axes, largest, measure)
    if count and len(cloud.radius):
        from resample_warp3d.clouds.kernels.cells import lay

        lay(normal, cloud.radius, axes)
    return Surfels(ordered.origin, position, axes, cloud.color, is_oriented)


def _measured(position: Floats, normal: Floats, axes: Floats, largest: float | None) -> None:
    """Fill in normals and discs by the neighbours of each point; None: discs are not needed."""
    is_first, count = _first_of_each_place(position)
    if count == 1 and largest is not None:
        raise ValueError("all points are in one place, so their size is unknown; give a radius")
    place = position if count == len(position) else _taken(position, is_first, count)
    is_crowded = _is_crowded(place)
    if place is position and not is_crowded:
        _measured_places(place, normal, axes, largest)
        return
    upward = _taken(normal, is_first, count)
    if is_crowded:
        along = _along_ranks(place)
        place, upward = _permuted(place, along), _permuted(upward, along)
    found = room_beside(place, (count, 2, 3), F4)
    _measured_places(place, upward, found, largest)
    if is_crowded:
        back = np.argsort(along)
        upward, found = _permuted(upward, back), _permuted(found, back)
    first = 0
    for rows in rows_of(position):
        owner = first + np.cumsum(is_first[rows]) - 1
        normal[rows], axes[rows] = upward[owner], found[owner]
        first = int(owner[-1]) + 1


def _first_of_each_place(position: Floats) -> tuple[NDArray[np.bool_], int]:
    """Which points (N,) along a curve are not where the one before is, and how many."""
    is_first = room_beside(position, (len(position),), np.bool_)
    count = 0
    for rows in rows_of(position):
        first = max(1, rows.start)
        is_first[rows.start] = True
        is_first[first : rows.stop] = _differ(
            position[first : rows.stop], position[first - 1 : rows.stop - 1]
        )
        count += int(np.count_nonzero(is_first[rows]))
    return is_first, count


def _taken(values: Floats, is_taken: NDArray[np.bool_], count: int) -> Floats:
    """Those rows (count, ...) of values that are taken."""
    taken: Floats = room_beside(values, (count, *values.shape[1:]), F4)
    first = 0
    for rows in rows_of(values):
        some = values[rows][is_taken[rows]]
        taken[first : first + len(some)] = some
        first += len(some)
    return taken


def _permuted(values: Floats, order: Indices) -> Floats:
    """Rows of values in an order."""
    permuted: Floats = room_beside(values, values.shape, F4)
    for rows in rows_of(values):
        permuted[rows] = values[order[rows]]
    return permuted


def _measured_places(position: Floats, normal: Floats, axes: Floats, largest: float | None) -> None:
    """Fill in normals and discs of points that lie along a curve, no two in one place."""
    from resample_warp3d.clouds.kernels.cells import Spaced, limit
    from resample_warp3d.clouds.kernels.measuring import Wanted, measure_all
    from resample_warp3d.clouds.kernels.neighbours import blocks_of

    count = len(position)
    discs = Spaced(axes, room_beside(position, (count,), F4))
    wanted = Wanted(min(NEIGHBOURS, count), min(MORE_NEIGHBOURS, count))
    nearest = room_beside(position, (count, wanted.few - 1), np.int32)
    with portion(0.0, MEASURING):
        measure_all(blocks_of(position), wanted, normal, discs, nearest)
    if count > 1 and largest is not None and np.isfinite(largest):
        with portion(MEASURING, 1.0):
            limit(nearest, discs.spacing, _sizes(axes), float(largest), axes)


def _sizes(axes: Floats) -> Floats:
    """Lengths (N,) of the longer half axes."""
    size: Floats = room_beside(axes, (len(axes),), F4)
    for rows in rows_of(axes):
        part = axes[rows]
        square = part[:, :, 0] * part[:, :, 0]
        for c in (1, 2):
            square += part[:, :, c] * part[:, :, c]
        size[rows] = np.sqrt(np.maximum(square[:, 0], square[:, 1]))
    return size


def _differ(position: Floats, other: Floats) -> NDArray[np.bool_]:
    """Which points (N,) are not where others are."""
    x, y, z = (position[:, axis] != other[:, axis] for axis in range(3))
    differ: NDArray[np.bool_] = x | y | z
    return differ


def _is_crowded(position: Floats) -> bool:
    """Whether many places of a sorted cloud share a step of the curve, as far strays leave few."""
    from resample_warp3d.clouds.kernels.neighbours import BLOCK

    if len(position) <= BLOCK:
        return False
    code = curve_through(position).codes(position[::BLOCK])
    return bool((code[1:] == code[:-1]).mean() > CROWDED)


def _along_ranks(position: Floats) -> Indices:
    """Order (N,) along a curve through ranks, of places that strays leave few steps of their own.

    Raises
    ------
    ValueError
        Memory does not hold the ranks of a cloud in files.
    """
    if is_in_file(position):
        left = memory_left()
        if left is not None and RANKED * len(position) > left:
            raise ValueError(
                "some points lie so far away that all others are nearly in one place, which takes "
                f"{amount(RANKED * len(position))} of memory, and {amount(left)} may be taken; "
                "leave them out, or allow more"
            )
    ranks = np.empty(position.shape, np.float32)
    for axis in range(3):
        ranks[np.argsort(position[:, axis], kind="stable"), axis] = np.arange(len(position))
    return np.argsort(curve_through(ranks).codes(ranks), kind="stable")
