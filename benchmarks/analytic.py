"""Volumes by formulas."""

from collections.abc import Callable

import numpy as np

from resample.types import Doubles
from resample_volume.types import Volume

SIDE = 64  # voxels

Formula = Callable[[Doubles, Doubles, Doubles], Doubles]


def rings(width: float) -> Formula:
    """Two tori and a shell with a Gaussian profile; `width` is its half width at 1 / e, voxels."""

    def values(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        first = (np.hypot(x, y) - 20.0) ** 2 + z * z
        second = (np.hypot(y, z) - 14.0) ** 2 + x * x
        shell = (np.sqrt(x * x + y * y + z * z) - 26.0) ** 2
        nearest = np.minimum(np.minimum(first, second), shell * 1.3 + 0.3)
        return 230.0 * np.exp(-nearest / width**2)

    return values


def marschner_lobb(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Marschner and Lobb's signal, of frequency 6 and depth ¼, over 64 voxels."""
    u, v, w = x / 32, y / 32, z / 32
    wave = np.cos(12 * np.pi * np.cos(0.5 * np.pi * np.hypot(u, v)))
    return 255.0 * (1.0 - np.sin(0.5 * np.pi * w) + 0.25 * (1.0 + wave)) / 2.5


def ramp(x: Doubles, y: Doubles, z: Doubles) -> Doubles:
    """Ball whose values decrease linearly from its center."""
    return np.clip(255.0 * (1.0 - np.sqrt(x * x + y * y + z * z) / 28.0), 0.0, None)


FIELDS: dict[str, Formula] = {
    "rings 1.2": rings(1.2),
    "rings 2.0": rings(2.0),
    "rings 3.5": rings(3.5),
    "ramp": ramp,
    "marschner-lobb": marschner_lobb,
}


def sampled(formula: Formula, stretch: float = 1.0) -> Volume:
    """Sample a formula around the origin to an 8-bit volume with voxels of 1 × 1 × `stretch`."""
    count = np.array([SIDE, SIDE, round(SIDE / stretch)])
    spacing = np.array([1.0, 1.0, stretch])
    origin = -0.5 * spacing * (count - 1)
    x, y, z = (origin[n] + spacing[n] * np.arange(count[n]) for n in range(3))
    values = formula(x, y[:, None], z[:, None, None])
    return Volume(
        np.rint(np.clip(values, 0, 255)).astype(np.uint8), spacing, origin, np.eye(3), "formula"
    )
