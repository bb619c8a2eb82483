"""Warps by control points: thin plates, polynomials, affine and projective maps that fit best.

Slow functions are evaluated at the nodes of a coarse grid; between them the map is a cubic through
four nodes along each axis. Where that is not enough, all pixels are evaluated.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.messages import doubles_of
from resample.types import Doubles
from resample_texture.geometry.mappings import BackwardMap, Homography, pixel_centers
from resample_texture.geometry.matrices import from_corners

EXACT = 0.01  # px by which a thin plate may be off between control points
HIGHEST = 9  # degree of a polynomial
STRAIGHT = 1e-9  # share of the second axis of points in the first, of those on a line
KINDS = "thin-plate", "affine", "projective", "polynomial"
STEP = 8.0  # px between nodes, at most
SAFETY = 0.5  # of the allowed error, at places that are checked
MOST_AT_ONCE = 1 << 20  # places per call of a function

PlaceFunction = Callable[[Any, Any], Any]  # from x and y to x and y


def coarsely(
    function: PlaceFunction, shape: tuple[int, int], error: float, exact: Any = ()
) -> BackwardMap:
    """Return the map of a function from x and y of pixels to x and y of the source.

    The error is checked at the middles of the grid's cells and of their sides. Cells where it may
    be larger, or where the function is not a number, and the cells beside them, are evaluated at
    each pixel.

    `function`: takes and returns two arrays of one shape, px. `shape`: height and width of the
    target, px. `error`: of a place, px, at most; 0: all pixels are evaluated. `exact`: (N, 2)
    places in the target with cells evaluated at each pixel, too.
    """
    from scipy import ndimage

    if not error >= 0.0:
        raise ValueError(f"an error is 0 px or more, not {error}")
    centers = pixel_centers(shape)
    if error == 0.0 or min(shape) < 2.0 * STEP:
        return BackwardMap(*_asked(function, *np.meshgrid(centers[0], centers[1][:, 0])))
    column, row = centers[0], centers[1][:, 0]
    across, down = (
        np.linspace(at[0], at[-1], max(int(np.ceil((at[-1] - at[0]) / STEP)) + 1, 4))
        for at in (column, row)
    )
    nodes = _asked(function, *np.meshgrid(across, down))
    cell_x, cell_y = _cell(across, column), _cell(down, row)
    places = _between(_between(nodes, down, row, cell_y, 1), across, column, cell_x, 2)
    # Compare at the middles of cells and of their sides.
    x, y = (0.5 * (node[1:] + node[:-1]) for node in (across, down))
    cells_x, cells_y = np.arange(x.size), np.arange(y.size)
    high = _between(nodes, down, y, cells_y, 1)
    off_x = _is_off(function, x, down, _between(nodes, across, x, cells_x, 2), error)
    off_y = _is_off(function, across, y, high, error)
    is_exact = _is_off(function, x, y, _between(high, across, x, cells_x, 2), error)
    is_exact |= off_x[1:] | off_x[:-1] | off_y[:, 1:] | off_y[:, :-1]
    for place in np.asarray(exact, np.float64).reshape(-1, 2):
        pairs = tuple(zip((across, down), place, strict=True))
        if all(node[0] - STEP <= one <= node[-1] + STEP for node, one in pairs):
            is_exact[_cell(down, place[1]), _cell(across, place[0])] = True
    is_exact = ndimage.binary_dilation(is_exact, np.ones((3, 3), np.bool_))
    below, right = np.nonzero(is_exact[cell_y[:, None], cell_x])
    if below.size:
        places[:, below, right] = _asked(function, np.add(right, 0.5), np.add(below, 0.5))
    return BackwardMap(places[0], places[1])


def _cell(node: Doubles, place: Any) -> Any:
    """Return the node before each place; never the last node."""
    return np.clip(np.searchsorted(node, place, side="right") - 1, 0, node.size - 2)


def _between(values: Doubles, node: Doubles, place: Doubles, cell: Any, axis: int) -> Doubles:
    """Interpolate values at nodes along an axis, by Lagrange's cubic through four of them."""
    first = np.clip(cell - 1, 0, node.size - 4)
    t = (place - node[first]) / (node[1] - node[0])
    form = (-1, *(1,) * (values.ndim - 1 - axis))
    terms = []
    for n in range(4):
        weight = np.ones_like(t)
        for other in set(range(4)) - {n}:
            weight *= (t - other) / (n - other)
        terms.append(weight.reshape(form) * values.take(first + n, axis))
    return np.asarray(terms[0] + terms[1] + terms[2] + terms[3])


