"""Read and write pictures by OpenImageIO; no other part of the core accesses files.

In memory a picture is float32, linear light, premultiplied, (H, W, C), row 0 at the top. EXR stores
it unchanged; PNG has straight alpha and sRGB-encoded color, so both are converted here, in linear
light. Files are written atomically.
"""

import errno
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import Background, from_srgb, over, straight, to_srgb
from resample.files.facts.origin import state
from resample.files.writing import INCOMPLETE, check_end, refused, replacing
from resample.memory.mapped import array_where_it_fits
from resample.reading.native import plain, suppressed_output
from resample.reading.pictures import check_honest, check_picture, opened
from resample.types import Floats, Frame

SUFFIXES = (".png", ".exr")
LOSSLESS = ("none", "rle", "zips", "zip", "piz")
CHANNELS = ("R", "G", "B", "A", "Z", "coverage", "first.Z", "value")
STRIP, LEAST_STRIP = 256, 32  # rows read at a time; for wide pictures
MOST_IN_STRIP = 1 << 22  # values read at a time

Attribute = str | int | float | Sequence[float]


def write_frame(
    path: str | Path,
    frame: Frame[Any],
    *,
    bits: int = 8,
    half: bool = False,
    background: Background | None = None,
    attributes: Mapping[str, Attribute] | None = None,
) -> None:
    """Write a picture in the format of its suffix.

    Parameters
    ----------
    path
        Target, `.png` or `.exr`.
    frame
        Picture to write; PNG stores only its `rgba`.
    bits, background
        As in `write_png`; EXR keeps transparency and needs neither.
    half, attributes
        As in `write_exr`; PNG supports neither.

    Raises
    ------
    ValueError
        The suffix is neither.
    OSError
        The file cannot be written.
    """
    check_suffix(path)
    if Path(path).suffix.lower() == ".png":
        write_png(path, frame.rgba, bits=bits, background=background)
    else:
        write_exr(path, frame, half=half, attributes=attributes)


def check_suffix(path: str | Path) -> None:
    """Reject a name that `write_frame` would reject, before any work is done."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: pictures are written as {' or '.join(SUFFIXES)}")


def write_png(
    path: str | Path, rgba: Floats, *, bits: int = 8, background: Background | None = None
) -> None:
    """Write a picture as PNG.

    Parameters
    ----------
    path
        Target.
    rgba
        (H, W, 4) premultiplied, linear light; clipped to 0..1.
    bits
        8 or 16 per channel.
    background
        Background, 3 values of linear light; the file is then opaque, (H, W, 3). Without it the
        file has straight alpha, and light where alpha is 0 is lost.

    Raises
    ------
    ValueError
        `bits` is neither 8 nor 16, the shape does not fit or a value is NaN.
    OSError
        The file cannot be written.
    """
    if bits not in (8, 16):
        raise ValueError(f"PNG has 8 or 16 bits per channel, not {bits}")
    if rgba.ndim != 3 or rgba.shape[2] != 4:
        raise ValueError(f"a picture is of the shape (H, W, 4), not {rgba.shape}")
    if np.isnan(rgba).any():
        raise ValueError(f"{path}: {int(np.isnan(rgba).any(axis=2).sum())} pixels are not numbers")
    levels = screen_levels(rgba, bits, background)
    _write(path, levels, {"oiio:UnassociatedAlpha": 1, "oiio:ColorSpace": "sRGB"})


def screen_levels(
    rgba: Floats, bits: int = 8, background: Background | None = None
) -> NDArray[Any]:
    """Convert to sRGB levels, (H, W, 4) with straight alpha, or (H, W, 3) over a background.

    Parameters as of `write_png`.
    """
    pixels = straight(rgba) if background is None else over(rgba, background)
    pixels = np.clip(pixels, 0.0, 1.0)
    pixels[..., :3] = to_srgb(pixels[..., :3])
    kind = np.uint8 if bits == 8 else np.uint16
    return np.asarray(np.floor(pixels * np.iinfo(kind).max + 0.5).astype(kind))


def write_exr(
    path: str | Path,
    frame: Frame[Any],
    *,
    compression: str = "zip",
    half: bool = False,
    attributes: Mapping[str, Attribute] | None = None,
) -> None:
    """Write a picture with all its data, lossless except for `half`.

    Parameters
    ----------
    path
        Target.
    frame
        Becomes the channels R, G, B, A (premultiplied, linear light), Z (`depth`), coverage,
        first.Z (`first_depth`) and, if there is one, `value`; all but colors are float32.
        Depths are in scene units, inf where empty.
    compression
        One of `LOSSLESS`.
    half
        Store R, G, B and A in 16 bits instead of 32.
    attributes
        Header entries: text, numbers, and sequences of numbers (16 make a 4 × 4 matrix).

    Raises
    ------
    ValueError
        The compression is unknown.
    OSError
        The file cannot be written.
    """
    if compression not in LOSSLESS:
        raise ValueError(f"unknown compression {compression!r}; known: {', '.join(LOSSLESS)}")
    layers = [frame.rgba, frame.depth, frame.coverage, frame.first_depth]
    data = np.dstack([*layers, *([] if frame.value is None else [frame.value])])
    header = {**(attributes or {}), "compression": compression}
    _write(path, data.astype(np.float32, copy=False), header, half=half)


def read_image(path: str | Path, page: int = 0) -> Floats:
    """Read a picture in linear light, premultiplied, in the stored orientation.

    Parameters
    ----------
    path
        Any format of OpenImageIO. Integer formats and files marked so are taken as sRGB, others
        as linear light. The orientation tag is ignored.
    page
        Number of the picture in a file that holds several.

    Returns
    -------
    (H, W, C) with those of the channels R, G, B and A that exist; all channels if there is no R or
    if there are unnamed bands.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    return _linear(_read(path, page))


