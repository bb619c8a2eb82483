"""Backward maps of slow functions: coarse grids, and all pixels where those are not enough.

Between the nodes of the grid the map is a cubic through four of them along each axis.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_texture.geometry.mappings import BackwardMap, pixel_centers

STEP = 8.0  # px between nodes, at most
SAFETY = 0.5  # of the allowed error, at places that are checked
MOST_AT_ONCE = 1 << 20  # places that a function is asked for

PlaceFunction = Callable[[Any, Any], Any]  # from x and y to x and y


class _Axis(NamedTuple):
    """Nodes along an axis, and the cubic through four of them at each of some places."""

    node: Doubles  # (n,) px
    cell: NDArray[np.int64]  # (m,) the node before each place
    first: NDArray[np.int64]  # (m,) of the four
    weight: Doubles  # (4, m)

    def along(self, values: Doubles) -> Doubles:
        """Interpolate the first axis of values at the nodes (n, ...)."""
        weight = self.weight.reshape(*self.weight.shape, *(1,) * (values.ndim - 1))
        terms = [weight[n] * values[self.first + n] for n in range(4)]
        return np.asarray(terms[0] + terms[1] + terms[2] + terms[3])


def coarsely(
    function: PlaceFunction, shape: tuple[int, int], error: float, exact: Any = ()
) -> BackwardMap:
    """Return the map of a function from x and y of pixels to those of the source.

    The error is checked at the middles of the grid's cells and of their sides. Cells where it may
    be larger, or where the function is not a number, and the cells beside them, are worked out
    pixel by pixel.

    `function`: takes and returns two arrays of one shape, px. `shape`: height and width of the
    target, px. `error`: of a place, px, at most; 0: all pixels are worked out. `exact`: (N, 2)
    places in the target whose cells are worked out pixel by pixel, too.
    """
    from scipy import ndimage

    if not error >= 0.0:
        raise ValueError(f"an error is 0 px or more, not {error}")
    centers = pixel_centers(shape)
    if error == 0.0 or min(shape) < 2.0 * STEP:
        return BackwardMap(*_asked(function, *np.meshgrid(centers[0], centers[1][:, 0])))
    across, down = _axis(centers[0]), _axis(centers[1][:, 0])
    nodes = _on_grid(function, across.node, down.node)
    places = np.stack([across.along(down.along(one).T).T for one in nodes])
    is_exact = _is_wrong(function, nodes, (across.node, down.node), error)
    for x, y in np.asarray(exact, np.float64).reshape(-1, 2):
        inside = [(a.node[0] - STEP <= p <= a.node[-1] + STEP) for a, p in ((across, x), (down, y))]
        if all(inside):
            is_exact[_cell(down.node, y), _cell(across.node, x)] = True
    is_exact = ndimage.binary_dilation(is_exact, np.ones((3, 3), np.bool_))
    row, column = np.nonzero(is_exact[down.cell[:, None], across.cell])
    if row.size:
        places[:, row, column] = _asked(function, np.add(column, 0.5), np.add(row, 0.5))
    return BackwardMap(places[0], places[1])


def _cell(node: Doubles, place: Any) -> Any:
    """Return the node before each place, of those that have one after them."""
    return np.clip(np.searchsorted(node, place, side="right") - 1, 0, node.size - 2)


def _axis(center: Doubles) -> _Axis:
    count = int(np.ceil((center[-1] - center[0]) / STEP)) + 1
    node = np.linspace(center[0], center[-1], max(count, 4))
    cell = _cell(node, center)
    return _Axis(node, cell, *_cubic(node, center, cell))


def _cubic(
    node: Doubles, place: Doubles, cell: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Doubles]:
    """Return the first of four nodes, and the four's weights (4, m): Lagrange's polynomials."""
    first = np.clip(cell - 1, 0, node.size - 4)
    t = (place - node[first]) / (node[1] - node[0])
    weight = [np.ones_like(t) for _ in range(4)]
    for n in range(4):
        for other in set(range(4)) - {n}:
            weight[n] *= (t - other) / (n - other)
    return first, np.stack(weight)


def _is_wrong(
    function: PlaceFunction, nodes: Doubles, node: tuple[Doubles, Doubles], error: float
) -> NDArray[np.bool_]:
    """Whether a cell's middle or one of its sides' is farther off than allowed."""
    axes = []
    for along in node:
        middle = 0.5 * (along[1:] + along[:-1])
        axes.append((middle, _cubic(along, middle, np.arange(middle.size))))
    (x, across), (y, down) = axes
    right, below = (_Axis(x, across[0], *across), _Axis(y, down[0], *down))
    wide = np.stack([right.along(one.T).T for one in nodes])  # middles of rows' cells
    high = np.stack([below.along(one) for one in nodes])
    both = np.stack([right.along(one.T).T for one in high])
    sides_x = _off(_on_grid(function, x, node[1]), wide, error)
    sides_y = _off(_on_grid(function, node[0], y), high, error)
    wrong = _off(_on_grid(function, x, y), both, error)
    wrong |= sides_x[1:] | sides_x[:-1] | sides_y[:, 1:] | sides_y[:, :-1]
    return wrong


def _off(exact: Doubles, made: Doubles, error: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray(~(np.hypot(*(exact - made)) <= SAFETY * error))


def _on_grid(function: PlaceFunction, x: Doubles, y: Doubles) -> Doubles:
    return _asked(function, *np.meshgrid(x, y))


def _asked(function: PlaceFunction, x: Doubles, y: Doubles) -> Doubles:
    """Return the function's values (2, ...), not a number where they are not finite."""
    flat = np.empty((2, x.size))
    for start in range(0, x.size, MOST_AT_ONCE):
        part = np.s_[start : start + MOST_AT_ONCE]
        given = function(x.ravel()[part], y.ravel()[part])
        flat[0, part], flat[1, part] = (np.asarray(one, np.float64) for one in given)
    flat[:, ~np.isfinite(flat).all(axis=0)] = np.nan
    return flat.reshape(2, *x.shape)
