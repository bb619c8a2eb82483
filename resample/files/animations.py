"""Write animations as films, animated pictures or folders of frames; runs can be resumed.

Each frame is first written to a PNG file: in the requested folder, or in a hidden one beside the
requested file. Frames are written atomically, and a small file beside them identifies the
animation.

GIF, animated WebP and APNG are written by Pillow. Films are H.264 in MP4, the one format that
browsers, office programs and phones all play, by PyAV (an extra), which includes FFmpeg with x264
for every platform (103 MB installed; imageio-ffmpeg's program takes 165 MB). OpenCV's own writer
needs no further package but has no H.264: its MP4 holds MPEG-4 part 2, which browsers do not play,
or VP9, which took 19 times as long and 7 times the space for 40 frames of 640 × 480 and has no
quality setting. PyAV is under the BSD licence, the x264 in its wheels under the GPL.
"""

import hashlib
import io
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import chdir, contextmanager, redirect_stderr, suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from secrets import token_hex
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.console import Progress, say
from resample.files.saving import tell_empty
from resample.files.writing import (
    check_targets,
    remove_left,
    replacing,
    take_lock,
    write_json,
)
from resample.memory import ALLOWED, allow, allowing
from resample.progress import Executor, WorkerPool, shared_out
from resample.reading.texts import json_of, text_of

FILMS = (".mp4", ".webp", ".gif", ".apng")
FRAME = "frame-{:04d}.png"
FRAMES = "frame-[0-9]*.png"
FACTS = "animation.json"  # in the folder of the frames: identifies their animation
MOST_FRAMES = 10_000

Levels = NDArray[np.uint8]
Frames = Callable[[int], Levels]  # by number


class Shots(NamedTuple):
    """Frames to make."""

    total: int
    frame: Callable[[int], Levels]  # (H, W, 3) display levels of frames 0 to total − 1
    job: Mapping[str, Any]  # JSON values; frames of equal jobs are equal
    has_more: Callable[[int], bool] = lambda _: True  # whether the frame's other outputs exist


def check_film(path: Path, fps: float) -> None:
    """Reject a target that `write_film` would reject, before any work is done."""
    if path.suffix and path.suffix.lower() not in FILMS and not path.is_dir():
        *most, last = FILMS
        raise ValueError(
            f"{path}: animations are written as {', '.join(most)}, {last} or a folder of .png files"
        )
    if not path.suffix and path.exists() and not path.is_dir():
        raise OSError(f"{path} is not a folder")
    if path.suffix.lower() == ".mp4" and not path.is_dir():
        from resample.files.films import check_codecs

        check_codecs(path)
    check_rate(fps)
    check_targets(path / FACTS if path.is_dir() else path)


def check_rate(fps: float) -> None:
    """Reject rates of films that are out of range."""
    if not 0.0 < fps <= 1000.0:
        raise ValueError(f"{fps:g} frames per second; above 0 to 1000 are allowed")


def check_count(count: int) -> None:
    """Reject zero frames, and more than the file names have digits for."""
    if not 1 <= count <= MOST_FRAMES:
        raise ValueError(f"{count} frames; 1 to {MOST_FRAMES} are allowed")


