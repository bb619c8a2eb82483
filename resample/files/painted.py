"""Write painted scenes: deep pictures."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.saving import new_output
from resample.files.writing import INCOMPLETE, refused, replacing
from resample.reading.pictures import complaint_of, opened
from resample.types import Floats

CHANNELS = ("R", "G", "B", "A", "Z", "ZBack")
LEAST = 1e-4  # transmittance below which nothing behind counts as visible


class DepthSlab(NamedTuple):
    """Color and opacity between two depths."""

    near: float  # scene units
    far: float
    rgba: Floats  # (H, W, 4) premultiplied, linear light


# Samples of a slab: pixels (N,), row × width + column, and values (N, 6) by `CHANNELS`.
_PixelPart = tuple[NDArray[np.int64], Floats]


def between(front: Floats, shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a slab holds (H, W, 4), from the picture up to its far plane.

    `shown`: the picture up to its near plane, to which the slab is added.

    A pixel's mean transmittance of several slabs is not the product of their means: where an edge
    runs through slabs painted separately, they would occlude too much. So a slab is a difference.
    """
    left = 1 - shown[..., 3:]
    more = np.divide(front - shown, left, out=np.zeros(front.shape), where=left > LEAST)
    more = np.maximum(more, 0) * (more[..., 3:] > 0)
    more[..., 3] = np.minimum(more[..., 3], 1)
    return more


def check_deep(path: Path) -> None:
    """Reject a name that `write_deep` would reject, before any work is done."""
    if path.suffix.lower() != ".exr":
        raise ValueError(f"{path}: deep pictures are written as .exr")


def write_deep(path: Path, slabs: Iterable[DepthSlab]) -> None:
    """Write slabs of one size from front to back; empty pixels get no sample."""
    check_deep(path)
    parts, shape = [], (0, 0)
    for slab in slabs:
        shape = slab.rgba.shape[:2]
        parts.append(_part(slab))
    if not parts:
        raise ValueError(f"{path}: a deep picture has one slab or more")
    with replacing(path) as temporary:
        target = new_output(path, temporary, _spec(shape))
        went_well = target.write_deep_image(_deep(parts, shape)) and target.close()
        if not went_well or target.has_error:
            raise refused(path, temporary, complaint_of(target))
        try:
            _check(temporary)
        except OSError:
            raise refused(path, temporary, INCOMPLETE) from None


def _check(path: Path) -> None:
    """Read a deep picture; an OSError if it is incomplete."""
    source = opened(path)
    data = source.read_native_deep_image()
    if data is None or source.geterror():
        raise OSError(f"{path} is damaged")
    source.close()


def _part(slab: DepthSlab) -> _PixelPart:
    rgba = slab.rgba.reshape(-1, 4)
    pixel = np.flatnonzero((rgba != 0).any(axis=1))
    ends = np.broadcast_to(np.array([slab.near, slab.far], np.float32), (pixel.size, 2))
    return pixel, np.hstack([rgba[pixel], ends]).astype(np.float32)


def _spec(shape: tuple[int, ...]) -> Any:
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(shape[1], shape[0], len(CHANNELS), OpenImageIO.FLOAT)
    spec.channelnames = CHANNELS
    spec.alpha_channel, spec.z_channel = 3, 4
    spec.deep = True
    spec.attribute("compression", "zips")
    return spec


def _deep(parts: list[_PixelPart], shape: tuple[int, ...]) -> Any:
    """Samples in OpenImageIO's form."""
    import OpenImageIO

    count = np.zeros(shape[0] * shape[1], np.int64)
    data = OpenImageIO.DeepData()
    data.init(_spec(shape))
    for where, _ in parts:
        count[where] += 1
    for pixel in np.flatnonzero(count).tolist():
        data.set_samples(pixel, int(count[pixel]))
    done = np.zeros(count.size, np.int64)
    for where, samples in parts:
        place = done[where]
        done[where] += 1
        told = zip(where.tolist(), place.tolist(), samples.tolist(), strict=True)
        for pixel, sample, values in told:
            for channel, value in enumerate(values):
                data.set_deep_value(pixel, channel, sample, value)
    return data
