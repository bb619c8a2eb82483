"""Points gathered from the target: for maps that say where pixels come from.

Every pixel is cut into so many parts that neither pixels nor texels are skipped; each part reads
the source where the map, linear between pixel centers, leads, and is added as a point.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import Counter, inner_kernel, parallel_kernel
from resample.engine.roles import plays
from resample.engine.windows.boxes import TRANSPARENT, mapped
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.texels.kernels.gather import FARTHEST, steps
from resample_texture.texels.kernels.texels import DENSE, EXACT

Pair = tuple[float, float]

MOST = 64  # parts of a pixel along an axis
AT_EDGES = 8.0  # parts of a pixel along an axis where an edge of the source may run through it


class Pixels(NamedTuple):
    """Tiles of pixels that read a source where a map leads."""

    texels: Floats  # (H, W, C), prefiltered for interpolation along both axes
    edge: int
    channels: tuple[int, int]  # first of them and how many: 1 or 3
    taps: Floats  # (K, R) of the interpolation; see `kernels.texels`
    map_u: Doubles  # (h + 2, w + 2) source coordinates of pixel centers, with a margin of one;
    map_v: Doubles  # NaN: nothing
    tiles: Integers  # (T, 4) px
    quality: float  # parts of a pixel along an axis, at least


class PixelPoints(NamedTuple):
    """Scratch for the points of one pixel."""

    batch: Batch


@inner_kernel
def _parts(step_u: tuple[float, float], step_v: tuple[float, float], quality: float) -> int:
    """Parts of a pixel along an axis, given the steps in the source on both sides."""
    longest = max(math.hypot(step_u[0], step_v[0]), math.hypot(step_u[1], step_v[1]))
    return int(min(MOST, max(math.ceil(quality), math.ceil(longest - 1e-9))))


@inner_kernel
def _may_cross(source: Floats, u: float, v: float, ux: Pair, uy: Pair, vx: Pair, vy: Pair) -> bool:
    """Whether an edge of the source may run through a pixel."""
    reach_u = 0.5 * (max(abs(ux[0]), abs(ux[1])) + max(abs(uy[0]), abs(uy[1])))
    reach_v = 0.5 * (max(abs(vx[0]), abs(vx[1])) + max(abs(vy[0]), abs(vy[1])))
    near_u = min(abs(u), abs(u - source.shape[1])) < reach_u - 1e-9  # not if it lies between pixels
    return bool(near_u or min(abs(v), abs(v - source.shape[0])) < reach_v - 1e-9)


@inner_kernel
def _read(source: Pixels, u: float, v: float, values: Floats, n: int) -> None:
    """Interpolate the source at a point, into column n of the values."""
    texels, edge, taps, first = source.texels, source.edge, source.taps, source.channels[0]
    # Find the texel and the phases of its taps.
    height, width = texels.shape[0], texels.shape[1]
    column, row = math.floor(u), math.floor(v)
    dense = EXACT * (EXACT + 1) // 2
    at_u = dense + min(DENSE - 1, int((u - column) * DENSE))
    at_v = dense + min(DENSE - 1, int((v - row) * DENSE))
    reach = taps.shape[0] // 2
    # Sum the taps, skipping those without weight.
    for c in range(values.shape[0]):
        values[c, n] = np.float32(0)
    for k in range(taps.shape[0]):
        if taps[k, at_v] == np.float32(0):
            continue
        r = mapped(int(row) + k - reach, height, edge)
        for m in range(taps.shape[0]):
            weight = taps[k, at_v] * taps[m, at_u]
            if weight != np.float32(0):
                q = mapped(int(column) + m - reach, width, edge)
                for c in range(values.shape[0]):
                    values[c, n] += weight * texels[r, q, first + c]


@inner_kernel
def _cut_pixel(source: Pixels, place: tuple[int, int], is_sum: bool, batch: Batch) -> int:
    """Cut a pixel into points: values, places within the pixel, masses; count them."""
    texels, edge, map_u, map_v = source.texels, source.edge, source.map_u, source.map_v
    _, along_x, along_y, mass, values = batch
    quality, row, column = source.quality, place[0] + 1, place[1] + 1

    # Skip pixels that the map leads nowhere.
    u, v = map_u[row, column], map_v[row, column]
    if not (abs(u) <= FARTHEST and abs(v) <= FARTHEST):
        return 0

    # Take the map's steps to the neighbours on both sides, as it may bend at the pixel.
    ux = steps(map_u[row, column - 1], u, map_u[row, column + 1])
    vx = steps(map_v[row, column - 1], v, map_v[row, column + 1])
    uy = steps(map_u[row - 1, column], u, map_u[row + 1, column])
    vy = steps(map_v[row - 1, column], v, map_v[row + 1, column])

    # Cut into parts no longer than a texel, and finer where the source's edge may run through.
    if edge == TRANSPARENT and _may_cross(texels, u, v, ux, uy, vx, vy):
        quality = max(quality, AT_EDGES)
    parts_x, parts_y = _parts(ux, vx, quality), _parts(uy, vy, quality)
    share = np.float32(1.0 / (parts_x * parts_y))
    count = 0

    # Visit the parts; each half of the pixel has the steps of its own side.
    for part_y in range(parts_y):
        y = (part_y + 0.5) / parts_y - 0.5
        below = int(y > 0)
        for part_x in range(parts_x):
            x = (part_x + 0.5) / parts_x - 0.5
            beyond = int(x > 0)
            at_u = u + x * ux[beyond] + y * uy[below]
            at_v = v + x * vx[beyond] + y * vy[below]
            # Skip parts beyond a transparent edge.
            is_in = 0.0 <= at_u <= texels.shape[1] and 0.0 <= at_v <= texels.shape[0]
            if edge == TRANSPARENT and not is_in:
                continue
            # Read the source there; a total is a density times the area.
            _read(source, at_u, at_v, values, count)
            if is_sum:
                area = np.float32(abs(ux[beyond] * vy[below] - uy[below] * vx[beyond]))
                for c in range(values.shape[0]):
                    values[c, count] *= area
            # Store the point with its share of the pixel.
            along_x[count], along_y[count] = x + 0.5, y + 0.5
            mass[count] = share
            count += 1
    return count


@plays(begun, Pixels)
def _begun(source: Pixels, part: int) -> PixelPoints:  # noqa: ARG001
    """Allocate scratch for the points of one pixel."""
    return PixelPoints(new_batch(source.channels[1], MOST * MOST))


@plays(lines, Pixels)
def _lines(source: Pixels, part: int) -> int:
    """Count the pixels of a tile, each of which is one line of the engine's loop."""
    tile = source.tiles[part]
    return int((tile[BOTTOM] - tile[TOP]) * (tile[RIGHT] - tile[LEFT]))


