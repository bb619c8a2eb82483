"""A volume in slabs of depth, each painted by itself: what a deep picture holds."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resample.cameras.models import AnyCamera
from resample.files.painted.deep import Slab, write_deep
from resample.painting.choices import MEASURING
from resample.resampler import Resampler
from resample.types import Doubles, Frame, View
from resample_volume.media.appearance import Medium
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import corners

Painter = Callable[[AnyCamera], Frame]

MOST = 1024
LEAST = 1e-4  # transmittance that something is seen through
BESIDE = 1e-6  # share of the depths that is added at both ends


@dataclass(frozen=True, eq=False)
class Sliced:
    """A camera that sees nothing outside of two depths."""

    camera: AnyCamera
    near: float
    far: float

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(near=max(view.near, self.near), far=min(view.far, self.far))


def check_slabs(count: int, resampler: Resampler) -> None:
    """Refuse slabs that would not add up to the picture."""
    if not 1 <= count <= MOST:
        raise ValueError(f"{count} slabs of a deep picture; give 1 to {MOST}")
    if resampler.projection in MEASURING:
        raise ValueError(
            f"deep pictures hold what is composited; the projection {resampler.projection} shows "
            "one value of a whole ray"
        )


def boxed(shown: Iterable[Medium], subject: Subject) -> Doubles:
    """Places (N, 3) that all which is seen lies between, in the subject's scene."""
    ends = [corners(subject.placed(volume)) for volume, _ in shown]
    return np.concatenate([*ends, subject.mesh.corner])


def depths(camera: AnyCamera, places: Doubles, count: int) -> Doubles:
    """Depths (count + 1,) of the planes between slabs, around places (N, 3)."""
    view = camera.view()
    depth = places @ view.rotation[2] + view.translation[2]
    slack = BESIDE * float(np.abs(depth).max())
    first, last = max(float(depth.min()) - slack, view.near), float(depth.max()) + slack
    return np.linspace(first, max(last, first + slack), count + 1)


def write_slabs(path: Path, count: int, paint: Painter, camera: AnyCamera, places: Doubles) -> None:
    """Write a deep picture of so many slabs; parameters as of `slabs` and `depths`.

    Raises
    ------
    OSError
        See `resample.files.painted.deep.write_deep`.
    """
    write_deep(path, slabs(paint, camera, depths(camera, places, count)))


def slabs(paint: Painter, camera: AnyCamera, planes: Doubles) -> Iterator[Slab]:
    """Slabs from the nearest on, which over each other are the picture up to each one's end.

    A pixel's mean over what several slabs let through is not the product of their means: where an
    edge runs through slabs, these painted alone would hide too much. So a slab is what the picture
    up to its end shows more than that up to its beginning.

    Parameters
    ----------
    paint
        Picture that a camera sees.
    camera
        Of the whole.
    planes
        Depths between slabs, from `depths`.
    """
    first, shown = float(planes[0]), None
    for near, far in zip(planes[:-1].tolist(), planes[1:].tolist(), strict=True):
        front = paint(Sliced(camera, first, far)).rgba
        alone = front
        if shown is None:
            shown = np.zeros(front.shape)
        else:
            alone = paint(Sliced(camera, near, far)).rgba
        left = 1 - shown[..., 3:]
        more = np.divide(front - shown, left, out=np.zeros(front.shape), where=left > LEAST)
        more = np.maximum(more, 0) * (alone[..., 3:] > 0) * (more[..., 3:] > 0)
        more[..., 3] = np.minimum(more[..., 3], 1)
        shown += left * more
        yield Slab(near, far, more.astype(np.float32))
