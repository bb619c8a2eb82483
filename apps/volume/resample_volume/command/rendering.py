"""A volume made ready once and painted as often as is asked for."""

import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Viewpoint
from resample.command.console import progress_bar, say
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.command.workers import Hire, hiring
from resample.files.tiles import NAME
from resample.files.writing import beside, inheriting
from resample.memory import available_memory
from resample.resampler import Resampler
from resample.types import Doubles, Field, Frame, LatticeField, Samples
from resample.watching import told
from resample_volume.command import needs
from resample_volume.rendering import (
    Appearance,
    Fit,
    Medium,
    Subject,
    check_several,
    check_together,
)
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Bricks, Values
from resample_volume.voxels.streaming import TooManyVoxelsError
from resample_volume.windows import Spent, render_in_windows, unseen

MARK = "picture"  # file in a folder of windows, whose text says what they are of
BYTES_PER_PIXEL = needs.BYTES_PER_PIXEL


def subject_of(
    session: Session,
    volume: Volume,
    appearance: Appearance,
    resampler: Resampler,
    fit: Fit = "visible",
) -> Subject:
    """Volume made ready for a renderer."""
    return scene_of(session, [(volume, appearance)], resampler, fit)


def scene_of(
    session: Session,
    media: Sequence[Medium],
    resampler: Resampler,
    fit: Fit = "visible",
    size: tuple[int, int] = (0, 0),
) -> Subject:
    """Volumes of a scene made ready for a renderer of pictures (height, width).

    Raises
    ------
    ValueError
        They do not go together, or do not fit in memory.
    """
    needs.require_room(media, size)
    if len(media) > 1:
        check_several(media, resampler)
    check_together(resampler, media[0][1].classification, media[0][1].extras)
    in_bricks = len(media) == 1 and needs.is_in_bricks(media[0][0])
    bar = "reading bricks that are seen" if in_bricks else "classifying"
    with session.stage("classify", bar=bar) as progress, told(progress if in_bricks else None):
        subject = Subject.of_several(media, resampler, fit)
    needs.require_room(media, size, subject, fit)
    if subject.is_empty:
        say("nothing to see: all voxels are transparent, missing or cut away")
    return subject


class Painting(NamedTuple):
    """What is painted, from where, and how."""

    subject: Subject
    camera: AnyCamera
    paint: Callable[[AnyCamera], Frame]


class Doing(NamedTuple):
    """Who paints a picture."""

    threads: int | None
    sharing: Sharing
    hire: Hire
    output: Path  # beside which several processes may keep windows
    left: list[Path]  # folders with windows of commands that were killed


@contextmanager
def doing_by(
    threads: int | None, sharing: Sharing, output: Path, fit: Fit = "volume"
) -> Iterator[Doing]:
    """Who paints a picture, until the end of the block.

    Raises
    ------
    ValueError, OSError
        As of `hiring`; or cameras are placed where windows do not serve.
    """
    with hiring(sharing, threads) as hire:
        if not sharing.is_asked:
            yield Doing(threads, sharing, hire, output, [])
            return
        if fit != "volume":
            raise ValueError("workers paint windows, for which cameras are placed by --fit volume")
        with inheriting(Path(os.path.realpath(output))) as left:
            yield Doing(threads, sharing, hire, output, left)


def to_paint(
    session: Session,
    media: Sequence[Medium],
    resampler: Resampler,
    fit: Fit,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    doing: Doing,
) -> Painting:
    """Volumes ready to be painted; window by window a single one in bricks, if that is too dense.

    So it is where workers are asked for, too.

    Raises
    ------
    ValueError
        As of `scene_of`; or windows serve neither.
    """
    if doing.sharing.is_asked:
        _check_bricks(media[0][0])
        return _in_windows(session, media, resampler, viewpoint, size, doing)
    try:
        subject = scene_of(session, media, resampler, fit, size)
    except TooManyVoxelsError as error:
        if fit != "volume":
            raise ValueError(f"{error}; with --fit volume it is painted window by window") from None
        return _in_windows(session, media, resampler, viewpoint, size, doing)
    camera = subject.camera(viewpoint, *size)
    seen = lit(session, subject, camera)

    def paint(eye: AnyCamera) -> Frame:
        return painted(session, resampler, seen, eye, size, doing.threads, subject.clip)

    return Painting(subject, camera, paint)


