"""Skip blocks of samples that lie outside the view, or behind what is opaque already.

Blocks are outlined on the screen; samples are painted front to back in passes, and between two
passes the largest transmittance that is left in the pixels is kept as a pyramid: a hierarchical
occlusion map (Zhang, Manocha, Hudson and Hoff, Visibility Culling Using Hierarchical Occlusion
Maps, 1997) of transmittances. What it hides could not have changed a single bit of the picture.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import cast_rays, laid_out, pixel_weights, resolve
from resample.engine.ellipsoids.footprints import Eye, Shape, eye_of, shape_of
from resample.engine.grid import grid
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.paint import Tally, paint_members
from resample.engine.sorting import put_in_order
from resample.engine.tiles import tiles_met
from resample.engine.vectors import Vector, combine, multiply
from resample.types import (
    DISC,
    EXACT,
    SMALL_ANGLE,
    Blocks,
    Canvas,
    Doubles,
    Ellipsoid,
    Film,
    Floats,
    Records,
    Screen,
    Sheets,
    Single,
    Style,
    Tables,
    Tiles,
    View,
)

# By these shares bounds are widened, since records hold float32.
ROUNDING, ROUNDING_PX = 1e-6, 0.01

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Outlines(NamedTuple):
    """What is known of B blocks before any of their samples is looked at."""

    bounds: Doubles  # (B, 4) left, top, right, bottom px of its samples; left > right: outside
    front: Doubles  # (B,) no sample's key is smaller
    spacing: Doubles  # (B,) px; no sample's is smaller


class Canvases(NamedTuple):
    """The canvases of all T tiles, which are painted in several passes."""

    pixel: Floats  # sub-pixels of one tile after another, as in Canvas
    start: Indices  # (T + 1,) where in `pixel` those of tile t begin
    still_open: Indices  # (T,) sub-pixels that are not opaque; negative: not begun
    light: Floats  # (T, S, S) largest transmittance in each px of a tile and its margin


class Pyramid(NamedTuple):
    """Largest transmittance in each px of the picture and its margin, then in squares of them."""

    light: Floats  # one level after another, row by row; the last has one element
    start: Indices  # (L + 1,) where the levels begin
    rows: Indices  # (L,)
    columns: Indices  # (L,)


class Span(NamedTuple):
    """Where the centers of a block's samples lie, camera axes."""

    near: float  # depths
    far: float
    left: float  # x and y, at depth 1 in perspective
    right: float
    top: float
    bottom: float


@kernel
def _set_corners(corner: Doubles, blocks: Blocks, n: int, eye: Eye) -> None:
    """Corners (8, 3) of a block's box, camera axes."""
    for k in range(8):
        x = blocks.high[n, 0] if k & 1 else blocks.low[n, 0]
        y = blocks.high[n, 1] if k & 2 else blocks.low[n, 1]
        z = blocks.high[n, 2] if k & 4 else blocks.low[n, 2]
        world = (float(x), float(y), float(z))
        place = combine(eye.shift, 1.0, multiply(eye.rotation, world))
        corner[k, 0], corner[k, 1], corner[k, 2] = place


@kernel
def _span_of(corner: Doubles, perspective: bool) -> Span:
    """Extent of a box; x and y mean something if it is in front of the eye."""
    near = left = top = np.inf
    far = right = bottom = -np.inf
    for k in range(8):
        z = corner[k, 2]
        x = corner[k, 0] / z if perspective else corner[k, 0]
        y = corner[k, 1] / z if perspective else corner[k, 1]
        near, far = min(near, z), max(far, z)
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
    return Span(near, far, left, right, top, bottom)


@kernel
def _is_beside(corner: Doubles, sides: Doubles, reach: float) -> bool:
    """Whether all ellipsoids with centers in a box lie outside one side of the frame."""
    for side in range(4):
        nearest = np.inf
        for k in range(8):
            value = sides[side, 3]
            for axis in range(3):
                value += sides[side, axis] * corner[k, axis]
            nearest = min(nearest, value)
        if nearest > ROUNDING * reach:
            return True
    return False


