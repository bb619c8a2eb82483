"""Coloring of triangles: the levels of a texture, or colors at the corners."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel
from resample.engine.vectors import dot
from resample.engine.windows.edges import WRAP, mapped
from resample.types import Doubles, Floats
from resample_texture.mesh.kernels.surfaces import (
    Ints,
    Place,
    ProjectedTriangles,
    barycentric,
)

OPAQUE, MASK, BLEND = range(3)


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
    # (N / 3,) alpha beside `texel`, premultiplied into the colors except in a mask's largest level;
    # a mask's other levels are reduced from what passes its cutoff. Empty if all is opaque.
    alpha: Floats


@inner_kernel
def level_for(skin: Skin, texture: int, size: tuple[float, float], widest: float) -> int:
    """Smallest level with texels of at most `widest` px.

    `size` is how long u and t are on screen, px.
    """
    found = 0
    for k in range(1, skin.levels[texture]):
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
