"""Read and write films frame by frame by PyAV; H.264 for all players."""

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.console import say
from resample.files.formats import FORMATS
from resample.files.writing import check_end, refused
from resample.reading.limits import check_unpacked

if TYPE_CHECKING:
    from av.container import InputContainer, OutputContainer

CODECS = {"h264": "libx264", "hevc": "libx265", "av1": "libsvtav1"}
PRESETS = {"h264": "medium", "hevc": "medium", "av1": "8"}
CHOICES = {"movflags": "faststart"}
# Formats that contain the film itself: playlists may refer to any file.
CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegvideo"
READING = {"format_whitelist": CONTAINERS, "protocol_whitelist": "file"}
# Codecs of sound and subtitles that MP4 holds; other sound becomes AAC.
HELD = ("aac", "ac3", "alac", "eac3", "flac", "mov_text", "mp3", "opus")
LAYOUTS = {1: "mono", 2: "stereo", 6: "5.1", 8: "7.1"}  # of AAC, by channels; others are mixed
RATES = (8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000, 64000, 88200, 96000)
# S before the first picture; sound codecs need the samples just before it. Not in Matroska.
EARLIEST = -0.2
FRAME_BYTES = 16  # bytes per pixel in memory: red, green, blue and alpha in float32
MODES = {"top-bottom": 1, "left-right": 2}  # of st3d
QUARTER = 0x40000000  # of a panorama, beside the half ahead at each side: as 0.32 fixed point
# Boxes that contain others, and the bytes before these.
HEADS = {b"moov": 0, b"trak": 0, b"mdia": 0, b"minf": 0, b"stbl": 0, b"stsd": 8}
OFFSETS = {b"stco": ">I", b"co64": ">Q"}  # tables of places in the file
CODERS = (b"avc1", b"hvc1", b"hev1", b"av01")


class FilmCoding(NamedTuple):
    """How the pictures of a film are encoded."""

    codec: str = "h264"  # of `CODECS`
    crf: int = 18  # constant quality: less is better and larger
    bitrate: int | None = None  # bits per second, in place of constant quality
    pixels: str = "yuv420p"  # pixel format in FFmpeg's words
    metadata: Mapping[str, str] = {}  # of the video stream
    packing: int | None = None  # number of H.264's SEI for two squeezed pictures in a frame

    @property
    def is_deep(self) -> bool:
        """Whether there are more than 8 bits per channel."""
        return self.pixels.endswith("le")

    def options(self) -> dict[str, str]:
        """Options of the encoder."""
        made = {} if self.bitrate is not None else {"crf": str(self.crf)}
        made["preset"] = PRESETS[self.codec]
        if self.codec == "h264" and self.packing is not None:
            made["x264-params"] = f"frame-packing={self.packing}"
        if self.codec == "hevc":
            made["x265-params"] = "log-level=error:pools=1:frame-threads=1"
        return made


PLAIN = FilmCoding()


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
    """Open a film for writing, in the format of its suffix (`FORMATS`)."""
    check_codecs(path)
    import av

    form = FORMATS[path.suffix.lower()]
    options = {} if form == "matroska" else CHOICES
    try:
        with av.open(str(path), "w", format=form, options=options) as film:
            yield film
    except av.FFmpegError as error:
        raise refused(path, path, str(error.strerror)) from None
    if path.is_file():  # without frames nothing is written
        check_end(path, path)


def new_stream(
    film: "OutputContainer", fps: float, size: tuple[int, int], coding: FilmCoding = PLAIN
) -> Any:
    """Add a video stream of a size (height, width) to a film; codecs want sides to be even."""
    from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc

    rate = Fraction(fps).limit_denominator(1001)
    stream: Any = film.add_stream(CODECS[coding.codec], rate=rate, options=coding.options())
    stream.height, stream.width = (side + side % 2 for side in size)
    stream.pix_fmt = coding.pixels
    if coding.bitrate is not None:
        stream.bit_rate = coding.bitrate
    stream.metadata.update(coding.metadata)
    codec_context = stream.codec_context
    codec_context.thread_count = 1  # more threads cut pictures into slices, without gain
    codec_context.color_range, codec_context.colorspace = ColorRange.MPEG, Colorspace.ITU709
    codec_context.color_primaries = ColorPrimaries.BT709
    codec_context.color_trc = ColorTrc.IEC61966_2_1
    return stream