@plays(fill, Pixels)
def _fill(
    source: Pixels, part: int, line: int, box: Integers, spread: FilterTaps, work: PixelPoints
) -> int:
    # Find the pixel that this line stands for.
    tile, (pixel, along_x, along_y, _, _) = source.tiles[part], work.batch
    width, before = box[RIGHT] - box[LEFT], 0.5 * spread.taps - 0.5
    down, across = divmod(line, tile[RIGHT] - tile[LEFT])
    row, column = tile[TOP] + down, tile[LEFT] + across
    # Cut it into points.
    count = _cut_pixel(source, (row, column), spread.is_sum, work.batch)
    for n in range(count):
        # Place them: in their own pixel for the area filter, else by the first tap of the filter.
        x, y = float(column - box[LEFT]), float(row - box[TOP])
        if spread.taps == 0:
            along_x[n], along_y[n] = 0.0, 0.0
        else:
            x += along_x[n] - before
            y += along_y[n] - before
            along_x[n], along_y[n] = x - math.floor(x), y - math.floor(y)
        pixel[n] = int(y) * width + int(x)
    return count


@parallel_kernel
def gather_tiles(counter: Counter, source: Pixels, spread: FilterTaps, parts: SourceParts) -> None:
    """Add the points of every tile's pixels to that tile's own sums."""
    paint_parts(counter, source, spread, parts)
