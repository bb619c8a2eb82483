"""Check picture sizes before pixels are decoded."""

import math
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample.messages import one_line, reader_of
from resample.reading.limits import PIECE, check_file, check_free, check_size, check_unpacked
from resample.reading.native import plain, suppressed_output

EXPOSURE = re.compile(rb"^EXPOSURE\s*=\s*(\d*\.?\d+(?:[eE][+-]?\d+)?)", re.MULTILINE)
TURNED = re.compile(rb"^([+-]X) \d+ ([+-]Y) \d+$", re.MULTILINE)
TURNS = {b"+X+Y": 8, b"-X-Y": 6}  # Exif's numbers, which OpenImageIO 3.2 exchanges
HEADER = 1 << 16  # bytes within which a Radiance file's header ends
WHITE, CIELAB = 0, 8  # photometric interpretations of TIFF: zero is white; L*a*b*
ORIENTATION = 274  # Exif tag
COLORS = ("R", "G", "B", "A")
AS_STORED = ("uint8", "unknown")  # OpenImageIO's types of values as they are


class DisplayedInput:
    """A picture file, with the methods of OpenImageIO's ImageInput that readers use.

    Data are placed in the display window of an EXR and cut at its sides. Decoded as a whole.

    `source`: OpenImageIO's ImageInput. `path`: its file.
    """

    def __init__(self, source: Any, path: str | Path) -> None:
        self.outside = 0.0  # value of pixels without data
        self._source, self._path = source, path
        self._exposure, self._orientation = _radiance(source, path)
        self.seek_subimage(source.current_subimage(), 0)

    def seek_subimage(self, page: int, level: int) -> bool:
        """Go to a page; returns whether there is such a page."""
        import OpenImageIO

        if not self._source.seek_subimage(page, level):
            return False
        self._stored, as_stored = self._source.spec(), OpenImageIO.ImageSpec()
        as_stored.attribute("oiio:UnassociatedAlpha", 1)
        self._pixels = OpenImageIO.ImageBuf(plain(self._path), page, level, as_stored)
        self._spec = seen = OpenImageIO.ImageSpec(self._stored)
        self._corner = seen.x, seen.y
        if _has_window(self._source):
            self._corner = seen.full_x, seen.full_y
            seen.width, seen.height = seen.full_width, seen.full_height
        seen.x = seen.y = seen.tile_width = seen.tile_height = 0
        seen.attribute("Orientation", self._orientation)
        return True

    def spec(self) -> Any:
        """Header of the picture as it is seen."""
        return self._spec

    def read_scanlines(
        self, first: int, last: int, _z: int, begin: int, end: int, form: Any
    ) -> NDArray[Any] | None:
        """Some channels of rows, in a type; None if the file is damaged."""
        import OpenImageIO

        (left, top), own = self._corner, self._stored
        kind = own.format if str(form) == "unknown" else form
        part = left, left + self._spec.width, top + first, top + last, 0, 1, begin, end
        if self._pixels.has_error:  # OpenImageIO divides by a width of zero then
            return None
        with suppressed_output():
            rows = self._pixels.get_pixels(kind, OpenImageIO.ROI(*part))
        if rows is None or self._pixels.has_error:
            return None
        if _is_white(own):
            color = [n - begin for n in range(begin, end) if n != own.alpha_channel]
            rows[..., color] = (65535 if rows.dtype.kind == "u" else 1) - rows[..., color]
        if self.outside and rows.dtype.kind == "f":
            y, x, is_inside = own.y - top - first, own.x - left, np.zeros(rows.shape[:2], np.bool_)
            is_inside[max(0, y) : max(0, y + own.height), max(0, x) : max(0, x + own.width)] = True
            rows[~is_inside] = self.outside
        return np.asarray(rows / np.float32(self._exposure) if self._exposure != 1 else rows)

    def read_image(self, *where: Any) -> NDArray[Any] | None:
        """All rows, in a type; or page, level and range of channels, and a type."""
        begin, end = where[2:4] if len(where) > 1 else (0, self._spec.nchannels)
        return self.read_scanlines(0, self._spec.height, 0, begin, end, where[-1])

    def geterror(self) -> str:
        """The error message."""
        return str(self._pixels.geterror())

    def close(self) -> bool:
        """Close the file."""
        return bool(self._source.close())


def displayed(source: Any, path: str | Path) -> Any:
    """The open file, or a copy if pixels are stored otherwise; reject CIELAB."""
    spec = source.spec()
    if spec.get_int_attribute("tiff:PhotometricInterpretation", -1) == CIELAB:
        raise ValueError(f"{path} is in CIELAB, which is not read; convert it to RGB")
    if _is_white(spec) and spec.format != "uint16":
        raise ValueError(
            f"{path} is of the kind MinIsWhite, but white is unknown for {spec.format}; write "
            "it as MinIsBlack"
        )
    is_seen = _has_window(source) or _is_white(spec)
    is_said = _radiance(source, path) != (1, spec.get_int_attribute("Orientation", 1))
    return DisplayedInput(source, path) if (is_seen or is_said) and not spec.deep else source


