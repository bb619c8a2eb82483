"""Matrices and target sizes for resizing, scaling and rotating pictures."""

import math

import numpy as np

from resample_texture.geometry.mappings import Homography

QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # cosine and sine, exactly
ROUNDED = 1e-6  # px by which a side may exceed a whole number of px and still fit


def resizing(source_shape: tuple[int, int], shape: tuple[int, int]) -> Homography:
    """Return the map from a picture's whole area to that of a target (height, width)."""
    (source_height, source_width), (height, width) = source_shape, shape
    return Homography(np.diag([width / source_width, height / source_height, 1.0]))


def scaling(factor: tuple[float, float]) -> Homography:
    """Return the map that scales along x and y about the picture's corner."""
    return Homography(np.diag([*factor, 1.0]))


def scaled_shape(source_shape: tuple[int, int], factor: tuple[float, float]) -> tuple[int, int]:
    """Return a picture's height and width times factors along x and y, rounded."""
    if not all(0.0 < one < math.inf for one in factor):
        raise ValueError(
            f"a picture cannot be scaled by {' and '.join(f'{one:g}' for one in factor)};"
            " give a factor above 0, or two: along x and y"
        )
    across, down = factor
    height, width = source_shape[0] * down, source_shape[1] * across
    return max(1, math.floor(height + 0.5)), max(1, math.floor(width + 0.5))


def turning(source_shape: tuple[int, int], degrees: float, shape: tuple[int, int]) -> Homography:
    """Return the map that rotates a picture counterclockwise about the centers.

    Parameters
    ----------
    source_shape, shape
        Height and width of the picture and of the target, px.
    degrees
        Multiples of 90 are exact: texels are copied if both centers are centers of pixels, or
        corners of pixels.
    """
    cosine, sine = _cosine_and_sine(degrees)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    middle, target = (np.array([width, height]) / 2.0 for height, width in (source_shape, shape))
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = turn, target - turn @ middle
    return Homography(matrix)


def turned_shape(source_shape: tuple[int, int], degrees: float) -> tuple[int, int]:
    """Return height and width that hold a whole rotated picture."""
    cosine, sine = (abs(number) for number in _cosine_and_sine(degrees))
    height, width = source_shape
    sides = cosine * height + sine * width, cosine * width + sine * height
    return math.ceil(sides[0] - ROUNDED), math.ceil(sides[1] - ROUNDED)


def _cosine_and_sine(degrees: float) -> tuple[float, float]:
    if not math.isfinite(degrees):
        raise ValueError(f"a picture cannot be turned by {degrees} degrees; give a finite number")
    left = math.fmod(degrees, 360.0)
    if left % 90.0 == 0.0:
        return QUARTERS[int(left // 90.0) % 4]
    return math.cos(math.radians(left)), math.sin(math.radians(left))
