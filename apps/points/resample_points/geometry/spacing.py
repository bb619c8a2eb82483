"""Prepare a cloud for rendering: sort points, find normals and discs.

Done once per cloud; the result serves every camera, and is cached on disk.

Neighbours are searched once per cloud, not once per picture. Files are in the user's cache, or in
the folder that HYBRID_RESAMPLE_CACHE names; the least recently used are deleted when all together
exceed `MOST_BYTES`. A file that is damaged or cannot be written only costs the time to measure
again.
"""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import load_arrays, source_fingerprint, store_arrays
from resample.memory import amount, mapped
from resample.memory.mapped import is_in_file
from resample.messages import check_threads, number, warn
from resample.progress import portion, told
from resample.types import Doubles, Floats, Indices
from resample_points.data.cloud import Cloud, check_cloud
from resample_points.data.curves import curve_through
from resample_points.data.parts import memory_left, rows_of, zeros_beside
from resample_points.geometry.scans import MeasuredDiscs, has_lines, scanned, shape_of, widened
from resample_points.geometry.sorting import in_order

NEIGHBOURS = 13  # with the point itself
NEIGHBOURS_OF_SCANS = 21  # the same, by direction: two rings to each side
MORE_NEIGHBOURS = 41  # for points with a gap between 13 neighbours
LARGEST = 1.75  # largest disc, relative to the upper quartile of its neighbours' sizes
MUCH = 4.0  # times the usual size of discs, from which strays are looked for
SAMPLED = 1 << 20  # points to estimate the usual size from, about
F4 = np.float32
SORTING, MEASURING = 0.2, 0.95  # share of all work, share of the rest
RANKED = 48  # bytes per point while ranks are sorted
CROWDED = 0.1  # share of the blocks that begin at the same code as the previous block

MOST_BYTES = 1 << 30
LEAST_POINTS = 20_000  # fewer are measured about as fast as loaded
WIDTH = 9  # numbers per point: a normal and two half axes
# Modules that measure discs.
CODE = (
    "resample_points.geometry.spacing",
    "resample_points.geometry.scans",
    "resample_points.kernels",
)
UNKNOWN = np.zeros(0, np.int32)


