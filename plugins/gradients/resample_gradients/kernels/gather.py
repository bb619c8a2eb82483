"""Pixels as means of an interpolated source, with derivatives.

Derivatives are by the source's samples and by the places of pixels. Pixels cover parallelograms
(h, w, 6): u and v of the middle, their steps to the right, and down.
"""

from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, parallel_kernel, tasks
from resample.types import Doubles
from resample_gradients.kernels.points import (
    Integers,
    InterpolatedSource,
    Node,
    PointScratch,
    counts_of,
    cut_at_edges,
    fill_weights,
    first_of,
    folded_in,
    is_cut,
    is_visible,
    node_of,
    place_in,
    scratch_for,
    sides,
    slopes_of_cut,
)

Place = Any  # a number kept in uint64, which spares a test for its sign


class CoefficientPlate(NamedTuple):
    """Coefficients of the source, or a part of them."""

    flat: Doubles  # rows × columns × channels
    columns: int
    channels: int
    left: int  # first column and row, of all coefficients
    top: int


class Landing(NamedTuple):
    """Place of a pixel's point in the source."""

    u: float
    v: float
    share_u: float  # of the point's box that is left inside, along both axes
    share_v: float


@inner_step
def _reaches(seen: Doubles, node: Node, axis: int) -> tuple[float, float]:
    """Extent of a point's box before and after the point, samples along an axis."""
    along_x, along_y = seen[2 + axis], seen[4 + axis]
    by_x, by_y = sides(along_x, along_y, node, -1.0)
    to_x, to_y = sides(along_x, along_y, node, 1.0)
    return by_x * along_x + by_y * along_y, to_x * along_x + to_y * along_y


@inner_kernel
def _cut_along(
    lens: InterpolatedSource, seen: Doubles, node: Node, axis: int, place: float
) -> tuple[float, float]:
    """Clip a point's box along an axis; return its place and the share that is left."""
    before, after = _reaches(seen, node, axis)
    return cut_at_edges(place, before, after, float(lens.size[1 - axis]))


@inner_step
def _spot_of(lens: InterpolatedSource, seen: Doubles, cut: bool, node: Node) -> Landing:
    """Place a point in the source, and clip its box if an edge runs through the pixel."""
    u, v = place_in(seen, node)
    share_u = share_v = 1.0
    if cut:
        u, share_u = _cut_along(lens, seen, node, 0, u)
        v, share_v = _cut_along(lens, seen, node, 1, v)
    return Landing(u, v, share_u, share_v)


@inner_step
def _window(
    lens: InterpolatedSource, plate: CoefficientPlate, spot: Landing, scratch: PointScratch
) -> int:
    """Fill in weights along both axes; return where the window begins in the plate."""
    # Fold the place into the source by the edge rule.
    u, _ = folded_in(lens, spot.u, 0)
    v, _ = folded_in(lens, spot.v, 1)
    # Evaluate the basis functions at its phase.
    column, along_u = first_of(lens, u)
    row, along_v = first_of(lens, v)
    fill_weights(lens.weight, along_u, scratch.along_u)
    fill_weights(lens.weight, along_v, scratch.along_v)
    return ((row - plate.top) * plate.columns + column - plate.left) * plate.channels


@inner_step
def _sum_rows(plate: CoefficientPlate, first: int, weights: Doubles, line: Doubles) -> None:
    """Sum a window's rows by weights, into a line of interleaved channels."""
    # Unsigned indices let LLVM vectorize the inner loop.
    stride, at = np.uint64(plate.columns * plate.channels), np.uint64(first)
    line[:] = 0.0
    for k in range(weights.size):
        weight = weights[k]
        for n in range(line.size):
            line[n] += weight * plate.flat[at + np.uint64(n)]
        at += stride


@inner_step
def _add_line(line: Doubles, weights: Doubles, share: float, total: Doubles) -> None:
    """Sum a line of interleaved channels by weights, and add it."""
    channels = total.size
    for k in range(weights.size):
        weight = share * weights[k]
        for c in range(channels):
            total[c] += weight * line[k * channels + c]


