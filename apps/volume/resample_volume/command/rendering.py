"""Workers that paint bands of a picture, each of volumes that it reads by itself."""

from collections.abc import Sequence
from functools import partial
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
from resample.outofcore.bricks import spans
from resample.painting.choices import SUMS, Projection
from resample.profiles.orders import Summing
from resample.progress import WorkerPool, shared_out, told
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume.appearance import (
    VolumeLayer,
    check_several,
    check_together,
    decided,
)
from resample_volume.classification.value_statistics import survey
from resample_volume.data.values import bricks_of, is_streamed, with_bricks
from resample_volume.rendering import (
    AROUND,
    Fit,
    Fitted,
    Painter,
    Subject,
    fields_of,
    filled,
    painted_with_bar,
)
from resample_volume.types import Volume
from resample_volume.voxels.framing import corners
from resample_volume.voxels.gathered import Gathered

if TYPE_CHECKING:
    from resample.command.workers import StartWorkers
    from resample_volume.command.choices import PictureExtras


def painted_by(
    crew: WorkerPool, media: Sequence[VolumeLayer], resampler: Resampler, fit: Fit,
    camera: AnyCamera, size: tuple[int, int],
) -> Frame:  # fmt: skip
    """Paint a picture (height, width) by workers, a band of rows each, bit-identical to here."""
    whole = bricks_of(media[0][0]).memory
    share = whole if whole is None or not crew.is_local else whole // (1 + crew.tasks)
    share = share if crew.memory is None else min(crew.memory, share or crew.memory)
    job = partial(_painted_rows, media, resampler, fit, camera, size, share, crew.threads)
    frames = list(shared_out(crew.executor, job, spans(size[0], min(crew.tasks, size[0]))))
    first, counts = frames[0], [frame.statistics for frame in frames]
    film = {
        name: np.concatenate([getattr(frame, name) for frame in frames])
        for name in Frame._fields
        if isinstance(getattr(first, name), np.ndarray)
    }
    rays = sum(count.rays for count in counts)
    return first._replace(**film, statistics=counts[0]._replace(rays=rays))


def _painted_rows(
    media: Sequence[VolumeLayer], resampler: Resampler, fit: Fit, camera: AnyCamera,
    size: tuple[int, int], memory: int | None, threads: int, rows: tuple[int, int],
) -> Frame:  # fmt: skip
    """Read the volumes of a scene, and paint rows of its picture."""
    own = []
    for volume, look in media:
        bricks = bricks_of(volume).anew()
        bricks.memory = memory
        own.append((with_bricks(volume, bricks), look))
    subject = Subject.of_several(own, resampler, fit)
    seen: Any = subject.samples_for(camera)  # fields, as was checked
    shape: dict[str, Any] = {"height": size[0], "width": size[1]}
    cuts = subject.cuts(camera)
    frame = resampler.paint_rows(seen, camera, rows, **shape, threads=threads, clip=cuts)
    return subject.tone.developed(frame)


BYTES_PER_PIXEL = 80  # of a picture and its copies for writing
SCANNED = 4  # bytes of temporaries per voxel during the scan
SCANNED_FLOATS = 18  # the same for values of floating point
VISIBLE, VISIBLE_OF_FIELD = 58, 22  # bytes per visible voxel; per voxel of a ray cast field
REMEDY = "take a smaller or downsampled volume, or show less of it"


def scene_of(
    session: Session, media: Sequence[VolumeLayer], resampler: Resampler, fit: Fit = "visible",
    size: tuple[int, int] = (0, 0),
) -> Subject:  # fmt: skip
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
    elif not in_bricks and len(media) == 1:
        volume, composited = media[0][0], resampler.projection is Projection.COMPOSITE
        least, greatest = survey(volume).whole
        if subject.is_empty:
            known = f"its values go from {least:g} to {greatest:g} (--transfer LOW..HIGH)"
            known = known if np.isfinite(volume.values).any() else "none of its values is finite"
            say(f"nothing to see: all voxels are transparent, missing or cut away; {known}")
        elif composited and least == greatest and volume.values.size > 1:
            say(f"all values of {volume.name} are {least:g}: nothing can be told apart")
    elif subject.is_empty:
        say("nothing to see: all voxels are transparent, missing or cut away")
    return subject


