"""Points placed from the target: for maps that say where pixels come from.

Every pixel is cut into parts, so many that neither the picture nor the source is skipped over; each
part reads the source where the map, linear between pixel centers, leads, and is added as a point.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.adding import add
from resample_texture.texels.kernels.blocks import BOTTOM, LEFT, RIGHT, TOP, Integers
from resample_texture.texels.kernels.placing import Places, Spread
from resample_texture.texels.kernels.texels import DENSE, EXACT, TRANSPARENT, mapped

Pair = tuple[float, float]

MOST = 64  # parts of a pixel along an axis
AT_EDGES = 8.0  # parts of a pixel along an axis where an edge of the source may run through it
FARTHEST = 2.0**52  # texels from the source's origin beyond which there is nothing
TORN = 8.0  # a step this many times as long as that on the pixel's other side leads across a tear


@kernel
def _steps(before: float, here: float, after: float) -> tuple[float, float]:
    """Steps of a map to both sides of a pixel; a missing or torn one is as the other."""
    left, right = here - before, after - here
    if not abs(left) <= FARTHEST or abs(left) > TORN * abs(right) + TORN:
        left = right
    if not abs(right) <= FARTHEST or abs(right) > TORN * abs(left) + TORN:
        right = left
    return (left, right) if abs(left) <= FARTHEST else (0.0, 0.0)


@kernel
def _parts(step_u: tuple[float, float], step_v: tuple[float, float], quality: float) -> int:
    """Parts of a pixel along an axis, given the steps in the source on both sides."""
    longest = max(math.hypot(step_u[0], step_v[0]), math.hypot(step_u[1], step_v[1]))
    return int(min(MOST, max(math.ceil(quality), math.ceil(longest - 1e-9))))


@kernel
def _may_cross(source: Floats, u: float, v: float, ux: Pair, uy: Pair, vx: Pair, vy: Pair) -> bool:
    """Whether an edge of the source may run through a pixel."""
    reach_u = 0.5 * (max(abs(ux[0]), abs(ux[1])) + max(abs(uy[0]), abs(uy[1])))
    reach_v = 0.5 * (max(abs(vx[0]), abs(vx[1])) + max(abs(vy[0]), abs(vy[1])))
    near_u = min(abs(u), abs(u - source.shape[1])) < reach_u - 1e-9  # not if it lies between pixels
    return bool(near_u or min(abs(v), abs(v - source.shape[0])) < reach_v - 1e-9)


@kernel
def _read(
    source: Floats, u: float, v: float, edge: int, taps: Floats, values: Floats, n: int, first: int
) -> None:
    """Interpolate the source at a point, into column n of the values."""
    height, width = source.shape[0], source.shape[1]
    column, row = math.floor(u), math.floor(v)
    dense = EXACT * (EXACT + 1) // 2
    at_u = dense + min(DENSE - 1, int((u - column) * DENSE))
    at_v = dense + min(DENSE - 1, int((v - row) * DENSE))
    reach = taps.shape[0] // 2
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
                    values[c, n] += weight * source[r, q, first + c]


@kernel
def _cut_pixel(
    source: Floats,
    edge: int,
    channels: tuple[int, int],
    map_u: Doubles,
    map_v: Doubles,
    place: tuple[int, int],
    quality: float,
    taps: Floats,
    is_sum: bool,
    values: Floats,
    along: tuple[Floats, Floats],
    mass: Floats,
) -> int:
    """Points of one pixel: fills values, places within the pixel and masses; gives their number."""
    row, column = place[0] + 1, place[1] + 1
    u, v = map_u[row, column], map_v[row, column]
    if not (abs(u) <= FARTHEST and abs(v) <= FARTHEST):
        return 0
    ux = _steps(map_u[row, column - 1], u, map_u[row, column + 1])
    vx = _steps(map_v[row, column - 1], v, map_v[row, column + 1])
    uy = _steps(map_u[row - 1, column], u, map_u[row + 1, column])
    vy = _steps(map_v[row - 1, column], v, map_v[row + 1, column])
    if edge == TRANSPARENT and _may_cross(source, u, v, ux, uy, vx, vy):
        quality = max(quality, AT_EDGES)
    parts_x, parts_y = _parts(ux, vx, quality), _parts(uy, vy, quality)
    share = np.float32(1.0 / (parts_x * parts_y))
    count = 0
    for part_y in range(parts_y):
        y = (part_y + 0.5) / parts_y - 0.5
        below = int(y > 0)
        for part_x in range(parts_x):
            x = (part_x + 0.5) / parts_x - 0.5
            beyond = int(x > 0)
            at_u = u + x * ux[beyond] + y * uy[below]
            at_v = v + x * vx[beyond] + y * vy[below]
            is_in = 0.0 <= at_u <= source.shape[1] and 0.0 <= at_v <= source.shape[0]
            if edge == TRANSPARENT and not is_in:
                continue
            _read(source, at_u, at_v, edge, taps, values, count, channels[0])
            if is_sum:
                texels = np.float32(abs(ux[beyond] * vy[below] - uy[below] * vx[beyond]))
                for c in range(channels[1]):
                    values[c, count] *= texels
            along[0][count], along[1][count] = x + 0.5, y + 0.5
            mass[count] = share
            count += 1
    return count


@kernel
def _gather_tile(
    source: Floats,
    edge: int,
    channels: tuple[int, int],
    map_u: Doubles,
    map_v: Doubles,
    tile: Integers,
    bounds: Integers,
    quality: float,
    taps: Floats,
    profile: Floats,
    spread: Spread,
    start: int,
    sums: Floats,
) -> None:
    """Add the points of one tile's pixels to sums of its own, which begin at `start`."""
    count = channels[1]
    width = bounds[RIGHT] - bounds[LEFT]
    for n in range(start, start + width * (bounds[BOTTOM] - bounds[TOP]) * (count + 1)):
        sums[n] = np.float32(0)
    most = MOST * MOST
    values, mass = np.empty((count, most), np.float32), np.empty(most, np.float32)
    along_x, along_y = np.empty(most, np.float32), np.empty(most, np.float32)
    pixel: Places = np.empty(most, np.int32)
    before = 0.5 * spread.taps - 0.5
    for row in range(tile[TOP], tile[BOTTOM]):
        for column in range(tile[LEFT], tile[RIGHT]):
            points = _cut_pixel(
                source,
                edge,
                channels,
                map_u,
                map_v,
                (row, column),
                quality,
                taps,
                spread.is_sum,
                values,
                (along_x, along_y),
                mass,
            )
            for n in range(points):
                x, y = float(column - bounds[LEFT]), float(row - bounds[TOP])
                if spread.taps == 0:
                    along_x[n], along_y[n] = 0.0, 0.0
                else:
                    x += along_x[n] - before
                    y += along_y[n] - before
                    along_x[n], along_y[n] = x - math.floor(x), y - math.floor(y)
                pixel[n] = int(y) * width + int(x)
            add(
                sums,
                start,
                width,
                values,
                pixel[:points],
                along_x[:points],
                along_y[:points],
                mass[:points],
                profile,
                spread.taps,
            )


@parallel_kernel
def gather_tiles(
    counter: Counter,
    source: Floats,
    edge: int,
    channels: tuple[int, int],
    map_u: Doubles,
    map_v: Doubles,
    tiles: Integers,
    bounds: Integers,
    quality: float,
    taps: Floats,
    profile: Floats,
    spread: Spread,
    start: Integers,
    sums: Floats,
) -> None:
    """Add the points of every tile of the target to sums of its own.

    Parameters
    ----------
    source
        (H, W, C) texels, prefiltered for interpolation along both axes.
    channels
        First of them and how many: 1 or 3.
    map_u, map_v
        (h + 2, w + 2) source coordinates of pixel centers, with a margin of one; NaN: nothing.
    tiles, bounds
        (T, 4) px whose points are made, and px that they may touch.
    quality
        Parts of a pixel along an axis, at least.
    taps, profile, spread, start, sums
        As `paint_blocks` takes them.
    """
    for n in tasks(counter, tiles.shape[0]):
        _gather_tile(
            source,
            edge,
            channels,
            map_u,
            map_v,
            tiles[n],
            bounds[n],
            quality,
            taps,
            profile,
            spread,
            start[n],
            sums,
        )
