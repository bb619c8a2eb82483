"""Read and write files of several pictures one by one: pages, animations, films.

Pillow handles animated pictures, PyAV films; display times are preserved.
"""

import glob
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.console import say, say_of
from resample.files.animations import FACTS, Stored, alone, check_same, facts_of
from resample.files.films import (
    FRAME_BYTES,
    PLAIN,
    FilmCoding,
    StereoMarks,
    check_codecs,
    film_picture,
    mark_stereo,
    new_film,
    new_stream,
    opened_film,
    other_tracks,
)
from resample.files.formats import (
    FORMATS,
    SUFFIXES,
    WriteOptions,
    as_srgb,
    can_be_written,
    check_output,
    flattened,
    levels,
    tell_colors,
)
from resample.files.metadata.colors import coded_colors, is_srgb, stretched
from resample.files.metadata.fields import TIFF, page_tags
from resample.files.metadata.tags import Tag, is_animated_png
from resample.files.pictures import Kind, Picture, read_picture
from resample.files.saving import write_pages
from resample.files.stores import STORE, Address, Place, is_in_store
from resample.files.writing import replacing, write_json
from resample.memory import return_freed_memory
from resample.reading.limits import check_animation, check_unpacked
from resample.reading.pictures import decoding

ANIMATED = (".gif", ".webp", ".apng", ".png")  # formats that may also hold a single picture
FILMS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mpg", ".mpeg")
WRITTEN = (".gif", ".webp", ".apng", *FORMATS)
SUBFILE, SMALLER, MASK = 254, 1, 4  # a tag of TIFF, and its bits
USUAL = 1.0 / 24.0  # s per picture if not specified
SHORTEST = 0.001  # s between two frames of a film, even if their times are equal
WEBP_ALPHA = 0x10  # bit in the flags of a WebP file
TICKS = 90_000  # per second, unit of time in films
OTHERS = (".avif", ".bmp", ".hdr", ".jp2", ".jxl", ".pgm", ".ppm", ".pfm", ".tga")
READ = (*SUFFIXES, *WRITTEN, *FILMS, *OTHERS)
PART = 250  # pictures; encoders begin anew after as many by default


class Frames(NamedTuple):
    """Pictures of a file, read on demand."""

    path: Path
    seconds: tuple[float, ...]  # display time of each
    pages: tuple[int, ...] | None = None  # for TIFF: directories that are pictures
    encoding: str = "auto"  # of integers in pages, see `resample.files.images.open_file`
    plays: int = 0  # how often an animation is shown; 0: without end
    has_tracks: bool = False  # sound or subtitles
    first: int = 0  # number of the first picture that is taken
    begin: float = 0.0  # seconds before it

    def part(self, start: float, end: float) -> "Frames":
        """Return the pictures that are first shown between two times, s.

        Raises ValueError: there is none.
        """
        begins = [0.0, *itertools.accumulate(self.seconds)]
        chosen = [n for n, at in enumerate(begins[:-1]) if start <= at + SHORTEST / 2 < end]
        if not chosen:
            raise ValueError(
                f"{self.path} has no picture from {start:g} to {end:g} s; it is {begins[-1]:g} s "
                "long (--start, --end)"
            )
        first, pages = chosen[0], self.pages
        return self._replace(
            seconds=self.seconds[first : chosen[-1] + 1], first=first, begin=begins[first],
            pages=None if pages is None else pages[first : chosen[-1] + 1],
        )  # fmt: skip

    def tell_tracks(self, target: Path) -> None:
        """Warn that a target drops the film's sound and subtitles, if any."""
        if self.has_tracks and target.suffix.lower() not in FORMATS:
            say(f"{self.path.name}: sound and subtitles are copied to {', '.join(FORMATS)} alone")

    def read(self) -> Iterator[Picture]:
        """Read pictures one after the other."""
        if self.pages is not None:
            options: dict[str, Any] = {"as_data": True, "encoding": self.encoding}
            return (read_picture(self.path, page, **options) for page in self.pages)
        if self.path.suffix.lower() in FILMS:
            return _film_frames(self.path, self.begin)
        return itertools.islice(_animated_frames(self.path), self.first, None)


