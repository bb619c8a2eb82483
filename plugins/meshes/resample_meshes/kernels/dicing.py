"""Dice a triangle into cells of its texture, at most a sub-pixel wide on screen.

Cells are parts of a texel where the texture is magnified, texels of a smaller level where it is
minified. (Cook, Carpenter and Catmull, The Reyes Image Rendering Architecture, 1987.)

Each cell's center is projected by the triangle's homography. The cell adds its color, weighted by
its area on screen, to those sub-pixels beneath that show its triangle or the same surface.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import within
from resample.engine.jit import kernel, making_kernel
from resample.engine.vectors import Matrix
from resample.engine.windows.footprints import area, box, crossing, reach
from resample.types import Doubles, Floats, Single
from resample_meshes.kernels.sampling import (
    Skin,
    fill_line,
    level_for,
    light_of,
    longer_of,
    share_of_levels,
)
from resample_meshes.kernels.surfaces import (
    Place,
    ProjectedTriangles,
    VisibilityCamera,
    cut_out,
    matrix_at,
    stretch,
    stretched,
    texture_place,
)
from resample_meshes.kernels.visibility import SubpixelGrid, TileBuffer, is_beside
from resample_texture.texels.kernels.texels import phase

Color = tuple[Single, Single, Single]

SLACK = 1e-3  # cells; tolerance for the rounded edges of a part
TINY = 1e-30  # px², area of a texel
SMALLEST = 1e-6  # sub-pixels; keeps divisions finite
MOST_CELLS = 64.0  # per sub-pixel; a texture more anisotropic than that is looked up instead
MOST_LINES = 256.0  # of cells, per sub-pixel along the clipped part
MOST_CUTS = 1e6  # cells along a texel
MOST_WAITING = 64  # parts of a tile; 8 quarterings leave 3 each
UNEVEN = 2.0  # sizes of a texture within a part of a tile may differ by this factor


class TextureDicing(NamedTuple):
    """How a texture is cut into cells."""

    level: int
    along_u: int  # cells per texel
    along_t: int


@kernel
def _add(
    block: TileBuffer,
    center: Place,
    extent: Place,
    weight: float,
    color: Color,
    n: int,
    triangles: ProjectedTriangles,
    lens: VisibilityCamera,
) -> bool:
    """Add a cell to the sub-pixels that show its surface.

    `center` and `extent` are in the block's sub-pixels. Returns whether any shows it.
    """
    total = block.sums
    rows, columns = block.owner.shape

    # Take the box around the cell; its weight spreads evenly over it.
    left, right = center[0] - 0.5 * extent[0], center[0] + 0.5 * extent[0]
    top, bottom = center[1] - 0.5 * extent[1], center[1] + 0.5 * extent[1]
    share = weight / (extent[0] * extent[1])
    seen = False
    for row in range(max(0, math.floor(top)), min(rows, math.floor(bottom) + 1)):
        # Visit the sub-pixels that the box overlaps.
        north, south = within(top, bottom, float(row))
        high = share * (south - north)
        for column in range(max(0, math.floor(left)), min(columns, math.floor(right) + 1)):
            owner = block.owner[row, column]
            # Skip sub-pixels of other surfaces; neighbouring triangles of one surface share them.
            if owner != n:
                if owner < 0:
                    continue
                place = (
                    block.left + center[0] / block.samples,
                    block.top + center[1] / block.samples,
                )
                if not is_beside(triangles, n, owner, place, lens):
                    continue
            # Add the color by the overlap's area; read all before writing, to make it one addition.
            west, east = within(left, right, float(column))
            part = np.float32(high * (east - west))
            r, c = np.uint64(row), np.uint64(column)
            red, green = total[r, c, 0] + part * color[0], total[r, c, 1] + part * color[1]
            blue, mass = total[r, c, 2] + part * color[2], total[r, c, 3] + part
            total[r, c, 0], total[r, c, 1], total[r, c, 2], total[r, c, 3] = red, green, blue, mass
            seen = True
    return seen


@kernel
def _between(texels: Floats, at: int, taps: Floats, part: int, count: int) -> Color:
    """Interpolate a line of texels by `count` taps, starting at its number `at`."""
    red = green = blue = np.float32(0)
    for k in range(count):
        weight, m = taps[k, part], np.uint64(at) + np.uint64(3 * k)
        red += weight * texels[m]
        green += weight * texels[m + np.uint64(1)]
        blue += weight * texels[m + np.uint64(2)]
    return red, green, blue


@kernel
def _crossed(block: TileBuffer, count: int, height: float) -> Place:
    """Where a line of cells begins and ends, in cells.

    The triangle's own corners decide at its edges: both triangles at an edge compute with the same
    numbers, and a cell belongs to exactly one of them. The `count` corners of the visible part are
    rounded, as they come from the screen; they only keep lines short.
    """
    low, high = crossing(block.corner, 3, height)
    left, right = crossing(block.rim, count, height)
    if left > right:
        left, _, right, _ = box(block.rim, count)
    return max(low, left - SLACK), min(high, right + SLACK)


@kernel
def _extent(forward: Matrix, place: Place, step: Place, samples: int) -> Place:
    """Box around a cell, sub-pixels: √(a² + b²) of its two sides along x and y."""
    along_u, along_t = stretch(forward, place)
    return (
        max(SMALLEST, samples * math.hypot(along_u[0] * step[0], along_t[0] * step[1])),
        max(SMALLEST, samples * math.hypot(along_u[1] * step[0], along_t[1] * step[1])),
    )


@kernel
def _shares(
    skin: Skin, texture: int, level: int, forward: Matrix, ends: tuple[float, float], t: float
) -> Place:
    """Share of a level of the texture in pixels at the ends of a line, from u to u.

    Levels of sRGB and the largest level of light share pixels by how long these are.
    """
    if level > skin.first[texture] or skin.first[texture] == 0:
        return 1.0, 1.0
    width, height = skin.level[texture, 0, 2], skin.level[texture, 0, 1]
    one = share_of_levels(_longer_at(forward, (ends[0], t), width, height))
    two = share_of_levels(_longer_at(forward, (ends[1], t), width, height))
    return (one, two) if level == 0 else (1.0 - one, 1.0 - two)


@kernel
def _longer_at(forward: Matrix, place: Place, width: int, height: int) -> float:
    """Longer axis of a pixel, texels: the inverse of a texel's shorter one."""
    (ux, uy), (tx, ty) = stretch(forward, place)
    ux, uy, tx, ty = ux / width, uy / width, tx / height, ty / height
    squares, area = ux * ux + uy * uy + tx * tx + ty * ty, abs(ux * ty - uy * tx)
    return longer_of(squares, area) / max(area, TINY)