def fingerprint(*arrays: NDArray[Any]) -> str:
    """Hash that identifies arrays, for a job."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


@dataclass(frozen=True)
class _Elsewhere:
    """Frames of a film, for worker processes that have to load its data."""

    run: str  # of a command: a later run reads files that may have changed again
    read: Callable[[int], Frames] = field(compare=False)
    threads: int = field(compare=False)
    folder: str = field(compare=False)  # base of relative file names
    memory: int | None = field(compare=False)  # bytes that each process may use; None: all free

    def __call__(self, n: int) -> Levels:
        """Display levels (H, W, 3) of a frame."""
        from resample.engine.jit import threads

        with threads(self.threads), allowing(None):
            if self.memory is not None:
                allow(self.memory)
            return _frames(self)(n)


@lru_cache(1)
def _frames(film: _Elsewhere) -> Frames:
    """Frames of a film in a worker process, which makes no other; warnings were shown before."""
    with chdir(film.folder), redirect_stderr(io.StringIO()):
        return film.read(film.threads)


def made_by(
    crew: WorkerPool | None, shots: Shots, read: Callable[[int], Frames] | None
) -> tuple[Shots, Executor | None]:
    """Frames made by worker processes, each after loading its own data; and the executor.

    Workers of this machine may use as much memory as this process. Without a crew frames are made
    here.
    """
    if crew is None or read is None:
        return shots, None
    memory = ALLOWED.get() if crew.is_local else None
    frames = _Elsewhere(token_hex(8), read, crew.threads, str(Path.cwd()), memory)
    return shots._replace(frame=frames), crew.executor


def write_film(
    path: Path,
    shots: Shots,
    fps: float,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> None:
    """Write an animation in the format of its suffix, or into a folder.

    `path`: target with a suffix in `FILMS`, or a folder; its other files are kept. `shots`:
    frames of one size. An interrupted run keeps its finished frames, and says so. `fps`: frames per
    second; GIF rounds to 1/100 s, folders ignore it. `resume`: make only missing frames.
    `progress`: called with the fraction done after each new frame. `executor`: makes frames;
    processes need shots that pickle, and write frames themselves. Only this process claims and
    cleans the folder. Raises ValueError: the suffix or rate is invalid, or the existing frames
    belong to another animation. Raises OSError: the target cannot be written.
    """
    check_film(path, fps)
    target = Path(os.path.realpath(path))
    write = None if target.is_dir() else _WRITERS.get(path.suffix.lower())
    kept = target if write is None else target.with_name(f".{target.name}.frames")
    is_new, frames = not kept.is_dir(), [kept / FRAME.format(n) for n in range(shots.total)]
    kept.mkdir(exist_ok=True)
    with alone(kept, path):
        try:
            # Record which animation the frames belong to; remove frames that do not.
            facts, job = kept / FACTS, {"frames": shots.total, **shots.job}
            if facts.is_file() and resume:
                check_same(kept, facts_of(facts), json.loads(json.dumps(job)))
            else:
                for frame in kept.glob(FRAMES) if facts.is_file() else frames:
                    frame.unlink(missing_ok=True)
            write_json(facts, job)
        except OSError:
            if is_new:
                kept.rmdir()
            raise
        try:
            missing = (
                n for n, frame in enumerate(frames) if not (_is_whole(frame) and shots.has_more(n))
            )
            make = partial(_make_one, kept, shots.frame, executor is not None)
            for n in shared_out(executor, make, missing):
                if progress is not None:  # not for frames of an earlier run, which take no time
                    progress((n + 1) / shots.total)
            if executor is not None:
                remove_left(kept)
            ends = (np.atleast_2d(image.getextrema()) for image in Stored(frames))
            tell_empty(path, all(low == high for every in ends for low, high in every))
            if write is not None:
                with replacing(target) as temporary:
                    write(temporary, frames, fps)
        except BaseException:
            count = len(list(kept.glob(FRAMES)))
            if count:
                say(f"{count} frames are kept; run the same command with --resume to continue")
            else:
                (kept / FACTS).unlink(missing_ok=True)
                with suppress(OSError):  # it holds other files
                    kept.rmdir()
            raise
        if write is not None:
            shutil.rmtree(kept)


@contextmanager
def alone(folder: Path, path: Path) -> Iterator[None]:
    """Lock a folder against other processes that make frames, if the system has locks."""
    if os.name == "nt":  # where folders cannot be opened
        yield
        return
    opened = os.open(folder, os.O_RDONLY)
    try:
        take_lock(opened, folder)
    except BlockingIOError:
        os.close(opened)
        raise OSError(
            f"{path} is being made by another process; wait until it ends, or give another name"
        ) from None
    except OSError:  # a file system without locks
        pass
    try:
        yield
    finally:
        os.close(opened)


def _make_one(folder: Path, frame: Callable[[int], Levels], by_others: bool, n: int) -> int:
    """Make a frame and return its number."""
    from PIL import Image

    path = folder / FRAME.format(n)
    if by_others and _is_whole(path):  # made by a process that ended before it was recorded
        return n
    levels = frame(n)
    with replacing(path) as temporary:
        Image.fromarray(levels).save(temporary)
    return n


def facts_of(path: Path) -> dict[str, Any]:
    """Job that a folder's file of facts states; empty if it is damaged."""
    try:
        held = json_of(text_of(path))
    except ValueError:
        held = None
    return held if isinstance(held, dict) else {}


def check_same(folder: Path, held: Mapping[str, Any], job: Mapping[str, Any]) -> None:
    """Reject a folder that was made by another job."""
    for key in {**job, **held}:
        if held.get(key) != job.get(key):
            raise ValueError(
                f"{folder} holds frames of another animation ({key} is {held.get(key)!r:.40} there "
                f"and {job.get(key)!r:.40} here); without --resume they are replaced"
            )


def _is_whole(path: Path) -> bool:
    from PIL import Image

    try:
        with Image.open(path) as image:
            image.verify()
    except (OSError, SyntaxError):  # raised by Pillow for a damaged PNG
        return False
    return True


class Stored:
    """Pictures of files, opened one by one; can be iterated repeatedly."""

    def __init__(self, paths: list[Path], mode: str | None = None) -> None:
        self.paths, self.mode = paths, mode

    def __iter__(self) -> Iterator[Any]:
        from PIL import Image

        for path in self.paths:
            with Image.open(path) as image:
                yield image.convert(self.mode)


def _write_animated(path: Path, frames: list[Path], fps: float) -> None:
    ends = [round(1000.0 * n / fps) for n in range(len(frames) + 1)]  # errors do not add up
    durations = [end - begin for begin, end in pairwise(ends)]
    every: dict[str, dict[str, Any]] = {
        ".gif": {"format": "GIF", "duration": max(20, 10 * round(100.0 / fps)), "optimize": False},
        ".apng": {"format": "PNG", "duration": 1000.0 / fps},
        ".webp": {"format": "WEBP", "duration": durations, "quality": 90},
    }
    choices = every[path.suffix.lower()]
    first = next(iter(Stored(frames[:1], "RGB")))
    first.save(path, save_all=True, loop=0, append_images=Stored(frames[1:], "RGB"), **choices)


def _write_film(path: Path, frames: list[Path], fps: float) -> None:
    from PIL import Image

    from resample.files import films

    with Image.open(frames[0]) as first:
        size = first.height, first.width
    with films.new_film(path) as film:
        stream = films.new_stream(film, fps, size)
        for image in Stored(frames, "RGB"):
            film.mux(stream.encode(films.film_picture(np.asarray(image), stream)))
        film.mux(stream.encode(None))


_WRITERS = {".mp4": _write_film, **dict.fromkeys((".webp", ".gif", ".apng"), _write_animated)}
