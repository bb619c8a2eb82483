"""Pictures of any number of channels, read and written as what their files say they are.

A file appears whole or not at all.
"""

import errno
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.command.settings import Written, linear_color
from resample.files.images import read_channels, read_image
from resample.files.writing import replacing
from resample.memory import require_memory
from resample.types import Floats

SUFFIXES = (".png", ".exr", ".tif", ".tiff", ".jpg", ".jpeg")
JPEG, TIFF = (".jpg", ".jpeg"), (".tif", ".tiff")
BYTES_PER_VALUE = 20  # of a source and the copies that are made while it is read and worked on
UNCALIBRATED = 0xFFFF  # Exif's word for neither sRGB nor Adobe RGB
Color = tuple[float, float, float]


class Kind(NamedTuple):
    """What a picture's file says about its values."""

    channels: tuple[str, ...]  # of those that `read_picture` gives; alpha is called A and is last
    bits: int  # per channel: 8, 16, or 32 for floats
    is_encoded: bool  # by the sRGB curve

    @property
    def has_alpha(self) -> bool:
        return "A" in self.channels


class Picture(NamedTuple):
    """A picture in linear light, premultiplied."""

    data: Floats  # (H, W, C)
    kind: Kind


def read_picture(path: str | Path) -> Picture:
    """Read a picture in linear light, premultiplied, and what its file says.

    Parameters
    ----------
    path
        Any format that OpenImageIO reads.

    Raises
    ------
    OSError
        The file is missing or damaged.
    ValueError
        It does not fit into this machine's memory.
    """
    height, width, stored, kind = _header(Path(path))
    require_memory(
        BYTES_PER_VALUE * height * width * stored,
        f"{path} of {width} x {height} pixels",
        "take a smaller picture",
    )
    data = read_image(path)
    if kind.has_alpha:
        n = kind.channels.index("A")
        order = [c for c in range(len(kind.channels)) if c != n] + [n]
        data = data[..., order]
        kind = kind._replace(channels=tuple(kind.channels[c] for c in order))
    return Picture(np.ascontiguousarray(data), kind)


class Look(NamedTuple):
    """How a picture is written."""

    bits: int | None = None  # 8, 16 or 32 per channel; None is what fits format and source
    background: Color | None = None  # linear light; None keeps transparency
    is_light: bool = True  # otherwise numbers, which no curve encodes


def look_of(written: Written) -> Look:
    """Choices of the writer.

    Raises
    ------
    ValueError
        The background is no color.
    """
    behind = None if written.background is None else linear_color(written.background)
    return Look(written.bits, behind)


