"""Chunks of PNG and WebP files."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from shutil import copyfileobj
from typing import BinaryIO

PNG_START = b"\x89PNG\r\n\x1a\n"


def is_animated_png(path: Path) -> bool:
    """Whether a file is an animated PNG."""
    with path.open("rb") as file:
        is_png = file.read(8) == PNG_START
        return is_png and next(chunks(file, 8, b"acTL", ">I4s", 4), None) is not None


def chunks(file: BinaryIO, place: int, wanted: bytes, form: str, tail: int) -> Iterator[bytes]:
    """Contents of the chunks of one name in a chunked file."""
    end = file.seek(0, 2)
    while place + 8 <= end:
        file.seek(place)
        head = struct.unpack(form, file.read(8))
        name, size = head if isinstance(head[0], bytes) else head[::-1]
        if name == wanted:
            yield file.read(size)
        place += 8 + size + tail + (size % 2 if tail == 0 else 0)


def before_pixels(file: BinaryIO) -> Iterator[bytes]:
    """Chunks of a PNG file from the current position up to its pixels."""
    while True:
        head = file.read(8)
        if len(head) < 8 or head[4:] == b"IDAT":
            file.seek(-len(head), 1)
            return
        yield head + file.read(4 + int(struct.unpack(">I", head[:4])[0]))


def put_into_png(path: Path, block: bytes, marks: bytes) -> None:
    """Insert an Exif chunk, unless empty, and chunks of colors after the header of a PNG file.

    If it gets these, or has a color profile, OpenImageIO's other color chunks are removed.
    """
    fresh = path.with_name(f"{path.name}.exif")
    try:
        with path.open("rb") as source, fresh.open("xb") as target:
            target.write(source.read(8))
            header, *others = before_pixels(source)
            has_profile = any(chunk[4:8] == b"iCCP" for chunk in others)
            left_out = (b"eXIf", *((b"sRGB", b"gAMA", b"cHRM") if has_profile or marks else ()))
            named = b"eXIf" + block
            length, check = struct.pack(">I", len(block)), struct.pack(">I", zlib.crc32(named))
            target.write(header + (length + named + check if block else b"") + marks)
            target.writelines(chunk for chunk in others if chunk[4:8] not in left_out)
            copyfileobj(source, target)
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)