@kernel
def _is_clipped(corner: Doubles, planes: Doubles) -> bool:
    """Whether all ellipsoids with centers in a box lie beyond a clipping plane."""
    for n in range(planes.shape[0]):
        inside = -np.inf
        for k in range(8):
            value = planes[n, 3]
            for axis in range(3):
                value += planes[n, axis] * corner[k, axis]
            inside = max(inside, value)
        if inside <= -(1.0 + ROUNDING) * planes[n, 4]:
            return True
    return False


@kernel
def _longest(x: float, y: float, eye: Eye, shape: Shape) -> tuple[float, float, float]:
    """Half axis of the affine footprint at depth 1 of a ray, px, and its derivatives there.

    It is a convex function of the ray's place: the largest length of vectors that are linear in it.
    """
    v, fx, fy = shape.covariance, eye.fx, eye.fy
    xx = fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
    yy = fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
    xy = fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    across, down = math.cos(angle), math.sin(angle)
    squared = across * across * xx + 2.0 * across * down * xy + down * down * yy
    length = math.sqrt(squared)
    w = (fx * across, fy * down, -(fx * across * x + fy * down * y))
    along = v[2][0] * w[0] + v[2][1] * w[1] + v[2][2] * w[2]
    return length, -fx * across * along / length, -fy * down * along / length


@kernel
def _least_spacing(span: Span, is_near: bool, eye: Eye, shape: Shape) -> float:
    """Distance on screen, px, that no two neighbours in a block fall short of."""
    if not eye.perspective:
        return _longest(0.0, 0.0, eye, shape)[0] / shape.radius
    v = shape.covariance
    least = max(  # wherever the ray is
        eye.fx * math.sqrt(max(0.0, v[0][0] - v[0][2] * v[0][2] / v[2][2])),
        eye.fy * math.sqrt(max(0.0, v[1][1] - v[1][2] * v[1][2] / v[2][2])),
    )
    if not is_near:
        x, y = 0.5 * (span.left + span.right), 0.5 * (span.top + span.bottom)
        length, by_x, by_y = _longest(x, y, eye, shape)
        length -= abs(by_x) * (span.right - x) + abs(by_y) * (span.bottom - y)
        least = max(least, length)
    return least / (max(span.far, 1e-30) * shape.radius)


@kernel
def _reach_px(half: Vector, spacing: float, shape: Shape, style: Style) -> float:
    """How far samples may touch pixels beside their centers, along one axis.

    `half` holds a bound of their ellipses' half extent, `spacing` one of their spacing.
    """
    reach = half[0]
    if style.model == SMALL_ANGLE:
        reach *= math.sqrt(2.0)
    if style.inflated > 0.0:
        reach = max(reach, style.inflated * shape.radius)
    if style.blurred > 0.0:
        reach = math.sqrt(reach * reach + style.blurred)
    point = style.point_extent
    if style.variance > 0.0:
        point *= math.sqrt(style.variance * spacing * spacing + 1.0 / 12.0)
    return max(reach, point)


@kernel
def _bound(
    bounds: Doubles, n: int, span: Span, eye: Eye, shape: Shape, screen: Screen, style: Style
) -> None:
    """Bounds of the pixels that a block in front of the near plane may touch."""
    reach_x, reach_y, reach_z = (
        math.sqrt(shape.covariance[0][0]),
        math.sqrt(shape.covariance[1][1]),
        math.sqrt(shape.covariance[2][2]),
    )
    wide, high = eye.fx * reach_x, eye.fy * reach_y
    if eye.perspective:  # the farthest that planes through the eye touch from the center
        nearest = span.near - reach_z
        wide = (wide + eye.fx * max(-span.left, span.right) * reach_z) / nearest
        high = (high + eye.fy * max(-span.top, span.bottom) * reach_z) / nearest
    spacing = math.sqrt(wide * wide + high * high) / shape.radius
    wide = _reach_px((wide, 0.0, 0.0), spacing, shape, style)
    high = _reach_px((high, 0.0, 0.0), spacing, shape, style)
    left, right = eye.fx * span.left + eye.cx - wide, eye.fx * span.right + eye.cx + wide
    top, bottom = eye.fy * span.top + eye.cy - high, eye.fy * span.bottom + eye.cy + high
    bounds[n, 0] = left - ROUNDING * abs(left) - ROUNDING_PX
    bounds[n, 1] = top - ROUNDING * abs(top) - ROUNDING_PX
    bounds[n, 2] = right + ROUNDING * abs(right) + ROUNDING_PX
    bounds[n, 3] = bottom + ROUNDING * abs(bottom) + ROUNDING_PX
    if (
        bounds[n, 2] < -screen.margin
        or bounds[n, 0] > screen.width + screen.margin
        or bounds[n, 3] < -screen.margin
        or bounds[n, 1] > screen.height + screen.margin
    ):
        _leave_out(bounds, n)


