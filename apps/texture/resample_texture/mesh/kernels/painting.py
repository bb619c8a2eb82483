"""Textured triangles to pixels: who is seen where, and the texture's points that land there.

Every sub-pixel has one sample of visibility inside it (`visibility`), at outlines many points that
tell how much of it is covered (`outlines`). Triangles that are seen are diced into cells of their
texture (`dicing`), which are projected and added to sub-pixels (`cells`); a sub-pixel that no cell
reached is looked up in the texture (`looking`), as is all that one can see through, layer by layer
(`shading`). Filtering to pixels comes last. The loop over tiles is the engine's.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.roles import plays
from resample.engine.surfaces.blocks import Surfaces
from resample.engine.surfaces.painting import (
    add,
    begun,
    claim,
    claimed,
    composed,
    paint_tile,
    write,
)
from resample.engine.surfaces.resolve import resolve_tile
from resample.types import Doubles, Floats, Tiles
from resample_texture.mesh.kernels.color import Skin
from resample_texture.mesh.kernels.dicing import dice
from resample_texture.mesh.kernels.outlines import (
    close_outline,
    open_outline,
    take_points,
)
from resample_texture.mesh.kernels.shading import count, finish, is_looked_up, put_behind, shade
from resample_texture.mesh.kernels.surfaces import Ints, Lens, Triangles
from resample_texture.mesh.kernels.tiles import Block, Grid, new_block
from resample_texture.mesh.kernels.visibility import may_show, show

MOST_LAYERS = 64  # of translucent triangles one behind the other


class MeshScene(NamedTuple):
    """What there is to see, and how finely."""

    triangles: Triangles
    skin: Skin
    lens: Lens
    grid: Grid
    tally: Ints  # (tiles, 4) points, those of them that were seen, sub-pixels covered, looked up


class MeshPicture(NamedTuple):
    """Where tiles are written."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)
    # (S + 2 margin S,) weights along an axis, of sum 1, of the S sub-pixels of a pixel and of those
    # around it.
    profile: Doubles


@plays(begun, MeshScene)
def _begun(
    scene: MeshScene,
    tiles: Tiles,
    tile: int,
    size: tuple[int, int],
    surfaces: Surfaces,
) -> Block:
    return new_block(tile, tiles, size, scene.grid, scene.tally[tile], surfaces.most > 1)


@plays(claim, MeshScene)
def _claim(scene: MeshScene, member: int, block: Block) -> None:
    show(scene.triangles, member, block)


@plays(claimed, MeshScene)
def _claimed(scene: MeshScene, tiles: Tiles, tile: int, block: Block) -> None:
    open_outline(block)
    for k in range(tiles.start[tile], tiles.start[tile + 1]):
        take_points(scene.triangles, tiles.member[k], block)
    close_outline(block)


@plays(add, MeshScene)
def _add(scene: MeshScene, member: int, _: int, block: Block) -> None:
    triangles, skin, lens = scene.triangles, scene.skin, scene.lens
    if is_looked_up(triangles, skin, member):
        return
    if may_show(triangles, member, block, lens):
        points, seen = dice(block, member, triangles, skin, lens, scene.grid)
        block.tally[0] += points
        block.tally[1] += seen


@plays(composed, MeshScene)
def _composed(scene: MeshScene, block: Block, surface: int, surfaces: Surfaces) -> bool:
    count(scene.skin, block)
    if surfaces.most == 1:
        shade(scene.triangles, scene.skin, scene.lens, block)
        return False
    if put_behind(scene.triangles, scene.skin, block) and surface + 1 < surfaces.most:
        return True
    finish(scene.lens, block)
    return False


@kernel
def _measure(block: Block, row: int, column: int) -> tuple[float, float]:
    """Mean and least depth of what a pixel's own sub-pixels show; infinite if nothing."""
    total, first, weight, n = 0.0, np.inf, 0.0, block.samples
    for r in range((row + block.margin) * n, (row + block.margin + 1) * n):
        for c in range((column + block.margin) * n, (column + block.margin + 1) * n):
            cover = block.sums[r, c, 3]
            if cover > np.float32(0):
                depth = block.nearness[r, c]
                total += cover * depth
                first = min(first, depth)
                weight += cover
    return (total / weight if weight > 0.0 else np.inf), first


@plays(write, MeshPicture)
def _write(picture: MeshPicture, block: Block, _: int) -> None:
    top, left = int(block.top) + block.margin, int(block.left) + block.margin
    height = block.owner.shape[0] // block.samples - 2 * block.margin
    width = block.owner.shape[1] // block.samples - 2 * block.margin
    pixels = picture.rgba[top : top + height, left : left + width]
    resolve_tile(block.sums, picture.profile, block.samples, pixels)
    for row in range(height):
        for column in range(width):
            pixels[row, column, 3] = min(np.float32(1), max(np.float32(0), pixels[row, column, 3]))
            mean, first = _measure(block, row, column)
            picture.depth[top + row, left + column] = mean
            picture.first_depth[top + row, left + column] = first


@parallel_kernel
def paint(counter: Counter, scene: MeshScene, tiles: Tiles, picture: MeshPicture) -> None:
    """Paint every tile.

    Parameters
    ----------
    tiles
        Which triangles touch which tile and its margin, in their order.
    picture
        Filled; transparent before, with infinite depths.
    """
    layers = MOST_LAYERS if len(scene.skin.alpha) > 0 else 1
    surfaces = Surfaces(layers, scene.grid.samples, 1, 4)
    for tile in tasks(counter, tiles.start.size - 1):
        paint_tile(scene, tiles, tile, picture.depth.shape, surfaces, picture)
