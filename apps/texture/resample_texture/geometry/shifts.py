"""Texels that are copied as they are: moved by whole pixels, or one texel for each pixel."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats, Indices
from resample_texture.geometry.edges import Edge

FARTHEST = 2.0**52  # px or texels; beyond it float64 has no halves


class Picks(NamedTuple):
    """Texel that each pixel shows."""

    row: Indices  # (h, w), or (h, 1) or (1, w) if rows or columns of pixels show one row of texels
    column: Indices  # (h, w), (1, w) or (h, 1)
    coverage: Floats  # (h, w); 0 where no texel is shown

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Values (h, w) or (h, w, C) of a picture's texels, 0 where none is shown."""
        values = np.array(image[self.row, self.column])
        values[self.coverage == 0.0] = 0
        return values


class Move(NamedTuple):
    """A shift by whole pixels after a turn by quarters, a flip, or neither."""

    shift: tuple[int, int]  # along x and y, px
    sign: tuple[int, int]  # −1 where the target's x and y lead against the source's axes
    is_turned: bool = False  # the target's x is the source's y, and the other way round


def whole_move(matrix: Doubles) -> Move | None:
    """Move that a matrix (3, 3) does; None if it does anything else."""
    scaled = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    turn, shift = scaled[:2, :2], scaled[:2, 2]
    is_turned = bool(turn[0, 0] == 0.0)
    sign = (turn[0, 1], turn[1, 0]) if is_turned else (turn[0, 0], turn[1, 1])
    straight = np.array([[0.0, sign[0]], [sign[1], 0.0]]) if is_turned else np.diag(sign)
    is_whole = np.array_equal(shift, np.rint(shift)) and float(abs(shift).max()) <= FARTHEST
    is_move = np.array_equal(turn, straight) and np.array_equal(np.abs(sign), [1.0, 1.0])
    if not (is_whole and is_move and np.array_equal(scaled[2], [0.0, 0.0, 1.0])):
        return None
    return Move((int(shift[0]), int(shift[1])), (int(sign[0]), int(sign[1])), is_turned)


def picks_of_move(
    move: Move, source_shape: tuple[int, int], shape: tuple[int, int], edge: Edge
) -> Picks:
    """Texels that pixels show after a move."""
    (x, y), (across, down) = move.shift, move.sign
    column, row = _counted(shape[1], x, across)[None], _counted(shape[0], y, down)[:, None]
    if move.is_turned:
        column, row = row, column
    row, row_is_in = texels_at(row, source_shape[0], edge)
    column, column_is_in = texels_at(column, source_shape[1], edge)
    return Picks(row, column, (row_is_in & column_is_in).astype(np.float32))


def _counted(size: int, shift: int, sign: int) -> Indices:
    """Texels along an axis of so many pixels."""
    place = np.arange(size) - shift
    return place if sign > 0 else -1 - place


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
