"""Texels that are copied as they are: a shift by whole pixels, or one texel for each pixel."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats, Indices
from resample_texture.types import Edge, Warped

FARTHEST = 2.0**52  # px or texels; beyond it float64 has no halves


class Picks(NamedTuple):
    """Texel that each pixel shows."""

    row: Indices  # (h, w), or (h, 1) if a row of pixels shows one row of texels
    column: Indices  # (h, w), or (1, w)
    coverage: Floats  # (h, w); 0 where no texel is shown

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Values (h, w) or (h, w, C) of a picture's texels, 0 where none is shown."""
        values = np.array(image[self.row, self.column])
        values[self.coverage == 0.0] = 0
        return values


def whole_shift(matrix: Doubles) -> tuple[int, int] | None:
    """Pixels along x and y by which a matrix (3, 3) shifts; None if it does anything else."""
    scaled = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    x, y = scaled[0, 2], scaled[1, 2]
    is_shift = np.array_equal(scaled, [[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    if not is_shift or x != np.rint(x) or y != np.rint(y) or max(abs(x), abs(y)) > FARTHEST:
        return None
    return int(x), int(y)


def picks_of_shift(
    shift: tuple[int, int], source_shape: tuple[int, int], shape: tuple[int, int], edge: Edge
) -> Picks:
    """Texels that pixels show after a shift by whole pixels."""
    row, row_is_in = texels_at(np.arange(shape[0]) - shift[1], source_shape[0], edge)
    column, column_is_in = texels_at(np.arange(shape[1]) - shift[0], source_shape[1], edge)
    is_in = row_is_in[:, None] & column_is_in
    return Picks(row[:, None], column[None], is_in.astype(np.float32))


def shifted(
    image: NDArray[Any], shift: tuple[int, int], shape: tuple[int, int], edge: Edge
) -> Warped:
    """Picture moved by whole pixels, value for value."""
    picks = picks_of_shift(shift, (image.shape[0], image.shape[1]), shape, edge)
    return Warped(picks.of(image), picks.coverage)


def nearest_texels(x: Doubles, y: Doubles, source_shape: tuple[int, int], edge: Edge) -> Picks:
    """Texels in which places lie, (h, w) each; none where they are not numbers."""
    is_place = (abs(x) < FARTHEST) & (abs(y) < FARTHEST)
    places = (np.floor(np.where(is_place, a, 0.0)).astype(np.int64) for a in (y, x))
    (row, row_is_in), (column, column_is_in) = (
        texels_at(index, size, edge) for index, size in zip(places, source_shape, strict=True)
    )
    return Picks(row, column, (row_is_in & column_is_in & is_place).astype(np.float32))


def texels_at(index: Indices, size: int, edge: Edge) -> tuple[Indices, NDArray[np.bool_]]:
    """Texels that stand at places counted by whole numbers, and whether there is one."""
    if edge is Edge.WRAP:
        return index % size, np.ones(index.shape, np.bool_)
    if edge is Edge.MIRROR:
        folded = index % (2 * size)
        return np.minimum(folded, 2 * size - 1 - folded), np.ones(index.shape, np.bool_)
    is_in = (index >= 0) & (index < size)
    return np.clip(index, 0, size - 1), is_in if edge is Edge.TRANSPARENT else np.ones_like(is_in)


def unfolded(image: NDArray[Any]) -> NDArray[Any]:
    """Picture and its mirror images about the outermost texels' centers: d c b | a b c d | c b a.

    It is one period of them all, so wrapping it around continues the picture by reflection that
    does not repeat the outermost texels (`cv2.BORDER_REFLECT_101`).
    """
    for axis in (0, 1):
        size = image.shape[axis]
        there_and_back = np.concatenate([np.arange(size), np.arange(size - 2, 0, -1)])
        image = image.take(there_and_back, axis)
    return image