def slab_missed(
    media: Sequence[VolumeLayer], subject: Subject, camera: AnyCamera | None = None
) -> str | None:
    """Return the message about an empty slab; None if it is not empty, or of the other kind."""
    section = media[0][1].section
    if section is None or (section.normal is None) != (camera is not None):
        return None
    forward = np.array(section.normal) if camera is None else camera.view().rotation[2]
    planes = section.planes(forward)
    for volume, _ in media:
        away = corners(subject.placed(volume)) @ planes[:, :3].T + planes[:, 3]
        if not (away <= 0).all(axis=0).any():
            return None
    names = ", ".join(volume.name for volume, _ in media)
    return f"the slab {media[0][1].slab} holds nothing of {names}"


def picture_of(
    scene: tuple[Subject, AnyCamera, Painter], media: Sequence[VolumeLayer], projection: Projection
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
    subject: Subject, camera: AnyCamera, frame: Frame, media: Sequence[VolumeLayer],
    resampler: Resampler, extras: "PictureExtras", background: Color | None,
) -> Frame:  # fmt: skip
    """Draw the annotations of a picture, and a color bar per volume, as far as asked for."""
    if extras.is_annotated or extras.color_bar:
        from resample_volume.annotations import annotated, with_bar
    if extras.is_annotated:
        marks = extras.annotations(background)
        frame = annotated(frame, camera, subject.placed(media[0][0]), marks)
    for medium in media if extras.color_bar else ():
        frame = with_bar(frame, *medium, resampler, background, subject.tone)
    return frame


def _emptiness(frame: Frame, volume: Volume, projection: Projection) -> str | None:
    """Return the message about an empty picture; None if it is not empty."""
    if projection not in SUMS:
        return None if (frame.coverage > 0).any() else EMPTY
    if frame.value is None or (frame.value > 0).any():
        return None
    is_below = projection is Projection.ADDITIVE and (frame.value < 0).any()
    why = "no ray meets an attenuating voxel"
    if projection is Projection.ADDITIVE:
        why = "all sums are below 0" if is_below else "all sums are 0"
    hint = ""
    if is_below and survey(volume).units.added is not None:
        hint = "; for Hounsfield units take the projection xray"
    return f"the picture is black: {why}{hint}"


def to_paint(
    session: Session, media: Sequence[VolumeLayer], resampler: Resampler, fit: Fitted,
    viewpoint: Viewpoint, size: tuple[int, int], threads: int | None, sharing: Sharing,
    start_workers: "StartWorkers",
) -> tuple[Subject, AnyCamera, Painter]:  # fmt: skip
    """Prepare volumes to be painted here or by workers: return scene, camera and painter."""
    if sharing.has_workers:
        # Workers can share only rays through chunked volumes.
        for volume, _ in media:
            if not is_streamed(volume):
                raise ValueError(
                    f"workers read chunks of a volume, and {volume.name} is in memory as a whole; "
                    "convert it to OME-Zarr, or leave workers out"
                )
        if decided(media, resampler)[1].order.summing is not Summing.RAYS:
            raise ValueError(
                "workers share rays through volumes, and this look paints voxels; leave classify "
                "pre, the method and the gradient sobel out, or the workers"
            )
    around: Fit = "volume" if fit == "volume" else "visible"  # others move the camera, too
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
                return painted_by(crew, media, painter, around, eye, size)
        frame = painted_with_bar(painter, seen, eye, size, threads, cuts)
        session.seconds.update(frame.statistics.seconds)
        return subject.tone.developed(frame)

    return subject, camera, paint


def report(session: Session, frame: Frame, subject: Subject) -> dict[str, Any]:
    """Return counts and times, for `--stats`."""
    names = ("samples", "points", "splats", "splat_fraction", "hidden", "rays", "subpixels")
    counts = {name: getattr(frame.statistics, name) for name in names}
    look = str(subject.appearance.classification)
    return {"classify": look, **counts, "seconds": session.times()}


def check_memory(
    media: Sequence[VolumeLayer], size: tuple[int, int], subject: Subject | None = None,
    fit: Fit = "visible",
) -> None:  # fmt: skip
    """Reject a picture that does not fit in memory, and log (DEBUG) what it needs."""
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
