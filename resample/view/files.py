"""Encode pictures as files in memory, and convert them to what a page shows."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray


def file_of(write: Callable[[Path], object], suffix: str) -> bytes:
    """Content of the file that a function writes to a path with a suffix."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{suffix}"
        write(path)
        return path.read_bytes()


def levels_in(png: bytes) -> NDArray[np.uint8]:
    """8-bit levels of a PNG as a page shows them."""
    import cv2

    stored: Any = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored.ndim == 3:
        stored = stored[..., [2, 1, 0, 3][: stored.shape[2]]]
    return shown(stored)


def shown(stored: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """8-bit levels (H, W, 3 or 4) as a page shows them.

    Parameters
    ----------
    stored
        (H, W) or (H, W, C): gray, gray and opacity, RGB, or RGB and opacity.
    """
    levels = stored if stored.dtype == np.uint8 else (stored >> 8).astype(np.uint8)
    if levels.ndim == 2:
        levels = levels[..., np.newaxis]
    if levels.shape[2] < 3:
        levels = levels[..., [0, 0, 0, 1][: 2 + levels.shape[2]]]
    return np.ascontiguousarray(levels, np.uint8)
