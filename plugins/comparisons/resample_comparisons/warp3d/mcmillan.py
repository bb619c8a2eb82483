"""McMillan's image warp: samples to nearest pixels, visibility by order or z-buffer."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from resample.types import Doubles
from resample_warp3d.types import Equation, Rendered, Source

if TYPE_CHECKING:
    from resample_comparisons.warp3d.kernels.mcmillan import Walks


@dataclass(frozen=True)
class McMillan:
    """Nearest pixels in the occlusion-compatible order; later samples replace earlier ones.

    The target's camera center, projected to the source, divides it into up to four sheets of rows
    and columns. They are walked toward that point if it is in front of the source, and away from it
    if it is behind; then samples nearer to the camera come later on each line of sight (McMillan
    1997). Two samples that share a pixel may lie on two lines of sight, and then come in either
    order. In a source with distortion the sheets meet at that point, but their borders are curved,
    which is ignored.
    """

    is_per_pixel: ClassVar[bool] = True  # takes no filter: sub-pixels would stay empty

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        walks = walks_of(equation, source.nearness.shape, source.place)
        return _nearest_pixels(source, equation, shape, walks, (0, 0))


@dataclass(frozen=True)
class McMillanZBuffer:
    """Nearest pixels with a z-buffer; of equally near samples the first in the source wins."""

    is_per_pixel: ClassVar[bool] = True  # takes no filter: sub-pixels would stay empty

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        height, width = source.nearness.shape
        walks = np.array([_walks(height, height, 1.0), _walks(width, width, 1.0)], np.int64)
        return _nearest_pixels(source, equation, shape, walks, shape)


def blank(source: Source, shape: tuple[int, int]) -> Rendered:
    """Allocate a picture for a kernel to fill."""
    channels = source.color.shape[2]
    return Rendered(
        np.empty((*shape, channels), np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.bool_),
    )


def walks_of(equation: Equation, shape: tuple[int, ...], place: Doubles) -> "Walks":
    """Return a source's rows and columns in the occlusion-compatible order.

    Result: (2, 2, 3) two walks of rows, then two of columns, one of which may be empty: from, up
    to, step. Every walk of rows is combined with every walk of columns, which makes four sheets.
    """
    eye = eye_in_source(equation)
    height, width = shape
    row = _samples_before_eye(eye[1], eye[2], _line(place, 1, width // 2, height))
    column = _samples_before_eye(eye[0], eye[2], _line(place, 0, min(row, height - 1), width))
    return np.array([_walks(row, height, eye[2]), _walks(column, width, eye[2])], np.int64)


def eye_in_source(equation: Equation) -> Doubles:
    """Project the target's camera center to the source, homogeneous; third < 0: behind."""
    return -np.linalg.solve(equation.matrix, equation.epipole).astype(np.float64)


def _line(place: Doubles, axis: int, across: int, count: int) -> Doubles:
    """Return the coordinates of samples along one row (`axis` 0) or column (1), px."""
    if place.size == 0:
        return (np.arange(count) + 0.5).astype(np.float64)
    return place[across, :, 0] if axis == 0 else place[:, across, 1]


def _samples_before_eye(eye: float, scale: float, line: Doubles) -> int:
    """Return how many samples of a line come before the camera center."""
    if scale == 0.0:  # the camera center is infinitely far to one side
        return len(line) if eye > 0.0 else 0
    return int(np.count_nonzero(line < eye / scale))


def _walks(turn: int, count: int, scale: float) -> list[list[int]]:
    """Return the walks along an axis: toward the turn, or away from it if behind."""
    if scale >= 0.0:
        return [[0, turn, 1], [count - 1, turn - 1, -1]]
    return [[turn, count, 1], [turn - 1, -1, -1]]


def _nearest_pixels(
    source: Source,
    equation: Equation,
    shape: tuple[int, int],
    walks: "Walks",
    depth_shape: tuple[int, int],
) -> Rendered:
    """Paint nearest samples; with an empty depth buffer the order decides visibility."""
    from resample_comparisons.warp3d.kernels.mcmillan import copy_rows, place_samples

    owner, rendered = np.full(shape, -1, np.int32), blank(source, shape)
    place_samples(source, equation, walks, owner, np.zeros(depth_shape, np.float32))
    copy_rows(source, equation, owner, rendered)
    return rendered