def _is_off(
    function: PlaceFunction, x: Doubles, y: Doubles, made: Doubles, error: float
) -> NDArray[np.bool_]:
    """Whether interpolated values on a grid (2, y, x) are farther off than allowed."""
    exact = _asked(function, *np.meshgrid(x, y))
    with np.errstate(invalid="ignore"):
        return np.asarray(~(np.hypot(*(exact - made)) <= SAFETY * error))


def _asked(function: PlaceFunction, x: Doubles, y: Doubles) -> Doubles:
    """Return the function's values (2, ...), not a number where they are not finite."""
    flat = np.empty((2, x.size))
    for start in range(0, x.size, MOST_AT_ONCE):
        part = np.s_[start : start + MOST_AT_ONCE]
        given = function(x.ravel()[part], y.ravel()[part])
        flat[0, part], flat[1, part] = (np.asarray(one, np.float64) for one in given)
    flat[:, ~np.isfinite(flat).all(axis=0)] = np.nan
    return flat.reshape(2, *x.shape)


def control_points(
    source: ArrayLike,
    target: ArrayLike,
    shape: tuple[int, int],
    kind: str = "thin-plate",
    *,
    smoothing: float = 0.0,
) -> Homography | BackwardMap:
    """Return the warp that brings source points to target points.

    Parameters
    ----------
    source, target
        (N, 2) each, x and y, px, pixel centers at + 0.5.
    shape
        Height and width of the target, px.
    kind
        `thin-plate`: passes through all points, and bends as little as possible between them;
        elsewhere it is exact to 0.01 px. `affine` (3 points or more) and `projective` (4 or
        more) are those of least squares, of distances in the target. `polynomial:degree=2` (6 or
        more; 3 at degree 1, 10 at degree 3) gives places in the source, of least squares there.
    smoothing
        Of a thin plate, px²: how far it may miss points that would bend it; 0 misses none.

    Returns
    -------
    A `Homography` if the kind is affine or projective, else a `BackwardMap`.

    Raises
    ------
    ValueError
        Points are too few, coincide, lie on a line, or are not finite; or the kind is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_sky import control_points
    >>> from resample_texture import warp
    >>> corners = [[0, 0], [64, 0], [64, 48], [0, 48], [32, 24]]
    >>> moved = [[0, 0], [64, 0], [64, 48], [0, 48], [40, 24]]  # the middle goes to the right
    >>> bent = control_points(corners, moved, (48, 64))
    >>> warp(np.ones((48, 64)), bent, (48, 64))
    WarpedMeans(48 × 64 float64, 99.1 % covered)
    """
    before, after = _points(source, "source"), _points(target, "target")
    if before.shape != after.shape:
        raise ValueError(f"{len(before)} source points do not fit {len(after)} target points")
    name, _, option = kind.partition(":")
    key, _, value = option.partition("=")
    if name not in KINDS or (option and (name != "polynomial" or key != "degree")):
        raise ValueError(f"kind {kind!r}; known: {', '.join(KINDS)}:degree=2")
    if not (value or "2").isdecimal() or not 1 <= int(value or "2") <= HIGHEST:
        raise ValueError(f"a polynomial's degree is 1 to {HIGHEST}, not {value!r}")
    if smoothing and name != "thin-plate":
        raise ValueError(f"only a thin plate takes smoothing, not {name}")
    if name == "affine":
        _check_count(before, 3, "an affine map", "source")
        _check_count(after, 3, "an affine map", "target")
        scaled, into = _scaled(before)
        found = np.linalg.lstsq(_with_ones(scaled), after, rcond=None)[0].T
        return Homography(np.vstack([found, [0.0, 0.0, 1.0]]) @ into)
    if name == "projective":
        return _projective(before, after)
    if name == "polynomial":
        return BackwardMap.from_function(_polynomial(before, after, int(value or "2")), shape)
    from scipy.interpolate import RBFInterpolator

    if not (smoothing >= 0.0 and math.isfinite(smoothing)):
        raise ValueError(f"smoothing is 0 or more, not {smoothing}")
    _check_count(after, 3, "a thin plate", "target")
    if len(np.unique(after, axis=0)) < len(after) and not smoothing:
        raise ValueError("two target points coincide; leave one out, or give smoothing")
    plate = RBFInterpolator(after, before, kernel="thin_plate_spline", smoothing=smoothing)

    def places(x: Any, y: Any) -> tuple[Doubles, Doubles]:
        found = plate(np.column_stack([x, y]))
        return found[:, 0], found[:, 1]

    return coarsely(places, shape, EXACT, exact=after)


