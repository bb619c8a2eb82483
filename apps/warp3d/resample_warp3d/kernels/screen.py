"""A depth image's sheet of cells on the target's screen."""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from resample.kernels.jit import kernel, parallel_kernel
from resample.types import Doubles, Floats, Single

Indices = NDArray[np.int32]
Corner = tuple[Single, Single, Single]

SEGMENT = 64  # cells of a row that are bounded, and skipped, together
NEAREST = 1e-6  # of the matrix's scale: what is nearer to the eye's plane is behind it
FARTHEST = 1e6  # px: what is farther out than this is not on any screen


@kernel
def _seen(
    matrix: Doubles, epipole: Doubles, x: float, y: float, nearness: float
) -> tuple[float, float, float]:
    """Place on the screen and nearness there; a negative nearness is nowhere."""
    scale = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] + nearness * epipole[2]
    if not (scale > NEAREST and nearness > 0):
        return 0.0, 0.0, -1.0
    inverse = 1.0 / scale
    screen_x = (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] + nearness * epipole[0]
    ) * inverse
    screen_y = (
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] + nearness * epipole[1]
    ) * inverse
    if not (abs(screen_x) < FARTHEST and abs(screen_y) < FARTHEST):
        return 0.0, 0.0, -1.0
    return screen_x, screen_y, nearness * inverse


@kernel
def _project_row(
    vertex: Floats, place: Doubles, matrix: Doubles, epipole: Doubles, row: int, screen: Floats
) -> None:
    is_bent = place.size > 0
    for column in range(vertex.shape[1]):
        x, y = float(column), float(row)
        if is_bent:
            x, y = place[row, column, 0], place[row, column, 1]
        sx, sy, near = _seen(matrix, epipole, x, y, float(vertex[row, column]))
        screen[row, column, 0] = np.float32(sx)
        screen[row, column, 1] = np.float32(sy)
        screen[row, column, 2] = np.float32(near)


@parallel_kernel
def project_vertices(
    vertex: Floats, place: Doubles, matrix: Doubles, epipole: Doubles, screen: Floats
) -> None:
    """Project the lattice's corners by the warping equation.

    Parameters
    ----------
    vertex
        (H + 1, W + 1) nearness.
    place
        (H + 1, W + 1, 2) where they are without distortion, px; (0, 0, 2): on the lattice.
    matrix, epipole
        Of the equation.
    screen
        (H + 1, W + 1, 3) filled: x and y in px of the target, and the nearness there, negative
        where there is nothing.
    """
    for row in prange(vertex.shape[0]):
        _project_row(vertex, place, matrix, epipole, row, screen)


@kernel
def _project_corner(
    corner: Floats, matrix: Doubles, epipole: Doubles, n: int, screen: Floats
) -> None:
    for k in range(4):
        sx, sy, near = _seen(
            matrix, epipole, float(corner[n, k, 0]), float(corner[n, k, 1]), float(corner[n, k, 2])
        )
        screen[n, k, 0], screen[n, k, 1] = np.float32(sx), np.float32(sy)
        screen[n, k, 2] = np.float32(near)


@parallel_kernel
def project_corners(corner: Floats, matrix: Doubles, epipole: Doubles, screen: Floats) -> None:
    """Project the corners (N, 4, 3) of torn cells; `screen` as in `project_vertices`."""
    for n in prange(corner.shape[0]):
        _project_corner(corner, matrix, epipole, n, screen)


@kernel
def _bound_row(screen: Floats, torn: Floats, index: Indices, row: int, bounds: Floats) -> None:
    width = index.shape[1]
    for segment in range(bounds.shape[1]):
        left, top = np.float32(np.inf), np.float32(np.inf)
        right, bottom = np.float32(-np.inf), np.float32(-np.inf)
        end = min(width, (segment + 1) * SEGMENT)
        for r in range(row, row + 2):
            for column in range(segment * SEGMENT, end + 1):
                if screen[r, column, 2] > 0:
                    x, y = screen[r, column, 0], screen[r, column, 1]
                    left, right = min(left, x), max(right, x)
                    top, bottom = min(top, y), max(bottom, y)
        for column in range(segment * SEGMENT, end):
            n = index[row, column]
            if n >= 0:
                for k in range(4):
                    if torn[n, k, 2] > 0:
                        x, y = torn[n, k, 0], torn[n, k, 1]
                        left, right = min(left, x), max(right, x)
                        top, bottom = min(top, y), max(bottom, y)
        bounds[row, segment, 0], bounds[row, segment, 1] = left, top
        bounds[row, segment, 2], bounds[row, segment, 3] = right, bottom


@parallel_kernel
def bound_segments(screen: Floats, torn: Floats, index: Indices, bounds: Floats) -> None:
    """Bound what segments of rows of cells meet on the screen.

    Parameters
    ----------
    screen, torn
        Of `project_vertices` and `project_corners`.
    index
        (H, W) which cells are torn; −1 for others, −2 where there is none.
    bounds
        (H, segments, 4) filled: left, top, right, bottom in px; left > right where nothing is.
    """
    for row in prange(index.shape[0]):
        _bound_row(screen, torn, index, int(np.int64(row)), bounds)


@kernel
def segment_count(width: int) -> int:
    """Segments of a row."""
    return math.ceil(width / SEGMENT)
