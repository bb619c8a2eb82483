"""Read and write pictures with any number of channels, as described by their files.

Files are written atomically.
"""

import errno
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.console.backgrounds import Color
from resample.console.messages import say
from resample.files.buffered_jpeg import BufferedJpeg
from resample.files.chunked import SUFFIX as STORE
from resample.files.chunked import (
    StoredPicture,
    check_store,
    is_in_store,
    open_picture,
    writing_store,
)
from resample.files.facts.geotiff import moved
from resample.files.facts.metadata import (
    AS_FLOATS,
    JPEG,
    TIFF,
    TURNS,
    FileMetadata,
    WrittenPage,
    about_file,
    complete,
    describe,
    page_tags,
    turn,
    upright,
)
from resample.files.facts.origin import state
from resample.files.images import (
    check_pixels,
    light_of,
    read_image,
    read_levels,
    read_numbers,
    shown,
)
from resample.files.levels import fits, gaps_of, levels, whole_numbers, with_word
from resample.files.stores.addresses import Address, Place, place_of
from resample.files.writing import INCOMPLETE, check_end, refused, replacing
from resample.memory import require_memory
from resample.reading.native import plain
from resample.reading.pictures import opened as opened_picture
from resample.types import Floats

SUFFIXES = (".png", ".exr", ".tif", ".tiff", ".jpg", ".jpeg")
BYTES_PER_VALUE = 20  # bytes per value of a source and its copies while it is read and processed
FORMS = {  # OpenImageIO's integer types
    "uint8": "u1", "uint16": "u2", "uint": "u4", "int8": "i1", "int16": "i2", "int": "i4",
}  # fmt: skip
UNCALIBRATED = 0xFFFF  # Exif's value for neither sRGB nor Adobe RGB
PLAIN = (("Y",), ("R", "G", "B"), ("R", "G", "B", "A"))  # channels of most pictures


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


def read_picture(path: str | Place, page: int = 0, *, as_data: bool = False) -> Picture:
    """Read a picture in linear light, premultiplied and upright, with its metadata.

    Parameters
    ----------
    path
        Any format of OpenImageIO, or zarr: a folder, a zip file or an address.
    page
        Number of the picture in a file that holds several.
    as_data
        Keep integers that are neither shades nor colors (signed, 32-bit, or georeferenced and
        not 8-bit colors) as numbers; the missing value of a GeoTIFF becomes NaN.

    Raises
    ------
    OSError
        The file is missing or damaged.
    ValueError
        It does not fit into memory.
    """
    path = place_of(path)
    header = header_of(path, page, as_data=as_data)
    height, width, stored = header.shape
    require_memory(
        BYTES_PER_VALUE * height * width * stored,
        f"{path} of {width} x {height} pixels",
        "take a smaller picture",
    )
    data = _data(path, page, header.kind, header.about)
    kind, order = alpha_last(header.kind)
    data = data[..., order] if kind.has_alpha else data
    data = with_gaps(data, kind, header.about) if as_data else data
    turned = np.ascontiguousarray(upright(data, header.orientation))
    return Picture(turned, kind, header.upright_about)


def alpha_last(kind: Kind) -> tuple[Kind, list[int]]:
    """Kind of a picture with opacity last, and the indices of its channels in that order."""
    order = sorted(range(len(kind.channels)), key=lambda n: kind.channels[n] == "A")
    return kind._replace(channels=tuple(kind.channels[n] for n in order)), order


def _data(path: Place, page: int, kind: Kind, about: FileMetadata) -> Any:
    """Light, or numbers, in the stored orientation."""
    if isinstance(path, Address) or is_in_store(path):
        return light_of(open_picture(path).levels(), kind.channels, is_encoded=kind.is_encoded)
    return read_numbers(path, page) if about.number else read_image(path, page)


