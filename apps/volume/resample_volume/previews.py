"""Quick previews of a volume: fewer voxels, the same view and opacity."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_volume.classification.labels import Labels
from resample_volume.data.values import values_of
from resample_volume.types import Volume
from resample_volume.voxels.cropping import planes
from resample_volume.voxels.framing import centered


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
