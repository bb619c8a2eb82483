"""Color of a sub-pixel by look-ups in the texture.

For sub-pixels that no cell reached, and for textures that are too compressed for cells. A sub-pixel
may cover very many texels in one direction and few in the other. The few decide the level, and the
texture is looked up at several places spread evenly over the sub-pixel.
"""

import math

import numpy as np

from resample.engine.jit import inner_kernel
from resample.engine.vectors import Matrix, column, dot, multiply
from resample.engine.windows.edges import WRAP, mapped
from resample_texture.mesh.kernels.color import MASK, OPAQUE, Skin
from resample_texture.mesh.kernels.surfaces import (
    Place,
    ProjectedTriangles,
    barycentric,
    matrix_at,
    texture_place,
)
from resample_texture.texels.kernels.texels import DENSE, phase

Layer = tuple[float, float, float, float]  # red, green, blue, premultiplied by alpha, and alpha

MOST_TAPS = 64.0  # per sub-pixel; a texture more anisotropic than that is read at a smaller level
MASKED_TAPS = 4.0  # per sub-pixel, at least, where a mask cuts
ROUNDING = 1e-5  # of a constant alpha, interpolated
TOO_MANY_TEXELS = 1e15  # per sub-pixel; beyond, a texture is its mean
DENSITY = 2.0  # looks per texel
GOLDEN = 0.6180339887498949  # multiples of it, modulo 1, fill an interval evenly


