"""Films frame by frame, by PyAV: H.264 that every player knows."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import check_end, refused
from resample.reading.limits import check_unpacked

if TYPE_CHECKING:
    from av.container import InputContainer, OutputContainer

H264 = "libx264"
CHOICES = {"movflags": "faststart"}
# Files that hold a film themselves: no lists of others, which may lie anywhere.
CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegvideo"
READING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file"}
FRAME_BYTES = 16  # of a pixel in memory: red, green, blue and alpha in float32
QUALITY = {"crf": "18", "preset": "medium"}


def check_codecs(path: Path) -> None:
    """Refuse a film where what reads and writes films is not installed.

    Raises
    ------
    ValueError
        It is not; the message says how to install it.
    """
    try:
        import av  # noqa: F401
    except ImportError:
        raise ValueError(
            f"{path.name}: films need PyAV, which is not installed: "
            "pip install 'hybrid-resample[film]'; .webp, .gif and .apng need nothing more"
        ) from None


@contextmanager
def opened_film(path: Path) -> Iterator["InputContainer"]:
    """Film, to be read.

    Raises
    ------
    OSError
        It is none, or damaged.
    ValueError
        PyAV is not installed, or its frames are too large.
    """
    check_codecs(path)
    import av

    try:
        with av.open(str(path), options=READING) as film:
            if not film.streams.video:
                raise OSError(f"{path} is not a film that can be read: it has no pictures")
            codec: Any = film.streams.video[0].codec_context
            if codec is None:
                raise OSError(f"{path} is not a film that can be read: its codec is unknown")
            frame = FRAME_BYTES * codec.width * codec.height
            check_unpacked(str(path), path.stat().st_size, frame)
            yield film
    except av.FFmpegError as error:
        raise OSError(f"{path} is not a film that can be read: {error.strerror}") from None


@contextmanager
def new_film(path: Path) -> Iterator["OutputContainer"]:
    """MP4 film, to be written.

    Raises
    ------
    OSError
        It cannot be written.
    ValueError
        PyAV is not installed.
    """
    check_codecs(path)
    import av

    try:
        with av.open(str(path), "w", format="mp4", options=CHOICES) as film:
            yield film
    except av.FFmpegError as error:
        raise refused(path, path, str(error.strerror)) from None
    if path.is_file():  # nothing is written of a film without pictures
        check_end(path, path)


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

    rate = Fraction(fps).limit_denominator(1001)
    stream: Any = film.add_stream(H264, rate=rate, options=QUALITY)
    stream.height, stream.width = (side + side % 2 for side in size)
    stream.pix_fmt = "yuv420p"
    codec_context = stream.codec_context
    codec_context.thread_count = 1  # several cut pictures otherwise, and gain nothing at such sizes
    codec_context.color_range, codec_context.colorspace = ColorRange.MPEG, Colorspace.ITU709
    codec_context.color_primaries = ColorPrimaries.BT709
    codec_context.color_trc = ColorTrc.IEC61966_2_1
    return stream


def film_picture(levels: NDArray[np.uint8], stream: Any) -> Any:
    """Levels (H, W, 3) as a stream takes them."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    height, width = levels.shape[:2]
    padding = ((0, stream.height - height), (0, stream.width - width), (0, 0))
    levels = np.ascontiguousarray(np.pad(levels, padding, mode="edge"))
    picture = av.VideoFrame.from_ndarray(levels, format="rgb24")
    return picture.reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )
