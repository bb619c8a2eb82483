"""Deep pictures in OpenEXR: several samples of different depths per pixel."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import INCOMPLETE, refused, replacing
from resample.reading.limits import check_unpacked
from resample.reading.native import plain
from resample.types import Floats

CHANNELS = ("R", "G", "B", "A", "Z", "ZBack")


class DepthSlab(NamedTuple):
    """Color and opacity between two depths."""

    near: float  # scene units
    far: float
    rgba: Floats  # (H, W, 4) premultiplied, linear light


class _PixelPart(NamedTuple):
    """Samples of a slab on pixels."""

    pixel: NDArray[np.int64]  # (N,) row × width + column
    sample: Floats  # (N, 6) in the order of `CHANNELS`


def check_deep(path: Path) -> None:
    """Reject a name that `write_deep` would reject, before any work is done."""
    if path.suffix.lower() != ".exr":
        raise ValueError(f"{path}: deep pictures are written as .exr")


def write_deep(path: Path, slabs: Iterable[DepthSlab]) -> None:
    """Write slabs of one size from front to back; empty pixels get no sample.

    Raises
    ------
    ValueError
        The suffix is not .exr, or there is no slab.
    OSError
        The file cannot be written.
    """
    check_deep(path)
    parts, shape = [], (0, 0)
    for slab in slabs:
        shape = slab.rgba.shape[:2]
        parts.append(_part(slab))
    if not parts:
        raise ValueError(f"{path}: a deep picture has one slab or more")
    with replacing(path) as temporary:
        complaint = _put(temporary, _deep(parts, shape), shape)
        if complaint:
            raise refused(path, temporary, complaint)
        try:
            _stored(temporary)
        except OSError:
            raise refused(path, temporary, INCOMPLETE) from None


def _stored(path: Path) -> tuple[Any, Any]:
    """Header and samples of a deep picture; an OSError if it is missing or not one."""
    import OpenImageIO

    source = OpenImageIO.ImageInput.open(plain(path))
    if source is None or not source.spec().deep:
        raise OSError(f"{path} is not a deep picture that can be read")
    spec = source.spec()
    samples = spec.width * spec.height * spec.nchannels * 4  # for one sample per pixel, or more
    check_unpacked(str(path), path.stat().st_size, samples)
    data = source.read_native_deep_image()
    complaint = source.geterror()
    source.close()
    if data is None or complaint:
        raise OSError(f"{path} is damaged")
    return spec, data


def _part(slab: DepthSlab) -> _PixelPart:
    rgba = slab.rgba.reshape(-1, 4)
    pixel = np.flatnonzero((rgba != 0).any(axis=1))
    ends = np.broadcast_to(np.array([slab.near, slab.far], np.float32), (pixel.size, 2))
    return _PixelPart(pixel, np.hstack([rgba[pixel], ends]).astype(np.float32))


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
    for part in parts:
        count[part.pixel] += 1
    for pixel in np.flatnonzero(count).tolist():
        data.set_samples(pixel, int(count[pixel]))
    done = np.zeros(count.size, np.int64)
    for part in parts:
        place = done[part.pixel]
        done[part.pixel] += 1
        told = zip(part.pixel.tolist(), place.tolist(), part.sample.tolist(), strict=True)
        for pixel, sample, values in told:
            for channel, value in enumerate(values):
                data.set_deep_value(pixel, channel, sample, value)
    return data


def _put(path: Path, data: Any, shape: tuple[int, ...]) -> str:
    """Write a file; returns the error message, empty on success."""
    import OpenImageIO

    name = plain(path)
    target = OpenImageIO.ImageOutput.create(name)
    if target is None:
        return str(OpenImageIO.geterror()).strip().partition("\n")[0]
    went_well = target.open(name, _spec(shape)) and target.write_deep_image(data) and target.close()
    complaint = str(target.geterror()).strip().partition("\n")[0]
    return "" if went_well and not complaint else complaint or "no reason is given"
