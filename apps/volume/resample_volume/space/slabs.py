"""Deep pictures: a volume painted in slabs of depth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resample.cameras.models import AnyCamera
from resample.files.saving import DepthSlab, between, write_deep
from resample.painting.choices import MEASURING
from resample.resampler import Resampler
from resample.types import Doubles, Frame, View
from resample_volume.multivolume.appearance import VolumeLayer
from resample_volume.rendering import Subject
from resample_volume.voxels.framing import corners

Painter = Callable[[AnyCamera], Frame]

MOST = 1024
BESIDE = 1e-6  # fraction of the depth range added at both ends


@dataclass(frozen=True, eq=False)
class DepthClippedCamera:
    """A camera clipped to a range of depths."""

    camera: AnyCamera
    near: float
    far: float

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(near=max(view.near, self.near), far=min(view.far, self.far))


def check_slabs(count: int, resampler: Resampler) -> None:
    """Reject slabs that would not composite to the picture."""
    if not 1 <= count <= MOST:
        raise ValueError(f"{count} slabs of a deep picture; give 1 to {MOST}")
    if resampler.projection in MEASURING:
        raise ValueError(
            f"deep pictures hold what is composited; the projection {resampler.projection} shows "
            "one value of a whole ray"
        )


def boxed(shown: Iterable[VolumeLayer], subject: Subject) -> Doubles:
    """Return the corners (N, 3) of a box around everything visible, in the subject's scene."""
    ends = [corners(subject.placed(volume)) for volume, _ in shown]
    return np.concatenate([*ends, subject.mesh.corner])


def depths(camera: AnyCamera, places: Doubles, count: int) -> Doubles:
    """Return depths (count + 1,) of the planes between slabs, around points (N, 3)."""
    view = camera.view()
    depth = places @ view.rotation[2] + view.translation[2]
    slack = BESIDE * float(np.abs(depth).max())
    first, last = max(float(depth.min()) - slack, view.near), float(depth.max()) + slack
    return np.linspace(first, max(last, first + slack), count + 1)


def write_slabs(path: Path, count: int, paint: Painter, camera: AnyCamera, places: Doubles) -> None:
    """Write a deep picture of `count` slabs; parameters as of `slabs` and `depths`."""
    write_deep(path, slabs(paint, camera, depths(camera, places, count)))


def slabs(paint: Painter, camera: AnyCamera, planes: Doubles) -> Iterator[DepthSlab]:
    """Yield slabs front to back that composite to the picture up to each one's far plane."""
    first, shown = float(planes[0]), None
    for near, far in zip(planes[:-1].tolist(), planes[1:].tolist(), strict=True):
        front = paint(DepthClippedCamera(camera, first, far)).rgba
        alone = front
        if shown is None:
            shown = np.zeros(front.shape)
        else:
            alone = paint(DepthClippedCamera(camera, near, far)).rgba
        more = between(front, shown) * (alone[..., 3:] > 0)
        shown += (1 - shown[..., 3:]) * more
        yield DepthSlab(near, far, more.astype(np.float32))