def read_numbers(path: str | Path, page: int = 0) -> NDArray[Any]:
    """Read all channels (H, W, C) of a picture as the stored integers.

    32-bit integers become float64, which represents them exactly.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    source, _ = _open(path, page)
    form = str(source.spec().format)
    stored = _stored(path, source, form)
    return stored.astype(np.float64 if form in ("int", "uint") else np.float32)


def read_levels(path: str | Path, channels: Sequence[str], page: int = 0) -> NDArray[Any]:
    """Read channels (H, W, C) of an 8- or 16-bit picture as stored, in this order.

    Large arrays are kept in files, see `array_where_it_fits`.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    source, header = _open(path, page)
    spec, form = source.spec(), str(source.spec().format)
    order = [header.names.index(name) for name in channels]
    check_honest(path, spec)
    shape, done = (spec.height, spec.width, len(order)), 0
    levels = array_where_it_fits(shape, form, Path(path).name)
    for strip in _stored_strips(path, source, form=form):
        levels[done : done + len(strip)] = strip[..., order]
        done += len(strip)
    return levels


def check_pixels(path: str | Path, page: int = 0) -> None:
    """Read all pixels of a picture to check them, without keeping any.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    source, _ = _open(path, page)
    for _ in _stored_strips(path, source):
        pass


def holds_half(path: str | Path) -> bool:
    """Whether half floats represent a picture file's light, as stored, exactly.

    Raises
    ------
    OSError
        The file is missing or damaged.
    """
    source, header = _open(path)
    has_straight_alpha = header.is_straight and "A" in header.names
    is_half = str(source.spec().format) == "half"
    source.close()
    return is_half and not (header.is_encoded or has_straight_alpha)


def number_rows(path: str | Path) -> Iterator[Floats]:
    """Read 8- and 16-bit numbers as `read_numbers` does, strip by strip from the top.

    Raises
    ------
    OSError
        The file is missing or damaged; damage may be detected only while iterating.
    """
    source, _ = _open(path)
    check_honest(path, source.spec())
    form = str(source.spec().format)
    return (strip.astype(np.float32) for strip in _stored_strips(path, source, form=form))


def read_rows(
    path: str | Path, height: int | None = None
) -> tuple[tuple[int, int, int], Iterator[Floats]]:
    """Read a picture strip by strip, in linear light, premultiplied.

    Parameters
    ----------
    path
        As in `read_image`.
    height
        Approximate rows per strip; tiles are not cut. None: a few million values per strip.

    Returns
    -------
    Height, width and number of channels, and an iterator over strips (rows, width, channels) from
    the top; together they equal the result of `read_image`.

    Raises
    ------
    OSError
        The file is missing or damaged; damage may be detected only while iterating.
    """
    source, header = _open(path)
    spec = source.spec()
    check_honest(path, spec)
    nothing = np.zeros((1, spec.width, spec.nchannels), np.float32)
    channels = _linear(header._replace(data=nothing)).shape[2]
    return (spec.height, spec.width, channels), _strips(path, source, header, height)


def _strips(
    path: str | Path, source: Any, header: "_ImageHeader", height: int | None
) -> Iterator[Floats]:
    spec = source.spec()
    size = spec.width * spec.height * spec.nchannels
    for strip in _stored_strips(path, source, height):
        yield _linear(header._replace(data=strip), size)


def _stored_strips(
    path: str | Path, source: Any, height: int | None = None, form: str = "float"
) -> Iterator[NDArray[Any]]:
    """Rows as stored, or converted to another type of OpenImageIO."""
    spec = source.spec()
    if height is None:
        few = MOST_IN_STRIP // (spec.width * spec.nchannels) // LEAST_STRIP * LEAST_STRIP
        height = min(STRIP, max(LEAST_STRIP, few))
    step = -(-height // spec.tile_height) * spec.tile_height if spec.tile_width else height
    for first in range(spec.y, spec.y + spec.height, step):
        last = min(first + step, spec.y + spec.height)
        with suppressed_output():
            if spec.tile_width:
                across = spec.x, spec.x + spec.width
                data = source.read_tiles(*across, first, last, 0, 1, 0, spec.nchannels, form)
            else:
                data = source.read_scanlines(first, last, 0, 0, spec.nchannels, form)
        complaint = source.geterror()
        if data is None or complaint:
            raise OSError(f"{path} is damaged: {_first_line(complaint)}")
        yield np.asarray(data).reshape(last - first, spec.width, spec.nchannels)
    source.close()


def _linear(stored: "_ImageHeader", size: int | None = None) -> Floats:
    """Convert to linear, premultiplied light, with the channels that `read_image` returns.

    `size`: values of the whole picture, of which this may be a part.
    """
    names, data = stored.names, stored.data
    alpha = names.index("A") if "A" in names else None
    color = [n for n in range(len(names)) if n != alpha]
    if stored.is_encoded and 0 < stored.levels < (
        size or data.size
    ):  # a table is faster than powers
        light = from_srgb((np.arange(stored.levels + 1) / stored.levels).astype(np.float32))
        for row in data:
            level = (row[:, color] * stored.levels + 0.5).astype(np.uint16)
            row[:, color] = light[level]
    elif stored.is_encoded:
        data[..., color] = from_srgb(data[..., color])
    if stored.is_straight and alpha is not None:
        data[..., color] *= data[..., alpha, None]
    return data[..., [names.index(name) for name in shown(names)]]


def light_of(levels: NDArray[Any], names: Sequence[str], *, is_encoded: bool) -> Floats:
    """Linear light, premultiplied, from levels (H, W, C) with straight alpha; floats are light."""
    if levels.dtype.kind == "f":
        return np.array(levels, np.float32)
    most = int(np.iinfo(levels.dtype).max)
    data = levels.astype(np.float32) / np.float32(most)
    return _linear(_ImageHeader(data, list(names), is_encoded, is_straight=True, levels=most))


def shown(names: Sequence[str]) -> tuple[str, ...]:
    """Channels that form the picture: only colors, unless there are other bands."""
    has_bands = any(name.startswith("channel") for name in names)  # unnamed in TIFF
    if "R" not in names or has_bands:
        return tuple(names)
    return tuple(name for name in CHANNELS[:4] if name in names)


def read_channels(path: str | Path, page: int = 0) -> dict[str, Floats]:
    """Read all channels of a file by name, (H, W) each, as stored."""
    stored = _read(path, page)
    return {name: stored.data[..., n] for n, name in enumerate(stored.names)}


class _ImageHeader(NamedTuple):
    """Content of a file before conversion to linear, premultiplied light."""

    data: Floats  # (H, W, C)
    names: list[str]  # C channels
    is_encoded: bool  # by the sRGB curve
    is_straight: bool  # color is not multiplied by alpha
    levels: int  # largest value of 8 and 16 bits, which scales data to 0..1; 0: other types


def _open(path: str | Path, page: int = 0) -> tuple[Any, _ImageHeader]:
    """Open a file and read its header, without data."""
    import OpenImageIO

    if not Path(path).is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    # The configuration also fixes PFM's flipped row order.
    as_stored = OpenImageIO.ImageSpec()
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    source = opened(path, as_stored)
    if source is None:
        raise OSError(
            f"{path} is not a picture that can be read: {_first_line(OpenImageIO.geterror())}"
        )
    if not source.seek_subimage(page, 0):
        raise OSError(f"{path} has no page {page + 1}: {_first_line(source.geterror())}")
    spec = source.spec()
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    is_integer = str(spec.format) not in ("half", "float", "double")
    header = _ImageHeader(
        np.zeros((0, 0, 0), np.float32),
        list(spec.channelnames),
        "srgb" in space or (is_integer and "lin" not in space),
        bool(spec.get_int_attribute("oiio:UnassociatedAlpha")),
        {"uint8": 255, "uint16": 65535}.get(str(spec.format), 0),
    )
    return source, header


def _read(path: str | Path, page: int = 0) -> _ImageHeader:
    return _pixels(path, *_open(path, page))


def _pixels(path: str | Path, source: Any, header: _ImageHeader) -> _ImageHeader:
    return header._replace(data=_stored(path, source, "float"))


def _stored(path: str | Path, source: Any, form: str) -> NDArray[Any]:
    """Read pixels (H, W, C) as OpenImageIO's type `form`."""
    check_picture(path, source.spec(), 4)
    with suppressed_output():
        data = source.read_image(form)
    complaint, spec = source.geterror(), source.spec()
    source.close()
    if data is None or complaint:
        raise OSError(f"{path} is damaged: {_first_line(complaint)}")
    shape = spec.height, spec.width, spec.nchannels
    return np.asarray(data).reshape(shape)