class Surfels(NamedTuple):
    """N discs of surfaces, in an order independent of the input's."""

    origin: Doubles  # (3,) scene units; positions are relative to it, so that float32 resolves them
    position: Floats  # (N, 3) scene units
    axes: Floats  # (N, 2, 3) scene units, half axes; first × second is along the normal
    color: Floats  # (N, 3) linear light; or (0, 3)
    is_oriented: bool  # normals are known to point outward
    source: NDArray[np.int32] = UNKNOWN  # (N,) rows of the cloud; or (0,) where not known


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
        Points; those without a finite position or color, or with a radius not above 0, are dropped.
        Unknown normals are fitted to the neighbours.
    radius
        Radius of all discs, scene units. Default: the cloud's own; if it has none, each disc is the
        smallest ellipse around its point that contains the part of the surface nearer to it than to
        its neighbours: discs then touch and leave no gaps.
    largest
        Largest disc, relative to the upper quartile of the sizes of its 12 neighbours; for a stray
        point, with at most one neighbour that is half as isolated, at most 1. Infinity removes both
        limits. Points on no surface, with discs much larger than usual, get half the usual size.
        Only for discs without a given radius.
    threads
        Most threads to use; the discs do not depend on it.
    cache
        Cache normals and discs in the user's cache folder; see
        `resample_points.geometry.spacing`.

    Returns
    -------
    Discs in the order of a space-filling curve.

    Raises
    ------
    ValueError
        Lengths do not fit, or no radius is known and all points coincide.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, prepare_cloud
    >>> x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    >>> place = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3)
    >>> discs = prepare_cloud(Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)))
    >>> round(float(np.median(np.linalg.norm(discs.axes, axis=2))), 1)  # half a diagonal
    0.7
    """
    check_cloud(cloud, Cloud)
    if not number("largest", largest) > 0:
        raise ValueError(
            f"discs of at most {largest:g} times their neighbours'; give a factor above 0"
        )
    if radius is not None and not (np.isfinite(number("radius", radius)) and radius > 0):
        raise ValueError(f"a radius of {radius}; give a length above 0")
    from resample.engine import jit

    check_threads(threads)
    with jit.threads(jit.workers() if threads is None else threads):
        with portion(0.0, SORTING):
            ordered = in_order(cloud, radius)
        given, kept = len(cloud.position), len(ordered.cloud.position)
        if given and not kept:
            warn(f"none of {given} points can be drawn: no place, color or radius is finite")
        with portion(SORTING, 1.0):
            points = ordered.cloud
            position, count = np.asarray(points.position, F4), len(points.position)
            normal = zeros_beside(position, (count, 3), F4)
            axes = zeros_beside(position, (count, 2, 3), F4)
            is_oriented = bool(count) and len(points.normal) > 0
            for rows in rows_of(points.normal):
                normal[rows] = points.normal[rows]
                is_oriented = is_oriented and bool(normal[rows].any(axis=1).all())
            if count and not (is_oriented and len(points.radius)):
                # With radii, only normals are found.
                limit = None if len(points.radius) else largest
                is_kept = cache and limit is not None and not is_in_file(position)
                measure = _measured_once if is_kept else _measured
                measure(position, normal, axes, limit, -ordered.origin)
            if count and len(points.radius):
                from resample_points.kernels.cells import lay

                lay(normal, points.radius, axes)
    return Surfels(ordered.origin, position, axes, points.color, is_oriented, ordered.source)


def _measured(
    position: Floats, normal: Floats, axes: Floats, largest: float | None, zero: Doubles
) -> None:
    """Fill in normals and discs from each point's neighbours; None: normals only.

    `zero`: (3,) where the file's coordinates are 0.
    """
    is_first, count = _first_of_each_place(position)
    if count == 1 and largest is not None:
        raise ValueError("all points coincide, so their size is unknown; give a radius")
    place = position if count == len(position) else _taken(position, is_first, count)
    is_crowded = _is_crowded(place)
    if place is position and not is_crowded:
        _measured_places(place, normal, axes, largest, zero)
        return
    upward = _taken(normal, is_first, count)
    if is_crowded:
        along = _along_ranks(place)
        place, upward = _permuted(place, along), _permuted(upward, along)
    found = zeros_beside(place, (count, 2, 3), F4)
    _measured_places(place, upward, found, largest, zero, is_along=not is_crowded)
    if is_crowded:
        back = np.argsort(along)
        upward, found = _permuted(upward, back), _permuted(found, back)
    first = 0
    for rows in rows_of(position):
        owner = first + np.cumsum(is_first[rows]) - 1
        normal[rows], axes[rows] = upward[owner], found[owner]
        first = int(owner[-1]) + 1


def _first_of_each_place(position: Floats) -> tuple[NDArray[np.bool_], int]:
    """Mark points (N,) that differ from the previous one, and count them."""
    is_first = zeros_beside(position, (len(position),), np.bool_)
    count = 0
    for rows in rows_of(position):
        first = max(1, rows.start)
        is_first[rows.start] = True
        here, before = position[first : rows.stop], position[first - 1 : rows.stop - 1]
        x, y, z = (here[:, axis] != before[:, axis] for axis in range(3))
        is_first[first : rows.stop] = x | y | z
        count += int(np.count_nonzero(is_first[rows]))
    return is_first, count


def _taken(values: Floats, is_taken: NDArray[np.bool_], count: int) -> Floats:
    """Return the rows (count, ...) of values that are marked."""
    taken: Floats = zeros_beside(values, (count, *values.shape[1:]), F4)
    first = 0
    for rows in rows_of(values):
        some = values[rows][is_taken[rows]]
        taken[first : first + len(some)] = some
        first += len(some)
    return taken


def _permuted(values: Floats, order: Indices) -> Floats:
    """Return rows of values in an order."""
    permuted: Floats = zeros_beside(values, values.shape, F4)
    for rows in rows_of(values):
        permuted[rows] = values[order[rows]]
    return permuted


def _measured_places(
    position: Floats,
    normal: Floats,
    axes: Floats,
    largest: float | None,
    zero: Doubles,
    is_along: bool = True,
) -> None:
    """Fill in normals and discs of distinct points sorted along a curve.

    `is_along`: the curve is that through the points' bounding box.
    """
    from resample_points.kernels.cells import limit

    count = len(position)
    is_known = bool(len(normal)) and bool(normal[:1].any())

    def cells(toward: Floats, upward: Floats) -> MeasuredDiscs:
        found = _measured_beside(toward, upward, NEIGHBOURS_OF_SCANS)
        if largest is not None and np.isfinite(largest):
            limit(found.nearest, found.spacing, _sizes(found.axes), float(largest), found.axes)
        return found

    with portion(0.0, MEASURING):
        found = _measured_alone(position, normal, axes)
        if has_lines(found):
            if scanned(found, zero, cells, is_known):
                return
            if is_along:
                widened(found, _measured_beside, is_known)
    if count > 1 and largest is not None and np.isfinite(largest):
        with portion(MEASURING, 1.0):
            limit(found.nearest, found.spacing, _sizes(axes), float(largest), axes)
            _shrink_strays(found, largest)


def _shrink_strays(found: MeasuredDiscs, largest: float) -> None:
    """Shrink much larger discs of points on no surface to half the usual size.

    Strays in empty space have strays around them, so their neighbours do not limit their discs.
    Some have neighbours that lie flat by chance; their sizes are limited by the others' new sizes.
    """
    axes, size = found.axes, _sizes(found.axes)
    usual = np.median(size[:: max(1, len(size) // SAMPLED)])
    large = [rows.start + np.flatnonzero(size[rows] > MUCH * usual) for rows in rows_of(axes)]
    for some in large:
        stray = some[shape_of(found, some).is_cloud]
        axes[stray] *= (0.5 * usual / size[stray])[:, None, None]
        size[stray] = 0.5 * usual
    for some in large:
        around = np.quantile(size[found.nearest[some]], 0.75, axis=1, method="higher")
        axes[some] *= np.minimum(1.0, largest * around / size[some])[:, None, None]


def _measured_alone(
    position: Floats, normal: Floats, axes: Floats, neighbours: int = NEIGHBOURS
) -> MeasuredDiscs:
    """Fill in normals and discs by the nearest neighbours alone."""
    from resample_points.kernels.neighbours import blocks_of, measure_all

    count, spacing = len(position), zeros_beside(position, (len(position),), F4)
    few, many = min(neighbours, count), min(MORE_NEIGHBOURS, count)
    nearest = zeros_beside(position, (count, few - 1), np.int32)
    measure_all(blocks_of(position), few, many, normal, axes, spacing, nearest)
    return MeasuredDiscs(position, normal, axes, spacing, nearest)


def _measured_beside(
    position: Floats, normal: Floats | None = None, neighbours: int = NEIGHBOURS
) -> MeasuredDiscs:
    """Measure other points, as part of larger work."""
    if normal is None:
        normal = zeros_beside(position, (len(position), 3), F4)
    axes = zeros_beside(position, (len(position), 2, 3), F4)
    with told(None):
        return _measured_alone(position, normal, axes, neighbours)


def _sizes(axes: Floats) -> Floats:
    """Return the lengths (N,) of the longer half axes."""
    size: Floats = zeros_beside(axes, (len(axes),), F4)
    for rows in rows_of(axes):
        part = axes[rows]
        square = part[:, :, 0] * part[:, :, 0]
        for c in (1, 2):
            square += part[:, :, c] * part[:, :, c]
        size[rows] = np.sqrt(np.maximum(square[:, 0], square[:, 1]))
    return size


def _is_crowded(position: Floats) -> bool:
    """Whether many points of a sorted cloud share a code, because of far stray points."""
    from resample_points.kernels.neighbours import BLOCK

    if len(position) <= BLOCK:
        return False
    code = curve_through(position).codes(position[::BLOCK])
    return bool((code[1:] == code[:-1]).mean() > CROWDED)


def _along_ranks(position: Floats) -> Indices:
    """Return the order (N,) along a curve through coordinate ranks, for crowded clouds."""
    if is_in_file(position):
        left = memory_left()
        if left is not None and RANKED * len(position) > left:
            raise ValueError(
                "some points are so far away that all others nearly coincide, which takes "
                f"{amount(RANKED * len(position))} of memory, and {amount(left)} may be used; "
                "drop those points, or allow more memory"
            )
    ranks = np.empty(position.shape, np.float32)
    for axis in range(3):
        ranks[np.argsort(position[:, axis], kind="stable"), axis] = np.arange(len(position))
    return np.argsort(curve_through(ranks).codes(ranks), kind="stable")


def folder() -> Path:
    """Return the cache's folder."""
    return mapped.folder() / "clouds"


def _measured_once(
    position: Floats, normal: Floats, axes: Floats, largest: float | None, zero: Doubles
) -> None:
    """Return `_measured`, or its result from the cache; cache new results."""
    if len(position) < LEAST_POINTS:
        _measured(position, normal, axes, largest, zero)
        return
    given = f"{source_fingerprint(*CODE)} {largest!r} {zero.tolist()} {position.shape}"
    digest = hashlib.sha256(given.encode())
    for array in (position, normal):
        digest.update(np.ascontiguousarray(array, np.float32).data)
    path = folder() / f"{digest.hexdigest()[:40]}.npz"
    found = (load_arrays(path, "measured") or {}).get("measured", UNKNOWN)
    if found.shape == (len(position), WIDTH) and found.dtype == np.float32:
        normal[:], axes[:] = found[:, :3], found[:, 3:].reshape(-1, 2, 3)
        return
    _measured(position, normal, axes, largest, zero)
    numbers = np.concatenate([normal, axes.reshape(-1, 6)], axis=1, dtype=np.float32)
    store_arrays(path, {"measured": numbers}, MOST_BYTES)