@kernel
def _leave_out(bounds: Doubles, n: int) -> None:
    bounds[n, 0], bounds[n, 1], bounds[n, 2], bounds[n, 3] = 1.0, 1.0, 0.0, 0.0


@kernel
def _distance(blocks: Blocks, n: int, view: View) -> float:
    """Distance of a block's box from the eye, scene units."""
    squared = 0.0
    for axis in range(3):
        eye = 0.0
        for row in range(3):
            eye -= view.rotation[row, axis] * view.translation[row]
        away = max(0.0, float(blocks.low[n, axis]) - eye, eye - float(blocks.high[n, axis]))
        squared += away * away
    return math.sqrt(squared)


@kernel
def outline_blocks(
    blocks: Blocks,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    by_distance: bool,
    outlines: Outlines,
) -> None:
    """Fill in what is known of blocks; keys are distances from the eye if asked for, or depths."""
    eye, shape = eye_of(view), shape_of(ellipsoid)
    reach = math.sqrt(shape.covariance[2][2])
    # Points reach as far as their filter, and wider footprints as far as they were made to.
    has_sides = style.inflated == 0.0 and style.blurred == 0.0
    corner = np.zeros((8, 3))
    bounds, front, spacing = outlines.bounds, outlines.front, outlines.spacing
    for n in range(bounds.shape[0]):
        _set_corners(corner, blocks, n, eye)
        span = _span_of(corner, eye.perspective)
        tolerance = ROUNDING * (abs(span.near) + abs(span.far) + reach)
        is_near = span.near - reach <= eye.near + tolerance
        is_near = is_near or (eye.perspective and span.near <= reach + tolerance)
        front[n] = span.near
        if eye.perspective and by_distance and not is_near:
            front[n] = _distance(blocks, n, view)
        front[n] -= ROUNDING * abs(front[n])
        spacing[n] = (1.0 - ROUNDING) * _least_spacing(span, is_near, eye, shape)
        if span.far + reach <= eye.near - tolerance or _is_clipped(corner, screen.planes):
            _leave_out(bounds, n)
        elif not is_near:
            _bound(bounds, n, span, eye, shape, screen, style)
        elif has_sides and spacing[n] > style.threshold and _is_beside(corner, screen.sides, reach):
            _leave_out(bounds, n)
        else:
            bounds[n, 0], bounds[n, 1], bounds[n, 2], bounds[n, 3] = (
                -np.inf,
                -np.inf,
                np.inf,
                np.inf,
            )


@kernel
def mark_doubtful(
    outlines: Outlines,
    screen: Screen,
    style: Style,
    size: int,
    columns: int,
    smallest: Floats,
    doubtful: Flags,
) -> None:
    """Mark blocks that may need a finer grid than the smallest spacing known of a tile (T,) does.

    `columns` tiles of `size` px lie in a row.
    """
    subpixels = np.zeros(smallest.size, np.int64)
    for tile in range(smallest.size):
        subpixels[tile] = grid(smallest[tile], style)
    bounds, rows = outlines.bounds, smallest.size // columns
    for n in range(bounds.shape[0]):
        doubtful[n] = False
        if bounds[n, 0] > bounds[n, 2]:
            continue
        finest = grid(outlines.spacing[n], style)
        left, right = tiles_met(bounds[n, 0], bounds[n, 2], screen.margin, size, columns)
        top, bottom = tiles_met(bounds[n, 1], bounds[n, 3], screen.margin, size, rows)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                doubtful[n] = doubtful[n] or finest > subpixels[row * columns + column]


