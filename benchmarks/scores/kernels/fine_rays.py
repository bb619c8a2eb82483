"""Many rays with short steps through a trilinear field or a formula."""

import math
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from benchmarks.scores.kernels.compiling import kernel, parallel_kernel

Floats = NDArray[np.float64]

SIDE = 64  # samples along an edge of a formula's cube
FIELD, RINGS, MARSCHNER_LOBB = range(3)
OUTSIDE = -1e9
DARK = 12.0  # optical depth at which a ray ends


@kernel
def trilinear(field: NDArray[Any], x: float, y: float, z: float) -> float:
    """Value between voxels (Z, Y, X); `OUTSIDE` beyond the outermost centers."""
    column, row, layer = int(x), int(y), int(z)
    if x < 0 or y < 0 or z < 0 or column >= field.shape[2] - 1:
        return OUTSIDE
    if row >= field.shape[1] - 1 or layer >= field.shape[0] - 1:
        return OUTSIDE
    a, b, c = x - column, y - row, z - layer
    value = 0.0
    for deeper in range(2):
        for below in range(2):
            first = field[layer + deeper, row + below, column]
            second = field[layer + deeper, row + below, column + 1]
            weight = (b if below else 1 - b) * (c if deeper else 1 - c)
            value += weight * (first * (1 - a) + second * a)
    return value


@kernel
def formula(kind: int, x: float, y: float, z: float) -> float:
    """Value of a formula in 0..255, at the places of its samples; `OUTSIDE` beyond them."""
    half = (SIDE - 1) / 2
    x, y, z = x - half, y - half, z - half
    if abs(x) > half or abs(y) > half or abs(z) > half:
        return OUTSIDE
    radius = math.sqrt(x * x + y * y + z * z)
    if kind == RINGS:
        first = (math.hypot(x, y) - 20) ** 2 + z * z
        second = (math.hypot(y, z) - 14) ** 2 + x * x
        shell = 1.3 * (radius - 26) ** 2 + 0.3
        return 230 * math.exp(-min(first, second, shell) / 4)
    wave = math.cos(12 * math.pi * math.cos(0.5 * math.pi * math.hypot(x / 32, y / 32)))
    # To 0 before the faces, where methods differ by half a voxel.
    fade = min(1.0, max(0.0, (30 - radius) / 6))
    smooth = fade * fade * (3 - 2 * fade)
    return 255 * (1 - math.sin(0.5 * math.pi * z / 32) + 0.25 * (1 + wave)) / 2.5 * smooth


@kernel
def extinction(value: float, at: Floats, opacity: Floats) -> float:
    """Extinction per unit of length of opacities that are linear between values."""
    if value <= at[0]:
        return 0.0
    m = 0
    while m < at.shape[0] - 2 and value > at[m + 1]:
        m += 1
    share = min(1.0, (value - at[m]) / (at[m + 1] - at[m]))
    return -math.log(max(1e-9, 1 - opacity[m] - share * (opacity[m + 1] - opacity[m])))


@parallel_kernel
def cast(
    kind: int,  # FIELD, or a formula
    field: NDArray[Any],  # (Z, Y, X)
    spacing: Floats,
    eye: Floats,
    turn: Floats,  # (3, 3) rows right, down, ahead
    focal: float,
    center: Floats,  # px
    rays: int,  # along a side of a pixel
    at: Floats,  # values of the transfer function
    opacity: Floats,  # at these values, for a length of `unit`
    unit: float,
    step: float,
    near: float,
    far: float,
    out: Floats,  # (H, W) alpha
) -> None:
    """Alpha of pixels: the mean over their rays of 1 - exp(-optical depth)."""
    for row in prange(out.shape[0]):
        for column in range(out.shape[1]):
            total = 0.0
            for ray in range(rays * rays):
                right = (column + (ray % rays + 0.5) / rays - center[0]) / focal
                down = (row + (ray // rays + 0.5) / rays - center[1]) / focal
                length = math.sqrt(right * right + down * down + 1)
                wx = (turn[0, 0] * right + turn[1, 0] * down + turn[2, 0]) / length
                wy = (turn[0, 1] * right + turn[1, 1] * down + turn[2, 1]) / length
                wz = (turn[0, 2] * right + turn[1, 2] * down + turn[2, 2]) / length
                depth, t = 0.0, near
                while t < far and depth < DARK:
                    x, y = (eye[0] + t * wx) / spacing[0], (eye[1] + t * wy) / spacing[1]
                    z = (eye[2] + t * wz) / spacing[2]
                    value = formula(kind, x, y, z) if kind else trilinear(field, x, y, z)
                    depth += extinction(value, at, opacity) * step / unit
                    t += step
                total += 1 - math.exp(-depth)
            out[row, column] = total / (rays * rays)


@kernel
def sampled(kind: int, out: Floats) -> None:
    """Fill (SIDE, SIDE, SIDE), in the order z, y, x, with a formula's values."""
    for layer in range(SIDE):
        for row in range(SIDE):
            for column in range(SIDE):
                out[layer, row, column] = formula(kind, column, row, layer)
