"""Gathering pixels: their places in a source, on a plane or by a map, and the values there.

Under filters other than the area, a pixel of a map is cut into so many parts that neither pixels
nor texels are skipped; each part reads the source where the map, linear between pixel centers,
leads, and is added as a point. Last come the shares of levels and of light in pixels: by how much
they cover, and how much texels differ there.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, bands, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import (
    Counter,
    inner_kernel,
    lane_kernel,
    packed_kernel,
    parallel_kernel,
    plays,
    tasks,
)
from resample.engine.windows.boxes import TRANSPARENT, mapped
from resample.engine.windows.footprints import GridView, PixelFootprint, footprint_at
from resample.engine.windows.gather import Extent, Mask, gather_tiles, measure_tiles
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.texels.kernels.texels import DENSE, EXACT

FARTHEST = 2.0**52  # texels from the source's origin; places beyond count as nowhere
TWELFTH = 1.0 / 12.0  # second moment of a pixel
TORN = 8.0  # a step so many times as long as that on the pixel's other side crosses a tear


class Plane(NamedTuple):
    """A source in perspective."""

    inverse: Doubles  # (3, 3) target to source; the third coordinate is positive in front
    left: int  # px of the target at which the picture begins
    top: int


class Map(NamedTuple):
    """A source with a map that gives each pixel its source coordinates."""

    u: Doubles  # (h + 2, w + 2) source coordinates of pixel centers, with a margin of one;
    v: Doubles  # NaN: nothing


@inner_kernel
def steps(before: float, here: float, after: float) -> tuple[float, float]:
    """Steps of a map to both sides; a missing or torn one equals the other."""
    left, right = here - before, after - here
    if not abs(left) <= FARTHEST or abs(left) > TORN * abs(right) + TORN:
        left = right
    if not abs(right) <= FARTHEST or abs(right) > TORN * abs(left) + TORN:
        right = left
    return (left, right) if abs(left) <= FARTHEST else (0.0, 0.0)


@plays(footprint_at, Plane)
def _footprint_on_plane(geometry: Plane, row: int, column: int) -> PixelFootprint:
    """Project a pixel into the source plane: its mean place and its sides."""
    # Project the pixel's center; it shows nothing behind the horizon.
    a, x, y = geometry.inverse, (geometry.left + column) + 0.5, (geometry.top + row) + 0.5
    d = a[2, 0] * x + a[2, 1] * y + a[2, 2]
    share = 1.0 / d if d > 0.0 else math.nan
    u = (a[0, 0] * x + a[0, 1] * y + a[0, 2]) * share
    # Differentiate the homography for the pixel's sides.
    v = (a[1, 0] * x + a[1, 1] * y + a[1, 2]) * share
    ux, uy = (a[0, 0] - u * a[2, 0]) * share, (a[0, 1] - u * a[2, 1]) * share
    vx, vy = (a[1, 0] - v * a[2, 0]) * share, (a[1, 1] - v * a[2, 1]) * share
    # Move the middle to the mean of the pixel's points, to second order.
    bend_x, bend_y = a[2, 0] * share * TWELFTH, a[2, 1] * share * TWELFTH
    u, v = u - ux * bend_x - uy * bend_y, v - vx * bend_x - vy * bend_y
    return PixelFootprint(u, v, (ux, vx), (uy, vy))


@plays(footprint_at, Map)
def _footprint_by_map(geometry: Map, row: int, column: int) -> PixelFootprint:
    """Look a pixel up in the map: its mean place and its sides."""
    r, c = row + 1, column + 1
    u, v = geometry.u[r, c], geometry.v[r, c]
    # Difference the map on both sides of the pixel.
    ux = steps(geometry.u[r, c - 1], u, geometry.u[r, c + 1])
    vx = steps(geometry.v[r, c - 1], v, geometry.v[r, c + 1])
    uy = steps(geometry.u[r - 1, c], u, geometry.u[r + 1, c])
    vy = steps(geometry.v[r - 1, c], v, geometry.v[r + 1, c])
    # Take the mean of both sides, and the bend between them for the mean place.
    bend_u, bend_v = ux[1] - ux[0] + uy[1] - uy[0], vx[1] - vx[0] + vy[1] - vy[0]
    along_x = 0.5 * (ux[0] + ux[1]), 0.5 * (vx[0] + vx[1])
    along_y = 0.5 * (uy[0] + uy[1]), 0.5 * (vy[0] + vy[1])
    # Unknown sides are the other turned by 90°, or a texel.
    is_known_x = along_x[0] != 0.0 or along_x[1] != 0.0
    is_known_y = along_y[0] != 0.0 or along_y[1] != 0.0
    if not is_known_x:
        along_x = (along_y[1], -along_y[0]) if is_known_y else (1.0, 0.0)
    if not is_known_y:
        along_y = (-along_x[1], along_x[0]) if is_known_x else (0.0, 1.0)
    return PixelFootprint(u + 0.5 * TWELFTH * bend_u, v + 0.5 * TWELFTH * bend_v, along_x, along_y)


@packed_kernel
def fill_tiles(
    counter: Counter,
    geometry: Plane | Map,
    view: GridView,
    tiles: Integers,
    bounds: Doubles,
    wanted: Mask,
    image: Floats,
    covered: Floats,
) -> None:
    """Gather the pixels of a picture's tiles; see `gather_tiles`."""
    gather_tiles(counter, geometry, view, tiles, bounds, wanted, image, covered)


