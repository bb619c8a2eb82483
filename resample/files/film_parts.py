"""Write films in parts that are joined at the end, so that interrupted runs can go on."""

import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from resample.console import say
from resample.files.animations import FACTS, alone, check_same, facts_of
from resample.files.films import FilmCoding, StereoMarks, mark_stereo, new_film
from resample.files.formats import WriteOptions
from resample.files.pictures import Picture
from resample.files.sequences import Frames, encoded, mux_beside, shades_of
from resample.files.writing import replacing, write_json

PART = 250  # pictures; encoders begin anew after as many by default


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

    `path`: target with a suffix of `resample.files.films.FORMATS`. `pictures`: function that gives
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
        except BaseException:
            _leave(kept, parts if resume is not None else [])
            raise
        with replacing(target) as temporary:
            with new_film(temporary) as made:
                mux_beside(made, _joined(made, parts, film.seconds, coding), film)
            if target.suffix.lower() != ".mkv":
                mark_stereo(temporary, marks)
    shutil.rmtree(kept)


def _leave(kept: Path, parts: Sequence[Path]) -> None:
    """After an error, keep finished parts and say so; without any remove their folder."""
    count = sum(part.is_file() for part in parts)
    if count:
        say(f"{count * PART} frames are kept; run the same command with --resume to continue")
    else:
        shutil.rmtree(kept, ignore_errors=True)


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
