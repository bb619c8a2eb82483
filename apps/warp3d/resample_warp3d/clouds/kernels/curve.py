"""Morton codes: the bits of three coordinates, interleaved."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.types import Floats

Codes = NDArray[np.uint64]

CHUNK = 16384  # points that a thread takes at a time


@inner_kernel
def _spaced(bits: int) -> int:
    """Spread the 21 bits of a number, with two zeros after each."""
    # Split the bits in halves again and again, moving the upper halves up.
    bits = (bits | bits << 32) & 0x1F00000000FFFF
    bits = (bits | bits << 16) & 0x1F0000FF0000FF
    bits = (bits | bits << 8) & 0x100F00F00F00F00F
    bits = (bits | bits << 4) & 0x10C30C30C30C30C3
    return (bits | bits << 2) & 0x1249249249249249


@kernel
def _codes(position: Floats, low: Floats, scale: float, code: Codes, chunk: int) -> None:
    """Fill in the codes of a chunk; see `codes`."""
    start = int(np.int64(chunk)) * CHUNK
    for n in range(start, min(start + CHUNK, code.size)):
        # Quantize to 21 bits per axis, and interleave.
        x = _spaced(int(float(position[n, 0] - low[0]) * scale))
        y = _spaced(int(float(position[n, 1] - low[1]) * scale))
        z = _spaced(int(float(position[n, 2] - low[2]) * scale))
        code[n] = x | y << 1 | z << 2


@parallel_kernel
def codes(counter: Counter, position: Floats, low: Floats, scale: float, code: Codes) -> None:
    """Fill in the Morton codes (N,) of points (N, 3).

    `low` (3,) are their least coordinates; the rest times `scale` is at most 2²¹ − 1.
    """
    for chunk in tasks(counter, (code.size + CHUNK - 1) // CHUNK):
        _codes(position, low, scale, code, chunk)