@kernel
def lay_out(
    spacing: Floats,
    size: int,
    columns: int,
    screen: Screen,
    style: Style,
    margin: int,
    start: Indices,
) -> None:
    """Where the canvases of tiles (T,) begin, (T + 1,), for `Canvases`."""
    for tile in range(spacing.size):
        _, _, rows, across = laid_out(
            tile, size, columns, grid(spacing[tile], style), margin, screen
        )
        start[tile + 1] = start[tile] + rows * across * 8


@kernel
def _go_on(
    tile: int,
    tiles: Tiles,
    footprints: Records,
    sheets: Sheets,
    key_bits: NDArray[np.uint32],
    first: int,
    last: int,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    canvases: Canvases,
    tally: Tally,
) -> None:
    """Paint those samples of a tile whose sheets are numbered from `first` to before `last`."""
    members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
    count = 0
    for n in range(members.size):
        if first <= sheets.sheet[members[n]] < last:
            members[count] = members[n]
            count += 1
    if count == 0:
        return
    members = members[:count]
    subpixels, margin = grid(tiles.spacing[tile], style), tables.pixel_margin
    tally[tile, 3] = subpixels
    home, place, rows, columns = laid_out(
        tile, tiles.size, tiles.columns, subpixels, margin, screen
    )
    part = canvases.pixel[canvases.start[tile] : canvases.start[tile + 1]]
    pixel = part.reshape((rows, columns, 8))
    still_open = canvases.still_open[tile]
    if still_open < 0:
        still_open = rows * columns
        pixel[:] = np.float32(0.0)
        pixel[:, :, 3] = np.float32(1.0)
        pixel[:, :, 6] = np.float32(np.inf)
    ray = np.zeros((rows, columns, 2), np.float32)
    if still_open > 0:
        put_in_order(members, key_bits, footprints)
        if style.model in (EXACT, DISC):
            cast_rays(ray, place, view, ellipsoid)
    sheet, dirty = np.zeros((rows, columns, 8), np.float32), np.array([rows, 0, columns, 0])
    canvases.still_open[tile] = paint_members(
        members,
        footprints,
        sheets,
        Canvas(pixel, sheet, ray, dirty),
        place,
        home,
        view,
        ellipsoid,
        screen.planes,
        style,
        tables,
        still_open,
        tally[tile],
    )
    if still_open > 0:
        _note_light(pixel, subpixels, canvases.light[tile])


