"""Shifts by whole pixels: the one warp that needs no arithmetic."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_texture.types import Edge, Warped


def whole_shift(matrix: Doubles) -> tuple[int, int] | None:
    """Pixels along x and y by which a matrix (3, 3) shifts; None if it does anything else."""
    scaled = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    x, y = scaled[0, 2], scaled[1, 2]
    is_shift = np.array_equal(scaled, [[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    if not is_shift or x != np.rint(x) or y != np.rint(y) or max(abs(x), abs(y)) > 2**52:
        return None
    return int(x), int(y)


def shifted(
    image: NDArray[Any], shift: tuple[int, int], shape: tuple[int, int], edge: Edge
) -> Warped:
    """Picture moved by whole pixels, value for value."""
    rows, row_is_in = _indices(shape[0], shift[1], image.shape[0], edge)
    columns, column_is_in = _indices(shape[1], shift[0], image.shape[1], edge)
    moved = image[rows[:, None], columns]
    is_in = row_is_in[:, None] & column_is_in
    moved[~is_in] = 0
    return Warped(moved, is_in.astype(np.float32))


def _indices(
    count: int, shift: int, size: int, edge: Edge
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Texel that each of `count` pixels shows, and whether there is one."""
    index = np.arange(count) - shift
    if edge is Edge.WRAP:
        return index % size, np.ones(count, np.bool_)
    if edge is Edge.MIRROR:
        folded = index % (2 * size)
        return np.minimum(folded, 2 * size - 1 - folded), np.ones(count, np.bool_)
    is_in = (index >= 0) & (index < size)
    return np.clip(index, 0, size - 1), is_in if edge is Edge.TRANSPARENT else np.ones_like(is_in)
