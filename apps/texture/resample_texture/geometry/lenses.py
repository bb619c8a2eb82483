"""Lens distortion by OpenCV's coefficients: maps that take it out of a photo, or put it in.

A `Lens` holds what `cv2.calibrateCamera` returns, so its matrix counts from pixel centers; the maps
are in continuous pixel coordinates like all others.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles
from resample_texture.geometry.distortion import COUNTS, Points, bend, distortion, unbend
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, pixel_centers

BLOCK = 1 << 15  # points at a time; their arrays stay in the cache
TOLERANCE = 1e-7  # px, of a point put through the lens again


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera's lens.

    Parameters
    ----------
    matrix
        (3, 3) camera matrix without skew, or the numbers fx, fy, cx, cy; px, with the first pixel's
        center at (0, 0).
    coefficients
        k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3, s4 [, τx, τy]]]].

    Raises
    ------
    ValueError
        The matrix is not a camera's, the count is another, or a number is not finite.
    """

    matrix: Doubles
    coefficients: Doubles

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", camera_matrix(self.matrix))
        given = np.array(self.coefficients, np.float64).ravel()
        if given.size not in COUNTS or not np.isfinite(given).all():
            counts = ", ".join(str(count) for count in COUNTS)
            raise ValueError(f"a lens has {counts} finite coefficients, not {given.tolist()}")
        object.__setattr__(self, "coefficients", given)

    def undistorting(
        self, shape: tuple[int, int], *, ideal: ArrayLike | None = None
    ) -> BackwardMap:
        """Map of a pinhole's picture, seen in the photo that the lens made.

        Parameters
        ----------
        shape
            Height and width of the pinhole's picture, the target, px.
        ideal
            The pinhole's matrix, as `matrix`; by default the same.

        Returns
        -------
        Map without numbers where the distortion's polynomial folds back: there
        `cv2.initUndistortRectifyMap` shows parts of the photo twice.
        """
        pinhole = self.matrix if ideal is None else camera_matrix(ideal)
        lens = partial(bend, distortion(self.coefficients))
        return BackwardMap(*_map(lens, shape, pinhole, self.matrix))

    def distorting(self, shape: tuple[int, int], *, ideal: ArrayLike | None = None) -> BackwardMap:
        """Map of the photo that the lens would make, seen in a pinhole's picture.

        Parameters
        ----------
        shape
            Height and width of the photo, the target, px.
        ideal
            The pinhole's matrix, as `matrix`; by default the same.

        Returns
        -------
        Map without numbers where no light comes through the lens.
        """
        return BackwardMap(*self._undistorted(shape, ideal))

    def undistorting_forward(
        self, source_shape: tuple[int, int], *, ideal: ArrayLike | None = None
    ) -> ForwardMap:
        """Map that moves the photo's texels to their places in a pinhole's picture.

        Parameters
        ----------
        source_shape
            Height and width of the photo, the source, px.
        ideal
            The pinhole's matrix, as `matrix`; by default the same.
        """
        return ForwardMap(*self._undistorted(source_shape, ideal))

    def _undistorted(self, shape: tuple[int, int], ideal: ArrayLike | None) -> Points:
        pinhole = self.matrix if ideal is None else camera_matrix(ideal)
        tolerance = TOLERANCE / max(self.matrix[0, 0], self.matrix[1, 1])
        lens = partial(unbend, distortion(self.coefficients), tolerance=tolerance)
        return _map(lens, shape, self.matrix, pinhole)


def camera_matrix(given: ArrayLike) -> Doubles:
    """Camera matrix (3, 3) of itself or of fx, fy, cx, cy, checked."""
    matrix = np.array(given, np.float64)
    if matrix.shape == (4,):
        fx, fy, cx, cy = matrix
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if matrix.shape != (3, 3):
        raise ValueError(f"a camera matrix is (3, 3), or fx, fy, cx, cy, not {matrix.shape}")
    zero = (matrix[0, 1], matrix[1, 0], matrix[2, 0], matrix[2, 1])
    is_camera = np.isfinite(matrix).all() and matrix[2, 2] == 1 and not any(zero)
    if not is_camera or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise ValueError(
            "a camera matrix is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with focal lengths above 0,"
            f" not {matrix.tolist()}"
        )
    return matrix


def _map(
    move: Callable[[Doubles, Doubles], Points],
    shape: tuple[int, int],
    before: Doubles,
    after: Doubles,
) -> Points:
    """Where a frame's pixels, taken by one camera, go in another's, px."""
    column, row = pixel_centers(shape)
    found_x, found_y = np.empty(shape), np.empty(shape)
    count = max(1, BLOCK // column.size)
    for first in range(0, row.size, count):
        rows = slice(first, first + count)
        x, y = np.broadcast_arrays(
            (column - 0.5 - before[0, 2]) / before[0, 0],
            (row[rows] - 0.5 - before[1, 2]) / before[1, 1],
        )
        x, y = move(x, y)
        found_x[rows] = after[0, 0] * x + after[0, 2] + 0.5
        found_y[rows] = after[1, 1] * y + after[1, 2] + 0.5
    return found_x, found_y
