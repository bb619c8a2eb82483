"""Pictures as files hold them, in memory: what commands write, and what a page shows of it."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray


def file_of(write: Callable[[Path], object], suffix: str) -> bytes:
    """Content of the file that is written to a path of a suffix."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"picture{suffix}"
        write(path)
        return path.read_bytes()


def levels_in(png: bytes) -> NDArray[np.uint8]:
    """Levels that a page shows of a PNG."""
    import cv2

    stored: Any = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored.ndim == 3:
        stored = stored[..., [2, 1, 0, 3][: stored.shape[2]]]
    return shown(stored)


def shown(stored: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Levels (H, W, 3 or 4) that a page shows of a picture's.

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