def form_of(path: Place) -> tuple[tuple[int, int, int], Kind]:
    """Height, width and channels of the result of `read_picture`, and its kind.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    header = header_of(path, 0, as_data=True)
    return (*header.size, header.shape[2]), header.kind


class Header(NamedTuple):
    """Header of a picture as stored."""

    shape: tuple[int, int, int]  # height, width and number of stored channels
    kind: Kind
    about: FileMetadata
    orientation: int  # Exif's number

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


class Levels(NamedTuple):
    """A picture with its stored levels, upright: in a quarter or half of the memory."""

    data: NDArray[Any]  # (H, W, C) uint8 or uint16; C is 1, 3 or 4; the fourth is straight alpha
    kind: Kind
    about: FileMetadata


def has_levels(path: Place) -> tuple[int, int, int] | None:
    """Height, width and channels if `read_picture_levels` can read a picture; else None."""
    header = header_of(path, 0, as_data=True)
    return (*header.size, len(header.kind.channels)) if is_plain(path, header) else None


def is_plain(path: Place, header: Header) -> bool:
    """Whether a picture has nothing but its levels."""
    _, kind, about, _ = header
    is_known = path.suffix.lower() == ".png" or is_in_store(path)  # TIFF's alpha may be either
    is_straight = not kind.has_alpha or is_known
    missing = None if about.geo is None else about.geo.missing
    is_bare = kind.bits in (8, 16) and not about.number and kind.channels in PLAIN
    return is_bare and missing is None and is_straight


def read_picture_levels(path: Place) -> Levels:
    """Read a picture like `read_picture`, but without converting its levels.

    Raises
    ------
    OSError
        The file is missing or damaged.
    ValueError
        `has_levels` returns None for it.
    """
    header = header_of(path, 0, as_data=True)
    kind, about = header.kind, header.upright_about
    if isinstance(path, Address) or is_in_store(path):
        return Levels(open_picture(path).levels(), kind, about)
    return Levels(upright(read_levels(path, kind.channels), header.orientation), kind, about)


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


class WriteOptions(NamedTuple):
    """Options for writing a picture."""

    bits: int | None = None  # 8, 16 or 32 per channel; None: what fits format and source
    background: Color | None = None  # linear light; None keeps transparency
    is_light: bool = True  # otherwise numbers, which are not encoded


def check_output(path: Path, look: WriteOptions, *, transparent: bool) -> None:
    """Reject a target that `write_picture` would reject, before any work is done.

    Raises
    ------
    ValueError
        The suffix is unknown, or the format lacks transparency or this bit depth.
    """
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES, STORE):
        raise ValueError(f"{path}: pictures are written as {', '.join(SUFFIXES)} or {STORE}")
    if suffix == STORE:
        check_store(path)
    if suffix in JPEG and transparent and look.background is None:
        raise ValueError(f"{path}: JPEG has no transparency; give --background white, or take .png")
    if look.bits is not None and look.bits not in _depths(suffix):
        allowed = " or ".join(map(str, _depths(suffix)))
        raise ValueError(f"{path}: {suffix} has {allowed} bits per channel, not {look.bits}")


def flattened(picture: Picture, background: Color) -> Picture:
    """Composite a picture over a uniform color; gray stays gray over gray.

    Raises
    ------
    ValueError
        The picture is neither gray nor RGB.
    """
    data, kind, about = picture
    if not kind.has_alpha:
        return picture
    color, alpha = data[..., :-1], data[..., -1:]
    names = kind.channels[:-1]
    is_gray = len(set(background)) == 1
    if len(names) not in (1, 3) and not is_gray:
        raise ValueError(
            f"a background's color needs a gray or RGB picture, not {', '.join(names)}"
        )
    if len(names) == 1 and not is_gray:
        color, names = np.repeat(color, 3, axis=2), ("R", "G", "B")
    behind = np.asarray(background[:1] if is_gray else background, np.float32)
    flat = color + (1.0 - np.clip(alpha, 0.0, 1.0)) * behind
    return Picture(np.asarray(flat, np.float32), kind._replace(channels=names), about)


def write_picture(path: Path, picture: Picture, look: WriteOptions) -> None:
    """Write a picture in the format of its suffix.

    Parameters
    ----------
    path
        Target with a suffix in `SUFFIXES`.
    picture
        EXR and float TIFF store it unchanged; integers are straight and sRGB-encoded.
    look
        Options for writing.

    Raises
    ------
    ValueError
        The format cannot store it.
    OSError
        The file cannot be written.
    """
    write_pages(path, [picture], look)


def write_pages(path: Path, pictures: Iterable[Picture], look: WriteOptions) -> None:
    """Write a sequence of pictures to one file; several need TIFF.

    Parameters
    ----------
    path, look
        As in `write_picture`.
    pictures
        Pictures, taken one by one.

    Raises
    ------
    ValueError
        The format cannot store one of them, or there is none.
    OSError
        The file cannot be written.
    """
    if path.suffix.lower() == STORE:
        (picture,) = pictures
        page = page_of(path, picture, look)
        with writing_store(path, page.data.shape[0]) as rows:
            rows.put(page.data)
        return
    with replacing(path) as temporary:
        written: list[WrittenPage] = []
        for picture in pictures:
            page = page_of(path, picture, look)
            target = opened(path, temporary, page, page.data.shape[0], is_next=bool(written))
            went_well = target.write_image(page.pixels) and target.close()
            if not went_well or target.has_error:
                raise refused(path, temporary, complaint_of(target))
            written.append(WrittenPage(page.about, page.data.shape, page.data.dtype.name))
        if not written:
            raise ValueError(f"{path}: there is no picture to write")
        finish(path, temporary, written)


def finish(path: Path, temporary: Path, written: list[WrittenPage]) -> None:
    """Add metadata that OpenImageIO cannot write, and read the file back as a check.

    Raises
    ------
    OSError
        It is incomplete.
    """
    check_end(path, temporary)
    complete(temporary, written)
    try:
        for n in range(len(written)):
            check_pixels(temporary, n)
    except OSError:
        raise refused(path, temporary, INCOMPLETE) from None


class StoredPage(NamedTuple):
    """A picture, or rows of one, in stored form."""

    data: NDArray[Any]  # in the stored type
    kind: Kind
    about: FileMetadata
    is_light: bool

    @property
    def pixels(self) -> NDArray[Any]:
        """Pixels in a type that OpenImageIO supports."""
        data = np.ascontiguousarray(self.data)
        return data.view(np.float32) if data.dtype.name in AS_FLOATS else data


def page_of(path: Path, picture: Picture, look: WriteOptions, *, tells: bool = True) -> StoredPage:
    """Convert a picture to stored form; warn about lost metadata.

    Raises
    ------
    ValueError
        The format cannot store it.
    """
    check_output(path, look, transparent=picture.kind.has_alpha)
    check_source(path, picture, look)
    if look.background is not None:
        picture = flattened(picture, look.background)
    suffix, (data, kind, about) = path.suffix.lower(), picture
    count = len(kind.channels)
    if suffix in (".png", *JPEG) and count - kind.has_alpha not in (1, 3):
        raise ValueError(f"{path}: {count} channels do not fit into {suffix}; take .exr or .tif")
    form = _form(suffix, kind, about, look)
    if about.geo is not None:
        if tells and about.geo.has_place and suffix not in TIFF:
            say(f"{path.name} cannot store the picture's georeference; .tif can")
        if not fits(about.geo.missing, form):
            about = about._replace(geo=about.geo._replace(nodata=""))
    is_light = look.is_light and not about.number
    if form != "float32":
        data = _integers(picture, form, is_light)
    if about.geo is not None and about.geo.missing is not None and not kind.has_alpha:
        data = with_word(data, picture.data, about.geo.missing, as_whole=kind.bits < 32)
    return StoredPage(data, kind, about, is_light)


def _integers(picture: Picture, form: str, is_light: bool) -> NDArray[Any]:
    """Convert numbers, or levels of light or fractions, to an integer type."""
    if picture.about.number:
        return whole_numbers(picture.data, form)
    return levels(picture.data, form, has_alpha=picture.kind.has_alpha, is_light=is_light)


def check_source(path: Path, picture: Picture, look: WriteOptions) -> None:
    """Reject a target that cannot store a picture's numbers (not light).

    Raises
    ------
    ValueError
        The format lacks the type, or another bit depth was requested.
    """
    number, suffix = picture.about.number, path.suffix.lower()
    if not number or suffix == ".exr":
        return
    bits = np.dtype(number).itemsize * 8
    if suffix not in TIFF and (np.dtype(number).kind != "u" or bits not in _depths(suffix)):
        raise ValueError(f"{path}: numbers of {number} do not fit into {suffix}; take .tif or .exr")
    if look.bits not in (None, 32, bits):
        raise ValueError(f"{path}: numbers of {number} are not written in {look.bits} bits")


def holds_gaps(path: Path, picture: Picture, look: WriteOptions) -> bool:
    """Whether a file marks missing values and the picture has some; always for numbers."""
    data, kind, about = picture
    has_nans = not about.number and not kind.has_alpha and bool(np.isnan(data).any())
    return holds_missing(path, kind, about, look, has_nans=has_nans)


def holds_missing(
    path: Path, kind: Kind, about: FileMetadata, look: WriteOptions, *, has_nans: bool
) -> bool:
    """As `holds_gaps`, for a picture with or without NaN."""
    if look.background is not None or kind.has_alpha:
        return False
    if about.number:
        return True
    suffix, geo = path.suffix.lower(), about.geo
    form = _form(suffix, kind, about, look)
    if suffix in TIFF and geo is not None and fits(geo.missing, form):
        return True
    return has_nans and form == "float32" and suffix in (".exr", *TIFF)


def _form(suffix: str, kind: Kind, about: FileMetadata, look: WriteOptions) -> str:
    """Type of a file's values."""
    if about.number and suffix != ".exr" and look.bits != 32:
        return about.number
    bits = look.bits or _bits(suffix, kind.bits)
    return {8: "uint8", 16: "uint16", 32: "float32"}[bits]


