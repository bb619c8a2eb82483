"""Homographies: read from numbers and files, in any convention; of resizing and rotation."""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Convention
from resample.types import Doubles
from resample_texture.geometry.mappings import Homography
from resample_texture.geometry.maps import read_arrays

SEPARATOR = re.compile(r"[\s,;\[\]()]+")
SHAPES = {(3, 3): (3, 3), (2, 3): (2, 3), (1, 9): (3, 3), (1, 6): (2, 3)}  # lines × numbers
LARGEST_FILE = 1 << 16  # bytes; more than nine numbers need
QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # cosine and sine, exactly
ROUNDED = 1e-6  # px by which a side may exceed a whole number of px and still fit


def homography(
    matrix: ArrayLike,
    *,
    convention: Convention | str = Convention.CORNER,
    inverse: bool = False,
) -> Homography:
    """Return the homography of a matrix in any of the usual forms.

    Parameters
    ----------
    matrix
        (3, 3), or (2, 3) if it is affine.
    inverse
        The matrix maps the target to the source (`cv2.WARP_INVERSE_MAP`).
    """
    if convention not in tuple(Convention):
        raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
    full = _full(matrix)
    if inverse:
        full = Homography(full).inverse()
    if convention == Convention.OPENCV:
        full = _shift(0.5) @ full @ _shift(-0.5)
    return Homography(full)


def parse_matrix(text: str) -> Doubles:
    """Read a matrix (3, 3) from a command line's text."""
    try:
        numbers = [_numbers(text)]
    except ValueError:
        return _read_matrix(text)
    return _of_lines(numbers, repr(text))


def _read_matrix(text: str) -> Doubles:
    path = Path(text)
    if not path.exists():
        raise ValueError(f"{text!r} is neither nine or six numbers nor a file")
    if path.is_file() and path.stat().st_size > LARGEST_FILE:
        raise ValueError(
            f"{path} has {path.stat().st_size} bytes; a file of nine numbers is smaller"
        )
    if path.suffix.lower() == ".npy":
        return _read_array(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        rows = [_numbers(line.partition("#")[0]) for line in lines]
    except ValueError:
        raise ValueError(f"{path} is not a text file of numbers and # comments") from None
    return _of_lines([row for row in rows if row], str(path))


def _read_array(path: Path) -> Doubles:
    loaded = read_arrays(path)
    if isinstance(loaded, dict):
        raise ValueError(f"{path} holds the arrays {', '.join(loaded)}; give a file of one matrix")
    return _full(loaded)


def _numbers(line: str) -> list[float]:
    return [float(number) for number in SEPARATOR.split(line) if number]


def _of_lines(rows: list[list[float]], name: str) -> Doubles:
    """Return the matrix of the numbers of all lines."""
    widths = {len(row) for row in rows}
    shape = SHAPES.get((len(rows), widths.pop())) if len(widths) == 1 else None
    if shape is None:
        counts = ", ".join(str(len(row)) for row in rows) or "no"
        raise ValueError(
            f"{name} has {counts} numbers in {len(rows)} lines; a matrix has three lines of three"
            " or, if it is affine, two, or all its numbers in one line"
        )
    return _full(np.reshape(rows, shape))


def _full(matrix: ArrayLike) -> Doubles:
    """Return a matrix as (3, 3)."""
    given = np.asarray(matrix)
    if given.shape not in ((2, 3), (3, 3)) or given.dtype.kind not in "fiu":
        raise ValueError(
            f"a matrix holds numbers of the shape (3, 3), or (2, 3) if it is affine,"
            f" not {given.dtype} of {given.shape}"
        )
    full = np.eye(3)
    full[: given.shape[0]] = given
    return full


def _shift(distance: float) -> Doubles:
    return np.array([[1, 0, distance], [0, 1, distance], [0, 0, 1]], np.float64)


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
