"""Lighting of voxels: `engine.slabs.lighting` without anything that prevents SIMD."""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Lamp

CHUNK = 4096  # voxels that a thread takes at a time

TINY = 1e-300  # keeps divisions finite
FRACTION_BITS, BIAS = 52, np.int32(1023)  # of float64
UP_TO_ONE = 0x00095F619980C433  # from the bits of √½ to those of 1
LEAST = -1000.0  # exponent of 2
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)  # unsigned indices
SERIES = tuple(math.log(2) ** n / math.factorial(n) for n in range(8))  # of 2 ** x


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