def _depths(suffix: str) -> tuple[int, ...]:
    return {".png": (8, 16), ".exr": (32,), ".jpg": (8,), ".jpeg": (8,)}.get(suffix, (8, 16, 32))


def _bits(suffix: str, source: int) -> int:
    """Bit depth of a format for a source of a bit depth."""
    depths = _depths(suffix)
    if source in depths:
        return source
    return min(depths) if suffix == ".png" else max(depths)


def opened(
    path: Path, temporary: Path, page: StoredPage, height: int, *, is_next: bool = False
) -> Any:
    """Open an OpenImageIO output for a page of `height` rows, the first or a further one.

    Raises
    ------
    OSError
        It cannot be written.
    """
    import OpenImageIO

    suffix, name = path.suffix.lower(), plain(temporary)
    spec = spec_of(suffix, page, height)
    if suffix in JPEG:
        return BufferedJpeg(temporary, spec)
    target = OpenImageIO.ImageOutput.create(name)
    if target is None:
        raise OSError(f"{path} cannot be written: {complaint_of(OpenImageIO)}")
    state(spec, path)
    if not target.open(name, spec, "AppendSubimage" if is_next else "Create"):
        raise refused(path, temporary, complaint_of(target))
    return target


def complaint_of(source: Any) -> str:
    """Error message of OpenImageIO or one of its files."""
    return str(source.geterror()).strip().partition("\n")[0] or "no reason is given"


