"""Color of triangles: the levels of a texture or corners' colors, looked up for a sub-pixel.

For sub-pixels that no cell reached, and for textures that are too compressed for cells. A sub-pixel
may cover very many texels in one direction and few in the other. The few decide the level, and the
texture is looked up at several places spread evenly over the sub-pixel.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.colors import from_srgb
from resample.engine.jit import inner_kernel
from resample.engine.vectors import Matrix, column, dot, multiply
from resample.engine.windows.boxes import WRAP, mapped
from resample.types import Doubles, Floats, Single
from resample_meshes.kernels.surfaces import (
    Ints,
    Place,
    ProjectedTriangles,
    barycentric,
    matrix_at,
    texture_place,
)
from resample_texture.texels.encoding import LONG, SHORT
from resample_texture.texels.kernels.texels import DENSE, phase

OPAQUE, MASK, BLEND = range(3)
Layer = tuple[float, float, float, float]  # red, green, blue, premultiplied by alpha, and alpha

MOST_TAPS = 64.0  # per sub-pixel; a texture more anisotropic than that is read at a smaller level
MASKED_TAPS = 4.0  # per sub-pixel, at least, where a mask cuts
ROUNDING = 1e-5  # of a constant alpha, interpolated
TOO_MANY_TEXELS = 1e15  # per sub-pixel; beyond, a texture is its mean
DENSITY = 2.0  # looks per texel
STEPS = 4096  # of the curve from levels to light, between which it is linear
CURVE = np.asarray(from_srgb(np.minimum(np.arange(STEPS + 2) / STEPS, 1.0)), np.float32)
GOLDEN = 0.6180339887498949  # multiples of it, modulo 1, fill an interval evenly


class Skin(NamedTuple):
    """Coloring of T triangles."""

    uv: Doubles  # (T, 3, 2) u and t of the vertices
    color: Floats  # (T, 3, 3) linear light at the vertices; read where there is no texture
    light: Floats  # (T, 3) factor at the vertices
    texture: Ints  # (T,) which one; -1: none
    texel: Floats  # (N,) red, green, blue of all levels of all textures, or their coefficients
    level: Ints  # (P, L, 3) where a level begins in `texel`, its height and its width
    levels: Ints  # (P,)
    taps: Floats  # (K, R) of the interpolation, see `texels.phase`
    edge: Ints  # (P, 2) what lies beyond a texture's edges along u and t, see `texels.mapped`
    mode: Ints  # (P,) OPAQUE, MASK or BLEND
    cutoff: Floats  # (P,) least alpha that shows of a mask
    # (N / 3,) alpha beside `texel`, premultiplied into the colors except in a mask's largest level,
    # of levels and of light; its others are means of texels above its cutoff. Empty: all opaque.
    alpha: Floats
    first: Ints  # (P,) largest level of light; 1 if the same in levels of sRGB comes before it


@inner_kernel
def level_for(skin: Skin, texture: int, size: tuple[float, float], widest: float) -> int:
    """Smallest level of light with texels of at most `widest` px.

    `size` is how long u and t are on screen, px.
    """
    found = int(skin.first[texture])
    for k in range(found + 1, skin.levels[texture]):
        height, width = skin.level[texture, k, 1], skin.level[texture, k, 2]
        if max(size[0] / width, size[1] / height) > widest:
            break
        found = k
    return found


@inner_kernel
def fill_line(
    skin: Skin,
    texture: int,
    level: int,
    start: tuple[int, int],
    part: int,
    line: Floats,
    length: int,
) -> None:
    """Interpolate between a level's rows, from a row and column (`start`) on.

    `part` is the column of taps for the place within that row; the first `length` numbers of `line`
    are filled. The texture repeats along u where its edge rule is WRAP.
    """
    row, first = start
    base = skin.level[texture, level, 0]
    height, width = skin.level[texture, level, 1], skin.level[texture, level, 2]
    edge_u, edge_t = skin.edge[texture, 0], skin.edge[texture, 1]
    texel, half = skin.texel, skin.taps.shape[0] // 2
    for m in range(length):
        line[m] = np.float32(0)

    # Add the rows around, skipping those without weight.
    for k in range(-half, half + 1):
        weight = skin.taps[half + k, part]
        if weight == np.float32(0):
            continue
        begin = base + mapped(row + k, height, edge_t) * width * 3
        # Apply the edge rule texel by texel unless rows repeat.
        if edge_u != WRAP:
            _fill_by_texels(line, length, texel, begin, (first, width, edge_u), weight)
            continue
        # A repeating row is added in runs of contiguous memory, as long as the texture is wide.
        column, done = first % width, 0
        while done < length:
            run = min(length - done, 3 * (width - column))
            source, target = np.uint64(begin + 3 * column), np.uint64(done)
            for m in range(run):
                line[target + np.uint64(m)] += weight * texel[source + np.uint64(m)]
            done += run
            column = 0


@inner_kernel
def _fill_by_texels(
    line: Floats,
    length: int,
    texel: Floats,
    begin: int,
    across: tuple[int, int, int],
    weight: float,
) -> None:
    """Add a row that begins at number `begin`, texel by texel.

    `across` is its first column, the level's width and the edge rule.
    """
    first, width, edge = across
    for m in range(0, length, 3):
        at = begin + 3 * mapped(first + m // 3, width, edge)
        for c in range(3):
            line[m + c] += weight * texel[at + c]


@inner_kernel
def lit(triangles: ProjectedTriangles, skin: Skin, n: int, place: Place) -> float:
    """Brightness of a triangle at a place on screen."""
    if len(skin.light) == 0:
        return 1.0
    corners = (skin.light[n, 0], skin.light[n, 1], skin.light[n, 2])
    return dot(barycentric(triangles, n, place), corners)


@inner_kernel
def longer_of(squares: float, area: float) -> float:
    """Larger singular value of a 2 × 2 matrix, by its sum of squares and its determinant."""
    rest = max(0.0, squares * squares - 4.0 * area * area)
    return math.sqrt(0.5 * (squares + math.sqrt(rest)))


@inner_kernel
def share_of_levels(longest: float) -> float:
    """Share of levels in a pixel of this length, texels."""
    return max(0.0, min(1.0, (LONG - longest) / (LONG - SHORT)))


@inner_kernel
def light_of(level: float) -> Single:
    """Light 0..1 of an interpolated level of sRGB."""
    place = np.float32(min(max(0.0, level), 1.0)) * np.float32(STEPS)
    step = np.uint64(np.int32(place))
    part = place - np.float32(step)
    return CURVE[step] + part * (CURVE[step + np.uint64(1)] - CURVE[step])


@inner_kernel
def _sample_level(skin: Skin, texture: int, level: int, place: Place) -> Layer:
    """Interpolate a level of the pyramid at (u, t): premultiplied light, and alpha."""
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
    # Cut a mask's largest level, with straight color; others are premultiplied.
    alpha = 1.0 if mode == OPAQUE else max(0.0, min(1.0, alpha))
    if mode == MASK and level <= skin.first[texture]:
        if alpha + ROUNDING < skin.cutoff[texture]:
            return 0.0, 0.0, 0.0, 0.0
        alpha = 1.0
    # Turn levels into light.
    if level < skin.first[texture] and alpha > 0.0:
        red, green, blue = (
            alpha * light_of(red / alpha),
            alpha * light_of(green / alpha),
            alpha * light_of(blue / alpha),
        )
    return red, green, blue, alpha


@inner_kernel
def _mixed(skin: Skin, texture: int, level: int, share: float, place: Place) -> Layer:
    """Interpolate a level at (u, t), and a share of it in levels of sRGB."""
    if share == 0.0:
        return _sample_level(skin, texture, level, place)
    red, green, blue, alpha = _sample_level(skin, texture, 0, place)
    if share == 1.0:
        return red, green, blue, alpha
    r, g, b, a = _sample_level(skin, texture, level, place)
    rest = 1.0 - share
    return (
        share * red + rest * r, share * green + rest * g, share * blue + rest * b,
        share * alpha + rest * a,
    )  # fmt: skip


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
    most = longer_of(squares, area)
    return most, (area / most if most > 0.0 else 0.0)


@inner_kernel
def _level_and_taps(skin: Skin, texture: int, reach: Place) -> tuple[int, int]:
    """Level for a sub-pixel that covers `reach` texels, and the number of look-ups."""
    most, fewest = reach
    # At the horizon, take the smallest level, which is the mean.
    if not most < TOO_MANY_TEXELS:
        return skin.levels[texture] - 1, 1
    # Choose the level by the shorter axis, or a smaller one if the longer needs too many looks.
    level, texel = skin.first[texture], 1.0
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
    # Choose a level and the number of look-ups by the sub-pixel's footprint.
    reach = _reach(triangles, skin, n, place, fine)
    level, taps = _level_and_taps(skin, texture, reach)
    levels = share_of_levels(reach[0] / fine) if level == skin.first[texture] == 1 else 0.0
    if taps == 1:
        return _mixed(skin, texture, level, levels, texture_place(triangles, skin.uv, n, place))
    # Average look-ups at places of a golden-ratio sequence over the sub-pixel.
    red, green, blue, alpha = 0.0, 0.0, 0.0, 0.0
    for k in range(taps):
        x, y = (k + 0.5) / taps, (k * GOLDEN + 0.5) % 1.0
        at = texture_place(triangles, skin.uv, n, (corner[0] + x * fine, corner[1] + y * fine))
        r, g, b, a = _mixed(skin, texture, level, levels, at)
        red, green, blue, alpha = red + r, green + g, blue + b, alpha + a
    return red / taps, green / taps, blue / taps, alpha / taps
