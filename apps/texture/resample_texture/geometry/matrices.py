"""Homographies: read from numbers and files, of resizing and rotation, from four corners.

Points are in continuous pixel coordinates, x to the right and y down; arrays of them are (4, 2).
"""

import math
import re
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.cameras.models import Convention
from resample.types import Doubles
from resample_texture.geometry.mappings import Homography, Size, read_arrays

SEPARATOR = re.compile(r"[\s,;\[\]()]+")
SHAPES = {(3, 3): (3, 3), (2, 3): (2, 3), (1, 9): (3, 3), (1, 6): (2, 3)}  # lines × numbers
LARGEST_FILE = 1 << 16  # bytes; more than nine numbers need
QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))  # cosine and sine, exactly
ROUNDED = 1e-6  # px by which a side may exceed a whole number of px and still fit
NEARLY_STRAIGHT = 1e-6  # height of a triangle over its longest side
FARTHEST = 1e9  # px
LEAST_LEAD = 0.02  # of the best order over the second; refuses pages turned by 44.4 to 45.6 degrees

Exact = NDArray[Any]  # rational numbers


def homography(
    matrix: ArrayLike, *, convention: Convention | str = Convention.CORNER, inverse: bool = False
) -> Homography:
    """Return the homography of a matrix (3, 3) or (2, 3), or of one from target to source."""
    if convention not in tuple(Convention):
        raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
    full = _full(matrix)
    if inverse:
        full = Homography(full).inverse()
    if convention == Convention.OPENCV:
        there, back = (np.array([[1, 0, n], [0, 1, n], [0, 0, 1]]) for n in (0.5, -0.5))
        full = there @ full @ back
    return Homography(full)


def parse_matrix(text: str) -> Doubles:
    """Read a matrix (3, 3) from a command line's text."""
    if not is_file(text):
        return _of_lines([_numbers(text)], repr(text))
    path = Path(text)
    if not path.exists():
        raise ValueError(f"{text}: there is no such file; a matrix may also be nine or six numbers")
    if path.is_file() and path.stat().st_size > LARGEST_FILE:
        raise ValueError(
            f"{path} has {path.stat().st_size} bytes; a file of nine numbers is smaller"
        )
    if path.suffix.lower() == ".npy":
        loaded = read_arrays(path)
        if isinstance(loaded, dict):
            raise ValueError(
                f"{path} holds the arrays {', '.join(loaded)}; give a file of one matrix"
            )
        return _full(loaded)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        rows = [_numbers(line.partition("#")[0]) for line in lines]
    except ValueError:
        raise ValueError(f"{path} is not a text file of numbers and # comments") from None
    return _of_lines([row for row in rows if row], str(path))


def is_file(text: str) -> bool:
    """Whether a text of a command line names a file of a matrix rather than giving numbers."""
    try:
        _numbers(text)
    except ValueError:
        return True
    return False


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
    try:
        given = np.asarray(matrix)
    except ValueError:  # of lists of different lengths
        given = np.empty(0, np.object_)
    if given.shape not in ((2, 3), (3, 3)) or given.dtype.kind not in "fiu":
        raise ValueError(
            f"a matrix holds numbers of the shape (3, 3), or (2, 3) if it is affine,"
            f" not {given.dtype} of {given.shape}"
        )
    full = np.eye(3)
    full[: given.shape[0]] = given
    return full


def resizing(source_shape: tuple[float, float], shape: Size) -> Homography:
    """Return the map from a picture's whole area to a target's (height, width)."""
    (source_height, source_width), (height, width) = source_shape, shape
    return Homography(np.diag([width / source_width, height / source_height, 1.0]))


def scaling(factor: tuple[float, float]) -> Homography:
    """Return the map that scales along x and y about the picture's corner."""
    return Homography(np.diag([*factor, 1.0]))


def scaled_shape(source_shape: tuple[float, float], factor: tuple[float, float]) -> tuple[int, int]:
    """Return a picture's height and width times factors along x and y, rounded."""
    if not all(0.0 < one < math.inf for one in factor):
        raise ValueError(
            f"a picture cannot be scaled by {' and '.join(f'{one:g}' for one in factor)};"
            " give a factor above 0, or two: along x and y"
        )
    across, down = factor
    height, width = source_shape[0] * down, source_shape[1] * across
    return max(1, math.floor(height + 0.5)), max(1, math.floor(width + 0.5))


def turning(source_shape: Size, degrees: float, shape: Size) -> Homography:
    """Return the map that rotates a picture counterclockwise about the centers of both."""
    cosine, sine = _cosine_and_sine(degrees)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    middle, target = (np.array([width, height]) / 2.0 for height, width in (source_shape, shape))
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = turn, target - turn @ middle
    return Homography(matrix)


def turned_shape(source_shape: Size, degrees: float) -> tuple[int, int]:
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


