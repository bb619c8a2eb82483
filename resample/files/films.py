"""Films frame by frame, by PyAV: H.264 that every player knows, and animated WebP."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from av.container import OutputContainer

H264, WEBP = "libx264", "libwebp_anim"
FORMS = {".mp4": ("mp4", {"movflags": "faststart"}), ".webp": ("webp", {"loop": "0"})}
QUALITY = {H264: {"crf": "18", "preset": "medium"}, WEBP: {"quality": "90"}}


@contextmanager
def new_film(path: Path) -> Iterator["OutputContainer"]:
    """Film of the form of its suffix, to be written.

    Raises
    ------
    OSError
        It cannot be written.
    """
    import av

    form, choices = FORMS[path.suffix.lower()]
    try:
        with av.open(str(path), "w", format=form, options=choices) as film:
            yield film
    except av.FFmpegError as error:
        raise OSError(f"{path} cannot be written: {error.strerror}") from None


def new_stream(film: "OutputContainer", fps: float, size: tuple[int, int]) -> Any:
    """Pictures of a film.

    Parameters
    ----------
    film
        To be written.
    fps
        Frames per second.
    size
        Height and width, px. H.264 has one color for 2 × 2 pixels, so both sides become even.
    """
    from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

    codec = WEBP if film.format.name == "webp" else H264
    rate = Fraction(fps).limit_denominator(1001)
    stream: Any = film.add_stream(codec, rate=rate, options=QUALITY[codec])
    stream.height, stream.width = size
    if codec == WEBP:
        stream.pix_fmt = "bgra"
        return stream
    stream.height, stream.width = (side + side % 2 for side in size)
    stream.pix_fmt = "yuv420p"
    codec_context = stream.codec_context
    codec_context.color_range, codec_context.colorspace = ColorRange.MPEG, Colorspace.ITU709
    codec_context.color_primaries = ColorPrimaries.BT709
    codec_context.color_trc = ColorTrc.IEC61966_2_1
    return stream


def film_picture(levels: NDArray[np.uint8], stream: Any) -> Any:
    """Levels (H, W, 3), or 4 for WebP, as a stream takes them."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    height, width, count = levels.shape
    padding = ((0, stream.height - height), (0, stream.width - width), (0, 0))
    levels = np.ascontiguousarray(np.pad(levels, padding, mode="edge"))
    picture = av.VideoFrame.from_ndarray(levels, format="rgb24" if count == 3 else "rgba")
    if stream.pix_fmt == "bgra":
        return picture.reformat(format="bgra")
    return picture.reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )
