"""What a picture should look like: dense rays through every pixel, read by Catmull-Rom's spline.

Looks from the target into the source and shares no code with the methods that it judges.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats


@kernel
def _cubic(t: float, weight: Doubles) -> None:
    """Catmull-Rom weights of the four texels around a place, `t` beyond the second."""
    weight[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    weight[1] = (1.5 * t - 2.5) * t * t + 1.0
    weight[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    weight[3] = (0.5 * t - 0.5) * t * t


@kernel
def _cast_row(
    source: Floats, inverse: Doubles, y: float, tap: Doubles, rays: int, row: Doubles
) -> None:
    """Rays along one line of the target, gathered into its pixels, `row` (w, C)."""
    height, width, channels = source.shape
    pixels, taps = row.shape[0], tap.size
    beyond = (taps - rays) // 2  # rays of the filter before a pixel's own
    across, down, value = np.empty(4), np.empty(4), np.empty(channels)
    for q in range(-beyond, pixels * rays + beyond):
        x = (q + 0.5) / rays
        d = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        if d <= 0.0:
            continue
        u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / d
        v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / d
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        left, top = math.floor(u - 0.5), math.floor(v - 0.5)
        _cubic(u - 0.5 - left, across)
        _cubic(v - 0.5 - top, down)
        value[:] = 0.0
        for m in range(4):
            r = min(max(top + m - 1, 0), height - 1)
            for n in range(4):
                k = min(max(left + n - 1, 0), width - 1)
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
        (H, W, C); beyond it there is nothing.
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
        _cast_row(source, inverse, y[n], tap, rays, rows[n])
