"""Shares of levels and of light: by how much pixels cover, and how much texels differ there."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import bands
from resample.engine.jit import Counter, lane_kernel, parallel_kernel, tasks
from resample.engine.windows.footprints import footprint_at
from resample.types import Floats
from resample_texture.texels.kernels.gather import Map, Plane

BESIDE = 2  # texels on each side that tell how much they differ
BAND = 32  # rows that a thread takes at a time
# The sRGB curve's second derivative over its first is 1.4 / (level + 0.055), and a variance is at
# most a quarter of the range's square.
CURVE, DARK = np.float32(1.4 / 8.0), np.float32(0.055)


@parallel_kernel
def put_shares(
    counter: Counter, geometry: Plane | Map, ends: tuple[float, float], form: tuple[int, int],
    shares: Floats,
) -> None:  # fmt: skip
    """Shares (h × w) of pixels that fall from 1 to 0 as their longer axes grow.

    `ends`: Lengths, texels, at which the share is 1 and 0; where pixels have no place it is 0.
    `form`: height and width.
    """
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
    """By how much, at most about, light under a pixel differs from the light of its levels."""

    flat: Floats  # (H × W,) levels, at texels; infinite where too few are around
    size: tuple[int, int]  # H and W
    first: tuple[int, int]  # column and row in the source at which they begin


@parallel_kernel
def put_differences(counter: Counter, levels: Floats, channels: int, found: Differences) -> None:
    """Bound differences of light by the range of levels (H × W × channels) around texels.

    By second order they are half of the curve's bend times the variance. Texels beside a pixel
    count in full, those a texel farther, which weigh less, as if they differed by half as much.
    """
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