def parse_points(text: str) -> Doubles:
    """Read four points (4, 2) from "10,20 500,30 490,700 5,680"; semicolons also separate."""
    try:
        numbers = _numbers(text)
    except ValueError:
        numbers = []
    if len(numbers) != 8 or not np.isfinite(numbers).all():
        raise ValueError(f"{text!r} is not four points like '10,20 500,30 490,700 5,680'")
    return np.reshape(numbers, (4, 2))


def page_corners(shape: Size) -> Doubles:
    """Return the corners of a page: top left, top right, bottom right, bottom left."""
    height, width = shape
    return np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)


def from_corners(source: ArrayLike, target: ArrayLike) -> Homography:
    """Return the homography that maps four source points (4, 2) to target points, all in front.

    It is solved in rational numbers, so that a shift results in exactly that shift.
    """
    before, after = _exact(_checked(source, "source")), _exact(_checked(target, "target"))
    coordinates, weight = _barycentric(before)
    d = _barycentric(after)[1] / weight  # weights of the first three corners; the last is 1
    if min(d) < 0:
        raise ValueError(
            "no camera sees these source points at those target points;"
            " give both in the same order, for example clockwise"
        )
    return Homography((after[:3].T * d @ coordinates).astype(np.float64), is_signed=True)


def order_corners(corners: ArrayLike) -> Doubles:
    """Order a page's corners: top left, top right, bottom right, bottom left."""
    given = _checked(corners, "page")
    offset = given - given.mean(axis=0)
    clockwise = np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))
    ring = given[clockwise]
    _check_convex(ring)
    starts = [np.roll(ring, -start, axis=0) for start in range(4)]
    # Right lies to the right of left, and bottom below top, in one order or two.
    upright = [start for start in starts if min(_spans(start)) > 0]
    ordered, *others = sorted(upright, key=lambda start: -sum(_spans(start)))
    lead = sum(_spans(ordered)) - sum(sum(_spans(start)) for start in others)
    if lead < LEAST_LEAD * sum(_spans(ordered)):
        raise ValueError(
            "the page is turned by 45 degrees, so either of two corners may be its top left;"
            " give top left, top right, bottom right, bottom left"
        )
    return np.asarray(ordered, np.float64)


def rectified_shape(corners: ArrayLike) -> tuple[int, int]:
    """Return height and width of a page of ordered corners: means of opposite sides, px."""
    page = _checked(corners, "page")
    _check_convex(page)
    top, right, bottom, left = np.linalg.norm(np.roll(page, -1, axis=0) - page, axis=1)
    return max(1, round((left + right) / 2)), max(1, round((top + bottom) / 2))


def _checked(points: ArrayLike, name: str) -> Doubles:
    """Return four points; reject three on a line."""
    given = np.asarray(points, np.float64)
    if given.shape != (4, 2):
        raise ValueError(f"the {name} has four points, (4, 2), not {given.shape}")
    if not (np.abs(given) <= FARTHEST).all():
        raise ValueError(f"the {name}'s points must be finite and within {FARTHEST:.0e} px")
    for three in combinations(given, 3):
        sides = np.array(three) - np.roll(three, 1, axis=0)
        if abs(_cross(sides[0], sides[1])) <= NEARLY_STRAIGHT * np.max(np.sum(sides**2, axis=1)):
            raise ValueError(f"three of the {name}'s points lie on a line or coincide")
    return given


def _spans(ring: Doubles) -> tuple[float, float]:
    """Return the distances of right from left and bottom from top, by the sides' means."""
    top_left, top_right, bottom_right, bottom_left = ring
    rightward = top_right + bottom_right - top_left - bottom_left
    downward = bottom_left + bottom_right - top_left - top_right
    return float(rightward[0]) / 2, float(downward[1]) / 2


def _check_convex(ring: Doubles) -> None:
    side = np.roll(ring, -1, axis=0) - ring
    turn = [_cross(side[n], side[(n + 1) % 4]) for n in range(4)]
    if min(turn) < 0 < max(turn):
        raise ValueError(
            "the page's corners do not bound a convex shape;"
            " give top left, top right, bottom right, bottom left"
        )


def _cross(first: Doubles, second: Doubles) -> float:
    return float(first[0] * second[1] - first[1] * second[0])


def _exact(points: Doubles) -> Exact:
    """Return points as rational numbers (4, 3), with a third coordinate of 1."""
    rows = [[Fraction(float(x)), Fraction(float(y)), Fraction(1)] for x, y in points]
    return np.array(rows, object)


def _barycentric(points: Exact) -> tuple[Exact, Exact]:
    """Return the matrix to coordinates in the first three points, and the fourth's."""
    first, second, third, fourth = points
    adjugate = np.stack([np.cross(second, third), np.cross(third, first), np.cross(first, second)])
    coordinates = adjugate / (first @ adjugate[0])
    return coordinates, coordinates @ fourth
