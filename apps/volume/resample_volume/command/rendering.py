"""Prepare volumes once, render many views."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Viewpoint
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.command.workers import StartWorkers, worker_pools
from resample.console import Color, say
from resample.files.writing import beside, inheriting
from resample.lazy import installed_version
from resample.memory import available_memory
from resample.painting.choices import SUMS, Projection
from resample.profiles.orders import Summing
from resample.resampler import Resampler
from resample.types import Doubles, Field, Frame, LatticeField, Samples
from resample.watching import told
from resample_volume.classification.surveys import survey
from resample_volume.command import needs
from resample_volume.command.filling import Fitted, ball_fit, filled, whole_fit
from resample_volume.data.fingerprints import fingerprint
from resample_volume.data.values import is_streamed, values_of
from resample_volume.media.appearance import (
    Appearance,
    Classification,
    VolumeLayer,
    check_several,
    check_together,
    decided,
    fits_as_field,
)
from resample_volume.rendering import Fit, Subject, painted_with_bar
from resample_volume.types import Volume
from resample_volume.voxels.streaming import TooManyVoxelsError

if TYPE_CHECKING:
    from resample_volume.command.choices import BesidePicture
    from resample_volume.windows import Budget

MARK = "picture"  # file in a folder of windows that identifies their picture
BYTES_PER_PIXEL = needs.BYTES_PER_PIXEL


def scene_of(
    session: Session,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    fit: Fit = "visible",
    size: tuple[int, int] = (0, 0),
) -> Subject:
    """Prepare the volumes of a scene for pictures (height, width)."""
    needs.check_memory(media, size)
    if len(media) > 1:
        check_several(media, resampler)
    check_together(resampler, media[0][1].classification, media[0][1].extras)
    say_lost_field(media, resampler)
    in_bricks = len(media) == 1 and is_streamed(media[0][0])
    bar = "reading visible bricks" if in_bricks else "classifying"
    with session.stage("classify", bar=bar) as progress, told(progress if in_bricks else None):
        subject = Subject.of_several(media, resampler, fit)
    needs.check_memory(media, size, subject, fit)
    if missed := slab_missed(media, subject):
        say(missed)
    elif subject.is_empty:
        say("nothing to see: all voxels are transparent, missing or cut away")
    return subject


def say_lost_field(
    media: Sequence[VolumeLayer], resampler: Resampler, *, in_windows: bool = False
) -> None:
    """Say why voxels of one volume are painted, if rays through its field were asked for."""
    (volume, look), *others = media
    is_by_rays = resampler.order.summing is Summing.RAYS
    if others or not is_by_rays or look.classification is not Classification.AUTO:
        return
    _, painter = decided(media, resampler)
    if painter.order.summing is Summing.RAYS:
        if in_windows:
            say("workers paint voxels (classify pre), not rays through the field")
    elif is_streamed(volume) and not fits_as_field(volume):
        say("memory does not hold the volume as a field: voxels are painted (classify pre)")


def say_missed(
    media: Sequence[VolumeLayer], subject: Subject, camera: AnyCamera | None = None
) -> None:
    """Warn if a slab is empty; parameters as of `slab_missed`."""
    if missed := slab_missed(media, subject, camera):
        say(missed)


def slab_missed(
    media: Sequence[VolumeLayer], subject: Subject, camera: AnyCamera | None = None
) -> str | None:
    """Return the message about an empty slab; None if it is not empty, or of the other kind.

    Parameters
    ----------
    camera
        For slabs across the view; None: check those across a scene direction.
    """
    section = media[0][1].section
    if section is None or (section.normal is None) != (camera is not None):
        return None
    forward = np.array(section.normal) if camera is None else camera.view().rotation[2]
    if not all(subject.misses(volume, forward) for volume, _ in media):
        return None
    names = ", ".join(volume.name for volume, _ in media)
    return f"the slab {media[0][1].slab} holds nothing of {names}"


class PreparedPicture(NamedTuple):
    """A prepared scene, its camera and its painter."""

    subject: Subject
    camera: AnyCamera
    paint: Callable[[AnyCamera], Frame]


def picture_of(
    scene: PreparedPicture, media: Sequence[VolumeLayer], projection: Projection
) -> Frame:
    """Paint volumes; warn once if the picture is empty."""
    subject, camera, paint = scene
    frame = paint(camera)
    words = slab_missed(media, subject, camera)
    if words is None and not (subject.is_empty or slab_missed(media, subject)):
        words = _emptiness(frame, media[0][0], projection)
    if words is not None:
        say(words)
    return frame


def annotated_picture(
    scene: PreparedPicture,
    frame: Frame,
    shown: VolumeLayer,
    resampler: Resampler,
    beside: "BesidePicture",
    background: Color | None,
) -> Frame:
    """Draw the annotations of a picture, and its color bar, as far as they are asked for."""
    if beside.is_annotated:
        from resample_volume.space.annotations import annotated

        marks = beside.annotations(background)
        frame = annotated(frame, scene.camera, scene.subject.placed(shown[0]), marks)
    if beside.color_bar:
        from resample_volume.figures.color_bar import with_bar

        frame = with_bar(frame, *shown, resampler, background, scene.subject.tone)
    return frame


def _emptiness(frame: Frame, volume: Volume, projection: Projection) -> str | None:
    """Return the message about an empty picture; None if it is not empty."""
    if projection not in SUMS:
        is_empty = not (frame.coverage > 0).any()
        return "the picture is empty: no ray meets anything visible" if is_empty else None
    if frame.value is None or (frame.value > 0).any():
        return None
    is_below = projection is Projection.ADDITIVE and (frame.value < 0).any()
    why = "no ray meets anything that attenuates"
    if projection is Projection.ADDITIVE:
        why = "all sums are below 0" if is_below else "all sums are 0"
    hint = ""
    if is_below and survey(volume).units.added is not None:
        hint = "; for Hounsfield units take the projection xray"
    return f"the picture is black: {why}{hint}"


class ExecutionContext(NamedTuple):
    """Threads, processes and memory that paint a picture."""

    threads: int | None
    sharing: Sharing
    start_workers: StartWorkers
    output: Path  # several processes may keep windows beside it
    left: list[Path]  # folders with windows of commands that were killed


@contextmanager
def execution_context(
    threads: int | None, sharing: Sharing, output: Path
) -> Iterator[ExecutionContext]:
    """Provide threads, processes and memory for a picture, until the end of the block."""
    with worker_pools(sharing, threads) as start_workers:
        if not sharing.has_workers:
            yield ExecutionContext(threads, sharing, start_workers, output, [])
            return
        with inheriting(Path(os.path.realpath(output))) as left:
            yield ExecutionContext(threads, sharing, start_workers, output, left)


def to_paint(
    session: Session,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    fit: Fitted,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    context: ExecutionContext,
) -> PreparedPicture:
    """Prepare volumes to be painted; volumes in bricks window by window, if too dense.

    With workers it is always by windows. The fit `picture` is `visible` with the camera zoomed and
    panned to fill the picture; that camera is printed.
    """
    if context.sharing.has_workers:
        from resample_volume.outofcore.dense import share_lattice

        for medium in media:
            _check_bricks(*medium)
        if not share_lattice(media):
            raise ValueError(
                "workers paint volumes that share a lattice, and others are resampled by one "
                "process; leave workers out"
            )
        say_lost_field(media, resampler, in_windows=True)
        return _in_windows(session, media, resampler, whole_fit(fit), viewpoint, size, context)
    try:
        subject = scene_of(session, media, resampler, ball_fit(fit), size)
    except TooManyVoxelsError:
        return _in_windows(session, media, resampler, whole_fit(fit), viewpoint, size, context)
    viewpoint = filled(viewpoint, fit, subject, media[0], resampler, size)
    camera = subject.camera(viewpoint, *size)
    seen, painter = lit(session, subject, camera), subject.painter(resampler)

    def paint(eye: AnyCamera) -> Frame:
        cuts = subject.cuts(eye)
        frame = painted(session, painter, seen, eye, size, context.threads, cuts)
        return subject.developed(frame)

    return PreparedPicture(subject, camera, paint)


def _check_bricks(volume: Volume, look: Appearance) -> None:
    """Reject workers for a picture that is not painted by windows."""
    from resample_volume.outofcore.dense import is_in_store

    if not is_streamed(volume):
        raise ValueError(
            f"workers paint windows of a volume in chunks, and {volume.name} is in memory as a "
            "whole; convert it to OME-Zarr, composite it by classify pre, or leave workers out"
        )
    if look.labels is not None and not is_in_store(look.labels):
        raise ValueError(
            "workers read labels from a store, and these are in memory as a whole; convert them to "
            "OME-Zarr, or leave workers out"
        )


def _in_windows(
    session: Session,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    fit: Fit,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    context: ExecutionContext,
) -> PreparedPicture:
    """Prepare volumes in bricks, to hold one window's voxels in memory at a time."""
    from resample_volume.windows import paint_streamed, streamed_subject

    spent = local_budget(media, context.threads)
    with session.stage("classify", bar="scanning voxels") as progress:
        subject = streamed_subject(media, fit, resampler, spent, progress)
    say_missed(media, subject)
    camera = subject.camera(viewpoint, *size)

    def paint(eye: AnyCamera) -> Frame:
        if eye is not camera:
            raise ValueError("slabs of depth cannot be painted window by window; leave --deep out")
        with (
            session.stage("paint", bar="painting windows") as progress,
            shared(context, media, (eye.view(), size, resampler)) as spent,
        ):
            frame, count = paint_streamed(media, subject, eye, size, spent, resampler, progress)
        if spent.executor is None:
            say(f"the visible voxels do not fit in memory: painted in {count} windows")
        else:
            say(f"painted in {count} windows by {context.sharing.description}")
        return frame

    return PreparedPicture(subject, camera, paint)


