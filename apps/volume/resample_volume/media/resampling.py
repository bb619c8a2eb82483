"""Resample values to another lattice in parts, so that the result may be a mapped file."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_like
from resample.types import Doubles, Floats
from resample_volume.data.parts import slabs
from resample_volume.data.recordings import linear_colors
from resample_volume.voxels.visible import finite_range

HALF = 0.5 + 1e-3  # half a voxel, plus the tolerance between lattices
SLAB = 1 << 22  # voxels resampled at a time
EVEN = 1.01  # step of the other lattice, voxels, up to which nothing is smoothed
WHAT = "a volume on the finest lattice"


def in_between(
    colors: NDArray[Any], matrix: Doubles, start: Doubles, shape: tuple[int, ...]
) -> Floats:
    """Resample linear colors (Z, Y, X, 3) as `resampled` does, weighted by opacity."""
    light, weight = linear_colors(colors), np.ones(1, np.float32)
    if colors.shape[-1] == 4:
        weight = resampled(colors[..., 3], matrix, start, shape)
        light = light * colors[..., 3:].astype(np.float32)
    parts = [resampled(light[..., c], matrix, start, shape) for c in range(3)]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(np.stack([part / weight for part in parts], axis=-1), posinf=0.0)


def resampled(
    values: NDArray[Any], matrix: Doubles, start: Doubles, shape: tuple[int, ...]
) -> Floats:
    """Resample values (Z, Y, X) by an affine map of indices: `matrix`, then an offset.

    If values are in a mapped file (`resample.memory.mapped`), so are all temporaries.
    """
    low, high = finite_range(values)
    widths = np.linalg.norm(matrix, axis=1)[::-1]
    given = array_like(values, values.shape, np.float32, WHAT)
    is_known = True
    for to, of in zip(slabs(given), slabs(values), strict=True):
        to[:] = of
        is_known &= bool(np.isfinite(to).all())
    if not is_known:
        return _interpolate_known(given, widths, matrix, start, shape)
    _smooth(given, widths)
    _to_coefficients(given)
    found = _read(given, matrix, start, shape, order=3)
    for part in slabs(found):
        np.clip(part, low, high, out=part)
    return found


def _interpolate_known(
    given: Floats, widths: Doubles, matrix: Doubles, start: Doubles, shape: tuple[int, ...]
) -> Floats:
    """Interpolate known values; NaN where most are missing."""
    weight = array_like(given, given.shape, np.float32, WHAT)
    for value, share in zip(slabs(given), slabs(weight), strict=True):
        share[:] = np.isfinite(value)
        value[share == 0] = 0
    _smooth(given, widths)
    _smooth(weight, widths)
    total = _read(given, matrix, start, shape, order=1)
    share_of_all = _read(weight, matrix, start, shape, order=1)
    for value, share in zip(slabs(total), slabs(share_of_all), strict=True):
        with np.errstate(invalid="ignore"):
            mean = value / np.maximum(share, 0.5)
            value[:] = np.where(share >= 0.5, mean, np.float32(np.nan))
    return total


def _smooth(values: Floats, widths: Doubles) -> None:
    """Smooth values in place for sampling at steps of these voxels along z, y and x."""
    from scipy.ndimage import gaussian_filter1d

    for axis, width in enumerate(widths):
        if width > EVEN:
            sigma = 0.5 * np.sqrt(width**2 - 1)
            for part in _lines(values, axis):
                part[:] = gaussian_filter1d(part, sigma, axis, mode="mirror")


def _to_coefficients(values: Floats) -> None:
    """Replace values by the coefficients of their cubic spline, in place."""
    from scipy.ndimage import spline_filter1d

    for axis in range(3):
        for part in _lines(values, axis):
            part[:] = spline_filter1d(part, 3, axis, np.float32, mode="mirror")


def _lines(values: Floats, axis: int) -> Iterator[Floats]:
    """Yield views of an array (Z, Y, X) that hold whole lines along an axis."""
    other = 1 if axis == 0 else 0
    step = max(1, SLAB * values.shape[other] // max(1, values.size))
    for first in range(0, values.shape[other], step):
        yield values[:, first : first + step] if other else values[first : first + step]


def _read(
    values: Floats, matrix: Doubles, start: Doubles, shape: tuple[int, ...], *, order: int
) -> Floats:
    """Values at the places of `_resampled`; NaN where there are no voxels."""
    from scipy.ndimage import affine_transform

    across = np.ascontiguousarray(matrix[::-1, ::-1])
    is_straight = not np.any(across - np.diag(np.diag(across)))
    steps = np.diag(across).copy() if is_straight else across
    found = array_like(values, shape, np.float32, WHAT)
    count = max(1, SLAB // max(1, shape[1] * shape[2]))
    for z in range(0, shape[0], count):
        part = found[z : z + count]
        begin = start[::-1] + across[:, 0] * z
        affine_transform(
            values, steps, begin, part.shape, part, order=order, mode="mirror", prefilter=False
        )
        if not is_straight:
            part[~_is_inside(values.shape, across, begin, part.shape)] = np.nan
    return found


def _is_inside(
    size: tuple[int, ...], across: Doubles, begin: Doubles, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return which points lie within half a voxel of a volume of this size."""
    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
    inside = np.ones(shape, bool)
    for axis in range(3):
        place = begin[axis] + across[axis, 0] * z + across[axis, 1] * y + across[axis, 2] * x
        inside &= (place >= -HALF) & (place <= size[axis] - 1 + HALF)
    return inside
