"""Read pictures with any number of channels, upright and described by their files.

They become light, or numbers; or stay in their stored form, in memory or in a temporary file: 8-
and 16-bit levels stay levels, half floats stay half floats.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.console import say_of
from resample.files.images import PictureFile, light_of, open_file, shown
from resample.files.metadata.colors import oddities_of
from resample.files.metadata.fields import (
    JPEG,
    TURNS,
    FileMetadata,
    about_file,
    orientation_of,
    page_tags,
    turn,
    upright,
)
from resample.files.metadata.tags import moved
from resample.files.stores import (
    Address,
    Part,
    Place,
    StoredPicture,
    is_in_store,
    place_of,
    store_format,
)
from resample.memory import require_memory
from resample.memory.mapped import array_where_it_fits
from resample.reading.pictures import check_honest, check_picture
from resample.types import Doubles, Floats

BYTES_PER_VALUE = 20  # bytes per value of a source and its copies while it is read and processed
FORMS = {  # OpenImageIO's integer types
    "uint8": "u1", "uint16": "u2", "uint": "u4", "int8": "i1", "int16": "i2", "int": "i4",
}  # fmt: skip
PLAIN = (("Y",), ("R", "G", "B"), ("R", "G", "B", "A"))  # channels of most pictures
EVEN = {4: 1e-6, 8: 1e-12}  # relative tolerance for equality of floats, by their size in bytes
WIDE = ("int32", "uint32")  # integers that float32 cannot represent exactly


class Kind(NamedTuple):
    """Meaning of a picture file's values."""

    channels: tuple[str, ...]  # those that `read_picture` returns; alpha is called A and is last
    bits: int  # per channel: 8, 16, or 32 for floats
    is_encoded: bool  # by the sRGB curve

    @property
    def has_alpha(self) -> bool:
        return "A" in self.channels


class Picture(NamedTuple):
    """A picture in linear light, premultiplied; or numbers, if `about` says so."""

    data: Floats  # (H, W, C), float64 for 32-bit numbers; NaN where missing
    kind: Kind
    about: FileMetadata = FileMetadata()


class LoadedPicture(NamedTuple):
    """A picture as it is loaded, upright."""

    data: NDArray[Any]  # (H, W, C) levels of straight alpha; or light, premultiplied, or numbers
    kind: Kind
    about: FileMetadata
    has_nans: bool = False  # missing values
    has_gaps: bool = False  # missing or infinite values

    @property
    def has_levels(self) -> bool:
        """Whether values are levels that are not converted to light yet."""
        return self.data.dtype.kind == "u"


