"""Unpack Zstandard data by numcodecs (an extra), with an upper bound on the size of the output."""

import struct
from typing import Any

import numpy as np

from resample.reading.limits import check_becomes

ZSTD = 0xFD2FB528  # magic number of a frame
ZSTD_BLOCK = 1 << 17  # largest unpacked size of a block, bytes


def unzstd(data: Any, most: int, size: int) -> Any:
    """Unpack Zstandard data, whose frame states its size or whose blocks bound it.

    `most`: limit in bytes. `size`: if the bound exceeds `most`, the output must have this size.
    """
    from numcodecs import Zstd

    data = bytes(data)
    told, first = _head(data)
    if told is not None:
        check_becomes(told, most)
        return Zstd().decode(data)
    if _bound(data, first, most) <= most:
        return Zstd().decode(data)
    try:
        return Zstd().decode(data, np.empty(size, np.uint8))
    except RuntimeError as error:
        raise ValueError(f"it unpacks to other than {size} bytes: {error}") from None


def _head(data: bytes) -> tuple[int | None, int]:
    """Unpacked size that a frame states, if any, and the position of its blocks."""
    if len(data) < 6 or struct.unpack_from("<I", data)[0] != ZSTD:
        raise ValueError("it is not of Zstandard")
    flags = data[4]
    is_single = bool(flags & 0x20)
    start = 5 + (not is_single) + (0, 1, 2, 4)[flags & 3]
    width = (int(is_single), 2, 4, 8)[flags >> 6]
    if len(data) < start + width:
        raise ValueError("it is cut off")
    if not width:
        return None, start
    told = int.from_bytes(data[start : start + width], "little")
    return told + 256 * (width == 2), start + width


def _bound(data: bytes, place: int, most: int) -> int:
    """Bound on the unpacked size of the only frame's blocks, or a number above `most`."""
    count, is_last = 0, False
    while not is_last and count <= most:
        if place + 3 > len(data):
            raise ValueError("it is cut off")
        head = int.from_bytes(data[place : place + 3], "little")
        is_last, kind, length = bool(head & 1), head >> 1 & 3, head >> 3
        count += ZSTD_BLOCK if kind == 2 else length
        place += 3 + (1 if kind == 1 else length)
    is_whole = place + 4 * (data[4] >> 2 & 1) >= len(data)  # with its checksum
    return count if is_whole else most + 1  # further frames would be unpacked, too
