"""Sizes of packed pictures within DICOM files, looked at before they are unpacked."""

import struct
from typing import Any

from resample.reading.limits import LimitError

START, SIZED = b"\xff\xd8", b"\xff\x4f\xff\x51"  # of JPEG and its kin; of JPEG 2000
NO_FRAMES = (0xC4, 0xC8, 0xCC)  # among the marks of frames
OF_JPEG_LS = 0xF7


def check_frames(told: Any, name: str) -> None:
    """Refuse packed pictures of another size than their file says: it is they that are unpacked.

    Parameters
    ----------
    told
        All of a file, by pydicom.
    name
        Of it, for the message.

    Raises
    ------
    ValueError
        One is of another size.
    """
    from pydicom.encaps import generate_frames

    wanted = (int(told.Rows), int(told.Columns))
    count = int(told.get("NumberOfFrames", 1) or 1)
    for frame in generate_frames(told.PixelData, number_of_frames=count):
        size = size_of(frame)
        if size is not None and size != wanted:
            raise LimitError(
                f"{name} holds a picture of {size[1]} x {size[0]} pixels and says that it has "
                f"{wanted[1]} x {wanted[0]}; get it again"
            )


def size_of(frame: bytes) -> tuple[int, int] | None:
    """Height and width of a picture of JPEG, JPEG-LS or JPEG 2000; None of others.

    Examples
    --------
    >>> from resample_volume.files.stacks.codestreams import size_of
    >>> size_of(bytes.fromhex("ffd8 ffc0 000b 08 0010 0020 01 011100"))
    (16, 32)
    """
    if not frame.startswith(START):
        at = frame[:4096].find(SIZED)
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


def _of_jpeg_2000(sizes: bytes) -> tuple[int, int] | None:
    if len(sizes) < 16:
        return None
    across, down, left, top = struct.unpack(">4I", sizes)
    return down - top, across - left
