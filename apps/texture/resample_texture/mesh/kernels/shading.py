"""Color sub-pixels by the cells that landed there, or by look-ups in the texture.

Translucent triangles are composited layer by layer, front to back, in any order: depth peeling.
(Everitt, Interactive order-independent transparency, 2001.)
"""

import numpy as np

from resample.engine.jit import inner_kernel
from resample_texture.mesh.kernels.color import OPAQUE, Skin, lit
from resample_texture.mesh.kernels.outlines import NOTHING, covered
from resample_texture.mesh.kernels.sampling import Layer, evaluate
from resample_texture.mesh.kernels.surfaces import ProjectedTriangles, VisibilityCamera
from resample_texture.mesh.kernels.tiles import TileBuffer, sample

LEAST_WEIGHT = 1e-2  # sub-pixels²; a sub-pixel that got less is looked up
FULL = 1.0 - 1e-3  # alpha beyond which nothing shows through


@inner_kernel
def is_sampled(triangles: ProjectedTriangles, skin: Skin, n: int) -> bool:
    """Whether a triangle has no cells: its texture has no area, or it is not opaque."""
    texture = skin.texture[n]
    return bool(texture < 0 or triangles.determinant[n] == 0.0 or skin.mode[texture] != OPAQUE)


@inner_kernel
def _is_reached(skin: Skin, block: TileBuffer, row: int, column: int) -> bool:
    """Whether cells gave a sub-pixel its color."""
    texture = skin.texture[block.owner[row, column]]
    is_opaque = texture < 0 or skin.mode[texture] == OPAQUE
    return bool(is_opaque and block.sums[row, column, 3] > LEAST_WEIGHT)


@inner_kernel
def _sampled(
    triangles: ProjectedTriangles, skin: Skin, block: TileBuffer, row: int, column: int
) -> Layer:
    """Color and alpha of the triangle that a sub-pixel shows, from its texture."""
    n, fine = block.owner[row, column], 1.0 / block.samples
    corner = (block.left + column * fine, block.top + row * fine)
    return evaluate(triangles, skin, n, sample(block, row, column), corner, fine)


@inner_kernel
def _mean(block: TileBuffer, row: int, column: int) -> Layer:
    """Weighted mean of the cells that landed in a sub-pixel, opaque."""
    sums, weight = block.sums, block.sums[row, column, 3]
    return (
        sums[row, column, 0] / weight,
        sums[row, column, 1] / weight,
        sums[row, column, 2] / weight,
        1.0,
    )


@inner_kernel
def count(skin: Skin, block: TileBuffer) -> None:
    """Count the tile's own sub-pixels that show a triangle, and those without cells."""
    margin, shown, missed = block.margin * block.samples, 0, 0
    for row in range(margin, block.owner.shape[0] - margin):
        for column in range(margin, block.owner.shape[1] - margin):
            n = block.owner[row, column]
            if n >= 0:
                shown += 1
                missed += skin.texture[n] >= 0 and not _is_reached(skin, block, row, column)
    block.tally[2] += shown
    block.tally[3] += missed


@inner_kernel
def shade(
    triangles: ProjectedTriangles, skin: Skin, lens: VisibilityCamera, block: TileBuffer
) -> None:
    """Turn an opaque layer's sums into color and coverage, its nearness into depth."""
    sums = block.sums
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            n = block.owner[row, column]
            # Nothing is infinitely far away.
            if n < 0:
                block.nearness[row, column] = np.inf
                continue
            # Take the mean of the cells, or look the texture up where too few landed.
            if sums[row, column, 3] > LEAST_WEIGHT:
                color = _mean(block, row, column)
            else:
                color = _sampled(triangles, skin, block, row, column)
            # Weigh by coverage and light.
            cover = covered(block, row, column)
            light = cover * lit(triangles, skin, n, sample(block, row, column))
            sums[row, column, 0] = light * color[0]
            sums[row, column, 1] = light * color[1]
            sums[row, column, 2] = light * color[2]
            sums[row, column, 3] = cover
            # Turn nearness into depth.
            nearness = block.nearness[row, column]
            block.nearness[row, column] = 1.0 / nearness if lens.perspective else -nearness


@inner_kernel
def put_behind(triangles: ProjectedTriangles, skin: Skin, block: TileBuffer) -> bool:
    """Composite the current layer under those in front; tell whether to go on."""
    seen, again = block.visible, False
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            n = block.owner[row, column]
            # Stop peeling where there is no triangle any more.
            if n < 0:
                block.limit[row, column] = -np.inf
                continue
            # Take the mean of the cells, or look the texture up.
            if _is_reached(skin, block, row, column):
                color = _mean(block, row, column)
            else:
                color = _sampled(triangles, skin, block, row, column)
            # Note the depth of the first layer that is not fully transparent.
            rest, nearness = 1.0 - seen[row, column, 3], block.nearness[row, column]
            if color[3] > 0.0 and seen[row, column, 3] == np.float32(0):
                block.front[row, column] = nearness
            # Composite under: what the layers in front let through, times light and color.
            light = rest * lit(triangles, skin, n, sample(block, row, column))
            seen[row, column, 0] += light * color[0]
            seen[row, column, 1] += light * color[1]
            seen[row, column, 2] += light * color[2]
            seen[row, column, 3] += rest * color[3]
            # Peel on behind this layer unless the sub-pixel is opaque by now.
            is_through = seen[row, column, 3] < FULL
            again = again or is_through
            block.limit[row, column] = nearness if is_through else -np.inf
            # Clear the sub-pixel for the next layer.
            block.owner[row, column] = NOTHING
            block.nearness[row, column] = -np.inf
            for c in range(4):
                block.sums[row, column, c] = np.float32(0)
    return again


@inner_kernel
def finish(lens: VisibilityCamera, block: TileBuffer) -> None:
    """Write the composite of all layers in place of a single layer's sums."""
    sums, seen = block.sums, block.visible
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            cover, front = covered(block, row, column), block.front[row, column]
            for c in range(4):
                sums[row, column, c] = cover * seen[row, column, c]
            depth = 1.0 / front if lens.perspective else -front
            block.nearness[row, column] = depth if front > -np.inf else np.inf
