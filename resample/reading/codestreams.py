"""Sizes of compressed pictures from their first bytes: some readers decode when opening."""

import struct
from pathlib import Path
from typing import BinaryIO

START, SIZED = b"\xff\xd8", b"\xff\x4f\xff\x51"  # of JPEG and its variants; of JPEG 2000
NO_FRAMES = (0xC4, 0xC8, 0xCC)  # markers in the range of frames that are not frames
OF_JPEG_LS = 0xF7
BARE_XL, BOXED_XL, BOXED_2000 = b"\xff\x0a", b"\0\0\0\x0cJXL ", b"\0\0\0\x0cjP  "
MOST_BOXES, NEAR = 1000, 1 << 16  # bytes within which JPEG 2000 states its size
BITS = (9, 13, 18, 30)  # field widths of a side in JPEG XL
SHAPES = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))  # width to height


def size_of(frame: bytes) -> tuple[int, int] | None:
    """Height and width of a JPEG, JPEG-LS or JPEG 2000 picture; None for others.

    Examples
    --------
    >>> from resample.reading.codestreams import size_of
    >>> size_of(bytes.fromhex("ffd8 ffc0 000b 08 0010 0020 01 011100"))
    (16, 32)
    """
    if not frame.startswith(START):
        at = frame[:NEAR].find(SIZED)
        return None if at < 0 else _of_jpeg_2000(frame[at + 8 : at + 24])
    place = 2
    while place + 9 <= len(frame) and frame[place] == 0xFF:
        mark, length = frame[place + 1], int.from_bytes(frame[place + 2 : place + 4], "big")
        if mark == 0xFF:  # padding
            place += 1
            continue
        if mark == OF_JPEG_LS or (0xC0 <= mark <= 0xCF and mark not in NO_FRAMES):
            height, width = struct.unpack_from(">2H", frame, place + 5)
            return height, width
        place += 2 + max(2, length)
    return None


def size_at_once(path: Path) -> tuple[int, int] | None:
    """Height and width of a file that is decoded when opened: JPEG 2000 or JPEG XL."""
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(0)
        if head.startswith((SIZED, BOXED_2000)):
            return size_of(file.read(NEAR))
        if head.startswith((BARE_XL, BOXED_XL)):
            return _of_jpeg_xl(_codestream(file, head))
    return None


def _of_jpeg_2000(sizes: bytes) -> tuple[int, int] | None:
    if len(sizes) < 16:
        return None
    across, down, left, top = struct.unpack(">4I", sizes)
    return down - top, across - left


def _codestream(file: BinaryIO, head: bytes) -> bytes:
    """First bytes of a JPEG XL picture; empty if not found."""
    if head.startswith(BARE_XL):
        return file.read(32)
    place = 0
    for _ in range(MOST_BOXES):
        file.seek(place)
        box = file.read(16)
        if len(box) < 16:
            break
        size, name, long = struct.unpack(">I4sQ", box)
        if name in (b"jxlc", b"jxlp"):
            file.seek(place + (16 if size == 1 else 8) + 4 * (name == b"jxlp"))
            return file.read(32)
        step = long if size == 1 else size
        if step < 8:
            break
        place += step
    return b""


def _of_jpeg_xl(head: bytes) -> tuple[int, int] | None:
    """Height and width from the bits after the marker, lowest first."""
    if not head.startswith(BARE_XL) or len(head) < 14:
        return None
    bits = int.from_bytes(head[2:], "little")

    def take(count: int) -> int:
        nonlocal bits
        found, bits = bits & ((1 << count) - 1), bits >> count
        return found

    def side(is_small: int) -> int:
        return 8 * (take(5) + 1) if is_small else take(BITS[take(2)]) + 1

    is_small = take(1)
    height = side(is_small)
    shape = take(3)
    if not shape:
        return height, side(is_small)
    across, down = SHAPES[shape - 1]
    return height, height * across // down
