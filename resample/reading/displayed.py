"""Pictures that OpenImageIO does not show as they are seen: windows, exposure, white zero; AVIF."""

import math
import re
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """The open file, or its like if pixels are not seen as stored; refuse those of CIELAB."""
    spec = source.spec()
    if spec.get_int_attribute("tiff:PhotometricInterpretation", -1) == CIELAB:
        raise ValueError(f"{path} is in CIELAB, which is not read; convert it to RGB")
    if _is_white(spec) and spec.format != "uint16":
        raise ValueError(
            f"{path} is of the kind MinIsWhite, whose white is not known for {spec.format}; write "
            "it as MinIsBlack"
        )
    is_seen = _has_window(source) or _is_white(spec)
    is_said = _radiance(source, path) != (1, spec.get_int_attribute("Orientation", 1))
    return DisplayedInput(source, path) if (is_seen or is_said) and not spec.deep else source


def _has_window(source: Any) -> bool:
    """Whether a file's display window is not that of its data; other formats than EXR have none."""
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
