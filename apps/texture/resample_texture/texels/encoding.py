"""Pictures as users have them, and texels as methods take them.

Texels are float32, linear light, multiplied by alpha and by whether there is a value at all: so
what is transparent or missing has no say in its neighbours' color.
"""

from enum import StrEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, to_srgb
from resample.types import Floats
from resample_texture.types import Warped

DTYPES = ("uint8", "uint16", "float16", "float32", "float64")
STEPS = 65535  # of linear light, in the table that encodes 8 bits


class Alpha(StrEnum):
    """What the fourth channel is."""

    STRAIGHT = "straight"  # opacity, and the color is not multiplied by it
    PREMULTIPLIED = "premultiplied"
    NONE = "none"  # no opacity


class Encoding(NamedTuple):
    """What to undo when texels become a picture again."""

    dtype: np.dtype[Any]
    is_flat: bool  # (H, W)
    is_encoded: bool  # by the sRGB curve
    is_straight: bool  # the fourth channel is opacity that does not multiply the color
    has_gaps: bool  # the last channel of texels tells whether there is a value


def decoded(
    image: NDArray[Any], *, linear_light: bool = True, alpha: str | None = None
) -> tuple[Floats, Encoding]:
    """Texels (H, W, C) of a picture (H, W) or (H, W, C).

    Parameters
    ----------
    image
        Of a type in `DTYPES`. Values that are not finite in float32 are missing.
    linear_light
        Take the color of integer types for sRGB-encoded; False takes all values as they are.
    alpha
        What a fourth channel is, an `Alpha`; straight for integer types, else premultiplied.

    Raises
    ------
    ValueError
        The picture has another shape or type, no pixel or a mask; or there is no such alpha.
    """
    if isinstance(image, np.ma.MaskedArray):
        raise ValueError("a picture with a mask; give floats that are not numbers where it is set")
    image = np.asarray(image)
    if image.dtype.name not in DTYPES:
        raise ValueError(f"a picture's type is one of {', '.join(DTYPES)}, not {image.dtype}")
    if image.ndim not in (2, 3) or 0 in image.shape:
        raise ValueError(
            f"a picture is (height, width) or (height, width, channels), not {image.shape}"
        )
    is_integer = image.dtype.kind == "u"
    kind = _alpha(alpha or (Alpha.STRAIGHT if is_integer else Alpha.PREMULTIPLIED))
    planes = image.reshape(*image.shape[:2], -1)
    is_straight = planes.shape[2] == 4 and kind is Alpha.STRAIGHT
    is_encoded = is_integer and linear_light
    has_alpha = planes.shape[2] == 4 and kind is not Alpha.NONE
    texels = light(planes, is_encoded=is_encoded, has_alpha=has_alpha)
    if is_straight:
        with np.errstate(invalid="ignore"):
            color = texels[..., :3] * texels[..., 3:]
        texels = np.concatenate([color, texels[..., 3:]], axis=2)
    gaps = not is_integer and _has_gaps(texels)
    if gaps:
        there = np.isfinite(texels).all(axis=2, keepdims=True)
        texels = np.concatenate([np.where(there, texels, 0.0), there], axis=2, dtype=np.float32)
    return texels, Encoding(image.dtype, image.ndim == 2, is_encoded, is_straight, gaps)


def encoded(warped: Warped, encoding: Encoding) -> Warped:
    """Picture of the type and shape that `decoded` was given."""
    image, coverage = without_gaps(warped, encoding)
    with np.errstate(over="ignore"):
        if encoding.is_straight:
            image = image.copy()
            alpha = image[..., 3:]
            np.divide(image[..., :3], alpha, out=image[..., :3], where=alpha > 0.0)
        if encoding.dtype.kind == "u":
            image = _levels(image, encoding)
        else:
            image = image.astype(encoding.dtype, copy=False)
    return Warped(image[..., 0] if encoding.is_flat else image, coverage)


def without_gaps(warped: Warped, encoding: Encoding) -> Warped:
    """Picture whose coverage, and no longer a channel, tells where there are values."""
    if not encoding.has_gaps:
        return warped
    coverage = np.clip(warped.image[..., -1], 0.0, warped.coverage)
    return Warped(warped.image[..., :-1], coverage)


def light(planes: NDArray[Any], *, is_encoded: bool, has_alpha: bool = False) -> Floats:
    """Values of planes (H, W, C) as float32: floats as they are, integers 0..1.

    Parameters
    ----------
    is_encoded
        Integers follow the sRGB curve.
    has_alpha
        The fourth channel does not.
    """
    if planes.dtype.kind == "f":
        with np.errstate(over="ignore"):
            return np.ascontiguousarray(planes, np.float32)
    largest = np.iinfo(planes.dtype).max
    plain = (np.arange(largest + 1) / largest).astype(np.float32)
    if not is_encoded:
        return np.asarray(plain[planes], np.float32)
    values = from_srgb(plain)[planes]
    if has_alpha:
        values[..., 3] = plain[planes[..., 3]]
    return np.asarray(values, np.float32)


def _alpha(name: str) -> Alpha:
    if name not in list(Alpha):
        raise ValueError(f"alpha {name!r}; known: {', '.join(Alpha)}")
    return Alpha(name)


def _has_gaps(texels: Floats) -> bool:
    """Whether a value is not finite; the sum tells at once, unless it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        return not (np.isfinite(texels.sum()) or np.isfinite(texels).all())


def _levels(image: Floats, encoding: Encoding) -> NDArray[Any]:
    """Integers of values 0..1, rounded."""
    largest = np.iinfo(encoding.dtype).max
    image = np.clip(image, 0.0, 1.0)
    if not encoding.is_encoded:
        return np.rint(image * largest).astype(encoding.dtype)
    count = 3 if encoding.is_straight else image.shape[2]
    levels = np.empty(image.shape, encoding.dtype)
    levels[..., count:] = np.rint(image[..., count:] * largest)
    if largest == 255:
        levels[..., :count] = _eight_bits()[(image[..., :count] * STEPS + 0.5).astype(np.uint16)]
    else:
        levels[..., :count] = np.rint(to_srgb(image[..., :count]) * largest)
    return levels


@cache
def _eight_bits() -> NDArray[np.uint8]:
    """sRGB-encoded levels of equal steps of light."""
    return np.asarray(np.rint(to_srgb(np.arange(STEPS + 1) / STEPS) * 255), np.uint8)