def frames_of(path: Place, encoding: str = "auto") -> Frames | None:
    """Pictures of a file with several; None if it has one or is not a picture."""
    if isinstance(path, Address) or is_in_store(path) or not path.is_file():
        return None
    suffix, found = path.suffix.lower(), None
    if suffix in FILMS:
        found = _film(path)
    elif suffix in ANIMATED and (suffix not in (".png", ".apng") or is_animated_png(path)):
        seconds, plays = _animated_times(path)
        found = Frames(path, seconds, plays=plays) if len(seconds) > 1 else None
    elif suffix in TIFF:
        # Directories that are pictures: neither reduced copies nor masks.
        kinds = [page.get(SUBFILE) for page in page_tags(path)]
        bits = [int(kind.values[0]) if isinstance(kind, Tag) else 0 for kind in kinds]
        if any(bit & MASK for bit in bits):
            say(f"{path.name}: its masks are ignored")
        pages = tuple(n for n, bit in enumerate(bits) if not bit & (SMALLER | MASK))
        if len(pages) > 1:
            return Frames(path, (USUAL,) * len(pages), pages, encoding)
    if found is not None and encoding == "linear":
        raise ValueError(f"{path}: films and animations are sRGB; leave out the encoding linear")
    return found


def check_frames(path: Path, frames: Frames, look: WriteOptions) -> None:
    """Reject a target that `write_frames` would reject, before any work is done."""
    suffix, is_animated = path.suffix.lower(), frames.path.suffix.lower() in ANIMATED
    frames.tell_tracks(path)
    if look.quality is not None:
        raise ValueError(f"{path}: a quality is of files of one picture; leave it out")
    if suffix in TIFF:
        check_output(path, look)
    elif suffix not in WRITTEN and not (suffix == ".png" and is_animated):
        known = ", ".join((*TIFF[:1], *WRITTEN))
        count = len(frames.seconds)
        raise ValueError(f"{path}: the {count} pictures of {frames.path} are written as {known}")
    elif look.bits not in (None, 8):
        raise ValueError(f"{path}: animations have 8 bits per channel, not {look.bits}")
    elif suffix in FORMATS:
        check_codecs(path)


def write_frames(path: Path, pictures: Iterable[Picture], film: Frames, look: WriteOptions) -> None:
    """Write pictures to one file, with the times of a film, and its sound, if any.

    Films are opaque: black is behind them, unless there is another background.
    """
    suffix, seconds = path.suffix.lower(), film.seconds
    if suffix in TIFF:
        write_pages(path, pictures, look)
        return
    shades = itertools.islice(shades_of(path, pictures, look), len(seconds))
    with replacing(path) as temporary:
        if suffix in FORMATS:
            with new_film(temporary) as made:
                mux_beside(made, encoded(made, shades, film.seconds), film)
        else:
            _ANIMATED[suffix](temporary, shades, seconds, film.plays)


def _animated_times(path: Path) -> tuple[tuple[float, ...], int]:
    """Seconds of each frame, and how often all are shown."""
    from PIL import Image

    with decoding(path):
        with Image.open(path) as image:
            width, height = image.size
            frame = FRAME_BYTES * width * height
            check_unpacked(str(path), path.stat().st_size, frame)
            count = getattr(image, "n_frames", 1)
            check_animation(str(path), path.stat().st_size, frame, count)
            seconds, loop = list[float](), image.info.get("loop")
            if image.info.get("icc_profile") and not is_srgb(image.info["icc_profile"]):
                say_of(path, "its colors are taken for sRGB, not its profile's")
            for n in range(count if count > 1 else 0):
                image.seek(n)
                image.load()
                seconds.append(float(image.info.get("duration", 0.0)) / 1000.0 or USUAL)
        if path.suffix.lower() == ".gif" and not path.read_bytes().rstrip(b"\0").endswith(b";"):
            say(f"{path.name} is cut off after {max(count, 1)} frames")
    repeats = 0 if loop is None else int(loop)  # GIF's count does not include the first time
    is_gif, is_endless = path.suffix.lower() == ".gif", loop == 0
    return tuple(seconds), 0 if is_endless else repeats + is_gif