class Header(NamedTuple):
    """Header of a picture as stored."""

    shape: tuple[int, int, int]  # height, width and number of stored channels
    kind: Kind
    about: FileMetadata
    orientation: int  # Exif's number
    has_half_light: bool = False  # half floats represent it exactly

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the upright picture."""
        height, width, _ = self.shape
        return (width, height) if TURNS[self.orientation][0] else (height, width)

    @property
    def upright_about(self) -> FileMetadata:
        """Metadata of the upright picture."""
        about = self.about
        if about.geo is None:
            return about
        return about._replace(geo=moved(about.geo, turn(self.orientation, self.shape[:2])))


def read_picture(
    path: str | Place, page: int = 0, *, as_data: bool = False, encoding: str = "auto"
) -> Picture:
    """Read a picture in linear light, premultiplied and upright, with its metadata.

    `path`: any format of OpenImageIO, or zarr: a folder, a zip file or an address. `page`: number
    of the picture in a file that holds several. `as_data`: keep integers that are neither shades
    nor colors (signed, 32-bit, or georeferenced and not 8-bit colors) as numbers; the missing value
    of a GeoTIFF becomes NaN. `encoding`: of integers, as in `open_file`. Raises OSError: the file
    is missing or damaged. Raises ValueError: it does not fit into memory.
    """
    return picture_at(place_of(path), page, as_data=as_data, encoding=encoding).picture()


def form_of(path: Place) -> tuple[tuple[int, int, int], Kind]:
    """Height, width and channels of the result of `read_picture`, and its kind."""
    header = header_of(path, 0, as_data=True)
    return (*header.size, header.shape[2]), header.kind


@dataclass(frozen=True, eq=False)
class LoadablePicture:
    """A picture after its header was read."""

    path: Place
    page: int
    header: Header
    as_data: bool  # see `read_picture`
    stored: StoredPicture | None  # of zarr
    encoding: str = "auto"  # see `open_file`

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels, upright."""
        return (*self.header.size, len(self.header.kind.channels))

    @property
    def is_encoded(self) -> bool:
        """Whether it has sRGB-encoded levels, or light converted from them."""
        return self.header.kind.is_encoded

    @cached_property
    def is_plain(self) -> bool:
        """Whether it has nothing but its levels."""
        kind, about = self.header.kind, self.header.about
        # TIFF's alpha may be either.
        is_straight = self.stored is not None or self.path.suffix.lower() == ".png"
        missing = None if about.geo is None else about.geo.missing
        is_bare = kind.bits in (8, 16) and not about.number and kind.channels in PLAIN
        return is_bare and missing is None and (is_straight or not kind.has_alpha)

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Type of the loaded values."""
        if self.is_plain:
            return np.dtype(np.uint8 if self.header.kind.bits == 8 else np.uint16)
        is_half = self.header.has_half_light and not self.header.about.number
        return np.dtype(np.float16 if is_half else np.float32)

    @property
    def size(self) -> int:
        """Bytes of the loaded values."""
        height, width, channels = self.shape
        return height * width * channels * self.dtype.itemsize

    def picture(self) -> Picture:
        """Read light, or numbers; errors as in `read_picture`."""
        height, width, stored = self.header.shape
        what = f"{self.path} of {width} x {height} pixels"
        require_memory(BYTES_PER_VALUE * height * width * stored, what, "take a smaller picture")
        file = self._file
        if file is not None:
            check_picture(file.path, file.source.spec(), 4)
        if not (self.as_data or self.page):
            self.tell_colors()
        kind, channels = alpha_last(self.header.kind)
        data, done = np.empty((height, width, len(channels)), self._form), 0
        for strip in self._strips(file):
            data[done : done + len(strip)] = strip
            done += len(strip)
        turned = np.ascontiguousarray(upright(data, self.header.orientation))
        return Picture(turned, kind, self.header.upright_about)

    def reduced(self, height: int, width: int) -> "tuple[Picture, Doubles] | None":
        """A JPEG at 1/2, 1/4 or 1/8 of its size, at least of a given size; None if it is smaller.

        libjpeg leaves finer waves out as it decodes, which takes a fraction of the time. Also
        given: a matrix (3, 3) from its px to the whole's.
        """
        from PIL import Image

        (stored_height, stored_width, _), kind = self.header.shape, self.header.kind
        if TURNS[self.header.orientation][0]:
            height, width = width, height
        is_plain = self.is_plain and kind.channels in PLAIN[:2]
        is_large = stored_height * stored_width > (Image.MAX_IMAGE_PIXELS or 0)
        if not (is_plain and self.path.name.lower().endswith(JPEG)) or is_large:
            return None
        assert isinstance(self.path, Path)
        with Image.open(self.path) as image:
            image.draft(image.mode, (width, height))
            if image.mode not in ("L", "RGB") or image.width == stored_width:
                return None
            try:
                levels = np.asarray(image).reshape(image.height, image.width, -1)
            except OSError as error:
                raise OSError(f"{self.path} is damaged: {error}") from None
        data = light_of(levels, kind.channels, is_encoded=kind.is_encoded, size=levels.size)
        orientation, times = self.header.orientation, round(stored_width / data.shape[1])
        turned = np.ascontiguousarray(upright(data, orientation))
        # The last row and column may be cut, which are the first of a picture that is turned.
        whole, part = (
            turn(orientation, shape) for shape in (self.header.shape[:2], data.shape[:2])
        )
        matrix = whole @ np.diag([times, times, 1.0]) @ np.linalg.inv(part)
        return Picture(turned, kind, self.header.upright_about), matrix

    def load(self, seen: Part | None = None) -> LoadedPicture:
        """Read the picture as `read_picture` does, but keep the stored form if it is smaller.

        Large arrays are kept in a file, see `array_where_it_fits`.
        """
        header, file = self.header, self._file
        if file is not None:
            check_honest(file.path, file.source.spec())
        if self.is_plain and self.stored is not None:
            return LoadedPicture(self.stored.levels(seen), header.kind, header.upright_about)
        kind, channels = alpha_last(header.kind)
        shape = (*header.shape[:2], len(channels))
        data = array_where_it_fits(shape, self.dtype, self.path.name)
        done, has_nans, has_gaps = 0, False, False
        strips: Iterator[NDArray[Any]] = self._strips(file)
        if self.is_plain and file is not None:  # levels, in the order of the kind's channels
            order = [file.encoding.names.index(name) for name in header.kind.channels]
            strips = (strip[..., order] for strip in file.strips(file.form))
        for strip in strips:
            data[done : done + len(strip)] = strip
            done += len(strip)
            if not self.is_plain:
                has_gaps = has_gaps or not bool(np.isfinite(strip).all())
                has_nans = has_nans or bool(np.isnan(strip).any())
        turned = upright(data, header.orientation)
        return LoadedPicture(turned, kind, header.upright_about, has_nans, has_gaps)

    @property
    def _form(self) -> "np.dtype[Any]":
        """Type of light or numbers."""
        return np.dtype(np.float64 if self.header.about.number in WIDE else np.float32)

    @property
    def _file(self) -> PictureFile | None:
        """The file, opened; None for zarr."""
        if isinstance(self.path, Address) or self.stored is not None:
            return None
        file = open_file(self.path, self.page, self.encoding)
        for odd in oddities_of(file.source.spec()) if self.page == 0 else ():
            say_of(self.path, f"its {odd}")
        return file

    def tell_colors(self) -> None:
        """Report color metadata that is lost, or assumed, if only light is used."""
        about = self.header.about
        lost = f"colors are taken for sRGB, not {about.colors}" if about.colors else ""
        for each in filter(None, (lost, about.assumed)):
            assert isinstance(self.path, Path)  # stores say nothing of colors
            say_of(self.path, f"its {each}")

    def _strips(self, file: PictureFile | None) -> Iterator[Floats]:
        """Light, or numbers, in the stored orientation, from the top; alpha is last."""
        kind, about = self.header.kind, self.header.about
        rows: Iterator[Any]
        if file is None:
            assert self.stored is not None
            size = self.stored.array.size
            rows = (
                light_of(strip, kind.channels, is_encoded=kind.is_encoded, size=size)
                for strip in self.stored.strips()
            )
        elif about.number:
            rows = (strip.astype(self._form) for strip in file.strips(file.form))
        else:
            rows = file.light_strips()
        ordered, channels = alpha_last(kind)
        for strip in rows:
            light = strip[..., channels] if kind.has_alpha else strip
            yield with_gaps(light, ordered, about) if self.as_data else light


def picture_at(
    path: Place, page: int = 0, *, as_data: bool = True, encoding: str = "auto"
) -> LoadablePicture:
    """Read a picture's header; parameters and errors as in `read_picture`."""
    stored = store_format(path).open_picture(path) if is_in_store(path) else None
    header = _header(path, page, stored, as_data=as_data, encoding=encoding)
    return LoadablePicture(path, page, header, as_data, stored, encoding)


