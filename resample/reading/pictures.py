"""Check picture sizes before pixels are decoded."""

import errno
import math
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resample.reading.codestreams import size_at_once
from resample.reading.limits import check_free, check_size, check_unpacked
from resample.reading.native import plain, suppressed_output
from resample.reading.unpacking import PIECE
from resample.words import one_line

PNG = b"\x89PNG\r\n\x1a\n"
FORMS = {"uint8": 1, "int8": 1, "uint16": 2, "int16": 2, "half": 2, "double": 8}  # others have 4


def check_picture(path: str | Path, spec: Any, size: int | None = None) -> None:
    """Reject a picture that unpacks to implausibly much for its file, or to more than is free.

    Parameters
    ----------
    size
        Bytes per value in memory. Default: as stored.
    """
    count, stored = check_honest(path, spec)
    check_free(str(path), count * (size or stored))


def check_honest(path: str | Path, spec: Any) -> tuple[int, int]:
    """Reject a picture that unpacks to implausibly much for its file, or has no pixels.

    Returns
    -------
    Number of values, and bytes per value.
    """
    if spec.deep:
        raise ValueError(f"{path} is a deep picture, of samples at several depths; flatten it")
    shape = (spec.width, spec.height, max(1, spec.depth), spec.nchannels)
    if min(shape) < 1:
        raise ValueError(f"{path} has {spec.width} x {spec.height} pixels; get the file again")
    count, stored = math.prod(shape), FORMS.get(str(spec.format), 4)
    check_unpacked(str(path), Path(path).stat().st_size, count * stored)
    return count, stored


def opened(path: str | Path, page: int = 0) -> Any:
    """Open a picture by OpenImageIO at a page, after checking that this does not unpack gigabytes.

    Colors are as stored, not multiplied by alpha.

    Returns
    -------
    OpenImageIO's ImageInput.
    """
    import OpenImageIO

    if not Path(path).is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    check_unopened(path)
    as_stored = OpenImageIO.ImageSpec()  # also fixes PFM's flipped row order
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    with suppressed_output():
        source = OpenImageIO.ImageInput.open(plain(path), as_stored)
    if source is None:
        raise OSError(f"{path} is not a picture that can be read: {complaint_of(OpenImageIO)}")
    if page and not source.seek_subimage(page, 0):
        raise OSError(f"{path} has no page {page + 1}: {complaint_of(source)}")
    return source


def complaint_of(source: Any, unknown: str = "no reason is given") -> str:
    """Error message, in a line, of OpenImageIO or one of its files, which forget it."""
    try:
        return str(source.geterror()).strip().partition("\n")[0].strip() or unknown
    except UnicodeDecodeError:  # it quotes a damaged file
        return "it has letters that are no text"


def check_unopened(path: str | Path) -> None:
    """Reject a picture that unpacks to too much when opened, by any library.

    That applies to compressed texts and color profiles of PNG, and to JPEG 2000 and JPEG XL.
    """
    size = size_at_once(Path(path))
    if size is not None:  # at least a byte per pixel
        check_unpacked(str(path), Path(path).stat().st_size, math.prod(size))
    total = 0
    with Path(path).open("rb") as file:
        if file.read(len(PNG)) != PNG:
            return
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            length, name = struct.unpack(">I4s", head)
            if name in (b"zTXt", b"iTXt", b"iCCP"):
                total = _grown(path, file.read(length), name, total)
                file.seek(4, 1)
            else:
                file.seek(length + 4, 1)


def _grown(path: str | Path, content: bytes, name: bytes, total: int) -> int:
    """Unpacked bytes of all texts so far, including this one."""
    keyword, _, rest = content.partition(b"\0")
    if name == b"iTXt":
        if rest[:1] != b"\1":  # uncompressed
            return total + len(rest)
        rest = b"".join(rest[2:].split(b"\0", 2)[2:])
    rest, unpacker = rest[name != b"iTXt" :], zlib.decompressobj()
    try:
        while rest:
            total += len(unpacker.decompress(rest, PIECE))
            check_size(f"{path}, its text {keyword.decode('latin-1')!r:.40}", total, "tree")
            rest = unpacker.unconsumed_tail
    except zlib.error:  # ignored by readers
        pass
    return total


@contextmanager
def decoding(path: str | Path) -> Iterator[None]:
    """Convert the errors of decoders written in Python to one type."""
    try:
        yield
    except (MemoryError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:  # Pillow's plugins raise a dozen types
        raise OSError(f"{path} is not a picture that can be read: {one_line(error):.200}") from None
