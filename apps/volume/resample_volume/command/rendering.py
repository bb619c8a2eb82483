"""A volume made ready once and painted as often as is asked for."""

from collections.abc import Sequence
from typing import Any

from resample.cameras.models import AnyCamera
from resample.command.console import progress_bar, say
from resample.command.session import Session
from resample.resampler import Resampler
from resample.types import Doubles, Field, Frame, LatticeField, Samples
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
    with session.stage("classify", bar="classifying"):
        subject = Subject.of_several(media, resampler, fit)
    needs.require_room(media, size, subject)
    if subject.is_empty:
        say("nothing to see: all voxels are transparent, missing or cut away")
    return subject


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