def _animated_frames(path: Path) -> Iterator[Picture]:
    from PIL import Image

    with decoding(path), Image.open(path) as image:
        count = getattr(image, "n_frames", 1)
        for n in range(count):
            image.seek(n)
            yield _shades(np.asarray(image.convert("RGBA")))


def _shades(levels: NDArray[Any]) -> Picture:
    """Picture from levels (H, W, 3 or 4) of 8 or 16 bits; without alpha if opaque."""
    from resample.engine.levels import decode, levels_of

    bits = 8 * levels.itemsize
    light = from_srgb((np.arange(1 << bits) / ((1 << bits) - 1.0)).astype(np.float32))
    kind = Kind(("R", "G", "B"), bits, is_encoded=True)
    color = np.empty((*levels.shape[:2], 3), np.float32)
    stored = np.ascontiguousarray(levels[..., :3]).reshape(-1)
    decode(light, levels_of(stored), color.reshape(-1))
    if levels.shape[2] == 3 or bool((levels[..., 3] == 255).all()):
        return Picture(color, kind)
    alpha = levels[..., 3:].astype(np.float32) / np.float32(255.0)
    data = np.concatenate([color * alpha, alpha], axis=2)
    return Picture(data, kind._replace(channels=("R", "G", "B", "A")))


def _film(path: Path) -> Frames:
    """Open a film, with the display times of its frames as far as packets have them."""
    with opened_film(path) as film:
        stream = film.streams.video[0]
        has_tracks = bool(film.streams.audio or film.streams.subtitles)
        seen = stream.codec_context
        colors = coded_colors((seen.color_primaries, seen.color_trc))
        lost = [f"colors are taken for sRGB, not {colors}"] if colors else []
        for each in (*lost, *stretched(float(stream.sample_aspect_ratio or 1))):
            say_of(path, f"its {each}")
        rate, base = stream.average_rate, stream.time_base or Fraction(1, TICKS)
        times = [
            packet.dts if packet.pts is None else packet.pts
            for packet in film.demux(stream)
            if packet.size
        ]
    last = float(1 / rate) if rate else USUAL
    known = sorted(float(time * base) for time in times if time is not None)
    if len(known) < len(times):
        return Frames(path, (last,) * len(times), has_tracks=has_tracks)
    gaps = np.maximum(np.diff(known), SHORTEST).tolist()
    return Frames(path, (*gaps, *(last,) * bool(known)), has_tracks=has_tracks)


def _film_frames(path: Path, begin: float = 0.0) -> Iterator[Picture]:
    """Pictures of a film that are shown `begin` seconds after its first one, or later."""
    from av.video.reformatter import Colorspace

    from resample.engine.jit import workers

    known = {int(space) for space in (Colorspace.ITU709, Colorspace.ITU601, Colorspace.SMPTE240M)}
    with opened_film(path) as film:
        stream = film.streams.video[0]
        stream.thread_type, stream.codec_context.thread_count = "AUTO", workers()
        base = stream.time_base or Fraction(1, TICKS)
        start = float((stream.start_time or 0) * base) + begin
        if begin > 0.0:
            film.seek(round(start / base), stream=stream)
        for frame in film.decode(stream):
            if begin > 0.0 and frame.time is not None and frame.time < start - SHORTEST / 2:
                continue
            check_unpacked(str(path), path.stat().st_size, FRAME_BYTES * frame.width * frame.height)
            has_alpha = any(part.is_alpha for part in frame.format.components)
            is_deep = not has_alpha and any(part.bits > 8 for part in frame.format.components)
            form = "rgba" if has_alpha else "rgb48le" if is_deep else "rgb24"
            # Large frames that do not state their color coding use HDTV's.
            coding: Any = Colorspace.ITU709 if frame.height >= 720 else Colorspace.ITU601
            coding = int(frame.colorspace) if int(frame.colorspace) in known else coding
            levels = frame.to_ndarray(format=form, src_colorspace=coding)
            yield _shades(np.rot90(levels, round(frame.rotation / 90.0)))