def check_output(path: Path, look: Look, *, transparent: bool) -> None:
    """Refuse a target that `write_picture` would refuse, before any work is done.

    Raises
    ------
    ValueError
        The suffix is unknown, or the format cannot hold transparency or so many bits.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path}: pictures are written as {', '.join(SUFFIXES)}")
    if suffix in JPEG and transparent and look.background is None:
        raise ValueError(f"{path}: JPEG has no transparency; give --background white, or take .png")
    if look.bits is not None and look.bits not in _depths(suffix):
        allowed = " or ".join(map(str, _depths(suffix)))
        raise ValueError(f"{path}: {suffix} has {allowed} bits per channel, not {look.bits}")


def flattened(picture: Picture, background: Color) -> Picture:
    """Picture in front of an even color; a gray one stays gray before gray.

    Raises
    ------
    ValueError
        A color is behind a picture that is neither gray nor RGB.
    """
    data, kind = picture
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
    return Picture(np.asarray(flat, np.float32), kind._replace(channels=names))


def write_picture(path: Path, picture: Picture, look: Look) -> None:
    """Write a picture in the format of its suffix.

    Parameters
    ----------
    path
        Target, of a suffix in `SUFFIXES`.
    picture
        EXR and TIFF of floats hold it as it is; integers are straight and sRGB-encoded.
    look
        How it is written.

    Raises
    ------
    ValueError
        The format cannot hold it.
    OSError
        The file cannot be written.
    """
    check_output(path, look, transparent=picture.kind.has_alpha)
    if look.background is not None:
        picture = flattened(picture, look.background)
    suffix = path.suffix.lower()
    bits = look.bits or _bits(suffix, picture.kind.bits)
    most = {".png": 4, ".jpg": 3, ".jpeg": 3}.get(suffix)
    count = len(picture.kind.channels)
    if most is not None and count - picture.kind.has_alpha not in (1, 3):
        raise ValueError(f"{path}: {count} channels do not fit into {suffix}; take .exr or .tif")
    data = picture.data if bits == 32 else _levels(picture, bits, look.is_light)
    with replacing(path) as temporary:
        complaint = _put(temporary, data, picture.kind, look.is_light)
        if complaint:
            raise OSError(f"{path} cannot be written: {complaint}")


def _depths(suffix: str) -> tuple[int, ...]:
    return {".png": (8, 16), ".exr": (32,), ".jpg": (8,), ".jpeg": (8,)}.get(suffix, (8, 16, 32))


def _bits(suffix: str, source: int) -> int:
    """Bits of a format for a source that has so many."""
    depths = _depths(suffix)
    if source in depths:
        return source
    return min(depths) if suffix == ".png" else max(depths)


def _levels(picture: Picture, bits: int, is_light: bool) -> NDArray[Any]:
    """Integers, straight alpha; light by the sRGB curve."""
    data = picture.data
    if not is_light:
        planes = np.clip(data, 0.0, 1.0)
    elif picture.kind.has_alpha:
        alpha = data[..., -1:]
        color = np.divide(
            data[..., :-1], alpha, out=np.zeros_like(data[..., :-1]), where=alpha > 0.0
        )
        planes = np.concatenate([_curve(color), np.clip(alpha, 0.0, 1.0)], axis=2)
    else:
        planes = _curve(data)
    kind = np.uint8 if bits == 8 else np.uint16
    levels: NDArray[Any] = np.floor(planes * np.iinfo(kind).max + 0.5).astype(kind)
    return levels


def _curve(color: Floats) -> Floats:
    return np.asarray(to_srgb(np.clip(color, 0.0, 1.0)), np.float32)


def _put(path: Path, data: NDArray[Any], kind: Kind, is_light: bool) -> str:
    """Write a file and read it back; returns why it is not whole, nothing if it is."""
    import OpenImageIO

    height, width, count = data.shape
    numbers = {1: OpenImageIO.UINT8, 2: OpenImageIO.UINT16, 4: OpenImageIO.FLOAT}
    spec = OpenImageIO.ImageSpec(width, height, count, numbers[data.dtype.itemsize])
    spec.channelnames = kind.channels
    spec.alpha_channel = count - 1 if kind.has_alpha else -1
    if data.dtype != np.float32:
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute("oiio:ColorSpace", "sRGB" if is_light else "lin_rec709_scene")
    elif path.suffix.lower() in TIFF:  # OpenImageIO 3.1 fails to write an Exif folder that is empty
        spec.attribute("Exif:ColorSpace", UNCALIBRATED)
    spec.attribute("compression", "jpeg:95" if path.suffix.lower() in JPEG else "zip")
    spec.attribute("jpeg:subsampling", "4:4:4")
    target = OpenImageIO.ImageOutput.create(str(path))
    if target is None:
        return str(OpenImageIO.geterror()).strip().partition("\n")[0]
    pixels = np.ascontiguousarray(data)
    went_well = [target.open(str(path), spec), target.write_image(pixels), target.close()]
    if not all(went_well) or target.has_error:
        return str(target.geterror()).strip().partition("\n")[0] or "no reason is given"
    try:
        read_channels(path)
    except OSError:
        return "the file came out incomplete; is the disk full?"
    return ""


def coverage_picture(coverage: Floats) -> Picture:
    """Shares of pixels as a gray picture whose numbers they are, whatever its format."""
    share = np.clip(coverage, 0.0, 1.0)[..., None]
    return Picture(np.asarray(share, np.float32), Kind(("Y",), 32, is_encoded=False))


def _header(path: Path) -> tuple[int, int, int, Kind]:
    """Height, width, number of stored channels, and what is said about the values."""
    import OpenImageIO

    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        reason = OpenImageIO.geterror().strip().partition("\n")[0] or "no reason is given"
        raise OSError(f"{path} is not a picture that can be read: {reason}")
    spec = source.spec()
    source.close()
    names = list(spec.channelnames)
    bits = {"uint8": 8, "uint16": 16}.get(str(spec.format), 32)
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    is_encoded = "srgb" in space or (bits < 32 and "lin" not in space)
    shown = tuple(name for name in "RGBA" if name in names) if "R" in names else tuple(names)
    return spec.height, spec.width, spec.nchannels, Kind(shown, bits, is_encoded)
