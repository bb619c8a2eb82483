"""Read AVIF pictures by Pillow, as OpenImageIO reads others."""

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ORIENTATION = 274  # Exif tag
COLORS = ("R", "G", "B", "A")
HEADER = 1 << 16  # bytes within which the boxes of colors are
AS_STORED = ("uint8", "unknown")  # OpenImageIO's types of values as they are


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
