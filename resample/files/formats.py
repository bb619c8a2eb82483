"""Capabilities of picture formats: options, and conversion of pictures to stored values."""

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.console import Color, say
from resample.files.metadata.colors import converted
from resample.files.metadata.fields import AS_FLOATS, JPEG, PROFILE_SPACES, TIFF, FileMetadata
from resample.files.pictures import Kind, Picture
from resample.files.stores import STORE, store_format
from resample.types import Floats

FORMATS = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska"}  # of films
SUFFIXES = (".png", ".exr", ".jpg", ".jpeg", ".tif", ".tiff")
BY_PILLOW = {".webp": "webp", ".avif": "avif"}  # its names of optional features
QUALITY = {".jpg": 95, ".jpeg": 95, ".webp": 90, ".avif": 85}  # unless given
NO_LOSS = "lossless"
PHOTO = "; for a photo give --encoding srgb"


class WriteOptions(NamedTuple):
    """Options for writing a picture."""

    bits: int | None = None  # 8, 16 or 32 per channel; None: what fits format and source
    background: Color | None = None  # linear light; None keeps transparency, black in JPEG
    is_light: bool = True  # otherwise numbers, which are not encoded
    quality: int | str | None = None  # 1 to 100 of `QUALITY`, or `NO_LOSS` of .webp
    in_srgb: bool = False  # colors of ICC profiles become sRGB's; otherwise profiles are kept


def check_output(path: Path, look: WriteOptions) -> None:
    """Reject a target that `write_picture` would reject, before any work is done."""
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES, *BY_PILLOW, STORE):
        known = ", ".join((*SUFFIXES, *BY_PILLOW))
        raise ValueError(f"{path}: pictures are written as {known} or {STORE}")
    if suffix in BY_PILLOW and not can_be_written(suffix):
        raise ValueError(f"{path}: the installed Pillow cannot write it; take .png or .jpg")
    if look.quality == NO_LOSS and suffix in QUALITY and suffix != ".webp":
        raise ValueError(f"{path}: {suffix} is never {NO_LOSS}; take .png or .webp")
    if look.quality not in (None, NO_LOSS) and suffix not in QUALITY:
        known = ", ".join(QUALITY)
        raise ValueError(f"{path}: {suffix} has no quality, {known} have; leave it out")
    if suffix == STORE:
        store_format(path).check_store(path)
    if look.bits is not None and look.bits not in _depths(suffix):
        allowed = " or ".join(map(str, _depths(suffix)))
        raise ValueError(f"{path}: {suffix} has {allowed} bits per channel, not {look.bits}")


def takes_alpha(path: Path, look: WriteOptions) -> bool:
    """Whether a file has opacity, or a background in its place; in others gaps are black."""
    return look.background is not None or path.suffix.lower() not in (*JPEG, *FORMATS)


def can_be_written(suffix: str) -> bool:
    """Whether a format is in `BY_PILLOW` and the installed Pillow writes it."""
    from PIL import features

    return suffix in BY_PILLOW and BY_PILLOW[suffix] in features.get_supported()


def flattened(picture: Picture, background: Color) -> Picture:
    """Composite a picture over a uniform color; gray stays gray over gray."""
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


class StoredPage(NamedTuple):
    """A picture, or rows of one, in stored form."""

    data: NDArray[Any]  # in the stored type
    kind: Kind
    about: FileMetadata
    options: WriteOptions
    is_light: bool  # values are neither numbers nor shares

    @property
    def pixels(self) -> NDArray[Any]:
        """Pixels in a type that OpenImageIO supports."""
        data = np.ascontiguousarray(self.data)
        return data.view(np.float32) if data.dtype.name in AS_FLOATS else data


