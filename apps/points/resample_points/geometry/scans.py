"""Discs of laser scans: of points along lines, and of a scan by one scanner.

The nearest neighbours of a point on a ring of a spinning scanner lie on its own line. They tell
neither the direction of the surface nor how far the next line is. Therefore the cloud is thinned
step by step, by cells of doubling sides along the sorting curve. Where cells are
about as large as lines are apart, neighbours lie all around: from there come the normal, and the
disc's extent across its line.

Seen from a scanner at the origin of the file's coordinates, points are neighbours if directions
are: rings are about as near to each other as the points along them, whatever the surface. A plane
has inverse distances that are linear in the direction, so one is fitted to each point's neighbours.
A point takes the best fitting planes among its own and its neighbours' on its side
of an edge. Its disc is the part of the plane that it has to cover as the scanner sees it: its cell
among the directions.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_points.data.curves import MortonCurve, corners, curve_through
from resample_points.data.parts import on_threads, rows_of, zeros_beside

SAMPLED = 4096  # points by which a cloud without lines is recognized
LINED = 0.02  # least share of them along lines
LINE = 0.05  # second variance of neighbours along a line, at most, relative to the first
WIDE = 0.15  # the same on a surface, at least
FLAT = 0.25  # third variance of neighbours on a surface, at most, relative to the second
SCATTERED = 0.02  # third variance of neighbours on no surface, at least, relative to the second
BEGINNING, BEYOND = 2.0, 64.0  # sides of the first cells and of the last, in spacings along lines
NEAR = 1.5  # times the spacing of points that a thinning is for: others left as their neighbours
STEPS = 21  # of the curve, halvings of its box
FEWEST = 64  # points left by the last thinning
LONGEST = 8.0  # ratio of a disc's axes, at most
TURNS = 3  # of the power iteration that finds the direction of a line

Flags = NDArray[np.bool_]
Nearest = NDArray[np.int32]


class MeasuredDiscs(NamedTuple):
    """Normals and discs of N points, and the neighbours that they come from."""

    position: Floats  # (N, 3) sorted along a curve
    normal: Floats  # (N, 3)
    axes: Floats  # (N, 2, 3)
    spacing: Floats  # (N,) mean distance to the nearest neighbours
    nearest: Nearest  # (N, k)


class Lying(NamedTuple):
    """Arrangement of the neighbours of N points."""

    along: Floats  # (N, 3) direction of the line; 0 where there is none
    is_line: Flags  # (N,)
    is_surface: Flags  # (N,)
    is_cloud: Flags  # (N,) in all directions, as for strays


def has_lines(whole: MeasuredDiscs) -> bool:
    """Whether some points lie along lines."""
    count = len(whole.position)
    sample = np.linspace(0, count - 1, min(SAMPLED, count)).astype(np.int64)
    return count >= FEWEST and bool(shape_of(whole, sample).is_line.mean() >= LINED)


def widened(
    whole: MeasuredDiscs, measure: Callable[[Floats], MeasuredDiscs], is_known: bool
) -> None:
    """Change normals and discs of points along lines in place, where a surface is found.

    `measure`: measures the points that are left of a thinned cloud. `is_known`: normals are given,
    and stay.
    """
    curve = curve_through(whole.position)
    along: Floats = zeros_beside(whole.position, whole.position.shape, np.float32)
    is_open: Flags = zeros_beside(whole.position, (len(along),), np.bool_)

    def begin(rows: slice) -> None:
        shape = shape_of(whole, rows)
        along[rows], is_open[rows] = shape.along, ~shape.is_surface

    on_threads(begin, rows_of(along))
    sample = np.flatnonzero(is_open)
    if not len(sample):
        return
    # Halve the curve's box to the finest cells first.
    sample = sample[np.linspace(0, len(sample) - 1, min(SAMPLED, len(sample))).astype(np.int64)]
    near, far = np.quantile(whole.spacing[sample], [0.1, 0.9])
    first = np.log2(curve.extent / (BEGINNING * max(float(near), 1e-30)))
    last = np.log2(curve.extent / (BEYOND * max(float(far), 1e-30)))
    finest, coarsest = int(np.clip(np.ceil(first), 0, STEPS)), max(int(np.floor(last)), 0)
    for halvings in range(finest, coarsest, -1):
        if not _widened_at(whole, measure, is_known, (curve, halvings), (along, is_open)):
            return


def _widened_at(
    whole: MeasuredDiscs,
    measure: Callable[[Floats], MeasuredDiscs],
    is_known: bool,
    level: tuple[MortonCurve, int],
    state: tuple[Floats, Flags],
) -> bool:
    """Widen discs by the result of one thinning; return whether a coarser one may find more."""
    curve, halvings = level
    along, is_open = state
    side = curve.extent / 2.0**halvings
    cell: NDArray[np.uint64] = zeros_beside(whole.position, (len(along),), np.uint64)
    for rows in rows_of(cell):
        cell[rows] = curve.codes(whole.position[rows]) >> np.uint64(3 * (STEPS - halvings))
    start = np.flatnonzero(np.append(True, cell[1:] != cell[:-1]))
    middle = (start + np.append(start[1:], len(cell))) // 2
    del cell
    # Points that are farther apart have their turn with larger cells.
    is_near = np.logical_or.reduceat(whole.spacing <= NEAR / BEGINNING * side, start)
    if np.count_nonzero(is_near) < FEWEST:
        return len(start) >= FEWEST
    thin = measure(np.ascontiguousarray(whole.position[middle[is_near]]))
    number = np.cumsum(is_near) - 1
    count = len(thin.position)
    flags = (np.zeros(count, np.bool_) for _ in range(3))
    shape = Lying(zeros_beside(thin.position, (count, 3), np.float32), *flags)

    def find(rows: slice) -> None:
        for values, part in zip(shape, shape_of(thin, rows), strict=True):
            values[rows] = part

    on_threads(find, rows_of(thin.position))

    def widen(rows: slice) -> None:
        these = np.flatnonzero(
            is_open[rows]
            & (whole.spacing[rows] <= side / BEGINNING)
            & (whole.spacing[rows] >= side / BEYOND)
        )
        these += rows.start
        which = number[np.searchsorted(start, these, side="right") - 1]
        is_line = shape.is_line[which]
        along[these[is_line]] = shape.along[which[is_line]]
        found = shape.is_surface[which]
        is_open[these[found]] = False
        _widen(whole, thin, (these[found], which[found]), along, is_known)

    on_threads(widen, rows_of(along))
    return bool(is_open.any())


def _widen(
    whole: MeasuredDiscs,
    thin: MeasuredDiscs,
    both: tuple[NDArray[np.int64], NDArray[np.int64]],
    along: Floats,
    is_known: bool,
) -> None:
    """Copy normals and extents across the line from points of a thinned cloud."""
    these, those = both
    normal = whole.normal[these] if is_known else thin.normal[those]
    line = along[these]
    line = np.where(line.any(axis=1, keepdims=True), line, thin.axes[those, 0])  # among noise
    one = line - normal * _dot(normal, line)[:, None]
    one /= np.maximum(np.linalg.norm(one, axis=1, keepdims=True), np.float32(1e-20))
    two = np.cross(normal, one)
    across = _extent(thin.axes[those], two)
    own = np.maximum(_extent(whole.axes[these], one), across / np.float32(LONGEST))
    whole.normal[these] = normal
    whole.axes[these, 0] = one * own[:, None]
    whole.axes[these, 1] = two * across[:, None]


def _extent(axes: Floats, direction: Floats) -> Floats:
    """Return the half extents (N,) of discs along directions (N, 3)."""
    one, two = _dot(axes[:, 0], direction), _dot(axes[:, 1], direction)
    return np.sqrt(one * one + two * two)


def _dot(one: Floats, two: Floats) -> Floats:
    product: Floats = one[:, 0] * two[:, 0] + one[:, 1] * two[:, 1] + one[:, 2] * two[:, 2]
    return product


def shape_of(points: MeasuredDiscs, rows: slice | NDArray[np.int64]) -> Lying:
    """Return the arrangement of some points' neighbours, from variances along three axes."""
    # Sum the offsets of neighbours, and their products; subtract the means.
    here, count = points.position[rows], points.nearest.shape[1]
    sums = [np.zeros(len(here)) for _ in range(9)]
    for k in range(count):
        x, y, z = (points.position[points.nearest[rows, k]] - here).T.astype(np.float64)
        parts = (x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)
        sums = [total + part for total, part in zip(sums, parts, strict=True)]
    x, y, z, *squares = sums
    means = (x * x, x * y, x * z, y * y, y * z, z * z)
    xx, xy, xz, yy, yz, zz = (
        square - mean / (count + 1) for square, mean in zip(squares, means, strict=True)
    )
    trace = np.maximum(xx + yy + zz, 1e-300)
    xx, xy, xz, yy, yz, zz = (part / trace for part in (xx, xy, xz, yy, yz, zz))
    # Eigenvalues of a symmetric 3 × 3 matrix of trace 1, by Viète's trigonometric solution.
    off = xy * xy + xz * xz + yz * yz
    x, y, z = xx - 1 / 3, yy - 1 / 3, zz - 1 / 3
    size = np.sqrt(np.maximum((x * x + y * y + z * z + 2 * off) / 6, 1e-30))
    half = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)
    angle = np.arccos(np.clip(half / (2 * size**3), -1, 1)) / 3
    most = 1 / 3 + 2 * size * np.cos(angle)
    least = np.maximum(1 / 3 + 2 * size * np.cos(angle + 2 * np.pi / 3), 0)
    middle = np.maximum(1 - most - least, 1e-30)
    is_line = middle <= LINE * most
    # Find the direction of the largest eigenvalue, far above the others, by powers of the matrix.
    lines = [part[is_line] for part in (xx, xy, xz, xy, yy, yz, xz, yz, zz)]
    columns = np.stack(lines, axis=1).reshape(-1, 3, 3)
    longest = np.argmax((columns * columns).sum(axis=1), axis=1)
    main = np.take_along_axis(columns, longest[:, None, None], axis=2)[:, :, 0]
    for _ in range(TURNS):
        main = (columns * main[:, None, :]).sum(axis=2)
        main /= np.maximum(np.sqrt((main * main).sum(axis=1, keepdims=True)), 1e-300)
    along = np.zeros((len(trace), 3), np.float32)
    along[is_line] = main
    is_surface = (middle >= WIDE * most) & (least <= FLAT * middle)
    return Lying(along, is_line, is_surface, ~is_line & (least > SCATTERED * middle))


