"""Prepare volumes once, render many views.

Peak memory of a picture of volumes is measured in fresh processes (`python -m benchmarks.memory`).
The number of visible voxels is known only once they are counted, so memory is checked twice: for
values and picture before the scan, and for everything before shading and painting. Chunked volumes
(`Bricks`) and mapped files keep their own account.
"""

from collections.abc import Callable, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Viewpoint
from resample.command.session import Session, libraries
from resample.command.settings import Sharing
from resample.console import Color, say
from resample.files.saving import EMPTY
from resample.memory import require
from resample.memory.mapped import is_in_file
from resample.painting.choices import SUMS, Projection
from resample.progress import told
from resample.resampler import Resampler
from resample.types import Doubles, Frame
from resample_volume.classification.value_statistics import survey
from resample_volume.data.values import is_streamed
from resample_volume.multivolume.appearance import VolumeLayer, check_several, check_together
from resample_volume.rendering import (
    AROUND,
    Fit,
    Fitted,
    Shaded,
    Subject,
    fields_of,
    filled,
    painted_with_bar,
)
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered

if TYPE_CHECKING:
    from resample.command.workers import StartWorkers
    from resample_volume.command.choices import BesidePicture

Paint = Callable[[AnyCamera], Frame]

BYTES_PER_PIXEL = 80  # of a picture and its copies for writing
SCANNED = 4  # bytes of temporaries per voxel during the scan
SCANNED_FLOATS = 18  # the same for values of floating point
VISIBLE, VISIBLE_OF_FIELD = 58, 22  # bytes per visible voxel; per voxel of a ray cast field
REMEDY = "take a smaller or downsampled volume, or show less of it"


def scene_of(
    session: Session,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    fit: Fit = "visible",
    size: tuple[int, int] = (0, 0),
) -> Subject:
    """Prepare the volumes of a scene for pictures (height, width)."""
    check_memory(media, size)
    if len(media) > 1:
        check_several(media, resampler)
    check_together(resampler, media[0][1].classification, media[0][1].extras)
    in_bricks = any(is_streamed(volume) for volume, _ in media)
    bar = "reading bricks" if in_bricks else "classifying"
    with session.stage("classify", bar=bar) as progress, told(progress if in_bricks else None):
        subject = Subject.of_several(media, resampler, fit)
    check_memory(media, size, subject, fit)
    if missed := slab_missed(media, subject):
        say(missed)
    elif subject.is_empty:
        say("nothing to see: all voxels are transparent, missing or cut away")
    return subject


def say_missed(
    media: Sequence[VolumeLayer], subject: Subject, camera: AnyCamera | None = None
) -> None:
    """Warn if a slab is empty; parameters as for `slab_missed`."""
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


def picture_of(
    scene: tuple[Subject, AnyCamera, Paint], media: Sequence[VolumeLayer], projection: Projection
) -> Frame:
    """Paint volumes, as `to_paint` prepared them; warn once if the picture is empty."""
    subject, camera, paint = scene
    frame = paint(camera)
    words = slab_missed(media, subject, camera)
    if words is None and not (subject.is_empty or slab_missed(media, subject)):
        words = _emptiness(frame, media[0][0], projection)
    if words is not None:
        say(words)
    return frame


def annotated_picture(
    subject: Subject,
    camera: AnyCamera,
    frame: Frame,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    beside: "BesidePicture",
    background: Color | None,
) -> Frame:
    """Draw the annotations of a picture, and a color bar per volume, as far as asked for."""
    if beside.is_annotated:
        from resample_volume.space.annotations import annotated

        marks = beside.annotations(background)
        frame = annotated(frame, camera, subject.placed(media[0][0]), marks)
    if beside.color_bar:
        from resample_volume.space.color_bar import with_bar

        for medium in media:
            frame = with_bar(frame, *medium, resampler, background, subject.tone)
    return frame


def _emptiness(frame: Frame, volume: Volume, projection: Projection) -> str | None:
    """Return the message about an empty picture; None if it is not empty."""
    if projection not in SUMS:
        return None if (frame.coverage > 0).any() else EMPTY
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


def to_paint(
    session: Session,
    media: Sequence[VolumeLayer],
    resampler: Resampler,
    fit: Fitted,
    viewpoint: Viewpoint,
    size: tuple[int, int],
    threads: int | None,
    sharing: Sharing,
    start_workers: "StartWorkers",
) -> tuple[Subject, AnyCamera, Paint]:
    """Prepare volumes to be painted here, or by workers; return scene, camera and painter.

    The fits `picture` and `most` are `visible` with the camera zoomed and panned to fill the
    picture, or most of it; the camera of the first is printed.
    """
    if sharing.has_workers:
        from resample_volume.command.bands import SharedScene, check_workers, painted_by

        check_workers(media, resampler)
    around: Fit = "volume" if fit == "volume" else "visible"
    subject = scene_of(session, media, resampler, around, size)
    if fit == "picture" or (fit == "most" and isinstance(viewpoint, Orbit)):
        viewpoint = filled(viewpoint, subject, size, AROUND if fit == "most" else 0.0)
        if fit == "picture":
            turned = (viewpoint.azimuth, viewpoint.elevation, viewpoint.zoom, *viewpoint.pan)
            say(f"the camera {'/'.join(f'{number:.8g}' for number in turned)} fills the picture")
    camera = subject.camera(viewpoint, *size)
    with session.stage("shade", bar="shading"):
        seen, painter = subject.samples_for(camera), subject.painter(resampler)

    def paint(eye: AnyCamera) -> Frame:
        cuts = subject.cuts(eye)
        crew = start_workers() if sharing.has_workers else None
        if crew is not None:
            say(f"rows of the picture are shared by {sharing.description}")
            with session.stage("paint", bar="painting"):
                return painted_by(crew, SharedScene(media, painter, around, eye, size))
        frame = painted(session, painter, seen, eye, size, threads, cuts)
        return subject.developed(frame)

    return subject, camera, paint


def painted(
    session: Session,
    resampler: Resampler,
    samples: Shaded,
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


def check_memory(
    media: Sequence[VolumeLayer],
    size: tuple[int, int],
    subject: Subject | None = None,
    fit: Fit = "visible",
) -> None:
    """Reject a picture that does not fit in memory, and log (DEBUG) what it needs.

    Parameters
    ----------
    size
        Height and width of the picture, px.
    subject
        Their visible voxels, once known.
    """
    volumes = [volume for volume, _ in media]
    if any(is_streamed(volume) or is_in_file(volume.values) for volume in volumes):
        return
    parts = {"libraries": libraries(), "values": 0}
    for volume in volumes:
        kind = volume.values.dtype
        looked_at = SCANNED if kind.kind in "bui" else SCANNED_FLOATS
        parts["values"] += (kind.itemsize + looked_at) * prod(volume.values.shape)
    parts["the picture"] = BYTES_PER_PIXEL * size[0] * size[1]
    what = volumes[0].name or "the volume"
    if subject is not None:
        parts[f"{subject.visible} visible voxels"] = VISIBLE * subject.visible
        if isinstance(subject.voxels, Gathered | list):
            fields = fields_of(subject.voxels)
            # Fields need visible voxels only to place a camera and for slopes.
            needed = [one for one in fields if fit == "visible" or len(one.table.table) > 1]
            count = VISIBLE_OF_FIELD * sum(one.visible for one in needed)
            parts[f"{subject.visible} visible voxels"] = count
            thin = [field.spline.coefficient.nbytes for field in fields if field.thin.parts > 1]
            if thin:
                parts["slices between thick ones"] = sum(thin)
    require(what, parts, REMEDY)