def local_budget(media: Sequence[VolumeLayer], threads: int | None) -> "Budget":
    """Return the budget of windows that this process paints."""
    from resample_volume.windows import Budget

    allowed = values_of(media[0][0].values).memory
    return Budget(allowed or available_memory() or 0, threads)


def _mark(media: Sequence[VolumeLayer], shown: tuple[Any, ...]) -> str | None:
    """Return a key shared by pictures of equal pixels; None if values may change unnoticed."""
    known: list[Any] = [installed_version(), shown]
    for volume, look in media:
        labels = [] if look.labels is None else [look.labels.values]
        states = [values_of(stored).state() for stored in (volume.values, *labels)]
        if None in states:
            return None
        known += [states, volume[1:], replace(look, labels=None)]
        known += [] if look.labels is None else [look.labels.rules]
    return fingerprint(known)


@contextmanager
def shared(
    context: ExecutionContext, media: Sequence[VolumeLayer], shown: tuple[Any, ...]
) -> "Iterator[Budget]":
    """Provide the budget and the executor of windows, until the end of the block.

    Windows that a killed command left of the same picture are reused.
    """
    from resample.files.painted import NAME
    from resample_volume.windows import Budget

    here = local_budget(media, context.threads)
    allowed, crew = here.memory, context.start_workers()
    if crew is None:
        yield here
        return
    each = allowed // crew.tasks if crew.is_local else min(allowed, crew.memory or allowed)
    mark = _mark(media, shown)
    with beside(Path(os.path.realpath(context.output))) as folder:
        same = [left for left in context.left if mark is not None and _mark_in(left) == mark]
        if same:
            same[0].rename(folder)
            count = len(list(folder.glob(NAME.format(*"****"))))
            say(f"{count} windows are reused from a command that was killed")
        else:
            folder.mkdir()
            (folder / MARK).write_text(mark or "", encoding="utf-8")
        yield Budget(each, crew.threads, folder, crew.executor)


