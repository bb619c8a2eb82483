"""What a picture should look like: dense rays through every pixel, to texels or to a spline.

Looks from the target into the source and shares no code with the methods that it judges.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats


@kernel
def _quartic(t: float, weight: Doubles) -> None:
    """B-spline weights of the five texels around a place, `t` beyond the third; or 1 for one."""
    if weight.size == 1:
        weight[0] = 1.0
        return
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
    """Texel that stands at an index a little beyond the source."""
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
    """Rays along one line of the target, gathered into its pixels, `row` (w, C)."""
    height, width, channels = source.shape
    pixels, taps = row.shape[0], tap.size
    beyond = (taps - rays) // 2  # rays of the filter before a pixel's own
    across, down, value = np.empty(texels), np.empty(texels), np.empty(channels)
    for q in range(-beyond, pixels * rays + beyond):
        x = (q + 0.5) / rays
        d = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        if d <= 0.0:
            continue
        u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / d
        v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / d
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
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
    """Rays along the lines `y` of the target.

    Parameters
    ----------
    source
        (H, W, C) texels, or coefficients of a spline; beyond it there is nothing.
    texels
        Along each axis, that tell a ray's value: 1, the one it hits, or 5, of a spline of degree 4.
    inverse
        (3, 3) from target to source, its last coordinate above 0 in front of the eye.
    y
        (L,) px.
    tap
        Weights of the rays under a pixel's filter, along x.
    rays
        Rays per pixel along x.
    rows
        (L, w, C) results, zero before.
    """
    for n in tasks(counter, y.size):
        _cast_row(source, texels, inverse, y[n], tap, rays, rows[n])
