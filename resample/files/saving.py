"""Write pictures, and deep ones, in any format and bit depth; files appear atomically."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import Background, over
from resample.console import Color, note
from resample.files.formats import (
    BY_PILLOW,
    NO_LOSS,
    QUALITY,
    SUFFIXES,
    StoredPage,
    WriteOptions,
    check_output,
    levels,
    page_of,
)
from resample.files.images import open_file
from resample.files.metadata.fields import (
    JPEG,
    TIFF,
    FileMetadata,
    WrittenPage,
    complete,
    describe,
    exif_of,
)
from resample.files.metadata.tags import state
from resample.files.pictures import Kind, Picture
from resample.files.stores import STORE, store_format
from resample.files.writing import INCOMPLETE, check_end, refused, replacing
from resample.reading.native import plain
from resample.reading.pictures import complaint_of, opened
from resample.types import Floats, Frame

LONGEST = {".webp": 16_383, ".avif": 65_535}  # px of a side
UNCALIBRATED = 0xFFFF  # Exif's value for neither sRGB nor Adobe RGB
CHANNELS = ("R", "G", "B", "A", "Z", "coverage", "first.Z", "value")  # of a frame in EXR

EMPTY = "the picture is empty: nothing visible lies in it"

Put = Callable[[Picture], None]
DEEP_CHANNELS = ("R", "G", "B", "A", "Z", "ZBack")
LEAST = 1e-4  # transmittance below which nothing behind counts as visible


def check_frame(path: Path, bits: int, background: Color | None) -> None:
    """Reject a target that `write_frame` would reject, before any work is done."""
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES, *BY_PILLOW):
        raise ValueError(f"{path}: pictures are written as {', '.join((*SUFFIXES, *BY_PILLOW))}")
    if suffix == ".png" and bits not in (8, 16):
        raise ValueError(f"{path}: PNG has 8 or 16 bits per channel, not {bits}")
    if suffix not in (".png", ".exr"):
        check_output(path, WriteOptions(bits, background))


def write_frame(
    path: str | Path,
    frame: Frame[Any],
    bits: int = 8,
    background: Background | None = None,
) -> None:
    """Write a rendered scene in the format of its suffix.

    `bits`: bits per channel; 32 are floats of linear light. EXR has 32. `background`: linear
    background color; None keeps transparency.
    """
    path = Path(path)
    check_frame(path, bits, _color(background))
    if path.suffix.lower() == ".exr":
        write_exr(path, frame)
    elif path.suffix.lower() == ".png":
        write_png(path, frame.rgba, bits=bits, background=background)
    else:
        kind = Kind(CHANNELS[:4], bits, is_encoded=bits != 32)
        write_picture(path, Picture(frame.rgba, kind), WriteOptions(bits, _color(background)))


def write_png(
    path: str | Path, rgba: Floats, *, bits: int = 8, background: Background | None = None
) -> None:
    """Write a picture as PNG.

    `rgba`: (H, W, 4) premultiplied, linear light; clipped to 0..1. `bits`: 8 or 16 per channel.
    `background`: Background, 3 values of linear light; the file is then opaque, (H, W, 3). Without
    it the file has straight alpha, and light where alpha is 0 is lost.
    """
    if bits not in (8, 16):
        raise ValueError(f"PNG has 8 or 16 bits per channel, not {bits}")
    if rgba.ndim != 3 or rgba.shape[2] != 4:
        raise ValueError(f"a picture is of the shape (H, W, 4), not {rgba.shape}")
    if np.isnan(rgba).any():
        raise ValueError(f"{path}: {int(np.isnan(rgba).any(axis=2).sum())} pixels are not numbers")
    picture = Picture(rgba, Kind(CHANNELS[:4], bits, is_encoded=True))
    write_picture(Path(path), picture, WriteOptions(bits, _color(background)))


def _color(background: Background | None) -> Color | None:
    """Background of three numbers."""
    if background is None:
        return None
    color = tuple(float(part) for part in np.ravel(background))
    if len(color) != 3:
        raise ValueError(f"a background has 3 values, not {len(color)}")
    return color


def screen_levels(
    rgba: Floats, bits: int = 8, background: Background | None = None
) -> NDArray[Any]:
    """Convert to sRGB levels, (H, W, 4) with straight alpha, or (H, W, 3) over a background."""
    pixels = rgba if background is None else over(rgba, background)
    return levels(pixels, f"uint{bits}", has_alpha=background is None, is_light=True)


def write_exr(path: str | Path, frame: Frame[Any]) -> None:
    """Write a picture with all its data, lossless.

    `frame`: becomes the channels R, G, B, A (premultiplied, linear light), Z (`depth`), coverage,
    first.Z (`first_depth`) and, if there is one, `value`; all are float32. Depths are in scene
    units, inf where empty.
    """
    layers = [frame.rgba, frame.depth, frame.coverage, frame.first_depth]
    data = np.dstack([*layers, *([] if frame.value is None else [frame.value])])
    kind = Kind(CHANNELS[: data.shape[2]], 32, is_encoded=False)
    write_picture(Path(path), Picture(data.astype(np.float32, copy=False), kind), WriteOptions())


def write_picture(path: Path, picture: Picture, look: WriteOptions) -> None:
    """Write a picture in the format of its suffix."""
    write_pages(path, [picture], look)


def write_pages(path: Path, pictures: Iterable[Picture], look: WriteOptions) -> None:
    """Write a sequence of pictures, taken one by one, to one file; several need TIFF."""
    if path.suffix.lower() == STORE:
        (picture,) = pictures
        with writing_rows(path, picture.data.shape[0], look) as put:
            put(picture)
        return
    with replacing(path) as temporary:
        written: list[WrittenPage] = []
        for picture in pictures:
            rows = _Rows(path, temporary, picture.data.shape[0], look, is_next=bool(written))
            rows.put(picture)
            written.append(rows.close())
        if not written:
            raise ValueError(f"{path}: there is no picture to write")
        _finish(path, temporary, written)


@contextmanager
def writing_rows(path: Path, height: int, look: WriteOptions) -> Iterator[Put]:
    """Write a picture of `height` rows; the file appears when the block succeeds.

    Yields the function that takes rows from the top, any number at a time.
    """
    if path.suffix.lower() == STORE:
        with store_format(path).writing_store(path, height) as store:
            yield lambda picture: store.put(page_of(path, picture, look).data)
        return
    with replacing(path) as temporary:
        rows = _Rows(path, temporary, height, look)
        yield rows.put
        _finish(path, temporary, [rows.close()])


def tell_empty(path: Path, is_empty: bool) -> None:
    """Warn if a picture or film is empty."""
    if is_empty:
        note(f"{path.name}: {EMPTY}")


def tell_unchanged(path: Path, made: Picture, given: Picture, remedy: str) -> None:
    """Warn if a picture equals its input, with the remedy."""
    before, after = given.data, made.data
    if made.kind.has_alpha and not given.kind.has_alpha:
        is_opaque = after[..., -1].min() == after[..., -1].max()
        after = after[..., :-1] if is_opaque else after
    if before.shape != after.shape or before.dtype != after.dtype:
        return
    far = 1 / 512 if after.dtype.kind == "f" else 0  # half a level of 8 bits
    if np.allclose(before, after, rtol=0, atol=far):
        note(f"{path.name} is the picture that was given, pixel by pixel; {remedy}")


class _Rows:
    """A page being written; `is_next`: to a file that has others."""

    def __init__(
        self, path: Path, temporary: Path, height: int, look: WriteOptions, *, is_next: bool = False
    ) -> None:
        self.path, self.temporary, self.height, self.options = path, temporary, height, look
        self.is_next, self.done = is_next, 0
        self.target: Any = None
        self.stored = WrittenPage(FileMetadata(), (), "")

    def put(self, picture: Picture) -> None:
        """Write the next rows."""
        tells = self.target is None and not self.is_next
        page = page_of(self.path, picture, self.options, tells=tells)
        shape = self.height, *page.data.shape[1:]
        if self.target is None:
            self.stored = WrittenPage(page.about, shape, page.data.dtype.name)
            spec = spec_of(self.path.suffix.lower(), page, self.height)
            mode = "AppendSubimage" if self.is_next else "Create"
            if self.path.suffix.lower() in BY_PILLOW:
                # Output for a format that Pillow writes.
                from resample.files.images import PillowOutput

                suffix, quality = self.path.suffix.lower(), page.options.quality
                if max(spec.width, spec.height) > LONGEST[suffix]:
                    raise ValueError(
                        f"{self.path}: {suffix} has sides of {LONGEST[suffix]} px at most; "
                        "take .png"
                    )
                choices: dict[str, Any] = {"format": BY_PILLOW[suffix]}
                choices["exif"] = exif_of(page.about, (spec.height, spec.width, spec.nchannels))
                if quality == NO_LOSS:
                    choices |= {"lossless": True, "exact": True}
                else:
                    choices["quality"] = quality or QUALITY[suffix]
                if suffix == ".avif":
                    choices["subsampling"] = "4:4:4"
                self.target = PillowOutput(self.temporary, spec, choices)
            else:
                self.target = new_output(self.path, self.temporary, spec, mode)
        first, last = self.done, self.done + page.data.shape[0]
        if self.stored.shape != shape or last > self.height:
            raise ValueError(f"rows {first} to {last} of {page.data.shape} in {self.stored.shape}")
        self._check(is_done=self.target.write_scanlines(first, last, 0, page.pixels))
        self.done = last

    def close(self) -> WrittenPage:
        """Write remaining rows."""
        if self.done != self.height:
            raise ValueError(f"{self.path}: only {self.done} of {self.height} rows were given")
        self._check(is_done=self.target.close())
        return self.stored

    def _check(self, *, is_done: bool) -> None:
        """On a full disk writers may report success: PNG's shows only in the error text."""
        if not is_done or self.target.has_error:
            raise refused(self.path, self.temporary, complaint_of(self.target))


