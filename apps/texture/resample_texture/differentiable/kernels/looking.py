"""Pixels as means of an interpolated source, and how they change with its samples and with places.

Pixels see parallelograms (h, w, 6): u and v of their middle, steps of both to the right, and down.
"""

import numpy as np

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.types import Doubles
from resample_texture.differentiable.kernels.points import (
    Integers,
    Lens,
    Node,
    Room,
    counts_of,
    cut_at_edges,
    fill_taps,
    is_cut,
    is_seen,
    node_of,
    place_in,
    sides,
    slopes_of_cut,
)


@inner_kernel
def _prepare(lens: Lens, seen: Doubles, cut: bool, node: Node, room: Room) -> float:
    """Fill in the weights of a point of a pixel; gives the point's own."""
    u, v = place_in(seen, node)
    share = node.weight
    if cut:
        u, share_u = _cut_along(lens, seen, node, 0, u)
        v, share_v = _cut_along(lens, seen, node, 1, v)
        share *= share_u * share_v
    if share > 0.0:
        fill_taps(lens, u, 0, room)
        fill_taps(lens, v, 1, room)
    return share


@inner_kernel
def _reaches(seen: Doubles, node: Node, axis: int) -> tuple[float, float]:
    """What a point's box has before and after the point, samples along an axis."""
    along_x, along_y = seen[2 + axis], seen[4 + axis]
    by_x, by_y = sides(along_x, along_y, node, -1.0)
    to_x, to_y = sides(along_x, along_y, node, 1.0)
    return by_x * along_x + by_y * along_y, to_x * along_x + to_y * along_y


@inner_kernel
def _cut_along(
    lens: Lens, seen: Doubles, node: Node, axis: int, place: float
) -> tuple[float, float]:
    """Where a point lies along an axis, and the share of its box that is left there."""
    before, after = _reaches(seen, node, axis)
    return cut_at_edges(place, before, after, float(lens.size[1 - axis]))


@inner_kernel
def _add_point(plate: Doubles, share: float, room: Room, total: Doubles) -> None:
    """Add what is seen at a point."""
    for k in range(room.at.shape[1]):
        row, along_v = room.at[1, k], share * room.weight[1, k]
        for n in range(room.at.shape[1]):
            column, weight = room.at[0, n], along_v * room.weight[0, n]
            for c in range(total.size):
                total[c] += weight * plate[row, column, c]


@kernel
def _look_along_row(
    plate: Doubles, places: Doubles, lens: Lens, room: Room, picture: Doubles
) -> None:
    """Fill a row of the picture."""
    for column in range(places.shape[0]):
        seen, total = places[column], picture[column]
        total[:] = 0.0
        if not is_seen(lens, seen):
            continue
        cut = is_cut(lens, seen)
        counts = counts_of(lens, seen, cut)
        for n in range(counts[0] * counts[1]):
            share = _prepare(lens, seen, cut, node_of(lens.rules, counts, n), room)
            if share > 0.0:
                _add_point(plate, share, room, total)


@parallel_kernel
def look(counter: Counter, plate: Doubles, places: Doubles, lens: Lens, picture: Doubles) -> None:
    """Fill a picture (h, w, C) with means of what coefficients (rows, columns, C) interpolate."""
    taps = lens.pieces.shape[0]
    room = Room(np.empty((2, taps), np.int64), np.empty((2, taps)), np.empty((2, taps)))
    for row in tasks(counter, places.shape[0]):
        _look_along_row(plate, places[row], lens, room, picture[row])


@inner_kernel
def _give_point(
    patch: Doubles, corner: Integers, share: float, room: Room, gradient: Doubles
) -> None:
    """Transposed `_add_point`, into a part of the coefficients."""
    for k in range(room.at.shape[1]):
        row, along_v = room.at[1, k] - corner[1], share * room.weight[1, k]
        for n in range(room.at.shape[1]):
            column, weight = room.at[0, n] - corner[0], along_v * room.weight[0, n]
            for c in range(gradient.size):
                patch[row, column, c] += weight * gradient[c]


@kernel
def _give_tile(
    gradient: Doubles,
    places: Doubles,
    lens: Lens,
    tile: Integers,
    corner: Integers,
    room: Room,
    patch: Doubles,
) -> None:
    """Give back what the pixels of a tile say about a part of the coefficients."""
    patch[:] = 0.0
    for row in range(tile[1], tile[3]):
        for column in range(tile[0], tile[2]):
            seen = places[row, column]
            if not is_seen(lens, seen):
                continue
            cut = is_cut(lens, seen)
            counts = counts_of(lens, seen, cut)
            for n in range(counts[0] * counts[1]):
                share = _prepare(lens, seen, cut, node_of(lens.rules, counts, n), room)
                if share > 0.0:
                    _give_point(patch, corner, share, room, gradient[row, column])