def loadable_picture(path: Place, encoding: str = "auto") -> LoadablePicture | None:
    """Open a picture to load; None for integers that float32 cannot represent."""
    reader = picture_at(path, encoding=encoding)
    return None if reader.header.about.number in WIDE else reader


def header_of(path: Place, page: int = 0, *, as_data: bool) -> Header:
    """Read the header of a picture; parameters and errors as in `read_picture`."""
    return picture_at(path, page, as_data=as_data).header


def alpha_last(kind: Kind) -> tuple[Kind, list[int]]:
    """Kind of a picture with opacity last, and the indices of its channels in that order."""
    order = sorted(range(len(kind.channels)), key=lambda n: kind.channels[n] == "A")
    return kind._replace(channels=tuple(kind.channels[n] for n in order)), order


def with_gaps(data: Floats, kind: Kind, about: FileMetadata) -> Floats:
    """Mark missing values as NaN; transparent too, if there is alpha."""
    missing = None if about.geo is None else about.geo.missing
    if missing is None or np.isnan(missing):
        return data
    if kind.bits < 32:
        missing /= 255.0 if kind.bits == 8 else 65535.0
        missing = float(from_srgb(np.array(missing))) if kind.is_encoded else missing
    color = data[..., :-1] if kind.has_alpha else data
    gaps = gaps_of(color, missing, as_whole=kind.bits < 32 or kind.has_alpha)
    return np.where(gaps, np.float32(0.0 if kind.has_alpha else np.nan), data)


def gaps_of(data: Floats, missing: float, *, as_whole: bool) -> NDArray[np.bool]:
    """Where values (H, W, C) are missing: each, or pixels (H, W, 1) `as_whole`."""
    gaps: NDArray[np.bool] = np.isclose(
        data, data.dtype.type(missing), rtol=EVEN[data.dtype.itemsize], atol=0.0
    )
    return np.asarray(gaps.all(axis=2, keepdims=True)) if as_whole else gaps


def _header(
    path: Place, page: int, stored: StoredPicture | None, *, as_data: bool, encoding: str
) -> Header:
    if stored is not None:
        is_encoded = stored.bits == 8 if encoding == "auto" else encoding == "srgb"
        kind = Kind(stored.channels, stored.bits, is_encoded and stored.bits < 32)
        is_half = stored.array.dtype.name == "float16"
        return Header(stored.shape, kind, FileMetadata(), 1, is_half)
    assert isinstance(path, Path)  # addresses are always stores
    file = open_file(path, page, encoding)
    spec, names = file.source.spec(), file.encoding.names
    form = np.dtype(FORMS.get(file.form, "f4")).name
    pages = page_tags(file.path)
    about = about_file(file.path, spec, pages[page] if page < len(pages) else {})
    if bool(FORMS.get(file.form)) and "lin" in spec.get_string_attribute("oiio:ColorSpace").lower():
        about = about._replace(says_linear=True)
    orientation = orientation_of(file.path, spec)
    file.source.close()
    bits = {"uint8": 8, "uint16": 16}.get(form, 32)
    is_encoded = file.encoding.is_encoded and (bits < 32 or form == "float32")
    kind = Kind(shown(names), bits, is_encoded)
    # Integers may be numbers, neither shades nor colors.
    if about.geo is not None and form in ("uint8", "uint16"):
        is_number = form == "uint16" or names != ("R", "G", "B")
    elif len(names) > 3 and form in ("uint8", "uint16"):
        is_number = shown(names) == names
    else:
        is_number = form in ("int8", "int16", "int32", "uint32")
    if as_data and is_number and "A" not in names:
        kind, about = Kind(names, 32, is_encoded=False), about._replace(number=form)
    if encoding != "auto" or about.number:
        about = about._replace(assumed="")
    return Header(file.shape, kind, about, orientation, file.has_half_light)
