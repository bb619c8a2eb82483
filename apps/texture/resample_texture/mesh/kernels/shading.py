"""Sub-pixels get their colors: from what cells left there, or from the texture.

What one can see through is taken layer by layer, front to back, whatever the order of triangles.
(Everitt, Interactive order-independent transparency, 2001.)
"""

import numpy as np

from resample.engine.jit import kernel
from resample_texture.mesh.kernels.color import OPAQUE, Skin, lit
from resample_texture.mesh.kernels.looking import Layer, evaluate
from resample_texture.mesh.kernels.outlines import NOTHING, covered
from resample_texture.mesh.kernels.surfaces import Lens, Triangles
from resample_texture.mesh.kernels.tiles import Block, sample

LEAST_WEIGHT = 1e-2  # sub-pixels²; a sub-pixel that got less is looked up
FULL = 1.0 - 1e-3  # alpha beyond which nothing shows through


@kernel
def is_looked_up(triangles: Triangles, skin: Skin, n: int) -> bool:
    """Whether a triangle has no cells: its texture has no area, or one may see through it."""
    texture = skin.texture[n]
    return bool(texture < 0 or triangles.determinant[n] == 0.0 or skin.mode[texture] != OPAQUE)


@kernel
def _color(triangles: Triangles, skin: Skin, block: Block, row: int, column: int) -> Layer:
    """Color and alpha of the triangle that a sub-pixel shows."""
    n, sums, fine = block.owner[row, column], block.sums, 1.0 / block.samples
    place, weight = sample(block, row, column), sums[row, column, 3]
    texture = skin.texture[n]
    is_reached = weight > LEAST_WEIGHT and (texture < 0 or skin.mode[texture] == OPAQUE)
    if is_reached:
        red, green, blue = (
            sums[row, column, 0] / weight,
            sums[row, column, 1] / weight,
            sums[row, column, 2] / weight,
        )
        alpha = 1.0
    else:
        corner = (block.left + column * fine, block.top + row * fine)
        red, green, blue, alpha = evaluate(triangles, skin, n, place, corner, fine)
    light = lit(triangles, skin, n, place)
    rows, columns = block.owner.shape
    margin = block.margin * block.samples
    if margin <= row < rows - margin and margin <= column < columns - margin:
        block.tally[2] += 1
        block.tally[3] += not is_reached and texture >= 0
    return light * red, light * green, light * blue, alpha


@kernel
def shade(triangles: Triangles, skin: Skin, lens: Lens, block: Block) -> None:
    """Turn sums into colors and coverage, and nearness into depth, where nothing shows through."""
    sums = block.sums
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            if block.owner[row, column] < 0:
                block.nearness[row, column] = np.inf
                continue
            color, cover = _color(triangles, skin, block, row, column), covered(block, row, column)
            sums[row, column, 0] = cover * color[0]
            sums[row, column, 1] = cover * color[1]
            sums[row, column, 2] = cover * color[2]
            sums[row, column, 3] = cover
            nearness = block.nearness[row, column]
            block.nearness[row, column] = 1.0 / nearness if lens.perspective else -nearness


@kernel
def put_behind(triangles: Triangles, skin: Skin, block: Block) -> bool:
    """Put the layer at hand behind those before; gives whether another may show through."""
    seen, again = block.seen, False
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            if block.owner[row, column] < 0:
                block.limit[row, column] = -np.inf
                continue
            color = _color(triangles, skin, block, row, column)
            rest, nearness = 1.0 - seen[row, column, 3], block.nearness[row, column]
            if color[3] > 0.0 and seen[row, column, 3] == np.float32(0):
                block.front[row, column] = nearness
            seen[row, column, 0] += rest * color[0]
            seen[row, column, 1] += rest * color[1]
            seen[row, column, 2] += rest * color[2]
            seen[row, column, 3] += rest * color[3]
            is_through = seen[row, column, 3] < FULL
            again = again or is_through
            block.limit[row, column] = nearness if is_through else -np.inf
            block.owner[row, column] = NOTHING
            block.nearness[row, column] = -np.inf
            for c in range(4):
                block.sums[row, column, c] = np.float32(0)
    return again


@kernel
def finish(lens: Lens, block: Block) -> None:
    """Put what is seen of all layers in the place of the last one's sums and nearness."""
    sums, seen = block.sums, block.seen
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            cover, front = covered(block, row, column), block.front[row, column]
            for c in range(4):
                sums[row, column, c] = cover * seen[row, column, c]
            depth = 1.0 / front if lens.perspective else -front
            block.nearness[row, column] = depth if front > -np.inf else np.inf