@inner_kernel
def _sample_level(skin: Skin, texture: int, level: int, place: Place) -> Layer:
    """Interpolate a texture's level at (u, t): premultiplied color, and alpha."""
    base, mode = skin.level[texture, level, 0], skin.mode[texture]
    height, width = skin.level[texture, level, 1], skin.level[texture, level, 2]
    edge_u, edge_t = skin.edge[texture, 0], skin.edge[texture, 1]
    # Find the texel and the phases of its taps.
    column, part_u = _nearest(place[0], width, edge_u)
    row, part_t = _nearest(place[1], height, edge_t)
    half = skin.taps.shape[0] // 2
    # Sum the taps along both axes.
    red, green, blue, alpha = 0.0, 0.0, 0.0, 0.0
    for k in range(-half, half + 1):
        line = base + mapped(row + k, height, edge_t) * width * 3
        for m in range(-half, half + 1):
            at = line + mapped(column + m, width, edge_u) * 3
            weight = skin.taps[half + k, part_t] * skin.taps[half + m, part_u]
            red += weight * skin.texel[at]
            green += weight * skin.texel[at + 1]
            blue += weight * skin.texel[at + 2]
            if mode != OPAQUE:
                alpha += weight * skin.alpha[at // 3]
    # Apply the alpha mode: opaque, cut by a mask, or blended.
    if mode == OPAQUE:
        return red, green, blue, 1.0
    if mode == MASK and level == 0:
        is_seen = alpha + ROUNDING >= skin.cutoff[texture]
        return (red, green, blue, 1.0) if is_seen else (0.0, 0.0, 0.0, 0.0)
    return red, green, blue, max(0.0, min(1.0, alpha))


@inner_kernel
def _nearest(place: float, size: int, edge: int) -> tuple[int, int]:
    """Texel at a texture coordinate, and the column of taps for the place within it."""
    turn = float(np.floor(place))
    along = (place - turn) * size
    texel = min(int(along), size - 1)
    part = phase(min(int((along - texel) * DENSE), DENSE - 1), DENSE)
    return (texel if edge == WRAP else texel + int(turn) * size), part


@inner_kernel
def _slope(matrix: Matrix, skin: Skin, n: int, axis: int, value: float) -> Place:
    """Derivatives of u or t by x and y, times the weights' sum.

    `value` is u or t at the place.
    """
    corner = (
        skin.uv[n, 0, axis] - value,
        skin.uv[n, 1, axis] - value,
        skin.uv[n, 2, axis] - value,
    )
    return dot(corner, column(matrix, 0)), dot(corner, column(matrix, 1))


@inner_kernel
def _reach(triangles: ProjectedTriangles, skin: Skin, n: int, place: Place, fine: float) -> Place:
    """Most and fewest texels that a sub-pixel covers: axes of its ellipse.

    `fine` is its size, px.
    """
    # Differentiate the texture coordinates by x and y, in texels per sub-pixel.
    matrix = matrix_at(triangles.weight, n)
    weight = multiply(matrix, (place[0], place[1], 1.0))
    scale = fine / (weight[0] + weight[1] + weight[2])
    texture, at = skin.texture[n], texture_place(triangles, skin.uv, n, place)
    across = scale * skin.level[texture, 0, 2]
    down = scale * skin.level[texture, 0, 1]
    ux, uy = _slope(matrix, skin, n, 0, at[0])
    tx, ty = _slope(matrix, skin, n, 1, at[1])
    # Take the singular values of the Jacobian: the longer axis, and the area over it.
    area = abs(across * down * (ux * ty - uy * tx))
    squares = across * across * (ux * ux + uy * uy) + down * down * (tx * tx + ty * ty)
    rest = max(0.0, squares * squares - 4.0 * area * area)
    most = math.sqrt(0.5 * (squares + math.sqrt(rest)))
    return most, (area / most if most > 0.0 else 0.0)


@inner_kernel
def _level_and_taps(skin: Skin, texture: int, reach: Place) -> tuple[int, int]:
    """Level for a sub-pixel that covers `reach` texels, and the number of look-ups."""
    most, fewest = reach
    # At the horizon, take the smallest level, which is the mean.
    if not most < TOO_MANY_TEXELS:
        return skin.levels[texture] - 1, 1
    # Choose the level by the shorter axis, or a smaller one if the longer needs too many looks.
    level, texel = 0, 1.0
    while level + 1 < skin.levels[texture]:
        if 2.0 * texel > fewest and most * max(texel, fewest) <= MOST_TAPS * texel * texel:
            break
        level, texel = level + 1, 2.0 * texel
    # Spread look-ups evenly along the longer axis; a mask needs a few in any case.
    taps = min(MOST_TAPS, math.ceil(DENSITY * most / texel * max(1.0, fewest / texel)))
    least = MASKED_TAPS if skin.mode[texture] == MASK else 1.0
    return level, int(max(least, taps))


@inner_kernel
def evaluate(
    triangles: ProjectedTriangles, skin: Skin, n: int, place: Place, corner: Place, fine: float
) -> Layer:
    """Color of triangle n over a sub-pixel that shows it at `place`.

    `corner` and `fine` are the sub-pixel's corner and size, px.
    """
    texture = skin.texture[n]
    # Without a texture, interpolate the colors of the corners.
    if texture < 0:
        weight = barycentric(triangles, n, place)
        return (
            dot(weight, (skin.color[n, 0, 0], skin.color[n, 1, 0], skin.color[n, 2, 0])),
            dot(weight, (skin.color[n, 0, 1], skin.color[n, 1, 1], skin.color[n, 2, 1])),
            dot(weight, (skin.color[n, 0, 2], skin.color[n, 1, 2], skin.color[n, 2, 2])),
            1.0,
        )
    # Choose a level and the number of look-ups by what the sub-pixel covers.
    reach = _reach(triangles, skin, n, place, fine)
    level, taps = _level_and_taps(skin, texture, reach)
    if taps == 1:
        return _sample_level(skin, texture, level, texture_place(triangles, skin.uv, n, place))
    # Average look-ups at places of a golden-ratio sequence over the sub-pixel.
    red, green, blue, alpha = 0.0, 0.0, 0.0, 0.0
    for k in range(taps):
        x, y = (k + 0.5) / taps, (k * GOLDEN + 0.5) % 1.0
        at = texture_place(triangles, skin.uv, n, (corner[0] + x * fine, corner[1] + y * fine))
        r, g, b, a = _sample_level(skin, texture, level, at)
        red, green, blue, alpha = red + r, green + g, blue + b, alpha + a
    return red / taps, green / taps, blue / taps, alpha / taps
