"""Colors of Gaussians by their spherical harmonics, toward an eye or along parallel rays.

The real harmonics of degrees 1 to 3, in the order and with the signs of Kerbl et al. 2023.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_step, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_points.data.harmonics import APART, CONSTANT, CUBIC, EVEN, LINEAR, MIXED, SQUARE

CHUNK = 4096

Levels = NDArray[np.int16]


@inner_step
def _basis(x: float, y: float, z: float, count: int, basis: Floats) -> None:
    """Evaluate the first `count` harmonics after the constant one, in a direction."""
    if count < 3:
        return
    basis[0], basis[1], basis[2] = -LINEAR * y, LINEAR * z, -LINEAR * x
    if count < 8:
        return
    xx, yy, zz = x * x, y * y, z * z
    basis[3], basis[4] = MIXED * x * y, -MIXED * y * z
    basis[5], basis[6] = SQUARE * (2.0 * zz - xx - yy), -MIXED * x * z
    basis[7] = APART * (xx - yy)
    if count < 15:
        return
    basis[8] = -CUBIC[0] * y * (3.0 * xx - yy)
    basis[9] = CUBIC[1] * x * y * z
    basis[10] = -CUBIC[2] * y * (4.0 * zz - xx - yy)
    basis[11] = CUBIC[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy)
    basis[12] = -CUBIC[2] * x * (4.0 * zz - xx - yy)
    basis[13] = EVEN * z * (xx - yy)
    basis[14] = -CUBIC[0] * x * (xx - 3.0 * yy)


@parallel_kernel
def color_gaussians(
    counter: Counter,
    position: Floats,
    constant: Floats,
    harmonics: Levels,
    step: float,
    eye: Doubles,
    color: Floats,
) -> None:
    """Colors (N, 3) of Gaussians, filled: display values of 0 and more.

    `position`: (N, 3). `constant`: (N, 3) of degree 0. `harmonics`: (N, K, 3) in steps of `step`.
    `eye`: (4,) position and 1, or a direction of view and 0.
    """
    count, scale, first = position.shape[0], np.float32(step), np.float32(CONSTANT)
    half, zero = np.float32(0.5), np.float32(0)
    for chunk in tasks(counter, (count + CHUNK - 1) // CHUNK):
        basis = np.empty(16, np.float32)
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, count)):
            x, y, z = eye[0], eye[1], eye[2]
            if eye[3] != 0.0:
                x, y, z = position[n, 0] - x, position[n, 1] - y, position[n, 2] - z
            length = math.sqrt(x * x + y * y + z * z)
            per = 1.0 / length if length > 0.0 else 0.0
            _basis(x * per, y * per, z * per, harmonics.shape[1], basis)
            # Sum the harmonics; colors below 0 are black.
            red = green = blue = np.float32(0)
            for k in range(harmonics.shape[1]):
                red += basis[k] * np.float32(harmonics[n, k, 0])
                green += basis[k] * np.float32(harmonics[n, k, 1])
                blue += basis[k] * np.float32(harmonics[n, k, 2])
            color[n, 0] = max(half + first * constant[n, 0] + scale * red, zero)
            color[n, 1] = max(half + first * constant[n, 1] + scale * green, zero)
            color[n, 2] = max(half + first * constant[n, 2] + scale * blue, zero)