def new_output(path: Path, temporary: Path, spec: Any, mode: str = "Create") -> Any:
    """Open an OpenImageIO output for a file that is called `path` in messages."""
    import OpenImageIO

    name = plain(temporary)
    if path.suffix.lower() in JPEG:
        from resample.files.images import BufferedJpeg

        return BufferedJpeg(temporary, spec)
    target = OpenImageIO.ImageOutput.create(name)
    if target is None:
        raise OSError(f"{path} cannot be written: {complaint_of(OpenImageIO)}")
    state(spec, path)
    if not target.open(name, spec, mode):
        raise refused(path, temporary, complaint_of(target))
    return target


def _finish(path: Path, temporary: Path, written: list[WrittenPage]) -> None:
    """Add metadata that OpenImageIO cannot write, and read the file back as a check."""
    check_end(path, temporary)
    complete(temporary, written)
    try:
        for n in range(len(written)):
            for _ in open_file(temporary, n).strips():
                pass
    except OSError:
        raise refused(path, temporary, INCOMPLETE) from None


def spec_of(suffix: str, page: StoredPage, height: int) -> Any:
    """OpenImageIO header of a page of `height` rows."""
    import OpenImageIO

    (_, width, count), kind, is_whole = page.data.shape, page.kind, page.data.dtype.kind != "f"
    is_bare = page.data.dtype.itemsize == 4
    form = "float" if is_bare else page.data.dtype.name
    spec = OpenImageIO.ImageSpec(width, height, count, form)
    spec.channelnames = kind.channels
    spec.alpha_channel = kind.channels.index("A") if kind.has_alpha else -1
    has_profile = bool(page.about.profile)
    describe(spec, page.about, suffix)
    if is_whole:
        spec.attribute("oiio:UnassociatedAlpha", 1)
        if not has_profile:
            # "data" states no space, as a source of light that states none.
            is_found = page.options.is_light and not (page.about.number or page.about.says_linear)
            unlit = "data" if is_found else "lin_rec709_scene"
            # A PNG is sRGB unless told otherwise; to look the name up takes 30 ms.
            if suffix != ".png" or not page.is_light:
                spec.attribute("oiio:ColorSpace", "sRGB" if page.is_light else unlit)
    if suffix in TIFF and (not is_whole or has_profile or not page.is_light):
        # OpenImageIO 3.1 cannot write an empty Exif directory.
        spec.attribute("Exif:ColorSpace", UNCALIBRATED)
    if is_bare and is_whole:
        spec.attribute("tiff:predictor", 1)
    quality = page.options.quality or QUALITY.get(suffix)
    spec.attribute("compression", f"jpeg:{quality}" if suffix in JPEG else "zip")
    spec.attribute("jpeg:subsampling", "4:4:4")
    return spec


