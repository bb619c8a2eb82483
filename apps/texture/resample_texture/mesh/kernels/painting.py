"""Textured triangles to pixels: who is seen where, and the texture's points that land there.

Every sub-pixel has one sample of visibility inside it (`mesh_visibility`). Triangles that are seen
are diced into cells of their texture (`mesh_dicing`), which are projected and added to sub-pixels
(`mesh_cells`); a sub-pixel that no cell reached is looked up in the texture (`mesh_color`).
Filtering to pixels comes last.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_texture.mesh.kernels.color import Skin, evaluate, lit
from resample_texture.mesh.kernels.dicing import dice
from resample_texture.mesh.kernels.surfaces import Ints, Lens, Surfaces
from resample_texture.mesh.kernels.tiles import Block, Grid, Members, new_block, sample
from resample_texture.mesh.kernels.visibility import claim, may_show

LEAST_WEIGHT = 1e-2  # sub-pixels²; a sub-pixel that got less is looked up


class MeshPicture(NamedTuple):
    """Where tiles are written."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)
    tally: Ints  # (tiles, 4) points, those of them that were seen, sub-pixels covered, looked up


@kernel
def _shade(block: Block, surfaces: Surfaces, skin: Skin, margin: int) -> tuple[int, int]:
    """Turn sums into colors; gives how many sub-pixels have one, and how many were looked up.

    The margin does not count.
    """
    total, fine = block.total, 1.0 / block.samples
    rows, columns = block.owner.shape
    covered, looked_up = 0, 0
    for row in range(rows):
        for column in range(columns):
            if block.owner[row, column] < 0:
                continue
            n = block.triangles[block.owner[row, column]]
            place = sample(block, row, column)
            weight = total[row, column, 3]
            is_reached = weight > LEAST_WEIGHT
            if is_reached:
                color = (
                    total[row, column, 0] / weight,
                    total[row, column, 1] / weight,
                    total[row, column, 2] / weight,
                )
            else:
                color = evaluate(surfaces, skin, n, place, fine)
            light = lit(surfaces, skin, n, place)
            for c in range(3):
                total[row, column, c] = light * color[c]
            if margin <= row < rows - margin and margin <= column < columns - margin:
                covered += 1
                looked_up += not is_reached and skin.texture[n] >= 0
    return covered, looked_up


@kernel
def _filter_rows(block: Block, profile: Doubles) -> Doubles:
    """Rows of sub-pixels under the pixel filter: (R, pixels in a row, 4)."""
    rows, columns = block.owner.shape
    lines = np.empty((rows, (columns - len(profile)) // block.samples + 1, 4))
    total = block.total
    for row in range(rows):
        for column in range(lines.shape[1]):
            red, green, blue, covered = 0.0, 0.0, 0.0, 0.0
            first = column * block.samples
            for k in range(len(profile)):
                if block.owner[row, first + k] >= 0:
                    red += profile[k] * total[row, first + k, 0]
                    green += profile[k] * total[row, first + k, 1]
                    blue += profile[k] * total[row, first + k, 2]
                    covered += profile[k]
            lines[row, column, 0], lines[row, column, 1] = red, green
            lines[row, column, 2], lines[row, column, 3] = blue, covered
    return lines


@kernel
def _measure(
    block: Block, row: int, column: int, margin: int, is_perspective: bool
) -> tuple[float, float]:
    """Mean and least depth of what a pixel's own sub-pixels show; infinite if nothing."""
    total, first, covered = 0.0, np.inf, 0
    for r in range(row * block.samples + margin, (row + 1) * block.samples + margin):
        for c in range(column * block.samples + margin, (column + 1) * block.samples + margin):
            if block.owner[r, c] >= 0:
                nearness = block.nearness[r, c]
                depth = 1.0 / nearness if is_perspective else -nearness
                total += depth
                first = min(first, depth)
                covered += 1
    return (total / covered if covered > 0 else np.inf), first


@kernel
def _resolve(
    block: Block, grid: Grid, profile: Doubles, is_perspective: bool, picture: MeshPicture
) -> None:
    """Filter a tile's sub-pixels to pixels."""
    lines = _filter_rows(block, profile)
    rgba = picture.rgba
    rows = (len(lines) - len(profile)) // block.samples + 1
    for row in range(rows):
        for column in range(lines.shape[1]):
            red, green, blue, covered = 0.0, 0.0, 0.0, 0.0
            first = row * block.samples
            for k in range(len(profile)):
                red += profile[k] * lines[first + k, column, 0]
                green += profile[k] * lines[first + k, column, 1]
                blue += profile[k] * lines[first + k, column, 2]
                covered += profile[k] * lines[first + k, column, 3]
            i, j = int(block.top) + grid.margin + row, int(block.left) + grid.margin + column
            rgba[i, j, 0], rgba[i, j, 1], rgba[i, j, 2] = red, green, blue
            rgba[i, j, 3] = min(1.0, max(0.0, covered))
            depth = _measure(block, row, column, grid.margin * block.samples, is_perspective)
            picture.depth[i, j], picture.first_depth[i, j] = depth


@kernel
def _paint_tile(
    tile: int,
    members: Members,
    surfaces: Surfaces,
    skin: Skin,
    lens: Lens,
    grid: Grid,
    profile: Doubles,
    picture: MeshPicture,
) -> None:
    """Paint one tile, which belongs to one thread."""
    triangles = members.triangle[members.start[tile] : members.start[tile + 1]]
    if len(triangles) == 0:
        return
    block = new_block(tile, triangles, grid)
    for member in range(len(triangles)):
        claim(surfaces, member, block)
    shows = np.zeros(len(triangles), np.bool_)
    rows, columns = block.owner.shape
    for row in range(rows):
        for column in range(columns):
            if block.owner[row, column] >= 0:
                shows[block.owner[row, column]] = True
    tally = picture.tally
    for member in range(len(triangles)):
        n = triangles[member]
        if skin.texture[n] < 0 or surfaces.determinant[n] == 0.0:
            continue
        if shows[member] or may_show(surfaces, member, block, lens):
            points, seen = dice(block, member, surfaces, skin, lens, grid)
            tally[tile, 0] += points
            tally[tile, 1] += seen
    tally[tile, 2], tally[tile, 3] = _shade(block, surfaces, skin, grid.margin * grid.samples)
    _resolve(block, grid, profile, lens.perspective, picture)


@parallel_kernel
def paint(
    counter: Counter,
    members: Members,
    surfaces: Surfaces,
    skin: Skin,
    lens: Lens,
    grid: Grid,
    profile: Doubles,
    picture: MeshPicture,
) -> None:
    """Paint every tile.

    Parameters
    ----------
    members, surfaces, skin, lens, grid
        What there is to see.
    profile
        (S + 2 margin S,) weights along an axis, of sum 1, of the S sub-pixels of a pixel and of
        those around it.
    picture
        Filled; transparent before.
    """
    for tile in tasks(counter, len(members.start) - 1):
        _paint_tile(tile, members, surfaces, skin, lens, grid, profile, picture)
