"""Read homographies from numbers and files, in either convention, or inverted."""

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
