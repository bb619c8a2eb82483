"""Workers that paint bands of a picture, each of volumes that it reads by itself."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.outofcore.bricks import spans
from resample.profiles.orders import Summing
from resample.progress import WorkerPool, shared_out
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume.data.values import bricks_of, is_streamed, with_bricks
from resample_volume.multivolume.appearance import VolumeLayer, decided
from resample_volume.rendering import Fit, Subject


class SharedScene(NamedTuple):
    """What workers paint: volumes that each of them reads by itself."""

    media: Sequence[VolumeLayer]
    resampler: Resampler
    fit: Fit
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px


def check_workers(media: Sequence[VolumeLayer], resampler: Resampler) -> None:
    """Reject workers for a picture that they cannot share."""
    for volume, _ in media:
        if not is_streamed(volume):
            raise ValueError(
                f"workers read chunks of a volume, and {volume.name} is in memory as a whole; "
                "convert it to OME-Zarr, or leave workers out"
            )
    if decided(media, resampler)[1].order.summing is not Summing.RAYS:
        raise ValueError(
            "workers share rays through volumes, and this look paints voxels; leave classify pre, "
            "the method and the gradient sobel out, or the workers"
        )


def painted_by(crew: WorkerPool, scene: SharedScene) -> Frame:
    """Paint a picture by workers, a band of rows each; the bits are those of this process."""
    whole = bricks_of(scene.media[0][0]).memory
    share = whole if whole is None or not crew.is_local else whole // (1 + crew.tasks)
    share = share if crew.memory is None else min(crew.memory, share or crew.memory)
    job = partial(_painted_rows, scene, share, crew.threads)
    bands = spans(scene.size[0], min(crew.tasks, scene.size[0]))
    frames = list(shared_out(crew.executor, job, bands))
    first, counts = frames[0], [frame.statistics for frame in frames]
    film = {
        name: np.concatenate([getattr(frame, name) for frame in frames])
        for name in Frame._fields
        if isinstance(getattr(first, name), np.ndarray)
    }
    rays = sum(count.rays for count in counts)
    return first._replace(**film, statistics=counts[0]._replace(rays=rays))


def _painted_rows(
    scene: SharedScene, memory: int | None, threads: int, rows: tuple[int, int]
) -> Frame:
    """Read a scene, and paint rows of its picture."""
    media = []
    for volume, look in scene.media:
        bricks = bricks_of(volume).anew()
        bricks.memory = memory
        media.append((with_bricks(volume, bricks), look))
    subject = Subject.of_several(media, scene.resampler, scene.fit)
    seen, (height, width) = subject.samples_for(scene.camera), scene.size
    frame = scene.resampler.paint_rows(
        seen,  # type: ignore[arg-type]  # fields, as was checked
        scene.camera,
        rows,
        height=height,
        width=width,
        threads=threads,
        clip=subject.cuts(scene.camera),
    )
    return subject.developed(frame)