def spec_of(suffix: str, page: StoredPage, height: int) -> Any:
    """OpenImageIO header of a page of `height` rows."""
    import OpenImageIO

    (_, width, count), kind, is_whole = page.data.shape, page.kind, page.data.dtype.kind != "f"
    is_bare = page.data.dtype.itemsize == 4
    form = "float" if is_bare else page.data.dtype.name
    spec = OpenImageIO.ImageSpec(width, height, count, form)
    spec.channelnames = kind.channels
    spec.alpha_channel = count - 1 if kind.has_alpha else -1
    is_same = kind.is_encoded == (is_whole and page.is_light)
    has_profile = describe(
        spec, page.about, suffix, is_encoded=is_same, colors=count - kind.has_alpha
    )
    if is_whole:
        spec.attribute("oiio:UnassociatedAlpha", 1)
        if not has_profile:
            space = "sRGB" if page.is_light else "lin_rec709_scene"
            spec.attribute("oiio:ColorSpace", space)
    if suffix in TIFF and (not is_whole or has_profile or not page.is_light):
        # OpenImageIO 3.1 cannot write an empty Exif directory.
        spec.attribute("Exif:ColorSpace", UNCALIBRATED)
    if is_bare and is_whole:
        spec.attribute("tiff:predictor", 1)
    spec.attribute("compression", "jpeg:95" if suffix in JPEG else "zip")
    spec.attribute("jpeg:subsampling", "4:4:4")
    return spec


def coverage_picture(coverage: Floats) -> Picture:
    """Gray picture of fractions, which stay numbers in every format."""
    share = np.clip(coverage, 0.0, 1.0)[..., None]
    return Picture(np.asarray(share, np.float32), Kind(("Y",), 32, is_encoded=False))


def header_in_store(found: StoredPicture) -> Header:
    """Header of a picture in chunks."""
    kind = Kind(found.channels, found.bits, is_encoded=found.bits < 32)
    return Header(found.shape, kind, FileMetadata(), 1)


def header_of(path: Place, page: int, *, as_data: bool) -> Header:
    """Read the header of a picture; parameters and errors as in `read_picture`."""
    import OpenImageIO

    if isinstance(path, Address) or is_in_store(path):
        return header_in_store(open_picture(path))
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    source = opened_picture(path)
    if source is None or not source.seek_subimage(page, 0):
        reason = OpenImageIO.geterror().strip().partition("\n")[0] or "no reason is given"
        raise OSError(f"{path} is not a picture that can be read: {reason}")
    spec = source.spec()
    source.close()
    names, form = tuple(spec.channelnames), np.dtype(FORMS.get(str(spec.format), "f4")).name
    pages = page_tags(path)
    about = about_file(path, spec, pages[page] if page < len(pages) else {})
    shape, orientation = (spec.height, spec.width, spec.nchannels), _orientation(spec)
    if as_data and _is_number(form, names, about):
        numbers = Kind(names, 32, is_encoded=False)
        return Header(shape, numbers, about._replace(number=form), orientation)
    bits = {"uint8": 8, "uint16": 16}.get(form, 32)
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    is_encoded = "srgb" in space or (bits < 32 and "lin" not in space)
    return Header(shape, Kind(shown(names), bits, is_encoded), about, orientation)


def _orientation(spec: Any) -> int:
    return int(spec.get_int_attribute("Orientation", 1))


def _is_number(form: str, names: tuple[str, ...], about: FileMetadata) -> bool:
    """Whether integers are numbers, neither shades nor colors."""
    if "A" in names:
        return False
    if about.geo is not None and form in ("uint8", "uint16"):
        return form == "uint16" or names != ("R", "G", "B")
    if len(names) > 3 and form in ("uint8", "uint16"):
        return shown(names) == names
    return form in ("int8", "int16", "int32", "uint32")