def page_of(path: Path, picture: Picture, look: WriteOptions, *, tells: bool = True) -> StoredPage:
    """Convert a picture to stored form; warn about lost metadata."""
    check_output(path, look)
    check_source(path, picture, look)
    if look.in_srgb:
        picture = as_srgb(picture)
    if look.background is not None or path.suffix.lower() in JPEG:
        picture = flattened(picture, look.background or (0.0, 0.0, 0.0))
    suffix, (data, kind, about) = path.suffix.lower(), picture
    count = len(kind.channels)
    if suffix in (".png", *JPEG, *BY_PILLOW) and count - kind.has_alpha not in (1, 3):
        raise ValueError(f"{path}: {count} channels do not fit into {suffix}; take .exr or .tif")
    form = _form(suffix, kind, about, look)
    is_whole = form != "float32"
    if about.geo is not None:
        if tells and about.geo.has_place and suffix not in TIFF:
            say(f"{path.name} cannot store the picture's georeference; .tif can")
        if not fits(about.geo.missing, form):
            about = about._replace(geo=about.geo._replace(nodata=""))
    is_linear = not kind.is_encoded and kind.bits <= 8 * np.dtype(form).itemsize
    if about.says_linear and kind.bits == 8 and suffix != ".png":
        is_linear = False  # only PNG can say so of 8 bits
    is_light = look.is_light and not (about.number or (is_linear and kind.bits < 32))
    about = _with_colors(path, picture, about, is_same=kind.is_encoded == (is_whole and is_light))
    if tells and about.says_linear and is_linear and suffix in TIFF:
        say(
            f"{path.name} cannot say that its values are linear light, as its source does; .png can"
        )
    if tells:
        tell_colors(path, about, is_guessed=suffix == ".exr" or (is_whole and is_light))
    if about.number and is_whole:
        # Numbers are rounded, and clipped to the type's range; missing values become 0.
        limits = np.iinfo(form)
        rounded = np.rint(np.nan_to_num(data.astype(np.float64), nan=0.0, posinf=np.inf))
        data = np.clip(rounded, limits.min, limits.max).astype(form)
    elif is_whole:
        data = levels(data, form, has_alpha=kind.has_alpha, is_light=is_light)
    if about.geo is not None and about.geo.missing is not None and not kind.has_alpha:
        data = with_word(data, picture.data, about.geo.missing, as_whole=kind.bits < 32)
    return StoredPage(data, kind, about, look, is_light)


def as_srgb(picture: Picture) -> Picture:
    """Convert the colors of a picture's ICC profile to sRGB.

    Raises ValueError: the picture says otherwise what its colors are, or its profile cannot be
    converted.
    """
    data, kind, about = picture
    if not about.colors:
        return picture
    count = len(kind.channels) - kind.has_alpha
    if not (kind.is_encoded and PROFILE_SPACES.get(about.profile[16:20]) == count):
        raise ValueError(f"{about.colors} of {count} channels: not converted; leave --profile out")
    color, alpha = data[..., :count], data[..., count:]
    if kind.has_alpha:
        color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0.0)
    color = converted(color, about.profile) * (alpha if kind.has_alpha else 1.0)
    data = np.concatenate([color, alpha], axis=2, dtype=np.float32)
    return Picture(data, kind, about._replace(profile=b"", marks=b"", colors=""))


def tell_colors(path: Path, about: FileMetadata, *, is_guessed: bool) -> None:
    """Report color information that a file cannot store, and the assumption made."""
    if about.assumed and is_guessed:
        say(f"{path.name}: its source's {about.assumed}{PHOTO * ('bits' in about.assumed)}")
    if about.colors:
        say(f"{path.name} cannot store the source's {about.colors}: its colors are taken for sRGB")


def _with_colors(
    path: Path, picture: Picture, about: FileMetadata, *, is_same: bool
) -> FileMetadata:
    """Metadata with the color information a file can store; `colors` is the rest."""
    suffix, count = path.suffix.lower(), len(picture.kind.channels) - picture.kind.has_alpha
    colors = PROFILE_SPACES.get(about.profile[16:20], 0)
    is_held = is_same and suffix != ".exr" and colors == (3 if suffix in BY_PILLOW else count)
    profile, marks = about.profile * is_held, about.marks * (is_same and suffix == ".png")
    is_named = suffix == ".exr" and any(name == "chromaticities" for name, _, _ in about.spoken)
    lost = "" if profile or marks or is_named else about.colors
    return about._replace(profile=profile, marks=marks, colors=lost)