def _points(given: ArrayLike, name: str) -> Doubles:
    points = doubles_of("control points", given, "numbers (N, 2)")
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise ValueError(f"{name} points are finite numbers (N, 2), not {points.shape}")
    return points


def _check_count(points: Doubles, least: int, kind: str, name: str) -> None:
    """Reject points that are too few, or on a line."""
    if len(points) < least:
        raise ValueError(f"{kind} needs {least} points or more, not {len(points)}")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not spread[1] > STRAIGHT * spread[0]:
        raise ValueError(f"the {name} points lie on a line; give one beside it")


def _scaled(points: Doubles) -> tuple[Doubles, Doubles]:
    """Return points about 0 and of size 1, and the matrix (3, 3) that makes them so."""
    middle = points.mean(axis=0)
    size = max(float(np.abs(points - middle).max()), 1e-300)
    matrix = np.diag([1.0 / size, 1.0 / size, 1.0])
    matrix[:2, 2] = -middle / size
    return (points - middle) / size, matrix


def _with_ones(points: Doubles) -> Doubles:
    return np.column_stack([points, np.ones(len(points))])


def _projective(before: Doubles, after: Doubles) -> Homography:
    """Return the map of least squares; of four points the exact one."""
    from scipy import optimize

    _check_count(before, 4, "a projective map", "source")
    if len(before) == 4:
        return from_corners(before, after)
    (old, into), (new, out) = _scaled(before), _scaled(after)
    rows, zero = _with_ones(old), np.zeros((len(old), 3))
    system = np.vstack(
        [np.hstack([rows, zero, -new[:, :1] * rows]), np.hstack([zero, rows, -new[:, 1:] * rows])]
    )
    start = np.linalg.svd(system)[2][-1]
    start = start / start[np.abs(start).argmax()]
    kept = int(np.abs(start).argmax())

    def matrix(numbers: Doubles) -> Doubles:
        return np.insert(numbers, kept, 1.0).reshape(3, 3)

    def miss(numbers: Doubles) -> Doubles:
        places = rows @ matrix(numbers).T
        return (places[:, :2] / places[:, 2:] - new).ravel()

    found = optimize.least_squares(miss, np.delete(start, kept), method="lm", xtol=1e-15)
    weights = rows @ matrix(found.x)[2]
    if weights.min() * weights.max() <= 0.0:
        raise ValueError("no camera sees these source points at those target points; check them")
    full = np.linalg.inv(out) @ matrix(found.x) @ into
    return Homography(full if weights[0] > 0.0 else -full, is_signed=True)


def _polynomial(
    before: Doubles, after: Doubles, degree: int
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    least = (degree + 1) * (degree + 2) // 2
    _check_count(after, least, f"a polynomial of degree {degree}", "target")
    scaled, into = _scaled(after)
    powers = [(p, total - p) for total in range(degree + 1) for p in range(total + 1)]
    system = np.stack([scaled[:, 0] ** p * scaled[:, 1] ** q for p, q in powers], axis=1)
    found, _, rank, _ = np.linalg.lstsq(system, before, rcond=None)
    if rank < least:
        raise ValueError(
            f"the target points lie on a curve, so that no polynomial of degree {degree} is found;"
            " give more points, or a lower degree"
        )

    def places(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        u, v = into[0, 0] * x + into[0, 2], into[1, 1] * y + into[1, 2]
        one, two = np.zeros_like(u), np.zeros_like(u)
        for (p, q), (first, second) in zip(powers, found, strict=True):
            term = u**p * v**q
            one += first * term
            two += second * term
        return one, two

    return places
