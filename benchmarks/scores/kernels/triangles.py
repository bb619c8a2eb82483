"""Depths of triangles at sample centers."""

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.scores.kernels.compiling import kernel

Floats = NDArray[np.float64]


@kernel
def nearest_depths(
    corners: Floats,  # (N, 3, 3) in the camera's frame
    focal: float,
    center_x: float,
    center_y: float,
    depth: Floats,  # (H, W), inf at first
) -> None:
    """Find the depth z of the nearest triangle at each sample."""
    u, v = np.empty(3), np.empty(3)
    for n in range(corners.shape[0]):
        near = corners[n]
        if min(near[0, 2], near[1, 2], near[2, 2]) <= 0.01:
            continue
        for k in range(3):
            u[k] = focal * near[k, 0] / near[k, 2] + center_x
            v[k] = focal * near[k, 1] / near[k, 2] + center_y
        area = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])
        if area == 0:
            continue
        top, left = max(0, math.ceil(v.min() - 0.5)), max(0, math.ceil(u.min() - 0.5))
        bottom = min(depth.shape[0], math.floor(v.max() - 0.5) + 1)
        right = min(depth.shape[1], math.floor(u.max() - 0.5) + 1)
        for row in range(top, bottom):
            for column in range(left, right):
                x, y = column + 0.5 - u[0], row + 0.5 - v[0]
                p = (x * (v[2] - v[0]) - (u[2] - u[0]) * y) / area
                q = ((u[1] - u[0]) * y - (v[1] - v[0]) * x) / area
                if p >= 0 and q >= 0 and p + q <= 1:
                    z = 1 / ((1 - p - q) / near[0, 2] + p / near[1, 2] + q / near[2, 2])
                    depth[row, column] = min(depth[row, column], z)