@kernel
def _note_light(pixel: Floats, n: int, light: Floats) -> None:
    """Largest transmittance of each px's sub-pixels."""
    for row in range(pixel.shape[0] // n):
        for column in range(pixel.shape[1] // n):
            largest = np.float32(0.0)
            for r in range(row * n, (row + 1) * n):
                for c in range(column * n, (column + 1) * n):
                    largest = max(largest, pixel[r, c, 3])
            light[row, column] = largest


@parallel_kernel
def paint_pass(
    counter: Counter,
    turn: Indices,
    tiles: Tiles,
    footprints: Records,
    sheets: Sheets,
    key_bits: NDArray[np.uint32],
    first: int,
    last: int,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    canvases: Canvases,
    tally: Tally,
) -> None:
    """Go on with the tiles listed in `turn`, by the sheets from `first` to before `last`."""
    for place in tasks(counter, turn.size):
        _go_on(
            turn[place],
            tiles,
            footprints,
            sheets,
            key_bits,
            first,
            last,
            view,
            ellipsoid,
            screen,
            style,
            tables,
            canvases,
            tally,
        )


@kernel
def _resolve_tile(
    tile: int,
    spacing: Floats,
    size: int,
    columns: int,
    screen: Screen,
    style: Style,
    tables: Tables,
    canvases: Canvases,
    film: Film,
) -> None:
    if canvases.still_open[tile] < 0:
        return
    subpixels = grid(spacing[tile], style)
    home, _, rows, across = laid_out(tile, size, columns, subpixels, tables.pixel_margin, screen)
    part = canvases.pixel[canvases.start[tile] : canvases.start[tile + 1]]
    pixel = part.reshape((rows, across, 8))
    resolve(pixel, subpixels, pixel_weights(tables, subpixels), home, film)


@parallel_kernel
def resolve_tiles(
    counter: Counter,
    spacing: Floats,
    size: int,
    columns: int,
    screen: Screen,
    style: Style,
    tables: Tables,
    canvases: Canvases,
    film: Film,
) -> None:
    """Filter the canvases of tiles (T,) of some spacing and size to a film (H, W)."""
    for tile in tasks(counter, spacing.size):
        _resolve_tile(
            tile,
            spacing,
            size,
            columns,
            screen,
            style,
            tables,
            canvases,
            film,
        )


@kernel
def _fill_finest(light: Floats, size: int, columns: int, pyramid: Pyramid) -> None:
    """Fill in the finest level: px that several canvases hold are as light as the lightest."""
    rows, side = light.shape[0] // columns, light.shape[1]
    height, width = pyramid.rows[0], pyramid.columns[0]
    for n in range(height * width):
        pyramid.light[n] = np.float32(0.0)
    for tile in range(rows * columns):
        top, left = tile // columns * size, tile % columns * size
        for row in range(min(side, height - top)):
            start = (top + row) * width + left
            for column in range(min(side, width - left)):
                here = max(pyramid.light[start + column], light[tile, row, column])
                pyramid.light[start + column] = here


@kernel
def fill_pyramid(light: Floats, size: int, columns: int, pyramid: Pyramid) -> None:
    """Fill in all levels from the `light` of tiles of `size` px, `columns` in a row."""
    _fill_finest(light, size, columns, pyramid)
    level_light = pyramid.light
    for level in range(1, pyramid.rows.size):
        rows, below = pyramid.rows[level - 1], pyramid.start[level - 1]
        across, place = pyramid.columns[level - 1], pyramid.start[level]
        for row in range(0, rows, 2):
            for column in range(0, across, 2):
                largest = np.float32(0.0)
                for r in range(row, min(row + 2, rows)):
                    for c in range(column, min(column + 2, across)):
                        largest = max(largest, level_light[below + r * across + c])
                level_light[place] = largest
                place += 1


@kernel
def _is_covered(
    top: int, bottom: int, left: int, right: int, pyramid: Pyramid, opaque: Single, todo: Indices
) -> bool:
    """Whether no light comes through the pixels from `top` to `bottom` and `left` to `right`.

    `todo` (K, 3) is room for level, row and column of squares that remain to be looked at.
    """
    todo[0, 0], todo[0, 1], todo[0, 2] = pyramid.rows.size - 1, 0, 0
    count = 1
    while count > 0:
        count -= 1
        level, row, column = todo[count, 0], todo[count, 1], todo[count, 2]
        columns = pyramid.columns[level]
        if pyramid.light[pyramid.start[level] + row * columns + column] <= opaque:
            continue
        if level == 0:
            return False
        for r in range(2 * row, min(2 * row + 2, pyramid.rows[level - 1])):
            for c in range(2 * column, min(2 * column + 2, pyramid.columns[level - 1])):
                side = 1 << (level - 1)
                if (
                    r * side <= bottom
                    and (r + 1) * side > top
                    and c * side <= right
                    and (c + 1) * side > left
                ):
                    todo[count, 0], todo[count, 1], todo[count, 2] = level - 1, r, c
                    count += 1
    return True


@kernel
def mark_covered(
    block: Indices, bounds: Doubles, margin: int, pyramid: Pyramid, style: Style, covered: Flags
) -> None:
    """Mark those of the blocks (K,) behind which nothing could be seen, by the pyramid's light."""
    todo = np.zeros((4 * pyramid.rows.size + 1, 3), np.int64)
    opaque = np.float32(style.opaque)
    most_row, most_column = pyramid.rows[0] - 1.0, pyramid.columns[0] - 1.0
    for k in range(block.size):
        n = block[k]
        left = math.floor(max(0.0, min(bounds[n, 0] + margin, most_column + 1.0)))
        top = math.floor(max(0.0, min(bounds[n, 1] + margin, most_row + 1.0)))
        right = math.floor(max(-1.0, min(bounds[n, 2] + margin, most_column)))
        bottom = math.floor(max(-1.0, min(bounds[n, 3] + margin, most_row)))
        is_empty = left > right or top > bottom
        covered[k] = is_empty or _is_covered(top, bottom, left, right, pyramid, opaque, todo)
