"""Dice a triangle into cells of its texture, at most a sub-pixel wide on screen.

Cells are parts of a texel where the texture is magnified, texels of a smaller level where it is
minified. (Cook, Carpenter and Catmull, The Reyes Image Rendering Architecture, 1987.)
"""

import math

import numpy as np

from resample.engine.jit import kernel, making_kernel
from resample.engine.windows.polygons import area, reach
from resample.types import Doubles
from resample_texture.mesh.kernels.cells import TextureDicing, paint_cells
from resample_texture.mesh.kernels.color import Skin, level_for
from resample_texture.mesh.kernels.surfaces import (
    Place,
    ProjectedTriangles,
    VisibilityCamera,
    cut_out,
    matrix_at,
    stretched,
    texture_place,
)
from resample_texture.mesh.kernels.tiles import SubpixelGrid, TileBuffer

MOST_CELLS = 64.0  # per sub-pixel; a texture more anisotropic than that is looked up instead
MOST_LINES = 256.0  # of cells, per sub-pixel along the clipped part
MOST_CUTS = 1e6  # cells along a texel
MOST_WAITING = 64  # parts of a tile; 8 quarterings leave 3 each
UNEVEN = 2.0  # sizes of a texture within a part of a tile may differ by this factor


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
        done = paint_cells(block, n, count, cut, triangles, skin, lens)
        points += done[0]
        seen += done[1]
    return points, seen
