"""Morton codes: the bits of three coordinates, interleaved."""

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats

Codes = NDArray[np.uint64]

CHUNK = 16384  # points whose codes are found together
SPREADS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def _spaced(bits: Codes) -> Codes:
    """Spread the 21 bits of numbers, with two zeros after each."""
    # Split the bits in halves again and again, moving the upper halves up.
    for shift, mask in SPREADS:
        bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
    return bits


def codes(position: Floats, low: Floats, scale: float, code: Codes) -> None:
    """Fill in the Morton codes (N,) of points (N, 3).

    `low` (3,) are their least coordinates; the rest times `scale` is at most 2²¹ − 1.
    """
    for start in range(0, code.size, CHUNK):
        # Quantize to 21 bits per axis, and interleave.
        part = slice(start, start + CHUNK)
        place = ((position[part] - low).astype(np.float64) * scale).astype(np.uint64)
        x, y, z = (_spaced(place[:, axis]) for axis in range(3))
        code[part] = x | y << np.uint64(1) | z << np.uint64(2)