def shades_of(
    path: Path, pictures: Iterable[Picture], look: WriteOptions, *, is_deep: bool = False
) -> Iterator[Any]:
    """Display levels (H, W, 3 or 4) of pictures for a file, of 16 bits if they are deep."""
    for n, picture in enumerate(pictures):
        shown = as_srgb(picture) if look.in_srgb else picture
        if n == 0:
            tell_colors(path, shown.about, is_guessed=look.is_light)
        is_opaque = path.suffix.lower() in FORMATS and shown.kind.has_alpha
        if look.background is not None or is_opaque:
            shown = flattened(shown, look.background or (0.0, 0.0, 0.0))
        has_alpha = shown.kind.has_alpha
        colors, form = len(shown.kind.channels) - has_alpha, "uint16" if is_deep else "uint8"
        if colors not in (1, 3) or shown.about.number:
            raise ValueError(f"{path}: neither gray nor RGB; .tif holds other channels and numbers")
        shades = levels(shown.data, form, has_alpha=has_alpha, is_light=look.is_light)
        if colors == 1:
            shades = shades[..., [0, 0, 0, 1][: 3 + has_alpha]]
        yield np.ascontiguousarray(shades, form)


def _write_gif(
    path: Path, frames: Iterable[NDArray[np.uint8]], seconds: Sequence[float], plays: int
) -> None:
    times = [10 * max(2, round(100.0 * second)) for second in seconds]
    images = map(_with_palette, frames)
    choices: dict[str, Any] = {"duration": times, "disposal": 2, "optimize": False}
    choices |= {} if plays == 1 else {"loop": max(plays - 1, 0)}  # without it, shown once
    next(images).save(path, save_all=True, append_images=images, **choices)


def _write_webp(
    path: Path, frames: Iterable[NDArray[np.uint8]], seconds: Sequence[float], plays: int
) -> None:
    """Write an animated WebP."""
    from PIL import Image

    clear = []

    def images() -> Iterator[Any]:
        for frame in frames:
            clear.append(frame.shape[2] == 4)  # clear borders are cropped: the file may say opaque
            yield Image.fromarray(frame)

    times, all_images = [round(1000.0 * second) for second in seconds], images()
    choices = {"duration": times, "quality": 90}
    next(all_images).save(path, save_all=True, loop=plays, append_images=all_images, **choices)
    if any(clear):
        with path.open("r+b") as file:
            head = file.read(21)
            if head[12:16] == b"VP8X":
                file.seek(20)
                file.write(bytes([head[20] | WEBP_ALPHA]))


def _write_apng(
    path: Path, frames: Iterable[NDArray[np.uint8]], seconds: Sequence[float], plays: int
) -> None:
    """Write an animated PNG; Pillow iterates over the frames twice."""
    from PIL import Image

    with TemporaryDirectory() as folder:
        kept = []
        for n, levels in enumerate(frames):
            kept.append(Path(folder) / f"{n}.png")
            Image.fromarray(levels).save(kept[-1], compress_level=1)
        times = [1000.0 * second for second in seconds]
        stored = Stored(kept)
        first, others = next(iter(stored)), Stored(kept[1:])
        choices = {"duration": times, "disposal": 1, "blend": 0}
        first.save(path, format="PNG", save_all=True, loop=plays, append_images=others, **choices)


def _with_palette(levels: NDArray[np.uint8]) -> Any:
    """Palette image for a GIF, with pixels either opaque or transparent."""
    from PIL import Image

    if levels.shape[2] == 3:
        return Image.fromarray(levels)
    is_clear = levels[..., 3] < 128
    image = Image.fromarray(levels[..., :3]).quantize(255)
    indices = np.where(is_clear, np.uint8(255), np.asarray(image))
    shown = Image.fromarray(indices).convert("P")
    palette = (image.getpalette() or [])[:765]
    shown.putpalette(palette + [0] * (768 - len(palette)))
    shown.info["transparency"] = 255
    return shown