def _has_window(source: Any) -> bool:
    """Whether a file's display window differs from its data window; only EXR has one."""
    spec = source.spec()
    data, seen = (spec.x, spec.y, spec.width, spec.height), (spec.full_x, spec.full_y)
    return source.format_name() == "openexr" and data != (*seen, spec.full_width, spec.full_height)


def _is_white(spec: Any) -> bool:
    """Whether zero is white, which OpenImageIO obeys for 8 bits."""
    kind = spec.get_int_attribute("tiff:PhotometricInterpretation", -1)
    return bool(kind == WHITE and spec.format != "uint8")


def _radiance(source: Any, path: str | Path) -> tuple[float, int]:
    """Exposure, by which a Radiance file's values have been multiplied, and orientation."""
    orientation = int(source.spec().get_int_attribute("Orientation", 1))
    if source.format_name() != "hdr":
        return 1.0, orientation
    with Path(path).open("rb") as file:
        head = file.read(HEADER)
    texts, _, rest = head.partition(b"\n\n")
    order = TURNED.match(rest)
    exposure = math.prod(float(found) for found in EXPOSURE.findall(texts))
    exposure = exposure if 0 < exposure < math.inf else 1.0
    return exposure, TURNS.get(order[1] + order[2], orientation) if order else orientation


class AvifInput:
    """An AVIF file, with the methods of OpenImageIO's ImageInput; decoded when rows are read.

    Values have 8 bits and straight alpha; of several pictures the first is read.

    `path`: file to read. Raises Exception: Pillow's, of a dozen types, see
    `resample.reading.pictures.decoding`.
    """

    def __init__(self, path: str | Path) -> None:
        import OpenImageIO
        from PIL import Image, features

        if "avif" not in features.get_supported():
            raise OSError("the installed Pillow cannot read AVIF; make a .png of it")
        content = Path(path).read_bytes()
        self._image = image = Image.open(BytesIO(content), formats=["AVIF"])
        count = len(image.getbands())
        self._spec = spec = OpenImageIO.ImageSpec(image.width, image.height, count, "uint8")
        spec.channelnames = COLORS[:count]
        spec.alpha_channel = 3 if count == 4 else -1
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute("Orientation", int(image.getexif().get(ORIENTATION, 1)))
        profile = image.info.get("icc_profile")
        if profile:
            kind = OpenImageIO.TypeDesc(f"uint8[{len(profile)}]")
            spec.attribute("ICCProfile", kind, np.frombuffer(profile, np.uint8))
        _, box, coded = content[:HEADER].partition(b"colrnclx")
        if box and len(coded) > 6:
            spec.attribute("CICP", "int[4]", (*struct.unpack(">3H", coded[:6]), 1))
        self._levels: NDArray[np.uint8] | None = None
        self._complaint = ""

    def spec(self) -> Any:
        """Header of the picture."""
        return self._spec

    def seek_subimage(self, page: int, _level: int) -> bool:
        """Whether there is such a page."""
        return page == 0

    def read_scanlines(
        self, first: int, last: int, _z: int, _begin: int, _end: int, form: str
    ) -> NDArray[Any] | None:
        """Rows, as 8 bits or as floats of 0 to 1; None if the file is damaged."""
        if self._levels is None:
            try:
                self._levels = np.asarray(self._image)
            except (OSError, ValueError, RuntimeError, SyntaxError) as error:
                self._complaint = str(error)
                return None
        rows = self._levels[first:last]
        return rows if form in AS_STORED else rows.astype(np.float32) / np.float32(255)

    def read_image(self, *where: Any) -> NDArray[Any] | None:
        """All rows, in a type; or page, level and range of channels, and a type."""
        rows = self.read_scanlines(0, self._spec.height, 0, 0, 4, str(where[-1]))
        return rows if rows is None or len(where) == 1 else rows[..., where[2] : where[3]]

    def geterror(self) -> str:
        """The error message."""
        return self._complaint

    def close(self) -> bool:
        """Close the file."""
        self._image.close()
        return True


def exif_block(path: Path) -> bytes:
    """Exif block of an AVIF file; empty if missing or damaged."""
    from PIL import Image

    try:
        with Image.open(path, formats=["AVIF"]) as image:
            return bytes(image.info.get("exif", b""))
    except (OSError, SyntaxError, ValueError):
        return b""


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
    """Height and width of a JPEG, JPEG-LS or JPEG 2000 picture; None for others."""
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

    from resample.reading.pictures import displayed

    check_file(path)
    check_unopened(path)
    if is_avif(path):
        from resample.reading.pictures import AvifInput

        with decoding(path):
            return AvifInput(path)
    as_stored = OpenImageIO.ImageSpec()  # also fixes PFM's flipped row order
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    with suppressed_output():
        source = OpenImageIO.ImageInput.open(plain(path), as_stored)
    if source is None:
        why = complaint_of(OpenImageIO)
        if "could not find a format reader" in why:
            why = reader_of(path) or "its suffix is of no format of pictures, such as .png or .jpg"
        raise OSError(f"{path} is not a picture that can be read: {why}")
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
        return "it has invalid characters"


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
