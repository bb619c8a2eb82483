"""Reference pictures: dense rays through every pixel, to texels or to a spline.

Rays go from the target into the source and share no code with the methods that they judge.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats


@kernel
def _quartic(t: float, weight: Doubles) -> None:
    """B-spline weights of the five texels around a place; or 1 for a single texel.

    `t` is counted from the third texel's center.
    """
    # A single texel needs no weights.
    if weight.size == 1:
        weight[0] = 1.0
        return
    # Evaluate the three pieces of the quartic B-spline.
    for n in range(5):
        x = abs(t + 2.0 - n)
        if x <= 0.5:
            weight[n] = (115.0 - 120.0 * x * x + 48.0 * x**4) / 192.0
        elif x <= 1.5:
            weight[n] = (55.0 + 20.0 * x - 120.0 * x**2 + 80.0 * x**3 - 16.0 * x**4) / 96.0
        else:
            weight[n] = max(5.0 - 2.0 * x, 0.0) ** 4 / 384.0


@kernel
def _mirrored(index: int, size: int) -> int:
    """Texel at an index a little outside the source, mirrored at the edge."""
    index = -1 - index if index < 0 else index
    return max(2 * size - 1 - index, 0) if index >= size else index


@kernel
def _cast_row(
    source: Floats,
    texels: int,
    inverse: Doubles,
    y: float,
    tap: Doubles,
    rays: int,
    row: Doubles,
) -> None:
    """Cast rays along a line of the target; filter them into its pixels, `row` (w, C)."""
    height, width, channels = source.shape
    pixels, taps = row.shape[0], tap.size
    # Rays of the filter before a pixel's own.
    beyond = (taps - rays) // 2
    across, down, value = np.empty(texels), np.empty(texels), np.empty(channels)
    # Cast the rays of all pixels, and of the filter's support beyond the picture.
    for q in range(-beyond, pixels * rays + beyond):
        # Project the ray into the source; skip it behind the horizon or outside.
        x = (q + 0.5) / rays
        d = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        if d <= 0.0:
            continue
        u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / d
        v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / d
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        # Interpolate the source, by a spline or by the nearest texel.
        left, top = math.floor(u), math.floor(v)
        _quartic(u - 0.5 - left, across)
        _quartic(v - 0.5 - top, down)
        value[:] = 0.0
        for m in range(texels):
            r = _mirrored(top + m - texels // 2, height)
            for n in range(texels):
                k = _mirrored(left + n - texels // 2, width)
                weight = down[m] * across[n]
                for c in range(channels):
                    value[c] += weight * source[r, k, c]
        # Add the value to the pixels with filters that cover the ray.
        first = max(0, (q - beyond) // rays)
        last = min(pixels - 1, (q + beyond) // rays)
        for p in range(first, last + 1):
            n = q + beyond - p * rays
            if 0 <= n < taps:
                for c in range(channels):
                    row[p, c] += tap[n] * value[c]


@parallel_kernel
def cast_rows(
    counter: Counter,
    source: Floats,
    texels: int,
    inverse: Doubles,
    y: Doubles,
    tap: Doubles,
    rays: int,
    rows: Doubles,
) -> None:
    """Cast rays along the lines `y` of the target.

    `source`: (H, W, C) texels, or coefficients of a spline; beyond it there is nothing. `texels`:
    texels along each axis that a ray's value depends on: 1, the nearest, or 5, of a quartic spline.
    `inverse`: (3, 3) from target to source, its last coordinate above 0 in front of the camera.
    `y`: (L,) px. `tap`: weights of the rays under a pixel's filter, along x. `rays`: rays per pixel
    along x. `rows`: (L, w, C) results, zero before.
    """
    for n in tasks(counter, y.size):
        _cast_row(source, texels, inverse, y[n], tap, rays, rows[n])