@kernel
def _gather_row(
    plate: CoefficientPlate,
    places: Doubles,
    lens: InterpolatedSource,
    scratch: PointScratch,
    picture: Doubles,
) -> None:
    """Fill a row of the picture (w, C)."""
    for column in range(places.shape[0]):
        seen, total = places[column], picture[column]
        total[:] = 0.0
        # Skip pixels outside the source.
        if not is_visible(lens, seen):
            continue
        # Choose the Gauss points, more where an edge runs through.
        cut = is_cut(lens, seen)
        counts = counts_of(lens, seen, cut)
        for n in range(counts[0] * counts[1]):
            node = node_of(lens.rules, counts, n)
            spot = _spot_of(lens, seen, cut, node)
            # Interpolate the source at each point, and add it by its weight.
            share = node.weight * spot.share_u * spot.share_v
            if share > 0.0:
                first = _window(lens, plate, spot, scratch)
                _sum_rows(plate, first, scratch.along_v, scratch.line)
                _add_line(scratch.line, scratch.along_u, share, total)


@parallel_kernel
def gather(
    counter: Counter,
    plate: CoefficientPlate,
    places: Doubles,
    lens: InterpolatedSource,
    picture: Doubles,
) -> None:
    """Fill a picture (h, w, C) with means of the interpolated coefficients."""
    scratch = scratch_for(lens.weight.shape[1], plate.channels)
    for row in tasks(counter, places.shape[0]):
        _gather_row(plate, places[row], lens, scratch, picture[row])


@inner_step
def _scatter_point(
    plate: CoefficientPlate, first: int, share: float, scratch: PointScratch, gradient: Doubles
) -> None:
    """Transposed `_sum_rows` and `_add_line`: scatter a pixel's gradient to a window."""
    stride, at = np.uint64(plate.columns * plate.channels), np.uint64(first)
    channels, line = gradient.size, scratch.line
    # Expand the gradient to a line of the window.
    for k in range(scratch.along_u.size):
        weight = share * scratch.along_u[k]
        for c in range(channels):
            line[k * channels + c] = weight * gradient[c]
    # Scatter the line to the rows of the window.
    for k in range(scratch.along_v.size):
        weight = scratch.along_v[k]
        for n in range(line.size):
            plate.flat[at + np.uint64(n)] += weight * line[n]
        at += stride


@kernel
def _scatter_tile(
    gradient: Doubles,
    places: Doubles,
    lens: InterpolatedSource,
    tile: Integers,
    plate: CoefficientPlate,
    scratch: PointScratch,
) -> None:
    """Scatter the gradients of a tile's pixels to its part of the coefficients."""
    plate.flat[:] = 0.0
    for row in range(tile[1], tile[3]):
        for column in range(tile[0], tile[2]):
            seen = places[row, column]
            # Skip pixels outside the source.
            if not is_visible(lens, seen):
                continue
            # Visit the same points as the forward pass, and scatter by the same weights.
            cut = is_cut(lens, seen)
            counts = counts_of(lens, seen, cut)
            for n in range(counts[0] * counts[1]):
                node = node_of(lens.rules, counts, n)
                spot = _spot_of(lens, seen, cut, node)
                share = node.weight * spot.share_u * spot.share_v
                if share > 0.0:
                    first = _window(lens, plate, spot, scratch)
                    _scatter_point(plate, first, share, scratch, gradient[row, column])


@parallel_kernel
def scatter_gradients(
    counter: Counter,
    gradient: Doubles,
    places: Doubles,
    lens: InterpolatedSource,
    tiles: Integers,
    boxes: Integers,
    start: Integers,
    patches: Doubles,
) -> None:
    """Transposed `gather`: scatter gradients (h, w, C), each tile into its own patch.

    `tiles`: (T, 4) left, top, right and bottom of pixels. `boxes`: (T, 4) of the coefficients that
    they may read. `start`: (T + 1,) where the patch (rows, columns, C) of each tile begins.
    """
    channels = gradient.shape[2]
    scratch = scratch_for(lens.weight.shape[1], channels)
    for n in tasks(counter, tiles.shape[0]):
        box, flat = boxes[n], patches[start[n] : start[n + 1]]
        plate = CoefficientPlate(flat, box[2] - box[0], channels, box[0], box[1])
        _scatter_tile(gradient, places, lens, tiles[n], plate, scratch)


@inner_step
def _weighed(line: Doubles, weights: Doubles, gradient: Doubles) -> float:
    """Sum of a line of interleaved channels by weights, times a pixel's gradient."""
    total, channels = 0.0, gradient.size
    for k in range(weights.size):
        part = 0.0
        for c in range(channels):
            part += gradient[c] * line[k * channels + c]
        total += weights[k] * part
    return total