class DepthSlab(NamedTuple):
    """Color and opacity between two depths."""

    near: float  # scene units
    far: float
    rgba: Floats  # (H, W, 4) premultiplied, linear light


# Samples of a slab: pixels (N,), row × width + column, and values (N, 6) by `DEEP_CHANNELS`.
_PixelPart = tuple[NDArray[np.int64], Floats]


def between(front: Floats, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a slab's samples (H, W, 4), from the picture up to its far plane.

    `shown`: the picture up to its near plane, to which the slab is added.

    A pixel's mean transmittance of several slabs is not the product of their means: where an edge
    runs through slabs painted separately, they would occlude too much. So a slab is a difference.
    """
    left = 1 - shown[..., 3:]
    more = np.divide(front - shown, left, out=np.zeros(front.shape), where=left > LEAST)
    more = np.maximum(more, 0) * (more[..., 3:] > 0)
    more[..., 3] = np.minimum(more[..., 3], 1)
    return more


def check_deep(path: Path) -> None:
    """Reject a name that `write_deep` would reject, before any work is done."""
    if path.suffix.lower() != ".exr":
        raise ValueError(f"{path}: deep pictures are written as .exr")


def write_deep(path: Path, slabs: Iterable[DepthSlab]) -> None:
    """Write slabs of one size from front to back; empty pixels get no sample."""
    check_deep(path)
    parts, shape = [], (0, 0)
    for near, far, picture in slabs:
        shape, rgba = picture.shape[:2], picture.reshape(-1, 4)
        pixel = np.flatnonzero((rgba != 0).any(axis=1))
        ends = np.broadcast_to(np.array([near, far], np.float32), (pixel.size, 2))
        parts.append((pixel, np.hstack([rgba[pixel], ends]).astype(np.float32)))
    if not parts:
        raise ValueError(f"{path}: a deep picture has one slab or more")
    with replacing(path) as temporary:
        target = new_output(path, temporary, _spec(shape))
        went_well = target.write_deep_image(_deep(parts, shape)) and target.close()
        if not went_well or target.has_error:
            raise refused(path, temporary, complaint_of(target))
        try:
            source = opened(temporary)
            is_whole = source.read_native_deep_image() is not None and not source.geterror()
            source.close()
        except OSError:
            is_whole = False
        if not is_whole:
            raise refused(path, temporary, INCOMPLETE)


def _spec(shape: tuple[int, ...]) -> Any:
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(shape[1], shape[0], len(DEEP_CHANNELS), OpenImageIO.FLOAT)
    spec.channelnames = DEEP_CHANNELS
    spec.alpha_channel, spec.z_channel = 3, 4
    spec.deep = True
    spec.attribute("compression", "zips")
    return spec


def _deep(parts: list[_PixelPart], shape: tuple[int, ...]) -> Any:
    """Samples in OpenImageIO's form."""
    import OpenImageIO

    count = np.zeros(shape[0] * shape[1], np.int64)
    data = OpenImageIO.DeepData()
    data.init(_spec(shape))
    for where, _ in parts:
        count[where] += 1
    for pixel in np.flatnonzero(count).tolist():
        data.set_samples(pixel, int(count[pixel]))
    done = np.zeros(count.size, np.int64)
    for where, samples in parts:
        place = done[where]
        done[where] += 1
        told = zip(where.tolist(), place.tolist(), samples.tolist(), strict=True)
        for pixel, sample, values in told:
            for channel, value in enumerate(values):
                data.set_deep_value(pixel, channel, sample, value)
    return data
