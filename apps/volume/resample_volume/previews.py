"""Quick previews of a volume: fewer voxels and pixels, the same view and opacity."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.painting import previews
from resample.types import Frame, View
from resample_volume.classification.labels import Labels
from resample_volume.data.values import values_of
from resample_volume.types import Volume
from resample_volume.voxels.cropping import planes
from resample_volume.voxels.framing import centered

PER = 2  # pixels per side that a preview merges


@dataclass(frozen=True, eq=False)
class Shrunk:
    """A camera for a picture of fewer pixels."""

    camera: AnyCamera
    per: int  # px per side that become one

    def view(self) -> View:
        view = self.camera.view()
        return view._replace(focal=view.focal / self.per, principal=view.principal / self.per)


def enlarged(frame: Frame, per: int, height: int, width: int) -> Frame:
    """Upsample a picture: light is interpolated, depths and values are not.

    Parameters
    ----------
    per
        Pixels per side that one becomes.
    height, width
        Of the result, px; anything beyond is cropped.
    """
    smooth = partial(previews.enlarged, per=per, shape=(height, width), smooth=True)
    alike = partial(previews.enlarged, per=per, shape=(height, width), smooth=False)
    return frame._replace(
        rgba=smooth(frame.rgba),
        coverage=smooth(frame.coverage),
        depth=alike(frame.depth),
        first_depth=alike(frame.first_depth),
        value=None if frame.value is None else alike(frame.value),
    )


def merged(volume: Volume, per: int) -> Volume:
    """Downsample a volume by means over blocks of voxels, without missing values."""
    shift = volume.direction * volume.spacing @ np.full(3, (per - 1) / 2)
    colors = None if volume.colors is None else _means(volume.colors, per)
    return volume._replace(
        values=_means(volume.values, per),
        colors=colors,
        spacing=per * volume.spacing,
        origin=volume.origin + shift,
    )


def merged_labels(labels: Labels, per: int) -> Labels:
    """Return labels of merged voxels, each that of the block's first voxel."""
    return replace(labels, values=values_of(labels.values).whole()[::per, ::per, ::per])


def kept_cuts(
    volume: Volume, coarse: Volume, crop: str | None, clip: Sequence[str]
) -> tuple[str, ...]:
    """Return clip planes that cut merged voxels where crop and clip cut the volume."""
    middle = centered(coarse)[1]
    return tuple(
        "/".join(map(repr, [*normal, -far - float(np.dot(normal, middle))]))
        for *normal, far in planes(volume, crop, clip).tolist()
    )


def _means(values: NDArray[Any], per: int) -> NDArray[Any]:
    """Return the means of blocks along the first three axes, in the same type."""
    total: NDArray[Any] = np.asarray(values, np.float32)
    known: NDArray[Any] = np.isfinite(total).astype(np.float32)
    total = np.where(known > 0, total, 0)
    for axis in range(3):
        starts = np.arange(0, values.shape[axis], per)
        total, known = (np.add.reduceat(part, starts, axis) for part in (total, known))
    with np.errstate(invalid="ignore"):
        mean = total / known
    return np.asarray(np.rint(mean).astype(values.dtype) if values.dtype.kind in "iu" else mean)
