"""A depth image's sheet of cells, projected to the target's screen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import pixel_of
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats, Single

Indices = NDArray[np.int32]

SEGMENT = 64  # cells of a row that are bounded, culled and measured together
NEAREST = 1e-6  # of the matrix's scale: points nearer to the camera's plane are behind it
FARTHEST = 1e6  # px: points farther outside than this are on no screen
OFF_SCREEN = np.int32(2**30)  # px
BLOCK = 256  # torn cells that a thread projects at a time


class SheetScreen(NamedTuple):
    """A sheet, projected to the target's screen."""

    vertex: Floats  # (3, H + 1, W + 1) of `project_vertices`
    torn: Floats  # (N, 4, 3) of `project_corners`
    own: Indices  # (H, W) which cells have their own corners; see `bound_segments`
    bounds: Indices  # (H, segments, 4) of `bound_segments`


@kernel
def projected(
    matrix: Doubles, epipole: Doubles, x: float, y: float, nearness: float
) -> tuple[Single, Single, Single]:
    """Project a point by the warping equation: place, and nearness, −1 if nowhere.

    Branch-free, so that several places are computed at once.
    """
    scale = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] + nearness * epipole[2]
    inverse = 1.0 / scale
    # Divide by the depth.
    screen_x = (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] + nearness * epipole[0]
    ) * inverse
    screen_y = (
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] + nearness * epipole[1]
    ) * inverse
    # Reject points behind the camera, without depth, or far outside any screen.
    is_seen = (scale > NEAREST) & (nearness > 0)
    is_seen &= (abs(screen_x) < FARTHEST) & (abs(screen_y) < FARTHEST)
    return (
        np.float32(screen_x if is_seen else 0.0),
        np.float32(screen_y if is_seen else 0.0),
        np.float32(nearness * inverse if is_seen else -1.0),
    )


@parallel_kernel
def project_vertices(
    counter: Counter,
    vertex: Floats,
    place: Doubles,
    matrix: Doubles,
    epipole: Doubles,
    screen: Floats,
) -> None:
    """Project the lattice's corners by the warping equation.

    `vertex`: (H + 1, W + 1) nearness. `place`: (H + 1, W + 1, 2) where they are without distortion,
    px; (0, 0, 2): on the lattice. `matrix`, `epipole`: of the warping equation. `screen`: (3, H +
    1, W + 1) filled: x and y in px of the target, and the nearness there, negative where there is
    nothing.
    """
    for row in tasks(counter, vertex.shape[0]):
        is_bent = place.size > 0
        for column in range(vertex.shape[1]):
            x, y = float(column), float(row)
            # Undo lens distortion.
            if is_bent:
                x, y = place[row, column, 0], place[row, column, 1]
            screen[0, row, column], screen[1, row, column], screen[2, row, column] = projected(
                matrix, epipole, x, y, float(vertex[row, column])
            )


@parallel_kernel
def project_corners(
    counter: Counter, corner: Floats, matrix: Doubles, epipole: Doubles, screen: Floats
) -> None:
    """Project the corners (N, 4, 3) of torn cells.

    `screen` (N, 4, 3) is filled with x, y and nearness.
    """
    for block in tasks(counter, (corner.shape[0] + BLOCK - 1) // BLOCK):
        for n in range(block * BLOCK, min(corner.shape[0], (block + 1) * BLOCK)):
            for k in range(4):
                x, y, near = float(corner[n, k, 0]), float(corner[n, k, 1]), float(corner[n, k, 2])
                screen[n, k, 0], screen[n, k, 1], screen[n, k, 2] = projected(
                    matrix, epipole, x, y, near
                )


@parallel_kernel
def bound_segments(
    counter: Counter, screen: Floats, torn: Floats, index: Indices, bounds: Indices
) -> None:
    """Bound segments of rows of cells on the screen.

    `screen`, `torn`: of `project_vertices` and `project_corners`. `index`: (H, W) number of a torn
    cell; −1 for others, −2 where there is none. `bounds`: (H, segments, 4) filled: left, top, right
    and bottom, px, the last two one beyond; left > right for an empty segment.
    """
    for row in tasks(counter, index.shape[0]):
        for segment in range(bounds.shape[1]):
            start, end = segment * SEGMENT, min(index.shape[1], (segment + 1) * SEGMENT)
            left, top, right, bottom = OFF_SCREEN, OFF_SCREEN, -OFF_SCREEN, -OFF_SCREEN
            # Use integers: their minima vectorize sixteen at once, which those of floats do not.
            for r in range(row, row + 2):
                for column in range(start, end + 1):
                    # Leave out corners that are nowhere on the screen.
                    is_there = screen[2, r, column] > 0
                    x, y = pixel_of(screen[0, r, column]), pixel_of(screen[1, r, column])
                    left, top = (
                        min(left, x if is_there else OFF_SCREEN),
                        min(top, y if is_there else OFF_SCREEN),
                    )
                    right = max(right, x if is_there else -OFF_SCREEN)
                    bottom = max(bottom, y if is_there else -OFF_SCREEN)
            # Add torn cells, which are numbered along the row.
            first, last = OFF_SCREEN, -OFF_SCREEN
            for column in range(start, end):
                n = index[row, column]
                first, last = min(first, n if n >= 0 else OFF_SCREEN), max(last, n)
            # Extend the bounds to their corners.
            for n in range(first, last + 1):
                for k in range(4):
                    if torn[n, k, 2] > 0:
                        x, y = pixel_of(torn[n, k, 0]), pixel_of(torn[n, k, 1])
                        left, top = min(left, x), min(top, y)
                        right, bottom = max(right, x), max(bottom, y)
            bounds[row, segment, 0], bounds[row, segment, 1] = left, top
            bounds[row, segment, 2], bounds[row, segment, 3] = right + 1, bottom + 1


def segment_count(width: int) -> int:
    """Number of segments in a row."""
    return -(-width // SEGMENT)
