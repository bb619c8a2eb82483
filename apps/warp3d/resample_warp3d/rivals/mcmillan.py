"""McMillan's image warp: every sample to its nearest pixel, seen by order or by a z-buffer."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from resample.types import Doubles
from resample_warp3d.types import Equation, Rendered, Source

if TYPE_CHECKING:
    from resample_warp3d.rivals.kernels.mcmillan import Walks


@dataclass(frozen=True)
class McMillan:
    """Nearest pixels in the occlusion-compatible order; later samples replace earlier ones.

    The target's eye, seen by the source, cuts it into up to four sheets of rows and columns. They
    are walked toward the eye where it is in front of the source and away from it where it is
    behind; then what is nearer to the eye comes later, on each line of sight (McMillan 1997). Two
    samples that share a pixel may lie on two lines of sight, and then come in either order. In a
    source with distortion the sheets meet at the eye, but their borders are bent, which is ignored.
    """

    is_per_pixel: ClassVar[bool] = True  # takes no filter: parts of pixels would stay empty

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        walks = walks_of(equation, source.nearness.shape, source.place)
        return _nearest_pixels(source, equation, shape, walks, (0, 0))


@dataclass(frozen=True)
class McMillanZBuffer:
    """Nearest pixels with a z-buffer; of equally near samples the first in the source stays."""

    is_per_pixel: ClassVar[bool] = True  # takes no filter: parts of pixels would stay empty

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        height, width = source.nearness.shape
        walks = np.array([_walks(height, height, 1.0), _walks(width, width, 1.0)], np.int64)
        return _nearest_pixels(source, equation, shape, walks, shape)


def blank(source: Source, shape: tuple[int, int]) -> Rendered:
    """A picture of a source's channels that a kernel will fill."""
    channels = source.color.shape[2]
    return Rendered(
        np.empty((*shape, channels), np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.bool_),
    )


def walks_of(equation: Equation, shape: tuple[int, ...], place: Doubles) -> "Walks":
    """Rows and columns of a source of (height, width) px in the occlusion-compatible order.

    Returns
    -------
    (2, 2, 3) of rows, then of columns, two walks each, one of them may be empty: from, up to, step.
    Every row of the first walk is combined with every walk along columns, which makes four sheets.
    """
    eye = eye_in_source(equation)
    height, width = shape
    row = _turn(eye[1], eye[2], _line(place, 1, width // 2, height))
    column = _turn(eye[0], eye[2], _line(place, 0, min(row, height - 1), width))
    return np.array([_walks(row, height, eye[2]), _walks(column, width, eye[2])], np.int64)


def eye_in_source(equation: Equation) -> Doubles:
    """Where the source sees the target's eye, homogeneous; the third is below 0 behind it."""
    return -np.linalg.solve(equation.matrix, equation.epipole).astype(np.float64)


def _line(place: Doubles, axis: int, across: int, count: int) -> Doubles:
    """Coordinate of the samples along one row (`axis` 0) or column (1), px."""
    if place.size == 0:
        return (np.arange(count) + 0.5).astype(np.float64)
    return place[across, :, 0] if axis == 0 else place[:, across, 1]


def _turn(eye: float, scale: float, line: Doubles) -> int:
    """How many samples of a line are walked before the eye is passed."""
    if scale == 0.0:  # the eye is infinitely far to one side
        return len(line) if eye > 0.0 else 0
    return int(np.count_nonzero(line < eye / scale))


def _walks(turn: int, count: int, scale: float) -> list[list[int]]:
    """Forward and backward walk along an axis, toward the turn or, behind the eye, away from it."""
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
    """Picture of nearest samples; a depth buffer of size 0 leaves visibility to the order."""
    from resample_warp3d.rivals.kernels.mcmillan import copy_rows, place_samples

    owner, rendered = np.full(shape, -1, np.int32), blank(source, shape)
    place_samples(source, equation, walks, owner, np.zeros(depth_shape, np.float32))
    copy_rows(source, equation, owner, rendered)
    return rendered
