"""Sort the points of a cloud along a Morton curve, in memory or bucket by bucket.

Points with the same curve code are ordered by all their attributes. So the order depends neither on
the order of the input nor on where it is stored.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import most_of
from resample.progress import report
from resample.types import Doubles, Floats, Indices
from resample_points.data.cloud import Cloud, checked, drawable, rows_in, some_of
from resample_points.data.curves import (
    BATCH_SIZE,
    Codes,
    MortonCurve,
    corners,
    curve_in,
    curve_through,
)
from resample_points.data.parts import on_threads, rows_of, zeros_beside

NEAR = 1 << 15  # points sorted at a time, which fit into the processor's cache
LOWER = np.uint64(63 - 16)  # bits of a code below those counted by the first sort
SAMPLED = 1 << 16  # points sampled to choose the ends of buckets
SORTED = 160  # bytes per point while its bucket is sorted

SOURCE = "row of the given cloud"  # column of a cloud in files while it is sorted


class Ordered(NamedTuple):
    """Sorted points, relative to the center of their bounding box."""

    origin: Doubles  # (3,)
    cloud: Cloud
    source: NDArray[np.int32]  # (N,) rows of the given cloud


def in_order(cloud: Cloud, radius: float | None) -> Ordered:
    """Sort the points that can be drawn; all get one radius, if given."""
    pages = most_of(np.asarray(cloud.position))
    if pages is not None:
        return _by_buckets(cloud, radius, max(BATCH_SIZE, pages // SORTED))
    points = _drawn(cloud, radius)
    origin = _middle(*corners(points.position)) if len(points.position) else np.zeros(3)
    position = np.empty((len(points.position), 3), np.float32)

    def move(rows: slice) -> None:
        position[rows] = points.position[rows] - origin

    on_threads(move, rows_of(position))
    relative = points._replace(position=position)
    order = canonical(relative, curve_through(relative.position))
    parts = {name: getattr(relative, name) for name in ("position", "normal", "color", "radius")}
    rows = order.astype(np.int32)
    if len(points.position) < len(cloud.position):
        rows = np.flatnonzero(drawable(cloud)).astype(np.int32)[order]
    for name, values in parts.items():
        taken = np.empty_like(values, order="C")

        def take(some: slice, values: Any = values, taken: Any = taken) -> None:
            # The mode "raise" would copy.
            np.take(values, order[some], axis=0, out=taken[some], mode="clip")

        on_threads(take, rows_of(values))
        parts[name] = taken
    return Ordered(origin, Cloud(**parts), rows)


def _drawn(cloud: Cloud, radius: float | None) -> Cloud:
    """Return the points that can be drawn, with one radius, if given."""
    points = checked(cloud)
    if radius is None:
        return points
    return points._replace(radius=np.full(len(points.position), radius, np.float32))


def _middle(low: Floats | Doubles, high: Floats | Doubles) -> Doubles:
    return np.asarray(0.5 * low + 0.5 * high, np.float64)


def canonical(cloud: Cloud, curve: MortonCurve) -> Indices:
    """Return the order along a curve; points with equal codes by all their attributes."""
    code = curve.codes(cloud.position)
    order, ordered = _ascending(code)  # unstable for equal codes, which are ordered below
    same = ordered[1:] == ordered[:-1]
    if same.any():
        shared = np.flatnonzero(np.append(False, same) | np.append(same, False))
        among = order[shared]
        parts = [part[among].reshape(among.size, -1).T for part in cloud[3::-1] if len(part)]
        keys = [column for columns in parts for column in columns[::-1]]
        order[shared] = among[np.lexsort([*keys, code[among]])]
    return order


def _ascending(code: Codes) -> tuple[Indices, Codes]:
    """Return the order (N,) of codes, and the sorted codes.

    They are grouped by their high bits, then adjacent groups are sorted together.
    """
    if code.size <= NEAR:
        order = np.argsort(code)
        return order, code[order]
    high = (code >> LOWER).astype(np.uint16)
    order = np.argsort(high, kind="stable")  # a radix sort
    grouped = code[order]
    ends = np.cumsum(np.bincount(high))
    wanted = np.arange(NEAR, code.size + NEAR, NEAR)
    starts = np.unique(np.append(0, ends[np.searchsorted(ends, np.minimum(wanted, code.size))]))

    def settle(span: tuple[int, int]) -> None:
        part = slice(*span)
        own = np.argsort(grouped[part])
        order[part], grouped[part] = order[part][own], grouped[part][own]

    on_threads(settle, pairwise(starts.tolist()))
    return order, grouped


def _by_buckets(cloud: Cloud, radius: float | None, most: int) -> Ordered:
    """Sort a cloud in files, about `most` points at a time.

    A sample of the points determines where buckets end along the curve; all points are then moved
    to their buckets, which are sorted one by one.
    """
    cloud = cloud._replace(columns={})
    low, high, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    for rows in rows_of(cloud.position):
        position = checked(rows_in(cloud, rows)).position
        if len(position):
            least, greatest = corners(position)
            low, high = np.minimum(low, least), np.maximum(high, greatest)
        count += len(position)
    origin = _middle(low, high) if count else np.zeros(3)

    def part_of(rows: slice) -> Cloud:
        """Return the points of some rows that can be drawn, relative to the origin."""
        given = rows_in(cloud, rows)
        points = _drawn(given, radius)
        number = np.arange(*rows.indices(len(cloud.position)), dtype=np.int32)
        if len(points.position) < len(number):
            number = number[drawable(given)]
        place = (points.position - origin).astype(np.float32)
        return points._replace(position=place, columns={SOURCE: number})

    if not count:
        return Ordered(origin, part_of(slice(0)), np.zeros(0, np.int32))
    curve = curve_in((low - origin).astype(np.float32), (high - origin).astype(np.float32))
    # Take the codes at which buckets of about equal size end from a sample.
    every, buckets = max(1, len(cloud.position) // SAMPLED), max(1, 2 * count // most)
    sample = np.sort(curve.codes(part_of(slice(None, None, every)).position))
    ends: Codes = np.unique(sample[:: max(1, len(sample) // buckets)][1:])
    # Allocate arrays in files.
    has_radius = radius is not None or len(cloud.radius) > 0
    has = {"normal": len(cloud.normal) > 0, "color": len(cloud.color) > 0, "radius": has_radius}
    made: dict[str, Any] = {
        name: zeros_beside(
            cloud.position,
            (count if has.get(name, True) else 0, *((3,) if name != "radius" else ())),
            np.float32,
        )
        for name in ("position", *has)
    }
    source = zeros_beside(cloud.position, (count,), np.int32)
    ordered = Cloud(**made, columns={SOURCE: source})
    start = _moved(cloud, part_of, curve, ends, ordered)
    for first, last in pairwise(start.tolist()):
        rows = slice(first, last)
        part = rows_in(ordered, rows)
        part = some_of(part, canonical(part, curve))
        for each, values in zip(_arrays(ordered), _arrays(part), strict=True):
            each[rows] = values
        report(last, count)
    return Ordered(origin, ordered._replace(columns={}), ordered.columns[SOURCE])


def _arrays(cloud: Cloud) -> list[NDArray[Any]]:
    """Return the arrays of a cloud while it is sorted; those that it lacks have no rows."""
    return [*cloud[:4], cloud.columns[SOURCE]]


def _moved(
    cloud: Cloud, part_of: Callable[[slice], Cloud], curve: MortonCurve, ends: Codes, moved: Cloud
) -> Indices:
    """Move points to buckets that end at given codes; return the buckets' starts."""
    bucket = zeros_beside(cloud.position, (len(moved.position),), np.uint32)
    held, first = np.zeros(len(ends) + 1, np.int64), 0
    for rows in rows_of(cloud.position):
        some = np.searchsorted(ends, curve.codes(part_of(rows).position), side="right")
        bucket[first : first + len(some)] = some
        held += np.bincount(some, minlength=len(held))
        first += len(some)
    start = np.concatenate([[0], np.cumsum(held)])
    free, first = start[:-1].copy(), 0
    for rows in rows_of(cloud.position):
        part = part_of(rows)
        some = bucket[first : first + len(part.position)]
        first += len(some)
        order = np.argsort(some, kind="stable")
        part, some = some_of(part, order), some[order]
        cuts = (np.flatnonzero(np.diff(some)) + 1).tolist()
        for begin, end in pairwise([0, *cuts, len(some)] if len(some) else []):
            place = int(free[some[begin]])
            for values, new in zip(_arrays(moved), _arrays(part), strict=True):
                if len(new):
                    values[place : place + end - begin] = new[begin:end]
            free[some[begin]] += end - begin
    return start
