"""Missing values: find them, give them no weight, mark them in the result.

Channels that mark where values exist are warped like any other; a pixel's mean is then that of the
existing values. Where less than half of a pixel's part of the source has a value, the value is
missing in the result, so that gaps keep their size.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.types import Warped

Booleans = NDArray[np.bool_]
LEAST = 0.5  # share of a pixel's coverage that must have a value
ROUNDED = 1e-5  # share of the coverage by which sums of weights may differ without missing values


class Mask(NamedTuple):
    """Mask and fill value of a masked array."""

    is_set: Booleans  # of the array's shape
    fill: Any  # fill value of the array


class Mended(NamedTuple):
    """Picture without the channels that mark missing values."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W), or (H, W, C) if channels differ
    missing: Booleans | None  # (H, W, C) where a channel has no value though a pixel is covered


def unmasked(image: Any) -> tuple[NDArray[Any], Mask | None]:
    """Return an array, and its mask if it is a masked array."""
    if isinstance(image, np.ma.MaskedArray):
        return np.asarray(image.data), Mask(np.ma.getmaskarray(image), image.fill_value)
    return np.asarray(image), None


def masked(values: NDArray[Any], hidden: Booleans, fill: Any) -> NDArray[Any]:
    """Return a masked array with a fill value."""
    with np.errstate(over="ignore"):  # float16 does not hold 1e20, NumPy's fill value
        return np.ma.MaskedArray(values, hidden, fill_value=fill)


def missing_in(
    planes: NDArray[Any], mask: Mask | None, *, together: bool = False
) -> Booleans | None:
    """Find values (H, W, C) that are masked or not finite; None if there are none."""
    missing = None if mask is None else mask.is_set.reshape(planes.shape)
    if planes.dtype.kind == "f" and not _all_finite(planes):
        not_finite = ~np.isfinite(planes)
        missing = not_finite if missing is None else missing | not_finite
    if missing is None or not missing.any():
        return None
    if together:
        missing = np.broadcast_to(missing.any(axis=2, keepdims=True), planes.shape)
    return np.asarray(missing)


def weighed(texels: Floats, missing: Booleans | None, least: int = 1) -> tuple[Floats, int]:
    """Append channels that mark where texels (H, W, C) have values; return their number.

    One channel marks it for all if all have the same gaps, unless more are requested.
    """
    if missing is None:
        return texels, 0
    is_one = least <= 1 and bool((missing == missing[..., :1]).all())
    count = 1 if is_one else missing.shape[2]
    there = ~missing[..., :count]
    values = np.where(missing, np.float32(0), texels)
    return np.concatenate([values, there], axis=2, dtype=np.float32), count


def mended(warped: Warped, gaps: int) -> Mended:
    """Return a picture whose coverage counts only existing values.

    The coverage of `warped` counts the source, with or without values.
    """
    if gaps == 0:
        return Mended(warped.image, warped.coverage, None)
    values, there = _bounded(warped, gaps)
    coverage = there.max(axis=2)
    if gaps == 1:
        return Mended(values, coverage, None)
    missing = (there < LEAST * coverage[..., None]) & (coverage > 0.0)[..., None]
    return Mended(_shared(values, there, coverage), coverage, missing)


def added(warped: Warped, there: Floats, gaps: int) -> Mended:
    """Return the sums of existing values, whose coverage is `there` (H, W, C)."""
    coverage = np.clip(there, 0.0, warped.coverage[..., None]).max(axis=2)
    return Mended(warped.image[..., :-gaps], coverage, None)


def kept(warped: Warped, gaps: int) -> Mended:
    """Return a picture with the source's coverage, missing where too few values exist.

    Where the source covers less than half of a pixel, the background shows through instead.
    """
    if gaps == 0:
        return Mended(warped.image, warped.coverage, None)
    values, there = _bounded(warped, gaps)
    cover = np.broadcast_to(warped.coverage[..., None], values.shape)
    few = there < LEAST * cover
    values = np.where(few, np.float32(0), _shared(values, there, warped.coverage))
    return Mended(values, np.where(few, np.float32(0), cover), few & (cover >= LEAST))


def _bounded(warped: Warped, gaps: int) -> tuple[Floats, Floats]:
    """Return values and their weights, limited to 0..coverage by a common factor.

    Beside a gap, negative lobes of a kernel take the weights out of that range. Pixels without gaps
    keep the values of a picture without any.
    """
    values, there = warped.image[..., :-gaps], warped.image[..., -gaps:]
    coverage = warped.coverage[..., None]
    is_all = np.abs(there - coverage) <= ROUNDED * coverage
    bounded = np.where(is_all, coverage, np.clip(there, 0.0, coverage))
    share = is_all.astype(there.dtype)
    np.divide(bounded, there, out=share, where=(there > 0.0) & ~is_all)
    return values * share, bounded


def _shared(values: Floats, there: Floats, coverage: Floats) -> Floats:
    """Return means of existing values, multiplied by the coverage that all channels share."""
    share = np.zeros_like(there)
    np.divide(coverage[..., None], there, out=share, where=there > 0.0)
    return values * share


def _all_finite(planes: NDArray[Any]) -> bool:
    """Whether all values are finite; first tries the sum, which is fast."""
    wide = np.float64 if planes.dtype.itemsize == 8 else np.float32
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(planes.sum(dtype=wide)) or np.isfinite(planes).all())