def check_source(path: Path, picture: Picture, look: WriteOptions) -> None:
    """Reject a target that cannot store a picture's numbers (not light)."""
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
    depths = _depths(suffix)
    nearest = min(depths) if suffix == ".png" else max(depths)
    bits = look.bits or (kind.bits if kind.bits in depths else nearest)
    return {8: "uint8", 16: "uint16", 32: "float32"}[bits]


def _depths(suffix: str) -> tuple[int, ...]:
    if suffix in QUALITY:
        return (8,)
    return {".png": (8, 16), ".exr": (32,)}.get(suffix, (8, 16, 32))


def coverage_picture(coverage: Floats) -> Picture:
    """Gray picture of fractions, which stay numbers in every format."""
    share = np.clip(coverage, 0.0, 1.0)[..., None]
    return Picture(np.asarray(share, np.float32), Kind(("Y",), 32, is_encoded=False))


def levels(data: Floats, form: str, *, has_alpha: bool, is_light: bool) -> NDArray[Any]:
    """Convert light to integer levels as pictures store them.

    `data`: (H, W, C) linear light, premultiplied; missing values become 0. `form`: unsigned type,
    with the largest number for 1. `is_light`: encode all but opacity by the sRGB curve;
    otherwise values are stored linearly.
    """
    if not is_light:
        return _quantized(data, form)
    if not has_alpha:
        return _encoded(data, form)
    alpha = data[..., -1:]
    color = np.divide(data[..., :-1], alpha, out=np.zeros_like(data[..., :-1]), where=alpha > 0.0)
    return np.concatenate([_encoded(color, form), _quantized(alpha, form)], axis=2)


def _quantized(shares: Floats, form: str) -> NDArray[Any]:
    """Round values 0..1 to levels of an unsigned type; NaN becomes 0, others are clipped."""
    known = np.clip(np.nan_to_num(shares, nan=0.0), 0.0, 1.0)
    return np.asarray(np.floor(known * np.iinfo(form).max + 0.5).astype(form))


def _encoded(light: Floats, form: str) -> NDArray[Any]:
    """Quantize light on the sRGB curve; 8 bits by a table, with the same result."""
    if form != "uint8" or light.dtype != np.float32:
        return _quantized(np.asarray(to_srgb(np.clip(light, 0.0, 1.0)), np.float32), form)
    from resample.engine.levels import put_encoded

    made = np.empty(light.shape, np.uint8)
    bits = np.ascontiguousarray(light).view(np.int32)
    put_encoded(*_least_light(), bits.reshape(-1), made.reshape(-1))
    return made


@cache
def _least_light() -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """Return the bits of the least light of each level's successor, and levels by leading bits."""
    level = np.arange(256)
    one = np.float32(1.0).view(np.int32)
    low, high = np.full(256, -1, np.int32), np.full(256, one, np.int32)
    for _ in range(31):
        middle = (low + high) // 2
        light = np.maximum(middle, 0).view(np.float32)
        is_reached = _quantized(to_srgb(light), "uint8") > level
        low, high = np.where(is_reached, low, middle), np.where(is_reached, middle, high)
    high[-1] = np.iinfo(np.int32).max  # the last level has none
    firsts = np.arange((one >> 16) + 1) << 16
    return high, np.searchsorted(high, firsts, "right").astype(np.uint8)


def fits(missing: float | None, form: str) -> bool:
    """Whether a type can represent the marker for missing values."""
    if missing is None:
        return False
    if form == "float32":
        return True
    limits = np.iinfo(form)
    return missing.is_integer() and limits.min <= missing <= limits.max


def with_word(
    data: NDArray[Any], values: Floats, missing: float, *, as_whole: bool
) -> NDArray[Any]:
    """Replace missing values (H, W, C) by their marker, and move other values off it."""
    gap, word = np.isnan(values), data.dtype.type(missing)
    taken = ~gap & (data == word)
    if as_whole:
        taken &= taken.all(axis=2, keepdims=True)
    if not gap.any() and not taken.any():
        return data
    if word.dtype.kind == "f":
        beside = np.nextafter(word, np.float32(0.0 if word else 1.0))
    else:
        beside = word - 1 if word == np.iinfo(word.dtype).max else word + 1
    return np.where(gap, word, np.where(taken, beside, data))
