"""Paint textured triangles: visibility per sub-pixel, then the texture's cells.

Every sub-pixel has one sample of visibility inside it (`visibility`), at outlines many points that
measure its coverage (`outlines`). Visible triangles are diced into cells of their texture
(`dicing`), which are projected and added to sub-pixels (`cells`); a sub-pixel that no cell reached
is looked up in the texture (`looking`), as are all translucent triangles, layer by layer
(`shading`). Filtering to pixels comes last. The loop over tiles is the engine's.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, plays, tasks
from resample.engine.surfaces import (
    Surfaces,
    add,
    begun,
    claim,
    claimed,
    composed,
    paint_tile,
    resolve_tile,
    write,
)
from resample.types import Doubles, Floats, Tiles
from resample_meshes.kernels.dicing import dice
from resample_meshes.kernels.sampling import Skin
from resample_meshes.kernels.shading import (
    close_outline,
    count,
    finish,
    is_sampled,
    open_outline,
    put_behind,
    shade,
    take_points,
)
from resample_meshes.kernels.surfaces import Ints, ProjectedTriangles, VisibilityCamera
from resample_meshes.kernels.visibility import (
    SubpixelGrid,
    TileBuffer,
    may_show,
    new_block,
    show,
)

MOST_LAYERS = 64  # of translucent triangles one behind the other


class MeshScene(NamedTuple):
    """Triangles, camera and sampling of a picture."""

    triangles: ProjectedTriangles
    skin: Skin
    lens: VisibilityCamera
    grid: SubpixelGrid
    tally: Ints  # (tiles, 4) cells, those that were visible, sub-pixels covered, looked up


class MeshPicture(NamedTuple):
    """Pictures that tiles are written to."""

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
) -> TileBuffer:
    """Allocate the sub-pixels of a tile."""
    return new_block(tile, tiles, size, scene.grid, scene.tally[tile], surfaces.most > 1)


@plays(claim, MeshScene)
def _claim(scene: MeshScene, member: int, block: TileBuffer) -> None:
    """Resolve the visibility of a triangle."""
    show(scene.triangles, member, block)


@plays(claimed, MeshScene)
def _claimed(scene: MeshScene, tiles: Tiles, tile: int, block: TileBuffer) -> None:
    """Measure coverage at outlines, once all triangles have been shown."""
    open_outline(block)
    for k in range(tiles.start[tile], tiles.start[tile + 1]):
        take_points(scene.triangles, tiles.member[k], block)
    close_outline(block)


@plays(add, MeshScene)
def _add(scene: MeshScene, member: int, block: TileBuffer) -> None:
    """Add the cells of a triangle, if it may be visible."""
    triangles, skin, lens = scene.triangles, scene.skin, scene.lens
    # Textures without area and translucent ones have no cells.
    if is_sampled(triangles, skin, member):
        return
    if may_show(triangles, member, block, lens):
        points, seen = dice(block, member, triangles, skin, lens, scene.grid)
        block.tally[0] += points
        block.tally[1] += seen


@plays(composed, MeshScene)
def _composed(scene: MeshScene, block: TileBuffer, surface: int, surfaces: Surfaces) -> bool:
    """Compose the layer; return whether another one may show through."""
    count(scene.skin, block)
    # A scene of opaque triangles has one layer, which is shaded in place.
    if surfaces.most == 1:
        shade(scene.triangles, scene.skin, scene.lens, block)
        return False
    # Composite under the layers in front, and peel the next one.
    if put_behind(scene.triangles, scene.skin, block) and surface + 1 < surfaces.most:
        return True
    finish(scene.lens, block)
    return False


@kernel
def _measure(block: TileBuffer, row: int, column: int) -> tuple[float, float]:
    """Mean and least depth of a pixel's own sub-pixels; infinite if empty."""
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
def _write(picture: MeshPicture, block: TileBuffer) -> None:
    """Filter a tile's sub-pixels to pixels, and write their depths."""
    # Leave out the margin, which only feeds the filter.
    top, left = int(block.top) + block.margin, int(block.left) + block.margin
    height = block.owner.shape[0] // block.samples - 2 * block.margin
    width = block.owner.shape[1] // block.samples - 2 * block.margin
    # Filter color and coverage.
    pixels = picture.rgba[top : top + height, left : left + width]
    resolve_tile(block.sums, picture.profile, block.samples, pixels)
    # Clamp coverage, which negative lobes of the filter may exceed, and reduce depths.
    for row in range(height):
        for column in range(width):
            pixels[row, column, 3] = min(np.float32(1), max(np.float32(0), pixels[row, column, 3]))
            mean, first = _measure(block, row, column)
            picture.depth[top + row, left + column] = mean
            picture.first_depth[top + row, left + column] = first


@parallel_kernel
def paint(counter: Counter, scene: MeshScene, tiles: Tiles, picture: MeshPicture) -> None:
    """Paint every tile.

    `tiles`: which triangles touch which tile and its margin, in their order. `picture`: filled;
    transparent before, with infinite depths.
    """
    layers = MOST_LAYERS if len(scene.skin.alpha) > 0 else 1
    surfaces = Surfaces(layers, scene.grid.samples)
    for tile in tasks(counter, tiles.start.size - 1):
        paint_tile(scene, tiles, tile, picture.depth.shape, surfaces, picture)