def encoded(
    film: Any,
    frames: Iterable[NDArray[Any]],
    seconds: Sequence[float],
    coding: FilmCoding = PLAIN,
    usual: float | None = None,
) -> Iterator[tuple[float, Any]]:
    """Encode frames as a new stream of a film; give packets, with seconds that are then shown.

    `usual`: seconds of a frame that the stream states; None: their mean.
    """
    iterator = iter(frames)
    first = next(iterator)
    begins = [0.0, *itertools.accumulate(seconds)]
    shown = list(seconds if usual is None else [usual])
    total = float(sum(shown))
    rate = min(1000.0, len(shown) / total) if total > 0.0 else 1.0 / USUAL
    stream = new_stream(film, rate, first.shape[:2], coding)
    stream.codec_context.time_base = Fraction(1, TICKS)
    for n, shades in enumerate(itertools.chain([first], iterator)):
        picture = film_picture(shades, stream)
        picture.pts, picture.time_base = round(begins[n] * TICKS), Fraction(1, TICKS)
        yield begins[n + 1], stream.encode(picture)
    yield begins[-1], stream.encode(None)


def mux_beside(film: Any, packets: Iterable[tuple[float, Any]], source: Frames) -> None:
    """Mux the pictures of a new film, beside the sound that is heard with them, and subtitles."""
    beside: Iterator[tuple[float, Any]] = iter(())
    waiting = None
    for n, (shown, made) in enumerate(packets):
        if n == 0 and source.has_tracks:
            beside = other_tracks(source.path, film, source.begin)
            waiting = next(beside, None)
        film.mux(made)
        while waiting is not None and waiting[0] < shown:
            film.mux(waiting[1])
            waiting = next(beside, None)


_ANIMATED = {".gif": _write_gif, ".webp": _write_webp, ".apng": _write_apng, ".png": _write_apng}


def is_batch(images: Sequence[Place], output: Path) -> bool:
    """Whether results go to a folder: for several files, a folder or a pattern, or if it is one."""
    is_folder = "*" in output.name
    is_folder |= output.is_dir() and output.suffix.lower() not in (*SUFFIXES, STORE)
    if len(images) > 1 or is_folder or isinstance(images[0], Address) or is_in_store(images[0]):
        return len(images) > 1 or is_folder
    return images[0].is_dir() or _is_pattern(images[0])


def batch_of(images: Sequence[Place], output: Path) -> list[tuple[Place, Path]]:
    """Expand arguments to pairs of source and target."""
    sources = files_of(images)
    pattern = output.name if "*" in output.name else None
    folder = output if pattern is None else output.parent
    if folder.exists() and not folder.is_dir():
        raise OSError(f"{folder} is not a folder; several pictures are written to one")
    if pattern is None and not folder.exists() and folder.suffix:
        raise ValueError(
            f"{folder}: several pictures are written to a folder; give its name, or a pattern such"
            " as 'small/*.webp'"
        )
    pairs = [(source, folder / _name(source, pattern)) for source in sources]
    taken: dict[Path, Place] = {}
    for source, target in pairs:
        if target in taken:
            raise ValueError(f"{taken[target]} and {source} would both become {target}")
        if target.resolve() in {source.resolve() for source in sources}:
            raise ValueError(f"{target} would be replaced; give another folder")
        taken[target] = source
    return pairs


def files_of(images: Sequence[Place]) -> list[Place]:
    """Expand folders and patterns to files."""
    every: list[Place] = []
    for path in images:
        if isinstance(path, Address) or is_in_store(path):
            every.append(path)
        elif path.is_dir():
            inside = [file for file in sorted(path.iterdir()) if file.suffix.lower() in READ]
            every += [one for one in inside if one.is_file() and not one.name.startswith(".")]
        elif _is_pattern(path):
            matches = sorted(map(Path, glob.glob(str(path), recursive=True)))
            every += [file for file in matches if file.is_file()]
        else:
            every.append(path)
    found = list(dict.fromkeys(every))
    if not found:
        raise ValueError(
            f"{', '.join(map(str, images))}: no pictures found; give files, a folder "
            "that holds some, or a quoted pattern such as 'photos/*.jpg'"
        )
    return found


