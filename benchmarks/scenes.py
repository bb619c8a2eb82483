"""Small synthetic inputs that need no file."""

from typing import Any

import numpy as np


def squares(side: int) -> Any:
    """Checkerboard (side, side) of 8 × 8 texels in float32."""
    place = np.arange(side) // 8
    return ((place[:, None] + place) % 2).astype(np.float32)


def floor_matrix(texels: int, pixels: int) -> Any:
    """Homography of a floor that fills the frame: all of its far edge, 1/8 of its near one."""
    source = np.array([(0, 0), (1, 0), (0.5625, 1), (0.4375, 1)]) * texels
    target = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * pixels
    rows: list[list[float]] = []
    for (u, v), (x, y) in zip(source, target, strict=True):
        rows += [[u, v, 1, 0, 0, 0, -u * x, -v * x], [0, 0, 0, u, v, 1, -u * y, -v * y]]
    matrix = np.linalg.solve(np.array(rows), target.ravel())
    return np.append(matrix, 1.0).reshape(3, 3)


def waves(side: int) -> tuple[Any, Any]:
    """A wavy disc in front of a slanted wall: color (side, side, 3) and depth (side, side)."""
    y, x = np.mgrid[0:side, 0:side] / side
    disc = (x - 0.5) ** 2 + (y - 0.5) ** 2 < 0.06
    depth = np.where(disc, 3 + 0.2 * np.sin(20 * x), 6 + x)
    color = np.stack([0.5 + 0.5 * np.sin(60 * x), 0.5 + 0.5 * np.sin(50 * y), x], axis=-1)
    return color.astype(np.float32), depth