def _write(
    path: str | Path, data: NDArray[Any], header: Mapping[str, Attribute], *, half: bool = False
) -> None:
    """Write an array (H, W, C) in its own type; `half` applies to R, G, B, A only."""
    import OpenImageIO

    height, width, count = data.shape
    kind = {"uint8": OpenImageIO.UINT8, "uint16": OpenImageIO.UINT16, "float32": OpenImageIO.FLOAT}[
        data.dtype.name
    ]
    spec = OpenImageIO.ImageSpec(width, height, count, kind)
    spec.channelnames = CHANNELS[:count]
    if half:
        spec.channelformats = (OpenImageIO.HALF,) * 4 + (kind,) * (count - 4)
    for name, value in header.items():
        _set(spec, name, value)
    with replacing(path) as temporary:
        complaint = _put(temporary, spec, data)
        if complaint:
            raise refused(path, temporary, complaint)
        check_end(path, temporary)
        try:
            _read(temporary)
        except OSError:
            raise refused(path, temporary, INCOMPLETE) from None


def _put(path: Path, spec: Any, data: NDArray[Any]) -> str:
    """Write a file; returns the error message, empty on success.

    On a full disk the writers may report success: PNG's shows only in the error text, and errors
    while closing the file in neither.
    """
    import OpenImageIO

    name = plain(path)
    target = OpenImageIO.ImageOutput.create(name)
    if target is None:
        return _first_line(OpenImageIO.geterror())
    state(spec, path)
    went_well = target.open(name, spec) and target.write_image(data) and target.close()
    complaint = target.geterror()
    return "" if went_well and not complaint else _first_line(complaint)


def _set(spec: Any, name: str, value: Attribute) -> None:
    """Set a header entry, with the type that fits its value."""
    if isinstance(value, str | int | float):
        spec.attribute(name, value)
    else:
        numbers = tuple(float(number) for number in np.ravel(value))
        kind = "matrix" if len(numbers) == 16 else f"float[{len(numbers)}]"
        spec.attribute(name, kind, numbers)


def _first_line(text: str) -> str:
    return text.strip().partition("\n")[0].strip() or "no reason is given"