@inner_step
def _rates(
    lens: InterpolatedSource,
    plate: CoefficientPlate,
    spot: Landing,
    gradient: Doubles,
    scratch: PointScratch,
) -> tuple[float, float, float]:
    """Value at a point times a pixel's gradient, and its derivatives by u and v."""
    # Fill the weights, and those of the derivatives; folding may mirror their sign.
    first = _window(lens, plate, spot, scratch)
    u, turn_u = folded_in(lens, spot.u, 0)
    v, turn_v = folded_in(lens, spot.v, 1)
    fill_weights(lens.slope, first_of(lens, u)[1], scratch.slope_u)
    fill_weights(lens.slope, first_of(lens, v)[1], scratch.slope_v)
    # Sum along v with weights, then with slopes; along u likewise.
    _sum_rows(plate, first, scratch.along_v, scratch.line)
    _sum_rows(plate, first, scratch.slope_v, scratch.sloped)
    value = _weighed(scratch.line, scratch.along_u, gradient)
    by_u = turn_u * _weighed(scratch.line, scratch.slope_u, gradient)
    return value, by_u, turn_v * _weighed(scratch.sloped, scratch.along_u, gradient)


@inner_step
def _add_rate(node: Node, axis: int, rate: float, change: Doubles) -> None:
    """Chain an uncut point's move along an axis to its pixel's six numbers."""
    change[axis] += rate
    change[2 + axis] += rate * node.x
    change[4 + axis] += rate * node.y


@inner_kernel
def _add_cut_rate(
    lens: InterpolatedSource,
    seen: Doubles,
    node: Node,
    axis: int,
    rates: tuple[float, float],
    change: Doubles,
) -> None:
    """Chain a cut point's move along an axis to its pixel's six numbers.

    `rates` are by the point's place and by its share.
    """
    # Differentiate place and share by the place and both sides of the uncut box.
    place = place_in(seen, node)[axis]
    before, after = _reaches(seen, node, axis)
    slopes = slopes_of_cut(place, before, after, float(lens.size[1 - axis]))
    # Chain through the place.
    _add_rate(node, axis, rates[0] * slopes[0] + rates[1] * slopes[3], change)
    # Chain through the box's sides, which grow with the pixel's steps.
    by_before = rates[0] * slopes[1] + rates[1] * slopes[4]
    by_after = rates[0] * slopes[2] + rates[1] * slopes[5]
    along_x, along_y = seen[2 + axis], seen[4 + axis]
    for sign, rate in ((-1.0, by_before), (1.0, by_after)):
        by_x, by_y = sides(along_x, along_y, node, sign)
        change[2 + axis] += rate * by_x
        change[4 + axis] += rate * by_y


@kernel
def _change_along_row(
    plate: CoefficientPlate,
    places: Doubles,
    lens: InterpolatedSource,
    gradient: Doubles,
    scratch: PointScratch,
    changes: Doubles,
) -> None:
    """Fill a row of derivatives (w, 6)."""
    for column in range(places.shape[0]):
        seen, change = places[column], changes[column]
        change[:] = 0.0
        # Skip pixels outside the source.
        if not is_visible(lens, seen):
            continue
        # Visit the same points as the forward pass.
        cut = is_cut(lens, seen)
        counts = counts_of(lens, seen, cut)
        for n in range(counts[0] * counts[1]):
            node = node_of(lens.rules, counts, n)
            spot = _spot_of(lens, seen, cut, node)
            both = node.weight * spot.share_u * spot.share_v
            if both <= 0.0:
                continue
            # Differentiate the interpolation, and chain to the pixel's middle and steps.
            value, by_u, by_v = _rates(lens, plate, spot, gradient[column], scratch)
            if cut:
                # The share along one axis scales the value by the share along the other.
                by_share = node.weight * spot.share_v * value, node.weight * spot.share_u * value
                _add_cut_rate(lens, seen, node, 0, (both * by_u, by_share[0]), change)
                _add_cut_rate(lens, seen, node, 1, (both * by_v, by_share[1]), change)
            else:
                _add_rate(node, 0, both * by_u, change)
                _add_rate(node, 1, both * by_v, change)


@parallel_kernel
def change(
    counter: Counter,
    plate: CoefficientPlate,
    places: Doubles,
    lens: InterpolatedSource,
    gradient: Doubles,
    changes: Doubles,
) -> None:
    """Fill in derivatives (h, w, 6) of the sum of gradient × picture by places."""
    scratch = scratch_for(lens.weight.shape[1], plate.channels)
    for row in tasks(counter, places.shape[0]):
        _change_along_row(plate, places[row], lens, gradient[row], scratch, changes[row])
