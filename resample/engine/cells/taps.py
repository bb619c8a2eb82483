"""Add cells to pixels: each is spread by weights along x and y, and leaves its value and mass.

Sums are interleaved, the channels of a pixel next to its weight, so that the pixels which a cell
meets in a row are contiguous in memory.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import Batch
from resample.engine.jit import inner_kernel
from resample.types import Floats, Single

PHASES = 2048  # rows of a filter's table


class FilterTaps(NamedTuple):
    """The pixel filter as a table, and the quantities that are summed."""

    taps: int  # px per side that a cell meets; 0: the area filter, which meets 2
    is_sum: bool  # a value is a total that is distributed, not a density
    profile: Floats  # (PHASES, taps) weights of the pixels around a point, by its phase


@inner_kernel
def _add_four(sums: Floats, at: int, a: Single, b: Single, c: Single, d: Single) -> None:
    """Add to four contiguous numbers; read first, so that the compiler makes it one addition."""
    i = np.uint64(at)
    j, k, m = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
    a, b, c, d = sums[i] + a, sums[j] + b, sums[k] + c, sums[m] + d
    sums[i], sums[j], sums[k], sums[m] = a, b, c, d


@inner_kernel
def _add_areas_gray(sums: Floats, start: int, width: int, batch: Batch, count: int) -> None:
    """Add cells of one channel to the 2 × 2 pixels each overlaps."""
    pixel, along_x, along_y, mass, values = batch
    for n in range(count):
        # Split the mass between the rows, and each row between its pixels.
        value = values[0, n]
        below = mass[n] * along_y[n]
        above = mass[n] - below
        at = start + 2 * pixel[n]
        right = above * along_x[n]
        left = above - right
        _add_four(sums, at, left * value, left, right * value, right)
        right = below * along_x[n]
        left = below - right
        _add_four(sums, at + 2 * width, left * value, left, right * value, right)


@inner_kernel
def _add_areas_color(sums: Floats, start: int, width: int, batch: Batch, count: int) -> None:
    """Add cells of three channels to the 2 × 2 pixels each overlaps."""
    pixel, along_x, along_y, mass, values = batch
    for n in range(count):
        red, green, blue = values[0, n], values[1, n], values[2, n]
        # Split the mass between the rows, and each row between its pixels.
        below = mass[n] * along_y[n]
        above = mass[n] - below
        at = start + 4 * pixel[n]
        right = above * along_x[n]
        left = above - right
        _add_four(sums, at, left * red, left * green, left * blue, left)
        _add_four(sums, at + 4, right * red, right * green, right * blue, right)
        right = below * along_x[n]
        left = below - right
        # The row below.
        at += 4 * width
        _add_four(sums, at, left * red, left * green, left * blue, left)
        _add_four(sums, at + 4, right * red, right * green, right * blue, right)


@inner_kernel
def phase_of(along: Single) -> int:
    """Row of a filter's table for a distance of 0..1 px from first tap to filter's start."""
    return min(int(along * np.float32(PHASES)), PHASES - 1)


@inner_kernel
def _add_row_of_four(
    sums: Floats, at: int, value: Single, mass: Single, profile: Floats, phase: int
) -> None:
    """Add a point of one channel to four contiguous pixels."""
    a, b = mass * profile[phase, 0], mass * profile[phase, 1]
    c, d = mass * profile[phase, 2], mass * profile[phase, 3]
    _add_four(sums, at, a * value, a, b * value, b)
    _add_four(sums, at + 4, c * value, c, d * value, d)


@inner_kernel
def _add_points_gray(
    sums: Floats, start: int, width: int, batch: Batch, count: int, profile: Floats
) -> None:
    """Add points of one channel to the taps × taps pixels around each."""
    pixel, along_x, along_y, mass, values = batch
    taps = profile.shape[1]
    # Cells of mass 0 lie outside, and have no valid pixel.
    for n in range(count):
        if mass[n] == np.float32(0):
            continue
        # Look up the weights of both axes; their products are the pixels' weights.
        value = values[0, n]
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        at = start + 2 * pixel[n]
        for row in range(taps):
            share = mass[n] * profile[phase_y, row]
            # Four taps, the commonest filter, are unrolled.
            if taps == 4:
                _add_row_of_four(sums, at, value, share, profile, phase_x)
            else:
                for column in range(taps):
                    weight = share * profile[phase_x, column]
                    sums[at + 2 * column] += weight * value
                    sums[at + 2 * column + 1] += weight
            at += 2 * width


@inner_kernel
def _add_points_color(
    sums: Floats, start: int, width: int, batch: Batch, count: int, profile: Floats
) -> None:
    """Add points of three channels to the taps × taps pixels around each."""
    pixel, along_x, along_y, mass, values = batch
    taps = profile.shape[1]
    # Cells of mass 0 lie outside, and have no valid pixel.
    for n in range(count):
        if mass[n] == np.float32(0):
            continue
        # Look up the weights of both axes; their products are the pixels' weights.
        red, green, blue = values[0, n], values[1, n], values[2, n]
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        at = start + 4 * pixel[n]
        for row in range(taps):
            share = mass[n] * profile[phase_y, row]
            for column in range(taps):
                w = share * profile[phase_x, column]
                _add_four(sums, at + 4 * column, w * red, w * green, w * blue, w)
            at += 4 * width


@inner_kernel
def add_points(
    sums: Floats, start: int, width: int, batch: Batch, count: int, profile: Floats
) -> None:
    """Add the first cells of a batch as points; as `add`, under a filter table (PHASES, taps)."""
    if batch.values.shape[0] == 1:
        _add_points_gray(sums, start, width, batch, count, profile)
    else:
        _add_points_color(sums, start, width, batch, count, profile)


@inner_kernel
def add(sums: Floats, start: int, width: int, batch: Batch, count: int, spread: FilterTaps) -> None:
    """Add the first `count` cells of a batch to sums that begin at `start`, `width` px wide.

    The batch has 1 or 3 channels; the sums have as many and the weight, interleaved.
    """
    if spread.taps > 0:
        add_points(sums, start, width, batch, count, spread.profile)
    elif batch.values.shape[0] == 1:
        _add_areas_gray(sums, start, width, batch, count)
    else:
        _add_areas_color(sums, start, width, batch, count)


@inner_kernel
def gather(pixels: Floats, width: int, batch: Batch, count: int, spread: FilterTaps) -> None:
    """Transpose of `add`: gather values of cells from the `pixels` (channels, P) that each meets.

    The values of the batch are float64.
    """
    if spread.taps == 0:
        _gather_areas(pixels, width, batch, count)
    else:
        _gather_points(pixels, width, batch, count, spread.profile)


@inner_kernel
def _gather_areas(pixels: Floats, width: int, batch: Batch, count: int) -> None:
    """Gather cells' values from the 2 × 2 pixels that each overlaps."""
    pixel, along_x, along_y, mass, values = batch
    for n in range(count):
        at, x, y, area = pixel[n], float(along_x[n]), float(along_y[n]), float(mass[n])
        for c in range(values.shape[0]):
            values[c, n] = 0.0
            if area == 0.0:
                continue
            # Interpolate bilinearly, and scale by the cell's area.
            above = (1.0 - x) * pixels[c, at] + x * pixels[c, at + 1]
            below = (1.0 - x) * pixels[c, at + width] + x * pixels[c, at + width + 1]
            values[c, n] = area * ((1.0 - y) * above + y * below)


@inner_kernel
def _gather_points(pixels: Floats, width: int, batch: Batch, count: int, profile: Floats) -> None:
    """Gather points' values from the taps × taps pixels around each."""
    pixel, along_x, along_y, mass, values = batch
    taps = profile.shape[1]
    for n in range(count):
        # Cells outside gather nothing.
        if mass[n] == np.float32(0):
            for c in range(values.shape[0]):
                values[c, n] = 0.0
            continue
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        for c in range(values.shape[0]):
            # Filter along the rows, then across them.
            total, at = 0.0, pixel[n]
            for row in range(taps):
                along_row = 0.0
                for column in range(taps):
                    along_row += float(profile[phase_x, column]) * pixels[c, at + column]
                total += profile[phase_y, row] * along_row
                at += width
            values[c, n] = total * mass[n]
