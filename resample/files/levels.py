"""Convert values to stored types: integers, levels of light, and markers for missing data."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.types import Floats

EVEN = {4: 1e-6, 8: 1e-12}  # relative tolerance for equality of floats, by their size in bytes


def whole_numbers(data: Floats, form: str) -> NDArray[Any]:
    """Round numbers to an integer type, clipped to its range; missing values become 0."""
    limits = np.iinfo(form)
    rounded = np.rint(np.nan_to_num(data.astype(np.float64), nan=0.0, posinf=np.inf))
    return np.asarray(np.clip(rounded, limits.min, limits.max).astype(form))


def levels(data: Floats, form: str, *, has_alpha: bool, is_light: bool) -> NDArray[Any]:
    """Convert light to integer levels as pictures store them.

    Parameters
    ----------
    data
        (H, W, C) linear light, premultiplied; missing values become 0.
    form
        Unsigned type, whose largest number stands for 1.
    has_alpha
        The last channel is opacity. The others are divided by it.
    is_light
        Encode all but opacity by the sRGB curve; otherwise values are stored linearly.
    """
    data = np.nan_to_num(data, nan=0.0, posinf=np.inf, neginf=-np.inf)
    if not is_light:
        planes = np.clip(data, 0.0, 1.0)
    elif has_alpha:
        alpha = data[..., -1:]
        color = np.divide(
            data[..., :-1], alpha, out=np.zeros_like(data[..., :-1]), where=alpha > 0.0
        )
        planes = np.concatenate([_curve(color), np.clip(alpha, 0.0, 1.0)], axis=2)
    else:
        planes = _curve(data)
    made: NDArray[Any] = np.floor(planes * np.iinfo(form).max + 0.5).astype(form)
    return made


def fits(missing: float | None, form: str) -> bool:
    """Whether a type can represent the marker for missing values."""
    if missing is None:
        return False
    if form == "float32":
        return True
    limits = np.iinfo(form)
    return missing.is_integer() and limits.min <= missing <= limits.max


def gaps_of(data: Floats, missing: float, *, as_whole: bool) -> NDArray[np.bool]:
    """Where values are missing, per value or per pixel.

    Parameters
    ----------
    data
        (H, W, C).
    missing
        Marker for a missing value.
    as_whole
        A pixel, (H, W, 1), is missing if all its values are.
    """
    gaps: NDArray[np.bool] = np.isclose(
        data, data.dtype.type(missing), rtol=EVEN[data.dtype.itemsize], atol=0.0
    )
    return np.asarray(gaps.all(axis=2, keepdims=True)) if as_whole else gaps


def with_word(
    data: NDArray[Any], values: Floats, missing: float, *, as_whole: bool
) -> NDArray[Any]:
    """Replace missing values by their marker, and move other values off it.

    Parameters
    ----------
    data
        (H, W, C) as stored.
    values
        The same before conversion, NaN where missing.
    missing, as_whole
        As in `gaps_of`.
    """
    gap, word = np.isnan(values), data.dtype.type(missing)
    taken = ~gap & (data == word)
    if as_whole:
        taken &= taken.all(axis=2, keepdims=True)
    if not gap.any() and not taken.any():
        return data
    return np.where(gap, word, np.where(taken, _neighbour(word), data))


def _neighbour(word: Any) -> Any:
    """Adjacent value of a marker."""
    if word.dtype.kind == "f":
        return np.nextafter(word, np.float32(0.0 if word else 1.0))
    return word - 1 if word == np.iinfo(word.dtype).max else word + 1


def _curve(color: Floats) -> Floats:
    return np.asarray(to_srgb(np.clip(color, 0.0, 1.0)), np.float32)
