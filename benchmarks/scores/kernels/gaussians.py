"""Gaussians in order of depth over the whole picture, and on single rays."""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from benchmarks.scores.kernels.compiling import kernel, parallel_kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@kernel
def composite(
    order: Integers,  # Gaussians, nearest first
    center: Floats,  # (N, 2) px
    conic: Floats,  # (N, 3) inverse covariance: xx, xy, yy
    reach: Floats,  # (N, 2) px, half sides of the box beyond which alpha is less than 1 / 255
    opacity: Floats,
    color: Floats,
    image: Floats,  # (H, W, 3), 0 at first
    light: Floats,  # (H, W), 1 at first
) -> None:
    """Composite Gaussians at pixel centers, one after the other."""
    height, width = light.shape
    for n in order:
        top, bottom = int(center[n, 1] - reach[n, 1]) - 1, int(center[n, 1] + reach[n, 1]) + 2
        left, right = int(center[n, 0] - reach[n, 0]) - 1, int(center[n, 0] + reach[n, 0]) + 2
        for row in range(max(0, top), min(height, bottom)):
            for column in range(max(0, left), min(width, right)):
                x, y = column + 0.5 - center[n, 0], row + 0.5 - center[n, 1]
                square = conic[n, 0] * x * x + conic[n, 2] * y * y
                alpha = min(0.99, opacity[n] * math.exp(-0.5 * square - conic[n, 1] * x * y))
                if alpha < 1 / 255 or light[row, column] < 1e-4:
                    continue
                for c in range(3):
                    image[row, column, c] += light[row, column] * alpha * color[n, c]
                light[row, column] *= 1 - alpha


@parallel_kernel
def composite_rays(
    way: Floats,  # (M, 2) x and y of the rays at z = 1, in the camera
    position: Floats,  # (N, 3) Gaussians in frames of their own, in which they are round
    inverse: Floats,  # (N, 3, 3) from the camera to these frames
    opacity: Floats,
    color: Floats,
    out: Floats,  # (M, 3), 0 at first
) -> None:
    """Composite every Gaussian's greatest response on each ray, sorted along the ray."""
    for ray in prange(way.shape[0]):
        alpha, depth, which = [0.0], [0.0], [0]
        for n in range(position.shape[0]):
            along = length = away = 0.0
            for m in range(3):
                step = inverse[n, m, 0] * way[ray, 0] + inverse[n, m, 1] * way[ray, 1]
                step += inverse[n, m, 2]
                along += step * position[n, m]
                length += step * step
                away += position[n, m] * position[n, m]
            most = min(0.99, opacity[n] * math.exp(-0.5 * (away - along * along / length)))
            if along > 0 and most >= 1 / 255:
                alpha.append(most)
                depth.append(along / length)
                which.append(n)
        light = 1.0
        for m in np.argsort(np.array(depth)):
            for c in range(3):
                out[ray, c] += light * alpha[m] * color[which[m], c]
            light *= 1 - alpha[m]