@parallel_kernel
def give_back(
    counter: Counter,
    gradient: Doubles,
    places: Doubles,
    lens: Lens,
    tiles: Integers,
    boxes: Integers,
    start: Integers,
    patches: Doubles,
) -> None:
    """Transposed `look`, tile by tile, each into a patch of its own.

    Parameters
    ----------
    tiles
        (T, 4) left, top, right and bottom of pixels.
    boxes
        (T, 4) of the coefficients that they may see.
    start
        (T + 1,) where the patch (rows, columns, C) of each tile begins.
    """
    taps, channels = lens.pieces.shape[0], gradient.shape[2]
    room = Room(np.empty((2, taps), np.int64), np.empty((2, taps)), np.empty((2, taps)))
    for n in tasks(counter, tiles.shape[0]):
        shape = boxes[n, 3] - boxes[n, 1], boxes[n, 2] - boxes[n, 0], channels
        patch = patches[start[n] : start[n + 1]].reshape(shape)
        _give_tile(gradient, places, lens, tiles[n], boxes[n], room, patch)


@inner_kernel
def _rates(plate: Doubles, room: Room, gradient: Doubles) -> tuple[float, float, float]:
    """What is seen at a point, times a pixel's gradient, and how that changes with u and v."""
    value = by_u = by_v = 0.0
    for k in range(room.at.shape[1]):
        row, line, sloped = room.at[1, k], 0.0, 0.0
        for n in range(room.at.shape[1]):
            column, weighed = room.at[0, n], 0.0
            for c in range(gradient.size):
                weighed += gradient[c] * plate[row, column, c]
            line += room.weight[0, n] * weighed
            sloped += room.slope[0, n] * weighed
        value += room.weight[1, k] * line
        by_u += room.weight[1, k] * sloped
        by_v += room.slope[1, k] * line
    return value, by_u, by_v


@inner_kernel
def _add_rate(node: Node, axis: int, rate: float, change: Doubles) -> None:
    """Add what a point's move along an axis changes, as if its pixel had no edge in it."""
    change[axis] += rate
    change[2 + axis] += rate * node.x
    change[4 + axis] += rate * node.y


@inner_kernel
def _add_cut_rate(
    lens: Lens, seen: Doubles, node: Node, axis: int, rates: tuple[float, float], change: Doubles
) -> None:
    """Add what a cut point's move along an axis changes; `rates` are by its place and its share."""
    place = place_in(seen, node)[axis]
    before, after = _reaches(seen, node, axis)
    slopes = slopes_of_cut(place, before, after, float(lens.size[1 - axis]))
    _add_rate(node, axis, rates[0] * slopes[0] + rates[1] * slopes[3], change)
    by_before = rates[0] * slopes[1] + rates[1] * slopes[4]
    by_after = rates[0] * slopes[2] + rates[1] * slopes[5]
    along_x, along_y = seen[2 + axis], seen[4 + axis]
    for sign, rate in ((-1.0, by_before), (1.0, by_after)):
        by_x, by_y = sides(along_x, along_y, node, sign)
        change[2 + axis] += rate * by_x
        change[4 + axis] += rate * by_y


@kernel
def _add_rates_of_cut(
    plate: Doubles,
    seen: Doubles,
    lens: Lens,
    node: Node,
    gradient: Doubles,
    room: Room,
    change: Doubles,
) -> None:
    """Add what the move of a point changes whose box is cut."""
    u, v = place_in(seen, node)
    u, share_u = _cut_along(lens, seen, node, 0, u)
    v, share_v = _cut_along(lens, seen, node, 1, v)
    if share_u <= 0.0 or share_v <= 0.0:
        return
    fill_taps(lens, u, 0, room)
    fill_taps(lens, v, 1, room)
    value, by_u, by_v = _rates(plate, room, gradient)
    both = node.weight * share_u * share_v
    _add_cut_rate(lens, seen, node, 0, (both * by_u, node.weight * share_v * value), change)
    _add_cut_rate(lens, seen, node, 1, (both * by_v, node.weight * share_u * value), change)


@kernel
def _change_along_row(
    plate: Doubles,
    places: Doubles,
    lens: Lens,
    gradient: Doubles,
    room: Room,
    changes: Doubles,
) -> None:
    """Fill a row of changes."""
    for column in range(places.shape[0]):
        seen, change = places[column], changes[column]
        change[:] = 0.0
        if not is_seen(lens, seen):
            continue
        cut = is_cut(lens, seen)
        counts = counts_of(lens, seen, cut)
        for n in range(counts[0] * counts[1]):
            node = node_of(lens.rules, counts, n)
            if cut:
                _add_rates_of_cut(plate, seen, lens, node, gradient[column], room, change)
                continue
            share = _prepare(lens, seen, False, node, room)
            _, by_u, by_v = _rates(plate, room, gradient[column])
            _add_rate(node, 0, share * by_u, change)
            _add_rate(node, 1, share * by_v, change)


@parallel_kernel
def change(
    counter: Counter,
    plate: Doubles,
    places: Doubles,
    lens: Lens,
    gradient: Doubles,
    changes: Doubles,
) -> None:
    """Fill in how the sum of gradient × picture changes with places, (h, w, 6)."""
    taps = lens.pieces.shape[0]
    room = Room(np.empty((2, taps), np.int64), np.empty((2, taps)), np.empty((2, taps)))
    for row in tasks(counter, places.shape[0]):
        _change_along_row(plate, places[row], lens, gradient[row], room, changes[row])