def _check_bricks(volume: Volume) -> None:
    """Refuse to share out a picture that is not painted by windows."""
    values: Values = volume.values
    if not isinstance(values, Bricks):
        raise ValueError(
            f"workers paint windows of a volume in chunks, and {volume.name} is in memory as a "
            "whole; convert it to OME-Zarr, composite it by classify pre, or leave workers out"
        )


def _in_windows(
    session: Session,
    media: Sequence[Medium],
    resampler: Resampler,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    doing: Doing,
) -> Painting:
    """A volume in bricks, of which one window's voxels are in memory at a time."""
    (volume, look), *others = media
    subject = unseen(volume, look)
    if others:
        raise ValueError("several volumes cannot be painted window by window; leave the others out")
    camera = subject.camera(viewpoint, *size)

    def paint(eye: AnyCamera) -> Frame:
        if eye is not camera:
            raise ValueError("slabs of depth cannot be painted window by window; leave --deep out")
        with (
            session.stage("paint", bar="painting windows") as progress,
            shared(doing, volume, (look, eye.view(), size, resampler)) as spent,
        ):
            frame, count = render_in_windows(
                volume, look, viewpoint, size, spent, resampler, progress
            )
        if spent.executor is None:
            say(f"not all that is seen fits in memory: painted in {count} windows")
        else:
            say(f"painted in {count} windows by {doing.sharing.who}")
        return frame

    return Painting(subject, camera, paint)


def _mark(volume: Volume, shown: tuple[Any, ...]) -> str | None:
    """Text that pictures of equal pixels share; None where values may change unseen."""
    bricks: Any = volume.values
    state = None if bricks.keeper is None else bricks.keeper.state()
    if state is None:
        return None
    values = (
        str(bricks.keeper.store),
        state,
        bricks.shape,
        bricks.dtype.str,
        bricks.side,
        bricks.replaced,
    )
    try:
        whole = pickle.dumps((version("hybrid-resample"), values, volume[1:], shown))
    except (pickle.PicklingError, TypeError, AttributeError):
        return None
    return sha256(whole).hexdigest()


@contextmanager
def shared(doing: Doing, volume: Volume, shown: tuple[Any, ...]) -> Iterator[Spent]:
    """What windows of a volume in bricks may take, and who paints them, while they do.

    Windows of what is shown by the same means, of a command that was killed, are taken.
    """
    bricks: Any = volume.values
    allowed = bricks.memory or available_memory() or 0
    crew = doing.hire()
    if crew is None:
        yield Spent(allowed, doing.threads)
        return
    each = allowed // crew.tasks if crew.is_local else min(allowed, crew.memory or allowed)
    mark = _mark(volume, shown)
    with beside(Path(os.path.realpath(doing.output))) as folder:
        same = [left for left in doing.left if mark is not None and _mark_in(left) == mark]
        if same:
            same[0].rename(folder)
            count = len(list(folder.glob(NAME.format(*"****"))))
            say(f"{count} windows are there already, of a command that was killed")
        else:
            folder.mkdir()
            (folder / MARK).write_text(mark or "", encoding="utf-8")
        yield Spent(each, crew.threads, folder, crew.executor)


def _mark_in(folder: Path) -> str | None:
    try:
        return (folder / MARK).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None


def lit(session: Session, subject: Subject, camera: AnyCamera) -> Samples | Field | LatticeField:
    """What a camera sees of a subject."""
    with session.stage("shade", bar="shading"):
        return subject.seen_by(camera)


def painted(
    session: Session,
    resampler: Resampler,
    samples: Samples | Field | LatticeField,
    camera: AnyCamera,
    size: tuple[int, int],
    threads: int | None = None,
    clip: Doubles | None = None,
) -> Frame:
    """Picture (height, width) of samples, with a bar while it takes long."""
    with progress_bar("painting") as progress:
        frame = resampler(
            samples,
            camera,
            height=size[0],
            width=size[1],
            threads=threads,
            progress=progress,
            clip=clip,
        )
    for name, seconds in frame.statistics.seconds.items():
        session.seconds[name] = seconds
    return frame


def report(session: Session, frame: Frame) -> dict[str, Any]:
    """Counts and times, for `--stats`."""
    counts = frame.statistics
    return {
        "samples": counts.samples,
        "points": counts.points,
        "splats": counts.splats,
        "splat_fraction": counts.splat_fraction,
        "hidden": counts.hidden,
        "subpixels": counts.subpixels,
        "seconds": session.times(),
    }
