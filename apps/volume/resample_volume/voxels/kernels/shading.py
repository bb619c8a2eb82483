"""Lighting of voxels, without anything that prevents SIMD.

The caller finds the nearest along z; then along y, of the results in each column, and along x, of
the results in each row. Maurer, Qi and Raghavan 2003, "A linear time algorithm for computing exact
Euclidean distance transforms of binary images in arbitrary dimensions".
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Indices, Lamp

CHUNK = 4096  # voxels that a thread takes at a time

TINY = 1e-300  # keeps divisions finite
FRACTION_BITS, BIAS = 52, np.int32(1023)  # of float64
UP_TO_ONE = 0x00095F619980C433  # from the bits of √½ to those of 1
LEAST = -1000.0  # exponent of 2
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)  # unsigned indices
SERIES = tuple(math.log(2) ** n / math.factorial(n) for n in range(8))  # of 2 ** x
NOTHING = -1  # in place of an index, where nothing is known

Places = NDArray[np.int32]


@kernel
def power(base: float, exponent: float) -> float:
    """Power of a base from 0 to 1 to an exponent above 0, with an error below 1e-8."""
    # Split the base into m 2^k with m around 1.
    bits = np.float64(base).view(np.int64)
    k = np.int32((bits + UP_TO_ONE) >> FRACTION_BITS) - BIAS
    m = np.int64(bits - (np.int64(k) << FRACTION_BITS)).view(np.float64)
    # Take its logarithm: log m = 2 atanh f.
    f = (m - 1.0) / (m + 1.0)
    g = f * f
    log = 2.0 * f * (1.0 + g * (1 / 3 + g * (1 / 5 + g * (1 / 7 + g * (1 / 9)))))
    # Multiply by the exponent, and split into whole and fraction.
    y = max(exponent * (float(k) + log / math.log(2)), LEAST)
    whole = np.int32(y - 0.5)
    x = y - float(whole)
    # Evaluate 2^x by its series (Horner), and scale by the whole power.
    total = SERIES[7]
    for n in range(6, -1, -1):
        total = SERIES[n] + x * total
    scale = np.int64(np.int64(whole + BIAS) << FRACTION_BITS).view(np.float64)
    return total * scale if base > 0.0 else 0.0


@kernel
def _shade(position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats) -> None:
    """Shade voxels by Blinn and Phong; flat arrays of three numbers each."""
    # Load the light: `at_viewer` is a headlight, `is_near` tells perspective.
    eye_x, eye_y, eye_z, is_near = lamp.viewer[0], lamp.viewer[1], lamp.viewer[2], lamp.viewer[3]
    to_x, to_y, to_z = lamp.toward[0], lamp.toward[1], lamp.toward[2]
    at_viewer = to_x * to_x + to_y * to_y + to_z * to_z == 0.0
    flat = lamp.flat * lamp.flat
    half = 0.5 * lamp.shininess
    for n in range(np.uint64(len(position)) // THREE):
        a = THREE * n
        b, c = a + ONE, a + TWO
        # Find the direction to the viewer, and the angles to the gradient.
        x = eye_x - is_near * position[a]
        y = eye_y - is_near * position[b]
        z = eye_z - is_near * position[c]
        u, v, w = np.float64(gradient[a]), np.float64(gradient[b]), np.float64(gradient[c])
        steep = u * u + v * v + w * w
        away = x * x + y * y + z * z
        along = u * x + v * y + w * z
        # A headlight's halfway vector is the view direction; otherwise add both unit vectors.
        if at_viewer:
            facing = along * along / max(steep * away, TINY)
            diffuse = math.sqrt(facing)
        else:
            near = 1.0 / math.sqrt(max(away, TINY))
            x, y, z = x * near + to_x, y * near + to_y, z * near + to_z
            along = u * x + v * y + w * z
            facing = along * along / max(steep * (x * x + y * y + z * z), TINY)
            along = u * to_x + v * to_y + w * to_z
            diffuse = math.sqrt(along * along / max(steep, TINY))
        # Flat regions, without a gradient, have only ambient and diffuse light.
        own = lamp.ambient + lamp.diffuse * diffuse
        highlight = lamp.specular * power(facing, half)
        own = own if steep > flat else lamp.ambient + lamp.diffuse
        highlight = highlight if steep > flat else 0.0
        shaded[a] = max(own * color[a] + highlight, 0.0)
        shaded[b] = max(own * color[b] + highlight, 0.0)
        shaded[c] = max(own * color[c] + highlight, 0.0)


@kernel
def _shade_chunk(
    position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats, first: int
) -> None:
    """Shade the voxels of one chunk."""
    last = first + 3 * CHUNK
    _shade(position[first:last], color[first:last], gradient[first:last], lamp, shaded[first:last])


@parallel_kernel
def shade_voxels(
    counter: Counter, position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats
) -> None:
    """Fill in lit colors of voxels; all arrays are flat, three numbers each."""
    for chunk in tasks(counter, (len(position) // 3 + CHUNK - 1) // CHUNK):
        _shade_chunk(position, color, gradient, lamp, shaded, 3 * CHUNK * chunk)


@kernel
def _envelope(away: Indices, stack: Indices) -> int:
    """Keep the places of a line that are nearest to some part of it; return how many.

    `away` (N,) is the squared distance from the line to the known voxel of each place; below 0
    there is none. `stack` (N,) receives the places, ascending. Section 4 of the paper: of three,
    the middle one is dropped where one of the two others is nearer all along the line.
    """
    count = 0
    for n in range(away.size):
        # Skip places without a known voxel.
        if away[n] < 0:
            continue
        # Pop places whose parabola is hidden by those before and after.
        while count >= 2:
            last, before = stack[count - 1], stack[count - 2]
            a, b = last - before, n - last
            c = a + b
            if c * away[last] - b * away[before] - a * away[n] - a * b * c <= 0:
                break
            count -= 1
        stack[count] = n
        count += 1
    return count


@kernel
def _nearest_on_line(away: Indices, stack: Indices, found: Indices) -> None:
    """Find the place with the nearest known voxel for all places of a line.

    Of equal distances the first counts.
    """
    count, at = _envelope(away, stack), 0
    for n in range(away.size):
        if count == 0:
            found[n] = NOTHING
            continue
        # Advance along the envelope while the next place is nearer.
        own = (stack[at] - n) * (stack[at] - n) + away[stack[at]]
        while at + 1 < count:
            after = stack[at + 1]
            other = (after - n) * (after - n) + away[after]
            if own <= other:
                break
            own = other
            at += 1
        found[n] = stack[at]


@parallel_kernel
def nearest_in_columns(counter: Counter, deep: Places, z: int, down: Places) -> None:
    """Find the row (Y, X) in each column that leads to the nearest known voxel.

    `deep` (Y, X) is the z of the known voxel that is nearest along z, or NOTHING.
    """
    height, width = deep.shape
    away, stack = np.empty(height, np.int64), np.empty(height, np.int64)
    found = np.empty(height, np.int64)
    for x in tasks(counter, width):
        # Measure along z, then search along y.
        for y in range(height):
            far = np.int64(deep[y, x]) - z
            away[y] = NOTHING if deep[y, x] < 0 else far * far
        _nearest_on_line(away, stack, found)
        for y in range(height):
            down[y, x] = found[y]


@parallel_kernel
def nearest_in_rows(
    counter: Counter, deep: Places, down: Places, z: int, known: NDArray[np.bool_], across: Places
) -> None:
    """Find the column (Y, X) in each row that leads to the nearest known voxel.

    `down` (Y, X) is of `nearest_in_columns`; rows in which all are `known` (Y, X) are skipped.
    """
    height, width = deep.shape
    away, stack = np.empty(width, np.int64), np.empty(width, np.int64)
    found = np.empty(width, np.int64)
    for y in tasks(counter, height):
        # Skip rows without gaps.
        if known[y].all():
            continue
        # Measure along y and z, then search along x.
        for x in range(width):
            row = np.int64(down[y, x])
            if row < 0:
                away[x] = NOTHING
                continue
            far = np.int64(deep[row, x]) - z
            away[x] = far * far + (row - y) * (row - y)
        _nearest_on_line(away, stack, found)
        for x in range(width):
            across[y, x] = found[x]
