"""Homographies from four corners, and the order and size of a page's corners.

Points are in continuous pixel coordinates, x to the right and y down; arrays of them are (4, 2).
"""

from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles
from resample_texture.geometry.mappings import Homography
from resample_texture.geometry.matrices import SEPARATOR

NEARLY_STRAIGHT = 1e-6  # height of a triangle over its longest side
FARTHEST = 1e9  # px
LEAST_LEAD = 0.02  # of the best order over the second; refuses pages turned by 44.4 to 45.6 degrees

Exact = NDArray[Any]  # rational numbers


def parse_points(text: str) -> Doubles:
    """Read four points (4, 2) from "10,20 500,30 490,700 5,680"; semicolons also separate."""
    try:
        numbers = [float(number) for number in SEPARATOR.split(text) if number]
    except ValueError:
        numbers = []
    if len(numbers) != 8 or not np.isfinite(numbers).all():
        raise ValueError(f"{text!r} is not four points like '10,20 500,30 490,700 5,680'")
    return np.reshape(numbers, (4, 2))


def page_corners(shape: tuple[int, int]) -> Doubles:
    """Return the corners of a page: top left, top right, bottom right, bottom left."""
    height, width = shape
    return np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)


def from_corners(source: ArrayLike, target: ArrayLike) -> Homography:
    """Return the homography that maps four source points to four target points.

    All four are in front of the camera. The system is solved in rational numbers, so that a shift
    results in exactly that shift, and an affine map in an affine one.

    Parameters
    ----------
    source, target
        (4, 2) each, in the same order, px.

    Raises
    ------
    ValueError
        Three points lie on a line, or the two orders differ so that a corner would lie behind the
        camera.
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
    """Order a page's corners: top left, top right, bottom right, bottom left.

    Parameters
    ----------
    corners
        (4, 2) px in any order. The page's top side lies above its bottom side, and its left side to
        the left of its right side, judged by the means of their ends; if two orders satisfy that,
        the page is taken to be turned by less than 45 degrees.
    """
    given = _checked(corners, "page")
    offset = given - given.mean(axis=0)
    clockwise = np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))
    ring = given[clockwise]
    _check_convex(ring)
    starts = [np.roll(ring, -start, axis=0) for start in range(4)]
    upright = [start for start in starts if min(_spans(start)) > 0]  # one or two: the ring has area
    ordered, *others = sorted(upright, key=lambda start: -sum(_spans(start)))
    lead = sum(_spans(ordered)) - sum(sum(_spans(start)) for start in others)
    if lead < LEAST_LEAD * sum(_spans(ordered)):
        raise ValueError(
            "the page is turned by 45 degrees, so either of two corners may be its top left;"
            " give top left, top right, bottom right, bottom left"
        )
    return np.asarray(ordered, np.float64)


def rectified_shape(corners: ArrayLike) -> tuple[int, int]:
    """Return height and width of a page: means of opposite sides, rounded to px.

    Parameters
    ----------
    corners
        (4, 2) px: top left, top right, bottom right, bottom left.
    """
    page = _checked(corners, "page")
    _check_convex(page)
    top, right, bottom, left = np.linalg.norm(np.roll(page, -1, axis=0) - page, axis=1)
    return max(1, round((left + right) / 2)), max(1, round((top + bottom) / 2))


def _checked(points: ArrayLike, name: str) -> Doubles:
    """Return four points, refusing three on a line."""
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
    """Return how far right lies from left, and bottom below top, by the sides' means."""
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