@parallel_kernel
def measure(
    counter: Counter,
    geometry: Plane | Map,
    tiles: Integers,
    step: int,
    view: GridView,
    extent: Extent,
) -> None:
    """Measure tiles' footprints in the source; see `measure_tiles`."""
    measure_tiles(counter, geometry, tiles, step, view, extent)


MOST = 64  # parts of a pixel along an axis
AT_EDGES = 8.0  # parts of a pixel along an axis where an edge of the source may run through it


class Pixels(NamedTuple):
    """Tiles of pixels that read a source by a map."""

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
    if edge == TRANSPARENT:
        reach_u = 0.5 * (max(abs(ux[0]), abs(ux[1])) + max(abs(uy[0]), abs(uy[1])))
        reach_v = 0.5 * (max(abs(vx[0]), abs(vx[1])) + max(abs(vy[0]), abs(vy[1])))
        near_u = min(abs(u), abs(u - texels.shape[1])) < reach_u - 1e-9  # not between pixels
        if near_u or min(abs(v), abs(v - texels.shape[0])) < reach_v - 1e-9:
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
    """Count the pixels of a tile; each is one line of the engine's loop."""
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
def collect_tiles(counter: Counter, source: Pixels, spread: FilterTaps, parts: SourceParts) -> None:
    """Add the points of every tile's pixels to that tile's own sums."""
    paint_parts(counter, source, spread, parts)


BESIDE = 2  # texels on each side that tell how much they differ
BAND = 32  # rows that a thread takes at a time
# The sRGB curve's second derivative over its first is 1.4 / (level + 0.055), and a variance is at
# most a quarter of the range's square; texels farther than beside a pixel count by half.
CURVE, DARK = np.float32(1.4 / 8.0), np.float32(0.055)


@parallel_kernel
def put_shares(
    counter: Counter, geometry: Plane | Map, ends: tuple[float, float], form: tuple[int, int],
    shares: Floats,
) -> None:  # fmt: skip
    """Shares (h × w) of pixels, 1 to 0 as their longer axes grow between the `ends`, texels."""
    for row in tasks(counter, form[0]):
        _put_row_of_shares(geometry, ends, row, form[1], shares)


