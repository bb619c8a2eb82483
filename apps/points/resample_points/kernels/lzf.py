"""LZF, the compression of PCD files (Lehmann, liblzf)."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel

Bytes = NDArray[np.uint8]


@kernel
def unpack(packed: Bytes, unpacked: Bytes) -> int:
    """Decompress into `unpacked`; count the bytes, −1 if the data is invalid."""
    source, target = 0, 0
    while source < packed.size:
        control = int(packed[source])
        source += 1
        # Copy literal bytes.
        if control < 32:
            length = control + 1
            if source + length > packed.size or target + length > unpacked.size:
                return -1
            for n in range(length):
                unpacked[target + n] = packed[source + n]
            source += length
        # Copy bytes from earlier output: lengths of 9 and more have a byte of their own.
        else:
            length = control >> 5
            if length == 7:
                if source >= packed.size:
                    return -1
                length += int(packed[source])
                source += 1
            length += 2
            if source >= packed.size or target + length > unpacked.size:
                return -1
            # The copy may overlap its source, so it goes byte by byte.
            back = target - ((control & 31) << 8) - int(packed[source]) - 1
            source += 1
            if back < 0:
                return -1
            for n in range(length):
                unpacked[target + n] = unpacked[back + n]
        target += length
    return target