def _is_pattern(path: Path) -> bool:
    return not path.exists() and glob.has_magic(str(path))


def _name(source: Place, pattern: str | None) -> str:
    """Name of a result: by a pattern, or its source's if the format can be written."""
    if pattern is not None:
        return pattern.replace("*", Path(source.name).stem)
    suffix = source.suffix.lower()
    if suffix in SUFFIXES or can_be_written(suffix):
        return source.name
    if suffix in FILMS:
        return Path(source.name).with_suffix(".mp4").name if suffix not in FORMATS else source.name
    is_animated = suffix in WRITTEN and frames_of(source) is not None
    return source.name if is_animated else Path(source.name).with_suffix(".png").name


def write_in_parts(
    path: Path,
    pictures: Callable[[int], Iterable[Picture]],
    film: Frames,
    look: WriteOptions,
    coding: FilmCoding,
    marks: StereoMarks,
    job: Mapping[str, Any],
    *,
    resume: bool | None = None,
) -> None:
    """Write a film; after an interruption its finished parts are kept in a hidden folder.

    `path`: target with a suffix of `formats.FORMATS`. `pictures`: function that gives
    the pictures from a number on. `film`: display times, and the file whose sound and subtitles are
    copied. `job`: JSON values; films of equal jobs are equal. `resume`: continue with the parts of
    an earlier run; None: keep none after an error. Raises ValueError: the existing parts belong to
    another film. Raises OSError: the target cannot be written.
    """
    target = Path(os.path.realpath(path))
    kept = target.with_name(f".{target.name}.parts")
    kept.mkdir(exist_ok=True)
    starts = range(0, len(film.seconds), PART)
    parts = [kept / f"{start:07d}.mp4" for start in starts]
    with alone(kept, path):
        facts = kept / FACTS
        if resume and facts.is_file():
            check_same(kept, facts_of(facts), job)
        else:
            for part in kept.glob("*.mp4"):
                part.unlink()
        write_json(facts, job)
        done = next((n for n, part in enumerate(parts) if not part.is_file()), len(parts))
        try:
            shades = shades_of(path, pictures(done * PART), look, is_deep=coding.is_deep)
            rate = sum(film.seconds) / len(film.seconds)
            for start, part in zip(starts[done:], parts[done:], strict=True):
                seconds = film.seconds[start : start + PART]
                with replacing(part) as temporary, new_film(temporary) as made:
                    shown = itertools.islice(shades, len(seconds))
                    for _, packets in encoded(made, shown, seconds, coding, rate):
                        made.mux(packets)
                return_freed_memory()  # encoders leave gaps between what stays
        except BaseException:
            count = PART * sum(part.is_file() for part in parts) if resume is not None else 0
            if count:
                say(f"{count} frames are kept; run the same command with --resume to continue")
            else:
                shutil.rmtree(kept, ignore_errors=True)
            raise
        with replacing(target) as temporary:
            with new_film(temporary) as made:
                mux_beside(made, _joined(made, parts, film.seconds, coding), film)
            if target.suffix.lower() != ".mkv":
                mark_stereo(temporary, marks)
    shutil.rmtree(kept)


def _joined(
    film: Any, parts: Sequence[Path], seconds: Sequence[float], coding: FilmCoding
) -> Iterator[tuple[float, Any]]:
    """Packets of all parts for a film, each with its seconds; times of decoding rise."""
    import av

    begins, last = [0.0, *itertools.accumulate(seconds)], None
    stream: Any = None
    for n, part in enumerate(parts):
        with av.open(str(part)) as source:
            video = source.streams.video[0]
            if stream is None:
                stream = film.add_stream_from_template(video, opaque=True)
                stream.metadata.update(coding.metadata)
            for packet in source.demux(video):
                if packet.size and packet.pts is not None and packet.dts is not None:
                    late = round(begins[n * PART] / packet.time_base)
                    packet.pts += late
                    packet.dts += late
                    if last is not None:
                        packet.dts = max(packet.dts, last + 1)
                    last, packet.stream = packet.dts, stream
                    yield float(packet.pts * packet.time_base), packet
    yield begins[-1], []
