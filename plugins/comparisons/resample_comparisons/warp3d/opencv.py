"""Warp depth images with OpenCV's `cv2.warpFrame`."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from resample.types import Doubles
from resample_comparisons.warp3d.mcmillan import blank
from resample_warp3d.types import Equation, Rendered, Source

HALF_PIXEL = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # from OpenCV's pixel centers


@dataclass(frozen=True)
class OpenCv:
    """OpenCV 5's `cv2.warpFrame`: nearest pixels, a z-buffer, one thread.

    It counts pixel centers from (0, 0) and rounds down, so the picture is shifted to the left and
    up by up to one pixel, on average half a pixel; that is not corrected. It takes one 3 × 3 matrix
    for both views, without skew and with fy > 0, which would exclude many cameras; but it applies
    any 3 × 4 matrix as the rigid motion, so the whole warping equation is passed there. Its
    pictures have 8 bits, so the samples' indices are passed in its four 8-bit channels, and colors
    are looked up, with any number of channels and without loss.

    Raises
    ------
    LookupError
        This OpenCV has no `cv2.warpFrame` (before 5.0).
    ValueError
        The source has distortion.
    """

    is_per_pixel: ClassVar[bool] = True  # takes no filter: sub-pixels would stay empty

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        from resample_comparisons.warp3d.kernels.mcmillan import copy_rows

        if source.place.size:
            raise ValueError(
                "opencv takes sources without distortion; undistort it, or use mcmillan-zbuffer"
            )
        height, width = source.nearness.shape
        size = max(height, shape[0]), max(width, shape[1])  # its output has the size of its input
        depth = np.zeros(size)
        is_known = np.zeros(size, np.uint8)
        is_known[:height, :width] = source.nearness > 0
        np.divide(1.0, source.nearness, out=depth[:height, :width], where=source.nearness > 0)
        number = np.zeros(size, np.int32)
        number[:height, :width] = np.arange(height * width, dtype=np.int32).reshape(height, width)
        shown, mask = _warp_frame(depth, number, is_known, equation)
        owner = np.where(mask, shown, -1).astype(np.int32)[: shape[0], : shape[1]]
        rendered = blank(source, shape)
        copy_rows(source, equation, np.ascontiguousarray(owner), rendered)
        return rendered


def _warp_frame(depth: Doubles, number: Any, is_known: Any, equation: Equation) -> tuple[Any, Any]:
    """Return the indices of the visible samples, and where there are any."""
    import cv2

    if not hasattr(cv2, "warpFrame"):
        raise LookupError(
            f"OpenCV {cv2.__version__} has no cv2.warpFrame; install opencv-python-headless 5 or "
            "newer, or use mcmillan-zbuffer, which does the same"
        )
    camera = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1.0]])  # any valid one; this one is exact
    back = np.array([[1, 0, -1], [0, 1, -1], [0, 0, 1.0]])
    matrix = np.linalg.inv(HALF_PIXEL) @ equation.matrix @ HALF_PIXEL
    epipole = np.linalg.inv(HALF_PIXEL) @ equation.epipole
    motion = back @ np.column_stack([matrix @ camera, epipole])
    bytes_of_number = number.view(np.uint8).reshape(*number.shape, 4)
    shown, mask = cv2.warpFrame(depth, bytes_of_number, is_known, motion, camera)[1:]
    return np.ascontiguousarray(shown).view(np.int32)[..., 0], mask > 0
