"""Conversions between linear light, sRGB, opacity and colormaps; arrays of any shape."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats

Background = Sequence[float] | Floats  # 3 values, linear light


def to_srgb(linear: NDArray[Any]) -> NDArray[Any]:
    """Convert linear light to sRGB (IEC 61966-2-1); negative values stay negative."""
    power = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, power).astype(linear.dtype)


def from_srgb(encoded: NDArray[Any]) -> NDArray[Any]:
    """Convert sRGB (IEC 61966-2-1) to linear light."""
    power = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, power).astype(encoded.dtype)


def as_levels(encoded: NDArray[Any], bits: int = 8) -> NDArray[Any]:
    """Convert values 0..1 to integers of 8 or 16 bits; others are clipped."""
    kind = np.uint8 if bits == 8 else np.uint16
    whole = np.floor(np.clip(encoded, 0.0, 1.0) * np.iinfo(kind).max + 0.5)
    return np.asarray(whole.astype(kind))


def straight(rgba: Floats) -> Floats:
    """Divide color by alpha, (H, W, 4); the result is black where alpha is 0."""
    alpha = rgba[..., 3:]
    color = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0.0)
    return np.concatenate([color, alpha], axis=2)


def over(rgba: Floats, background: Background) -> Floats:
    """Composite a picture over a uniform background of 3 values, (H, W, 3)."""
    behind = np.asarray(background, np.float32)
    if behind.shape != (3,):
        raise ValueError(f"a background has 3 values, not {behind.size}")
    transparency = 1.0 - np.clip(rgba[..., 3:], 0.0, 1.0)
    return rgba[..., :3] + transparency * behind


def mapped(name: str, share: Doubles) -> Floats:
    """Look up fractions (N,) from 0 to 1 in a matplotlib colormap; linear colors (N, 3).

    Raises ValueError: the colormap is unknown.
    """
    check_colormap(name)
    import matplotlib

    colors = np.asarray(matplotlib.colormaps[name](np.asarray(share, np.float64)))
    return from_srgb(colors[:, :3].astype(np.float32))


def check_colormap(name: str) -> None:
    """Reject a colormap that matplotlib does not know, and suggest similar ones."""
    import matplotlib

    if name not in matplotlib.colormaps:
        from difflib import get_close_matches

        like = get_close_matches(name, list(matplotlib.colormaps)) or ["viridis", "turbo", "tab10"]
        raise ValueError(f"unknown colormap {name!r}; matplotlib has, e.g., {', '.join(like)}")