@lane_kernel
def _put_row_of_shares(
    geometry: Plane | Map, ends: tuple[float, float], row: int, count: int, shares: Floats
) -> None:
    long, scale, first = ends[1], 1.0 / (ends[1] - ends[0]), row * count
    for column in range(count):
        footprint = footprint_at(geometry, row, column)
        (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
        across, down, both = ux * ux + vx * vx, uy * uy + vy * vy, ux * uy + vx * vy
        half = 0.5 * (across - down)
        root = math.sqrt(half * half + both * both)
        share = (long - math.sqrt(0.5 * (across + down) + root)) * scale
        # Constants come first, as min and max with NaN return their first argument.
        shares[np.uint64(first + column)] = np.float32(min(1.0, max(0.0, share)))


class Differences(NamedTuple):
    """Approximate bound of the difference between light and levels' light under a pixel."""

    flat: Floats  # (H × W,) levels, at texels; infinite where too few are around
    size: tuple[int, int]  # H and W
    first: tuple[int, int]  # column and row in the source at which they begin


@parallel_kernel
def put_differences(counter: Counter, levels: Floats, channels: int, found: Differences) -> None:
    """Bound differences of light by the range of levels (H × W × channels) around texels."""
    height, width = found.size
    scratch = np.empty(5 * width * channels, np.float32)
    for rows in bands(counter, height, BAND):
        for row in range(rows[0], rows[1]):
            if BESIDE <= row < height - BESIDE and width > 2 * BESIDE:
                _put_row_of_differences(levels, row, channels, scratch, found)
            else:
                found.flat[row * width : (row + 1) * width] = math.inf


@lane_kernel
def _put_row_of_differences(
    levels: Floats, row: int, channels: int, scratch: Floats, found: Differences
) -> None:
    flat, width, count = found.flat, found.size[1], found.size[1] * channels
    low, high, least, most = (
        scratch[:count], scratch[count : 2 * count], scratch[2 * count : 3 * count],
        scratch[3 * count : 4 * count],
    )  # fmt: skip
    # Ranges down the columns, of three texels and of five.
    step, start = np.uint64(count), np.uint64((row - BESIDE) * count)
    for n in range(count):
        k, o = np.uint64(n), start + np.uint64(n)
        a, b, c = levels[o], levels[o + step], levels[o + step + step]
        o += step + step + step
        d, e = levels[o], levels[o + step]
        lower, higher = min(b, c, d), max(b, c, d)
        low[k], high[k] = lower, higher
        least[k], most[k] = min(lower, a, e), max(higher, a, e)
    # And across them.
    made, one, half = scratch[4 * count :], np.uint64(channels), np.float32(0.5)
    for n in range(count - 4 * channels):
        a = np.uint64(n)
        b, c = a + one, a + one + one
        d, e = c + one, c + one + one
        lower = min(least[a], least[b], least[c], least[d], least[e])
        farther = max(most[a], most[b], most[c], most[d], most[e]) - lower
        range_ = max(high[b], high[c], high[d]) - min(low[b], low[c], low[d])
        range_ = max(range_, half * farther)
        made[a] = CURVE * range_ * range_ / (max(lower, np.float32(0)) + DARK)
    # The channel with the largest difference counts.
    first = np.uint64(row * width)
    for n in range(BESIDE):
        flat[first + np.uint64(n)] = flat[first + np.uint64(width - 1 - n)] = np.float32(math.inf)
    for n in range(width - 2 * BESIDE):
        k, largest = np.uint64(n * channels), np.float32(0)
        for channel in range(channels):
            largest = max(largest, made[k + np.uint64(channel)])
        flat[first + np.uint64(n + BESIDE)] = largest


@parallel_kernel
def spare_light(
    counter: Counter, geometry: Plane | Map, found: Differences, most: float,
    form: tuple[int, int], shares: Floats,
) -> None:  # fmt: skip
    """Raise the shares (h × w) of pixels to 1 where light makes a difference of `most` at most."""
    nearest, least = np.empty(form[1], np.int32), np.float32(most)
    for row in tasks(counter, form[0]):
        _put_nearest(geometry, found, row, nearest)
        for column in range(form[1]):
            at, k = nearest[column], np.uint64(row * form[1] + column)
            share = shares[k]
            if at >= 0 and share > np.float32(0):
                is_spared = found.flat[np.uint64(at)] * (np.float32(1) - share) <= least
                shares[k] = np.float32(1) if is_spared else share


@lane_kernel
def _put_nearest(
    geometry: Plane | Map, found: Differences, row: int, nearest: NDArray[np.int32]
) -> None:
    """Index of the texel at each pixel of a row; -1: none."""
    left, top = float(found.first[0]), float(found.first[1])
    height, width = found.size
    for column in range(nearest.size):
        footprint = footprint_at(geometry, row, column)
        u, v = footprint.u - left, footprint.v - top
        is_inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height)
        # Constants come first, as min and max with NaN return their first argument.
        x = np.int32(min(width - 1.0, max(0.0, u)))
        y = np.int32(min(height - 1.0, max(0.0, v)))
        at = y * np.int32(width) + x
        nearest[np.uint64(column)] = at if is_inside else np.int32(-1)
