"""Read and write films frame by frame by PyAV; H.264 for all players."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from resample.console import say
from resample.files.writing import check_end, refused
from resample.reading.limits import check_unpacked

if TYPE_CHECKING:
    from av.container import InputContainer, OutputContainer

H264 = "libx264"
CHOICES = {"movflags": "faststart"}
# Formats that contain the film itself: playlists may refer to any file.
CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegvideo"
READING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file"}
# Codecs of sound and subtitles that MP4 holds; other sound becomes AAC.
HELD = ("aac", "ac3", "alac", "eac3", "flac", "mov_text", "mp3", "opus")
LAYOUTS = {1: "mono", 2: "stereo", 6: "5.1", 8: "7.1"}  # of AAC, by channels; others are mixed
RATES = (8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000, 64000, 88200, 96000)
EARLIEST = -0.2  # s before the first picture; coders of sound need what is just before it
FRAME_BYTES = 16  # bytes per pixel in memory: red, green, blue and alpha in float32
QUALITY = {"crf": "18", "preset": "medium"}


def check_codecs(path: Path) -> None:
    """Reject films if PyAV is not installed."""
    try:
        import av  # noqa: F401
    except ImportError:
        raise ValueError(
            f"{path.name}: films need PyAV, which is not installed: "
            "pip install 'hybrid-resample[film]'; .webp, .gif and .apng need nothing more"
        ) from None


@contextmanager
def opened_film(path: Path) -> Iterator["InputContainer"]:
    """Open a film for reading."""
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
    """Open an MP4 film for writing."""
    check_codecs(path)
    import av

    try:
        with av.open(str(path), "w", format="mp4", options=CHOICES) as film:
            yield film
    except av.FFmpegError as error:
        raise refused(path, path, str(error.strerror)) from None
    if path.is_file():  # without frames nothing is written
        check_end(path, path)


def new_stream(film: "OutputContainer", fps: float, size: tuple[int, int]) -> Any:
    """Add a video stream to a film.

    `size`: height and width, px. H.264 stores one color per 2 × 2 pixels, so sides are rounded to
    even.
    """
    from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

    rate = Fraction(fps).limit_denominator(1001)
    stream: Any = film.add_stream(H264, rate=rate, options=QUALITY)
    stream.height, stream.width = (side + side % 2 for side in size)
    stream.pix_fmt = "yuv420p"
    codec_context = stream.codec_context
    codec_context.thread_count = 1  # more threads cut pictures into slices, without gain
    codec_context.color_range, codec_context.colorspace = ColorRange.MPEG, Colorspace.ITU709
    codec_context.color_primaries = ColorPrimaries.BT709
    codec_context.color_trc = ColorTrc.IEC61966_2_1
    return stream


def other_tracks(path: Path, film: "OutputContainer") -> Iterator[tuple[float, Any]]:
    """Add the sound and subtitles of a film (path) to a new one, and give their packets.

    Packets of `HELD` are copied, other sound is encoded anew; subtitles of other codecs are left
    out, which is said. Tracks are added when the first packet is asked for.

    Result: packets for the new film, each with its time in seconds from the first picture.
    """
    import av

    with opened_film(path) as source:
        pictures, made = source.streams.video[0], dict[Any, tuple[Any, Any]]()
        start = float((pictures.start_time or 0) * (pictures.time_base or 0))
        for stream in (*source.streams.audio, *source.streams.subtitles):
            codec: Any = stream.codec_context
            if codec is not None and codec.name in HELD:
                made[stream] = film.add_stream_from_template(stream), None
            elif codec is not None and stream.type == "audio":
                rate = codec.rate if codec.rate in RATES else 48_000
                layout = LAYOUTS.get(codec.layout.nb_channels, "stereo")
                turned = av.AudioResampler("fltp", layout, rate)
                made[stream] = film.add_stream("aac", rate=rate, layout=layout), turned
            else:
                name = "an unknown codec" if codec is None else codec.name
                say(f"{path.name}: {stream.type} of {name} is not copied")
        for packet in source.demux(list(made)) if made else ():
            for each in _remade(packet, *made[packet.stream], start):
                second = float(each.pts * each.time_base)
                if second >= EARLIEST:
                    yield second, each


def _remade(packet: Any, track: Any, turned: Any, start: float) -> list[Any]:
    """Return a packet for another film that begins at a time of its own, s.

    `turned`: resampler of sound that is encoded anew; what is damaged of it is left out.
    """
    import av

    is_last = packet.dts is None
    if turned is None:
        if is_last:
            return []
        late = round(start / packet.time_base)
        packet.pts = (packet.dts if packet.pts is None else packet.pts) - late
        packet.dts -= late
        packet.stream = track
        return [packet]
    made, frames = [], []
    with suppress(av.error.InvalidDataError):
        frames = packet.decode()
    for frame in frames:
        frame.pts -= round(start / frame.time_base)
        made += [each for part in turned.resample(frame) for each in track.encode(part)]
    if is_last:
        made += [each for part in turned.resample(None) for each in track.encode(part)]
        made += track.encode(None)
    return made


def film_picture(levels: NDArray[np.uint8], stream: Any) -> Any:
    """Convert levels (H, W, 3) to a frame of a stream."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    height, width = levels.shape[:2]
    padding = ((0, stream.height - height), (0, stream.width - width), (0, 0))
    levels = np.ascontiguousarray(np.pad(levels, padding, mode="edge"))
    picture = av.VideoFrame.from_ndarray(levels, format="rgb24")
    return picture.reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )
