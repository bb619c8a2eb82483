"""Missing values: found in pictures, left without weight, and shown again in what was warped.

Channels of texels that tell where there is a value are warped like any other; a pixel's mean is
then that of the values that are there. Where less than half of a pixel's part of the source has a
value, the value is missing again, so that gaps keep their size.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.types import Warped

Booleans = NDArray[np.bool_]
LEAST = 0.5  # of what covers a pixel that must have a value
ROUNDED = 1e-5  # of the coverage that sums of weights may differ by where no value is missing


class Mask(NamedTuple):
    """Mask of a masked array."""

    is_set: Booleans  # of the array's shape
    fill: Any  # what the array fills gaps with


class Mended(NamedTuple):
    """Picture without channels that tell of gaps."""

    image: Floats  # (H, W, C) multiplied by the coverage
    coverage: Floats  # (H, W), or (H, W, C) if channels differ
    missing: Booleans | None  # (H, W, C) where a channel has no value though a pixel is covered


def unmasked(image: Any) -> tuple[NDArray[Any], Mask | None]:
    """Array and its mask, if it is a masked array."""
    if isinstance(image, np.ma.MaskedArray):
        return np.asarray(image.data), Mask(np.ma.getmaskarray(image), image.fill_value)
    return np.asarray(image), None


def masked(values: NDArray[Any], hidden: Booleans, fill: Any) -> NDArray[Any]:
    """Masked array of values, with what fills it."""
    with np.errstate(over="ignore"):  # float16 does not hold 1e20, by which NumPy fills it
        return np.ma.MaskedArray(values, hidden, fill_value=fill)


def missing_in(
    planes: NDArray[Any], mask: Mask | None, *, together: bool = False
) -> Booleans | None:
    """Where values (H, W, C) are masked or not finite; None if they are nowhere.

    Parameters
    ----------
    together
        Channels are one thing: where one is missing, all are.
    """
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
    """Texels (H, W, C) followed by channels that tell where they have values, and their number.

    One channel tells it for all if all have the same gaps, and no more are asked for.
    """
    if missing is None:
        return texels, 0
    is_one = least <= 1 and bool((missing == missing[..., :1]).all())
    count = 1 if is_one else missing.shape[2]
    there = ~missing[..., :count]
    values = np.where(missing, np.float32(0), texels)
    return np.concatenate([values, there], axis=2, dtype=np.float32), count


def mended(warped: Warped, gaps: int) -> Mended:
    """Picture whose coverage tells where there are values.

    Its own coverage tells what the source covers, with or without a value.

    Parameters
    ----------
    gaps
        Last channels, which tell where there are values.
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
    """Sums of the values that are there, of which `there` (H, W, C) is the coverage."""
    coverage = np.clip(there, 0.0, warped.coverage[..., None]).max(axis=2)
    return Mended(warped.image[..., :-gaps], coverage, None)


def kept(warped: Warped, gaps: int) -> Mended:
    """Picture as the source covers it: where too few values are there, they are missing.

    What is missing from less than half of a pixel is left to what shows through.
    """
    if gaps == 0:
        return Mended(warped.image, warped.coverage, None)
    values, there = _bounded(warped, gaps)
    cover = np.broadcast_to(warped.coverage[..., None], values.shape)
    few = there < LEAST * cover
    values = np.where(few, np.float32(0), _shared(values, there, warped.coverage))
    return Mended(values, np.where(few, np.float32(0), cover), few & (cover >= LEAST))


def _bounded(warped: Warped, gaps: int) -> tuple[Floats, Floats]:
    """Values, and what is there of them, 0 to the coverage, both by the same factor.

    Negative lobes of a kernel take the latter out of that range beside a gap. Pixels that see no
    gap are what they are in a picture without any.
    """
    values, there = warped.image[..., :-gaps], warped.image[..., -gaps:]
    coverage = warped.coverage[..., None]
    is_all = np.abs(there - coverage) <= ROUNDED * coverage
    bounded = np.where(is_all, coverage, np.clip(there, 0.0, coverage))
    share = is_all.astype(there.dtype)
    np.divide(bounded, there, out=share, where=(there > 0.0) & ~is_all)
    return values * share, bounded


def _shared(values: Floats, there: Floats, coverage: Floats) -> Floats:
    """Means of what is there, multiplied by one coverage of all channels."""
    share = np.zeros_like(there)
    np.divide(coverage[..., None], there, out=share, where=there > 0.0)
    return values * share


def _all_finite(planes: NDArray[Any]) -> bool:
    """Whether all values are finite; the sum tells at once, unless it overflows."""
    wide = np.float64 if planes.dtype.itemsize == 8 else np.float32
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(planes.sum(dtype=wide)) or np.isfinite(planes).all())
