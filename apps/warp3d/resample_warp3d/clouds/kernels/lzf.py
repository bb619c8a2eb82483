"""LZF, the packing of compressed PCD files (Lehmann, liblzf)."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel

Bytes = NDArray[np.uint8]


@kernel
def unpack(packed: Bytes, unpacked: Bytes) -> int:
    """Fill `unpacked`; gives how many bytes were written, −1 where the packing makes no sense."""
    source, target = 0, 0
    while source < packed.size:
        control = int(packed[source])
        source += 1
        if control < 32:  # literal bytes
            length = control + 1
            if source + length > packed.size or target + length > unpacked.size:
                return -1
            for n in range(length):
                unpacked[target + n] = packed[source + n]
            source += length
        else:  # bytes that were there before
            length = control >> 5
            if length == 7:
                if source >= packed.size:
                    return -1
                length += int(packed[source])
                source += 1
            length += 2
            if source >= packed.size or target + length > unpacked.size:
                return -1
            back = target - ((control & 31) << 8) - int(packed[source]) - 1
            source += 1
            if back < 0:
                return -1
            for n in range(length):
                unpacked[target + n] = unpacked[back + n]
        target += length
    return target