def other_tracks(
    path: Path, film: "OutputContainer", begin: float = 0.0
) -> Iterator[tuple[float, Any]]:
    """Add the sound and subtitles of a film (path) to a new one, and give their packets.

    Packets of `HELD` are copied, other sound is encoded anew; subtitles of other codecs are left
    out, which is said. Tracks are added when the first packet is asked for.

    `begin`: seconds of the film before the new one's first picture.

    Result: packets for the new film, each with its time in seconds from the first picture.
    """
    import av

    is_free = film.format.name == "matroska"  # it holds nearly every codec

    with opened_film(path) as source:
        pictures, made = source.streams.video[0], dict[Any, tuple[Any, Any]]()
        start = float((pictures.start_time or 0) * (pictures.time_base or 0)) + begin
        for stream in (*source.streams.audio, *source.streams.subtitles):
            codec: Any = stream.codec_context
            name = "" if codec is None else codec.name
            if name and (name != "mov_text" if is_free else name in HELD):
                made[stream] = film.add_stream_from_template(stream, opaque=True), None
            elif codec is not None and stream.type == "audio":
                rate = codec.rate if codec.rate in RATES else 48_000
                layout = LAYOUTS.get(codec.layout.nb_channels, "stereo")
                turned = av.AudioResampler("fltp", layout, rate)
                made[stream] = film.add_stream("aac", rate=rate, layout=layout), turned
            else:
                known = name or "an unknown codec"
                say(f"{path.name}: {stream.type} of {known} is not copied")
        if made and begin > 0.0:
            source.seek(round((start + EARLIEST) * av.time_base))
        for packet in source.demux(list(made)) if made else ():
            for each in _remade(packet, *made[packet.stream], start):
                second = float(each.pts * each.time_base)
                if second >= (0.0 if is_free else EARLIEST):
                    yield second, each


def _remade(packet: Any, track: Any, turned: Any, start: float) -> list[Any]:
    """Packets for another film with its own start time, s; `turned` resamples sound."""
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


def film_picture(levels: NDArray[np.uint8] | NDArray[np.uint16], stream: Any) -> Any:
    """Convert levels (H, W, 3) of 8 or 16 bits to a frame of a stream."""
    import av
    from av.video.reformatter import ColorRange, Colorspace

    height, width = levels.shape[:2]
    padding = ((0, stream.height - height), (0, stream.width - width), (0, 0))
    levels = np.ascontiguousarray(np.pad(levels, padding, mode="edge"))
    form = "rgb24" if levels.dtype == np.uint8 else "rgb48le"
    picture = av.VideoFrame.from_ndarray(levels, format=form)
    return picture.reformat(
        format=stream.pix_fmt, dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )


class StereoMarks(NamedTuple):
    """Stereo metadata of a film, for players.

    `st3d` says how the pictures of both eyes lie in a frame, `sv3d` which directions it shows
    ("Spherical Video V2 RFC", Google). FFmpeg's muxer writes them from side data that PyAV cannot
    set, so they are added to finished files.
    """

    mode: str | None = None  # of `MODES`; None: no layout that players show to both eyes
    around: str | None = None  # "360" or "180"; None: flat pictures
    name: str = ""  # of the layout in the names of files that players read
    matroska: str | None = None  # FFmpeg's name of Matroska's StereoMode
    packing: int | None = None  # of H.264's SEI, for squeezed pictures

    def boxes(self) -> bytes:
        """Return the boxes of a sample entry."""
        made = b""
        if self.mode is not None:
            made += _box(b"st3d", struct.pack(">IB", 0, MODES[self.mode]))
        if self.around is not None:
            side = QUARTER if self.around == "180" else 0
            head = _box(b"svhd", struct.pack(">I", 0) + b"hybrid-resample\0")
            pose = _box(b"prhd", struct.pack(">Iiii", 0, 0, 0, 0))
            shown = _box(b"equi", struct.pack(">IIIII", 0, 0, 0, side, side))
            made += _box(b"sv3d", head + _box(b"proj", pose + shown))
        return made


UNMARKED = StereoMarks()


def mark_stereo(path: Path, marks: StereoMarks) -> None:
    """Add the boxes of two eyes to the video of an MP4 file, which begins with its tables."""
    added = marks.boxes()
    with path.open("r+b") as file:
        found = [box for box in _boxes_in(file.read(1 << 16), 0) if box[0] == b"moov"]
        if not found:
            raise ValueError(f"{path}: the tables of an MP4 file lie before its pictures")
        _, place, size = found[0]
        file.seek(place)
        moov, end, last = file.read(size), place + size, path.stat().st_size
        growth = len(_marked(moov, added, 0)) - size
        # Everything behind the tables moves by their growth, from the end on.
        while last > end:
            first = max(end, last - (1 << 24))
            file.seek(first)
            part = file.read(last - first)
            file.seek(first + growth)
            file.write(part)
            last = first
        file.seek(place)
        file.write(_marked(moov, added, growth))


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", 8 + len(body)) + kind + body


def _boxes_in(data: bytes, start: int) -> Iterator[tuple[bytes, int, int]]:
    """Kind, place and size of the boxes from a place on."""
    while start + 8 <= len(data):
        size = int.from_bytes(data[start : start + 4], "big")
        if size == 1:
            size = int.from_bytes(data[start + 8 : start + 16], "big")
        yield data[start + 4 : start + 8], start, size
        start += max(size, 8)


def _marked(box: bytes, added: bytes, growth: int) -> bytes:
    """Return a box with boxes added to its video's sample entry, and places moved by a growth."""
    kind, body = box[4:8], box[8:]
    if kind in HEADS:
        head = HEADS[kind]
        parts = (body[at : at + size] for _, at, size in _boxes_in(body, head))
        return _box(kind, body[:head] + b"".join(_marked(each, added, growth) for each in parts))
    if kind in OFFSETS:
        places = (at + growth for (at,) in struct.iter_unpack(OFFSETS[kind], body[8:]))
        return _box(kind, body[:8] + b"".join(struct.pack(OFFSETS[kind], at) for at in places))
    return _box(kind, body + added) if kind in CODERS else box