def _mark_in(folder: Path) -> str | None:
    try:
        return (folder / MARK).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return None


def lit(session: Session, subject: Subject, camera: AnyCamera) -> Samples | Field | LatticeField:
    """Return the shaded samples, or the field, for a camera."""
    with session.stage("shade", bar="shading"):
        return subject.samples_for(camera)


def painted(
    session: Session,
    resampler: Resampler,
    samples: Samples | Field | LatticeField,
    camera: AnyCamera,
    size: tuple[int, int],
    threads: int | None = None,
    clip: Doubles | None = None,
) -> Frame:
    """Paint a picture (height, width) of samples, with a progress bar if it takes long."""
    frame = painted_with_bar(resampler, samples, camera, size, threads, clip)
    for name, seconds in frame.statistics.seconds.items():
        session.seconds[name] = seconds
    return frame


def report(session: Session, frame: Frame, subject: Subject) -> dict[str, Any]:
    """Return counts and times, for `--stats`."""
    counts = frame.statistics
    return {
        "classify": str(subject.appearance.classification),
        "samples": counts.samples,
        "points": counts.points,
        "splats": counts.splats,
        "splat_fraction": counts.splat_fraction,
        "hidden": counts.hidden,
        "rays": counts.rays,
        "subpixels": counts.subpixels,
        "seconds": session.times(),
    }
