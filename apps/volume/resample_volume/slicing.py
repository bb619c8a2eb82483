"""Orthogonal slices of a volume as gray pictures, and values along a line."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles
from resample_volume.classification.scales import value_at
from resample_volume.types import Volume
from resample_volume.voxels.visible import lattice_of

MOST = 512  # values along a line
PER_VOXEL = 2  # values along a line, per voxel that it passes
# Name, scene axis across, scene axes to the right and downward, and their signs: radiological
SLICES = (("axial", 2, 0, 1, 1, 1), ("coronal", 1, 0, 2, 1, -1), ("sagittal", 0, 1, 2, 1, -1))


@dataclass(frozen=True)
class SlicePlane:
    """Orientation of orthogonal slices; axes are the voxels', 0: x."""

    name: str  # axial, coronal or sagittal
    across: int  # axis perpendicular to the slices
    right: int  # axis to the right
    down: int  # axis downward
    right_sign: int  # -1: indices grow to the left
    down_sign: int  # -1: indices grow upward


def slice_planes(volume: Volume) -> tuple[SlicePlane, ...]:
    """Return the orientations of axial, coronal and sagittal slices, by the nearest axes.

    In axial slices x goes to the right and y downward, in the others z goes upward.
    """
    from scipy.optimize import linear_sum_assignment

    _, voxel = linear_sum_assignment(-np.abs(volume.direction))
    along = [int(axis) for axis in voxel]
    sign = [int(np.sign(volume.direction[axis, along[axis]])) or 1 for axis in range(3)]
    return tuple(
        SlicePlane(name, along[across], along[x], along[y], right * sign[x], down * sign[y])
        for name, across, x, y, right, down in SLICES
    )


def slice_levels(
    volume: Volume, plane: SlicePlane, at: int, size: tuple[int, int],
    window: tuple[float, float] | None = None,
) -> NDArray[np.uint8]:  # fmt: skip
    """Return levels (h, w, 3 or 4) of slice `at`, fit into a size (width, height) in px."""
    import cv2

    count = volume.values.shape[2 - plane.across]
    if not 0 <= at < count:
        raise ValueError(f"slice {at} of {count} {plane.name} ones; give 0 to {count - 1}")
    taken: NDArray[Any] = np.asarray(volume.values.take(at, axis=2 - plane.across), np.float32)
    if plane.down < plane.right:  # of two axes the later one changes slower
        taken = taken.T
    values = np.ascontiguousarray(taken[:: plane.down_sign, :: plane.right_sign])
    is_known = np.isfinite(values)
    known = values[is_known] if is_known.any() else np.array([0.0, 1.0])
    low, high = window or (float(known.min()), float(known.max()))
    values = np.where(is_known, values, np.float32(low))
    cells = np.array(values.shape[::-1])  # to the right, downward
    extent = volume.spacing[[plane.right, plane.down]] * cells
    sides = float(np.min(np.array(size) / extent)) * extent
    shape = [max(1, round(side)) for side in sides.tolist()]
    kind = cv2.INTER_AREA if (np.array(shape) <= cells).all() else cv2.INTER_CUBIC
    shown = cv2.resize(values, shape, interpolation=kind)
    share = (shown - np.float32(low)) / np.float32(max(high - low, 1e-30))
    levels = np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)[..., np.newaxis]
    if is_known.all():
        return np.repeat(levels, 3, axis=2)
    opacity = cv2.resize(is_known.astype(np.uint8) * 255, shape, interpolation=cv2.INTER_NEAREST)
    return np.concatenate([np.repeat(levels, 3, axis=2), opacity[..., np.newaxis]], axis=2)


def profile(volume: Volume, start: ArrayLike, end: ArrayLike) -> tuple[float, Doubles]:
    """Return the distance of two points (3,), and values (N,) evenly apart between them.

    Values are interpolated linearly; NaN: outside, or missing.

    >>> from resample_volume import as_volume
    >>> ramp = as_volume(np.broadcast_to(np.arange(8.0), (8, 8, 8)))
    >>> profile(ramp, (1, 4, 4), (3, 4, 4))
    (2.0, array([1. , 1.5, 2. , 2.5, 3. ]))
    """
    from scipy.ndimage import map_coordinates

    ends = np.array([start, end], np.float64)
    index = (ends - volume.origin) @ np.linalg.inv(lattice_of(volume)).T
    steps = int(np.ceil(PER_VOXEL * np.abs(index[1] - index[0]).max() - 1e-9))
    share = np.linspace(0, 1, min(MOST, max(2, steps + 1)))[:, np.newaxis]
    place = (1 - share) * index[0] + share * index[1]
    size = np.array(volume.values.shape[::-1])
    at, how = place.T[::-1], {"output": np.float64, "order": 1, "mode": "nearest"}
    found = map_coordinates(volume.values, at, **how)
    is_outside = ((place < -0.5) | (place > size - 0.5)).any(axis=1)
    values = np.where(is_outside, np.nan, value_at(found, volume.scale))
    return float(np.linalg.norm(ends[1] - ends[0])), values