@kernel
def _color_at(
    texels: Floats, at: int, beside: int, taps: Floats, part: int, is_encoded: bool
) -> Color:
    """Light of a line of texels, interpolated from its number `at` on, or of one texel."""
    if beside == 0:
        color = texels[at], texels[at + 1], texels[at + 2]
    elif beside == 2:  # a count that is known is unrolled
        color = _between(texels, at, taps, part, 5)
    else:
        color = _between(texels, at, taps, part, taps.shape[0])
    if is_encoded:
        return light_of(color[0]), light_of(color[1]), light_of(color[2])
    return color


@kernel
def paint_cells(
    block: TileBuffer,
    n: int,
    count: int,
    cut: TextureDicing,
    triangles: ProjectedTriangles,
    skin: Skin,
    lens: VisibilityCamera,
) -> tuple[int, int]:
    """Add the cells with centers in a triangle; count all, and the visible ones.

    Levels of sRGB and the largest level of light share the weight by how long pixels are.
    `block.corner` and `block.rim` hold the corners of the triangle n and the `count` corners of its
    visible part, in cells.
    """
    # Set up the homography, the size of a cell in the texture, and its area on screen times w³.
    samples, texture, taps = block.samples, skin.texture[n], skin.taps
    is_encoded = cut.level < skin.first[texture]
    forward = matrix_at(triangles.forward, n)
    (xu, xt, x1), (yu, yt, y1), (wu, wt, w1) = forward
    step_u = 1.0 / (skin.level[texture, cut.level, 2] * cut.along_u)
    step_t = 1.0 / (skin.level[texture, cut.level, 1] * cut.along_t)
    mass = abs(triangles.determinant[n]) * step_u * step_t * samples * samples
    # Allocate a line of texels, padded for the interpolation unless cells are whole texels.
    left, top, right, bottom = box(block.rim, count)
    beside = taps.shape[0] // 2
    if cut.along_u == 1 and taps[beside, 0] == np.float32(1):
        beside = 0
    longest = math.ceil((right - left + 2 * SLACK) / cut.along_u) + 2 + 2 * beside
    texels = np.empty(3 * longest, np.float32)
    points, seen = 0, 0
    for line in range(math.ceil(top - SLACK - 0.5), math.ceil(bottom + SLACK - 0.5)):
        low, high = _crossed(block, count, line + 0.5)
        if not low < high:
            continue
        # Find the cells with centers between the triangle's edges.
        first, last = math.ceil(low - 0.5), math.ceil(high - 0.5)
        if first >= last:
            continue
        # Take the extent of a cell in the middle of the line for all of it.
        t = (line + 0.5) * step_t
        middle = (0.5 * (first + last) * step_u, t)
        extent = _extent(forward, middle, (step_u, step_t), samples)
        # Skip lines near the horizon with cells larger than the tile.
        if not (extent[0] <= len(block.owner) and extent[1] <= len(block.owner)):
            continue
        # The level's share changes evenly along the line.
        ends = first * step_u, last * step_u
        share, end = _shares(skin, texture, cut.level, forward, ends, t)
        if share == end == 0.0:
            continue
        # Interpolate the texture along t, once per line.
        row, column = line // cut.along_t, first // cut.along_u
        vertical, part = phase(line - row * cut.along_t, cut.along_t), first - column * cut.along_u
        needed = 3 * ((last - 1) // cut.along_u - column + 1 + 2 * beside)
        fill_line(skin, texture, cut.level, (row, column - beside), vertical, texels, needed)
        # Walk along u: project each cell's center with one division.
        xw, yw, ww = xt * t + x1, yt * t + y1, wt * t + w1
        at = 0
        for cell in range(first, last):
            u = (cell + 0.5) * step_u
            inverse = 1.0 / (ww + wu * u)
            x = ((xw + xu * u) * inverse - block.left) * samples
            y = ((yw + yu * u) * inverse - block.top) * samples
            # Interpolate the color along u, or take the texel as it is.
            color = _color_at(texels, at, beside, taps, phase(part, cut.along_u), is_encoded)
            points += 1
            # Drop cells behind the camera; the others add their area on screen.
            if 0.0 < inverse < np.inf:
                weight = share * mass * inverse * inverse * inverse
                seen += _add(block, (x, y), extent, weight, color, n, triangles, lens)
            share += (end - share) / (last - cell)
            part = (part + 1) % cut.along_u
            at += 3 * (part == 0)
    return points, seen


@kernel
def _cut(
    skin: Skin, texture: int, level: int, size: Place, finest: float
) -> tuple[TextureDicing, float]:
    """Cut a level into cells at most `1 / finest` px wide; count them."""
    height, width = skin.level[texture, level, 1], skin.level[texture, level, 2]
    along_u = max(1, math.ceil(min(MOST_CUTS, size[0] / width * finest) - 1e-9))
    along_t = max(1, math.ceil(min(MOST_CUTS, size[1] / height * finest) - 1e-9))
    return TextureDicing(level, along_u, along_t), float(width * along_u) * float(height * along_t)


@kernel
def _best_cut(
    skin: Skin, texture: int, size: Place, share: float, room: float, finest: float
) -> tuple[TextureDicing, bool]:
    """Cut of the level that suits a part best, and whether it has few enough cells.

    `size` is how long u and t are on screen, px, `share` the share of the texture that is needed,
    `room` the sub-pixels that it covers.
    """
    level = level_for(skin, texture, size, 1.0 / finest)
    cut, cells = _cut(skin, texture, level, size, finest)
    return cut, share * cells <= MOST_CELLS * room


@kernel
def _set_rim(
    block: TileBuffer, triangles: ProjectedTriangles, uv: Doubles, n: int, count: int
) -> tuple[Place, Place]:
    """Map the clipped polygon to the texture; return least and greatest scales, px."""
    forward = matrix_at(triangles.forward, n)
    least_u, least_t, most_u, most_t = np.inf, np.inf, 0.0, 0.0
    for k in range(count):
        corner = (block.polygon[k, 0], block.polygon[k, 1])
        place = texture_place(triangles, uv, n, corner)
        size_u, size_t = stretched(forward, place)
        least_u, most_u = min(least_u, size_u), max(most_u, size_u)
        least_t, most_t = min(least_t, size_t), max(most_t, size_t)
        block.rim[k, 0], block.rim[k, 1] = place
    return (least_u, least_t), (most_u, most_t)


@kernel
def _quarter(waiting: Doubles, last: int) -> int:
    """Replace the rectangle on top of a stack by its quarters; return the new height."""
    left, top = waiting[last, 0], waiting[last, 1]
    right, bottom = waiting[last, 2], waiting[last, 3]
    x, y = 0.5 * (left + right), 0.5 * (top + bottom)
    for k in range(4):
        waiting[last + k, 0] = left if k % 2 == 0 else x
        waiting[last + k, 1] = top if k < 2 else y
        waiting[last + k, 2] = x if k % 2 == 0 else right
        waiting[last + k, 3] = y if k < 2 else bottom
    return last + 4


@making_kernel
def dice(
    block: TileBuffer,
    n: int,
    triangles: ProjectedTriangles,
    skin: Skin,
    lens: VisibilityCamera,
    grid: SubpixelGrid,
) -> tuple[int, int]:
    """Add a triangle's cells; return how many, and how many were visible.

    Where the scale changes much within the tile, as toward a horizon, the tile is quartered.
    """
    texture, uv = skin.texture[n], skin.uv
    finest, fine = grid.quality * grid.samples, 1.0 / grid.samples

    # Start with the whole tile, a sub-pixel wider on all sides.
    rows, columns = block.owner.shape
    waiting = np.empty((MOST_WAITING, 4))
    waiting[0, 0], waiting[0, 1] = block.left - fine, block.top - fine
    waiting[0, 2], waiting[0, 3] = block.left + (columns + 1) * fine, block.top + (rows + 1) * fine
    pending, points, seen = 1, 0, 0
    while pending > 0:
        pending -= 1
        left, top = waiting[pending, 0], waiting[pending, 1]
        right, bottom = waiting[pending, 2], waiting[pending, 3]
        # Clip the triangle to the rectangle.
        count = cut_out(triangles, n, (left, top, right, bottom), block.polygon, block.spare)
        if count < 3:
            continue
        # Measure the texture's scale at the corners; infinite at the horizon.
        least, most = _set_rim(block, triangles, uv, n, count)
        if not (most[0] < np.inf and most[1] < np.inf):
            continue
        # Quarter the rectangle where the scale varies too much, down to a sub-pixel.
        is_uneven = most[0] > UNEVEN * least[0] or most[1] > UNEVEN * least[1]
        if is_uneven and max(right - left, bottom - top) > fine:
            pending = _quarter(waiting, pending)
            continue
        # Choose a level and a cut; too many cells are left to look-ups in the texture.
        share = area(block.rim, count)
        room = 1.0 + area(block.polygon, count) * finest * finest
        cut, is_few = _best_cut(skin, texture, most, share, room, finest)
        if not is_few:
            continue
        # Scale the triangle and its part from texture coordinates to cells.
        across = skin.level[texture, cut.level, 2] * cut.along_u
        down = skin.level[texture, cut.level, 1] * cut.along_t
        for k in range(3):
            block.corner[k, 0], block.corner[k, 1] = uv[n, k, 0] * across, uv[n, k, 1] * down
        for k in range(count):
            block.rim[k, 0] *= across
            block.rim[k, 1] *= down
        # A texture compressed to a thread has few cells, but on very many lines: look it up.
        along = 1.0 + reach(block.polygon, count) * finest
        if not reach(block.rim, count) < MOST_LINES * along:
            continue
        # Project the cells and add them to the sub-pixels.
        for level in range(0 if cut.level == skin.first[texture] else cut.level, cut.level + 1):
            one = TextureDicing(level, cut.along_u, cut.along_t)
            done = paint_cells(block, n, count, one, triangles, skin, lens)
            points += done[0]
            seen += done[1]
    return points, seen
