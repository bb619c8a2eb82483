"""Points added to pixels: each is spread by weights along x and y and leaves its value and mass.

Sums lie interleaved, the channels of a pixel and its weight side by side, so that the pixels which
a point meets in a row are one stretch of memory.
"""

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single
from resample_texture.texels.kernels.placing import Places

PHASES = 2048  # rows of a filter's table


@kernel
def _add_four(sums: Floats, at: int, a: Single, b: Single, c: Single, d: Single) -> None:
    """Add to four numbers in a row; read first, so that the compiler makes it one addition."""
    i = np.uint64(at)
    j, k, m = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
    a, b, c, d = sums[i] + a, sums[j] + b, sums[k] + c, sums[m] + d
    sums[i], sums[j], sums[k], sums[m] = a, b, c, d


@kernel
def _add_areas_gray(
    sums: Floats,
    start: int,
    width: int,
    values: Floats,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
) -> None:
    """Add cells of one channel to the 2 × 2 pixels each overlaps."""
    for n in range(mass.size):
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


@kernel
def _add_areas_color(
    sums: Floats,
    start: int,
    width: int,
    values: Floats,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
) -> None:
    """Add cells of three channels to the 2 × 2 pixels each overlaps."""
    for n in range(mass.size):
        red, green, blue = values[0, n], values[1, n], values[2, n]
        below = mass[n] * along_y[n]
        above = mass[n] - below
        at = start + 4 * pixel[n]
        right = above * along_x[n]
        left = above - right
        _add_four(sums, at, left * red, left * green, left * blue, left)
        _add_four(sums, at + 4, right * red, right * green, right * blue, right)
        right = below * along_x[n]
        left = below - right
        at += 4 * width
        _add_four(sums, at, left * red, left * green, left * blue, left)
        _add_four(sums, at + 4, right * red, right * green, right * blue, right)


@kernel
def phase_of(along: Single) -> int:
    """Row of a filter's table for a distance of 0..1 px from first tap to filter's start."""
    return min(int(along * np.float32(PHASES)), PHASES - 1)


@kernel
def _add_row_of_four(
    sums: Floats, at: int, value: Single, mass: Single, profile: Floats, phase: int
) -> None:
    """Add a point of one channel to four pixels in a row."""
    a, b = mass * profile[phase, 0], mass * profile[phase, 1]
    c, d = mass * profile[phase, 2], mass * profile[phase, 3]
    _add_four(sums, at, a * value, a, b * value, b)
    _add_four(sums, at + 4, c * value, c, d * value, d)


@kernel
def add_points_gray(
    sums: Floats,
    start: int,
    width: int,
    values: Floats,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
    profile: Floats,
) -> None:
    """Add points of one channel to the taps × taps pixels around each."""
    taps = profile.shape[1]
    for n in range(mass.size):
        if mass[n] == np.float32(0):
            continue
        value = values[0, n]
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        at = start + 2 * pixel[n]
        for row in range(taps):
            share = mass[n] * profile[phase_y, row]
            if taps == 4:
                _add_row_of_four(sums, at, value, share, profile, phase_x)
            else:
                for column in range(taps):
                    weight = share * profile[phase_x, column]
                    sums[at + 2 * column] += weight * value
                    sums[at + 2 * column + 1] += weight
            at += 2 * width


@kernel
def add_points_color(
    sums: Floats,
    start: int,
    width: int,
    values: Floats,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
    profile: Floats,
) -> None:
    """Add points of three channels to the taps × taps pixels around each."""
    taps = profile.shape[1]
    for n in range(mass.size):
        if mass[n] == np.float32(0):
            continue
        red, green, blue = values[0, n], values[1, n], values[2, n]
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        at = start + 4 * pixel[n]
        for row in range(taps):
            share = mass[n] * profile[phase_y, row]
            for column in range(taps):
                w = share * profile[phase_x, column]
                _add_four(sums, at + 4 * column, w * red, w * green, w * blue, w)
            at += 4 * width


@kernel
def add(
    sums: Floats,
    start: int,
    width: int,
    values: Floats,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
    profile: Floats,
    taps: int,
) -> None:
    """Add a row of cells or points to sums that begin at `start` and are `width` px wide.

    Parameters
    ----------
    values
        (1 or 3, N).
    pixel, along_x, along_y, mass
        (N,) as `place_on_plane` fills them.
    profile, taps
        (PHASES, taps) of the pixel filter; taps is 0 for the area filter.
    """
    if taps == 0 and values.shape[0] == 1:
        _add_areas_gray(sums, start, width, values, pixel, along_x, along_y, mass)
    elif taps == 0:
        _add_areas_color(sums, start, width, values, pixel, along_x, along_y, mass)
    elif values.shape[0] == 1:
        add_points_gray(sums, start, width, values, pixel, along_x, along_y, mass, profile)
    else:
        add_points_color(sums, start, width, values, pixel, along_x, along_y, mass, profile)
