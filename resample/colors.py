"""Light and its encodings, arrays of any shape."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats

Background = Sequence[float] | Floats  # 3 values, linear light


def to_srgb(linear: NDArray[Any]) -> NDArray[Any]:
    """Linear light to sRGB values (IEC 61966-2-1), any shape; negative light stays negative."""
    power = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, power).astype(linear.dtype)


def from_srgb(encoded: NDArray[Any]) -> NDArray[Any]:
    """Linear light of sRGB values (IEC 61966-2-1), any shape."""
    power = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, power).astype(encoded.dtype)


def straight(rgba: Floats) -> Floats:
    """Color not multiplied by alpha, (H, W, 4); black where alpha is 0."""
    alpha = rgba[..., 3:]
    color = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0.0)
    return np.concatenate([color, alpha], axis=2)


def over(rgba: Floats, background: Background) -> Floats:
    """Picture in front of an even color of 3 values, (H, W, 3)."""
    behind = np.asarray(background, np.float32)
    if behind.shape != (3,):
        raise ValueError(f"a background has 3 values, not {behind.size}")
    transparency = 1.0 - np.clip(rgba[..., 3:], 0.0, 1.0)
    return rgba[..., :3] + transparency * behind
