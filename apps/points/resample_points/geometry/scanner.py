"""Discs of a scan by a scanner at the origin of the file's coordinates.

Seen from there, points are neighbours whose directions are: rings are about as near to each other
as the points along them, whatever the surface. A plane has inverse distances that are linear in the
direction, so one is fitted to each point's neighbours. A point takes those that fit best among its
own and those of its neighbours, which lie on its side of an edge. Its disc is the part of that
plane that it has to cover as the scanner sees it: its cell among the directions.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_points.data.curves import MortonCurve, corners
from resample_points.data.parts import on_threads, zeros_beside
from resample_points.geometry.rings import MeasuredDiscs

AROUND = MortonCurve(np.full(3, -1, np.float32), 2.0)  # the curve through all directions
STEP = 1 << 13  # points at a time
OUTSIDE = 0.1  # of the longest side of the cloud's box: the scanner is at most so far outside of it
FITTED = 0.02  # of the distance: rms distance of neighbours from their plane, at most
SEEN = 0.75  # least share of points with such a plane, of what one scanner sees
ALIKE = 1.5  # times the least misfit: planes that a point takes the mean of
STEEPEST = 0.5  # change of the distance within a disc, at most, relative to the distance


def scanned(
    whole: MeasuredDiscs,
    scanner: Doubles,
    measure: Callable[[Floats, Floats], MeasuredDiscs],
    is_known: bool,
) -> bool:
    """Fill in normals and discs of a scan; whether it is one, else nothing is changed.

    `whole`: all points; with `is_known` they keep their normals. `scanner`: (3,) its place, beside
    the points' positions. `measure`: finds cells among directions (N, 3) on given tangent planes.
    """
    low, high = corners(whole.position)
    margin = OUTSIDE * (high - low).max()
    if ((scanner < low - margin) | (scanner > high + margin)).any():
        return False
    least = np.float32(1e-6) * (high - low).max()
    count = len(whole.position)
    code: NDArray[np.uint64] = np.empty(count, np.uint64)
    for rows in _parts(count):
        code[rows] = AROUND.codes(_seen(whole.position[rows], scanner, least)[0])
    order = np.argsort(code, kind="stable")
    toward: Floats = zeros_beside(whole.position, (count, 3), np.float32)
    away: Doubles = zeros_beside(whole.position, (count,), np.float64)
    for rows in _parts(count):
        toward[rows], away[rows] = _seen(whole.position[order[rows]], scanner, least)
    cells = measure(toward, toward.copy())
    plane: Doubles = zeros_beside(whole.position, (count, 3), np.float64)
    misfit: Doubles = zeros_beside(whole.position, (count,), np.float64)

    def fit(rows: slice) -> None:
        near = _with_themselves(cells.nearest, rows)
        plane[rows] = _planes(toward[near], away[near])
        off = _off(plane[rows, None], toward[near], away[near])
        misfit[rows] = np.sqrt((off * off).mean(axis=1))

    on_threads(fit, _parts(count))
    taken: Doubles = zeros_beside(whole.position, (count, 3), np.float64)

    def choose(rows: slice) -> None:
        near = _with_themselves(cells.nearest, rows)
        own = _off(plane[near], toward[rows, None], away[rows, None])
        cost = np.maximum(misfit[near], 0.5 * own)
        least = cost.min(axis=1, keepdims=True)
        mean = (plane[near] * (cost <= ALIKE * least)[..., None]).sum(axis=1)
        taken[rows] = np.where(least <= FITTED * away[rows, None], mean, 0)

    on_threads(choose, _parts(count))
    is_fitted = np.asarray(taken.any(axis=1))
    if np.count_nonzero(is_fitted) < SEEN * count:
        return False

    def lay(rows: slice) -> None:
        ray, these = toward[rows].astype(np.float64), order[rows]
        normal = np.where(is_fitted[rows, None], taken[rows], ray)
        if is_known:
            normal = whole.normal[these].astype(np.float64)
        # Move along the rays until the ends of both axes are on the plane, but not far.
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        facing = _dot(normal, ray)[:, None]
        steep = _dot(normal[:, None], cells.axes[rows]) / np.where(facing == 0, 1e-30, facing)
        along = np.clip(steep, -STEEPEST, STEEPEST)[..., None] * ray[:, None]
        whole.normal[these] = normal
        whole.axes[these] = away[rows, None, None] * (cells.axes[rows] - along)

    on_threads(lay, _parts(count))
    return True


def _parts(count: int) -> Iterator[slice]:
    return (slice(first, min(first + STEP, count)) for first in range(0, count, STEP))


def _seen(position: Floats, scanner: Doubles, least: float) -> tuple[Floats, Doubles]:
    """Return directions (N, 3) and distances (N,) of places, seen from the scanner."""
    place = position - scanner
    away = np.maximum(np.sqrt(_dot(place, place)), least)  # some scanners put misses at the origin
    return (place / away[:, None]).astype(np.float32), away


def _with_themselves(nearest: NDArray[np.int32], rows: slice) -> NDArray[np.int64]:
    """Return the rows (N, k) of some points and their neighbours."""
    return np.column_stack([np.arange(rows.start, rows.stop), nearest[rows]])


def _planes(toward: Floats, away: Doubles) -> Doubles:
    """Fit planes m · place = 1 (N, 3) to points (N, k) by least squares of inverse distances."""
    # Directions from the first one, which keeps precision; along it the value is known best.
    first = toward[:, 0].astype(np.float64)
    one = np.cross(first, np.eye(3)[np.argmin(np.abs(first), axis=1)])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two = np.cross(first, one)
    z, x, y = (_dot(toward, axis[:, None]) for axis in (first, one, two))
    x, y, w = x / z, y / z, 1 / (away * z)
    size = np.sqrt((x * x + y * y).mean(axis=1, keepdims=True)) + 1e-30
    forms = np.stack([np.ones_like(x), x / size, y / size], axis=-1)
    square = np.einsum("nki,nkj->nij", forms, forms) + 1e-9 * np.eye(3)
    found: Doubles = np.linalg.solve(square, np.einsum("nki,nk->ni", forms, w)[..., None])[..., 0]
    found[:, 1:] /= size
    plane: Doubles = found[:, :1] * first + found[:, 1:2] * one + found[:, 2:] * two
    return plane


def _off(plane: Doubles, toward: Floats, away: Doubles) -> Doubles:
    """Return how far (N, k) points are from planes along their rays; inf where rays miss them."""
    inverse = _dot(plane, toward)
    with np.errstate(divide="ignore"):
        off: Doubles = np.where(inverse > 0, np.abs(1 / inverse - away), np.inf)
    return off


def _dot(one: Floats | Doubles, two: Floats | Doubles) -> Doubles:
    product: Doubles = (one * two).sum(axis=-1, dtype=np.float64)
    return product
