"""Check picture sizes before pixels are decoded."""

import math
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from resample.messages import one_line
from resample.reading.limits import PIECE, check_file, check_free, check_size, check_unpacked
from resample.reading.native import plain, suppressed_output

START, SIZED = b"\xff\xd8", b"\xff\x4f\xff\x51"  # of JPEG and its variants; of JPEG 2000
NO_FRAMES = (0xC4, 0xC8, 0xCC)  # markers in the range of frames that are not frames
OF_JPEG_LS = 0xF7
BARE_XL, BOXED_XL, BOXED_2000 = b"\xff\x0a", b"\0\0\0\x0cJXL ", b"\0\0\0\x0cjP  "
MOST_BOXES, NEAR = 1000, 1 << 16  # bytes within which JPEG 2000 states its size
BITS = (9, 13, 18, 30)  # field widths of a side in JPEG XL
SHAPES = ((1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1))  # width to height
PNG = b"\x89PNG\r\n\x1a\n"
AVIF = (b"ftypavif", b"ftypavis")  # after the length of the first box
FORMS = {"uint8": 1, "int8": 1, "uint16": 2, "int16": 2, "half": 2, "double": 8}  # others have 4


def size_of(frame: bytes) -> tuple[int, int] | None:
    """Height and width of a JPEG, JPEG-LS or JPEG 2000 picture; None for others.

    Examples
    --------
    >>> size_of(bytes.fromhex("ffd8 ffc0 000b 08 0010 0020 01 011100"))
    (16, 32)
    """
    if not frame.startswith(START):
        at = frame[:NEAR].find(SIZED)
        if at < 0 or len(frame) < at + 24:
            return None
        across, down, left, top = struct.unpack_from(">4I", frame, at + 8)
        return down - top, across - left
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


def check_picture(path: str | Path, spec: Any, size: int | None = None) -> None:
    """Reject a picture that unpacks to implausibly much for its file, or to more than is free.

    `size`: bytes per value in memory. Default: as stored.
    """
    count, stored = check_honest(path, spec)
    check_free(str(path), count * (size or stored))


def check_honest(path: str | Path, spec: Any) -> tuple[int, int]:
    """Reject a picture that unpacks to implausibly much for its file, or has no pixels.

    Result: number of values, and bytes per value.
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

    Result: OpenImageIO's ImageInput; or its like for AVIF, which it cannot read, and where pixels
    are not seen as stored.
    """
    import OpenImageIO

    from resample.reading.displayed import displayed

    check_file(path)
    check_unopened(path)
    if is_avif(path):
        from resample.reading.displayed import AvifInput

        with decoding(path):
            return AvifInput(path)
    as_stored = OpenImageIO.ImageSpec()  # also fixes PFM's flipped row order
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    with suppressed_output():
        source = OpenImageIO.ImageInput.open(plain(path), as_stored)
    if source is None:
        raise OSError(f"{path} is not a picture that can be read: {complaint_of(OpenImageIO)}")
    if page and not source.seek_subimage(page, 0):
        raise OSError(f"{path} has no page {page + 1}: {complaint_of(source)}")
    seen = displayed(source, path)
    if seen is not source:  # it is decoded as a whole
        check_picture(path, source.spec())
    return seen


def is_avif(path: str | Path) -> bool:
    """Whether a file is an AVIF picture, by its first bytes."""
    with Path(path).open("rb") as file:
        return file.read(12)[4:] in AVIF


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