AROUND = MortonCurve(np.full(3, -1, np.float32), 2.0)  # the curve through all directions
AT_A_TIME = 1 << 13  # points at a time
OUTSIDE = 0.1  # of the longest side of the cloud's box: the scanner is at most so far outside of it
FITTED = 0.02  # of the distance: rms distance of neighbours from their plane, at most
SEEN = 0.75  # least share of points with such a plane, of a single scanner's points
ALIKE = 1.5  # times the least misfit: planes that a point takes the mean of
STEEPEST = 0.5  # change of the distance within a disc, at most, relative to the distance


def scanned(
    whole: MeasuredDiscs,
    scanner: Doubles,
    measure: Callable[[Floats, Floats], MeasuredDiscs],
    is_known: bool,
) -> bool:
    """Fill in normals and discs of a scan; return False, unchanged, if it is not a scan.

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
        facing = _product(normal, ray)[:, None]
        steep = _product(normal[:, None], cells.axes[rows]) / np.where(facing == 0, 1e-30, facing)
        along = np.clip(steep, -STEEPEST, STEEPEST)[..., None] * ray[:, None]
        whole.normal[these] = normal
        whole.axes[these] = away[rows, None, None] * (cells.axes[rows] - along)

    on_threads(lay, _parts(count))
    return True


def _parts(count: int) -> Iterator[slice]:
    return (slice(first, min(first + AT_A_TIME, count)) for first in range(0, count, AT_A_TIME))


def _seen(position: Floats, scanner: Doubles, least: float) -> tuple[Floats, Doubles]:
    """Return directions (N, 3) and distances (N,) of places, seen from the scanner."""
    place = position - scanner
    away = np.maximum(
        np.sqrt(_product(place, place)), least
    )  # some scanners put misses at the origin
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
    z, x, y = (_product(toward, axis[:, None]) for axis in (first, one, two))
    x, y, w = x / z, y / z, 1 / (away * z)
    size = np.sqrt((x * x + y * y).mean(axis=1, keepdims=True)) + 1e-30
    forms = np.stack([np.ones_like(x), x / size, y / size], axis=-1)
    square = np.einsum("nki,nkj->nij", forms, forms) + 1e-9 * np.eye(3)
    found: Doubles = np.linalg.solve(square, np.einsum("nki,nk->ni", forms, w)[..., None])[..., 0]
    found[:, 1:] /= size
    plane: Doubles = found[:, :1] * first + found[:, 1:2] * one + found[:, 2:] * two
    return plane


def _off(plane: Doubles, toward: Floats, away: Doubles) -> Doubles:
    """Return distances (N, k) of points to planes along their rays; inf where rays miss."""
    inverse = _product(plane, toward)
    with np.errstate(divide="ignore"):
        off: Doubles = np.where(inverse > 0, np.abs(1 / inverse - away), np.inf)
    return off


def _product(one: Floats | Doubles, two: Floats | Doubles) -> Doubles:
    product: Doubles = (one * two).sum(axis=-1, dtype=np.float64)
    return product
