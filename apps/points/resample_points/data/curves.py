"""A Morton curve through points: the bits of three coordinates, interleaved."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats

Codes = NDArray[np.uint64]

BATCH_SIZE = 256  # points compared at a time
CHUNK = 16384  # points with codes computed together
STEPS = 2**21 - 1  # per axis
SPREADS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


class MortonCurve(NamedTuple):
    """A Morton curve with 2²¹ steps per axis through a box."""

    low: Floats  # (3,) least coordinates
    extent: float  # of the box's longest side

    def codes(self, position: Floats | Doubles) -> Codes:
        """Return the codes (N,) of points (N, 3) along the curve."""
        code: Codes = np.empty(len(position), np.uint64)
        for start in range(0, code.size, CHUNK):
            # Quantize to 21 bits per axis, and interleave.
            part = slice(start, start + CHUNK)
            apart = np.asarray(position[part], np.float32) - self.low
            place = (apart.astype(np.float64) * (STEPS / self.extent)).astype(np.uint64)
            code[part] = 0
            for axis in range(3):
                # Split the bits in halves again and again, moving the upper halves up.
                bits = place[:, axis]
                for shift, mask in SPREADS:
                    bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
                code[part] |= bits << np.uint64(axis)
        return code


def corners(position: Floats | Doubles) -> tuple[Floats | Doubles, Floats | Doubles]:
    """Return least and greatest coordinates (3,) of at least one point."""
    whole = len(position) // BATCH_SIZE * BATCH_SIZE
    if not whole:
        return position.min(axis=0), position.max(axis=0)
    rows = position[:whole].reshape(-1, 3 * BATCH_SIZE)  # long rows are compared faster
    low, high = rows.min(axis=0).reshape(-1, 3), rows.max(axis=0).reshape(-1, 3)
    rest = position[whole:]
    return np.concatenate([low, rest]).min(axis=0), np.concatenate([high, rest]).max(axis=0)


def curve_through(position: Floats | Doubles) -> MortonCurve:
    """Return the curve through the bounding box of points (N, 3)."""
    if not len(position):
        return MortonCurve(np.zeros(3, np.float32), 1.0)
    return curve_in(*(np.asarray(corner, np.float32) for corner in corners(position)))


def curve_in(low: Floats, high: Floats) -> MortonCurve:
    """Return the curve through a box."""
    return MortonCurve(low, float((high - low).max()) or 1.0)
