"""Cells of points: polygons that are cut along lines."""

import numpy as np
import pytest

from resample_warp3d.clouds.kernels import polygons
from resample_warp3d.clouds.kernels.polygons import SIDES, WIDTH, crossed, cut, open_polygon

ALL_OPEN = (2 << SIDES) - 2


def opened():
    polygon = np.zeros((4, WIDTH))
    open_polygon(polygon, 1.0)
    return polygon


def filled(corners):
    polygon = np.zeros((4, WIDTH))
    polygon[:2, 1 : len(corners) + 1] = np.transpose(corners)
    polygon[:2, len(corners) + 1] = corners[0]
    return polygon


def clipped(corners, is_open, side):
    """The obvious way: corners that stay and places where sides meet the line, one after the other.

    Gives these corners, and whether the sides after them are open.
    """
    left, still = [], []
    for n, here in enumerate(corners):
        before, was_open = corners[n - 1], is_open[n - 1]
        depth, last = (side[0] * x + side[1] * y - side[2] for x, y in (here, before))
        if (depth > 0) != (last > 0):
            left.append(before + last / (last - depth) * (here - before))
            still.append(was_open and depth <= 0)
        if depth <= 0:
            left.append(here)
            still.append(is_open[n])
    return np.reshape(left, (-1, 2)), still


def bits_of(is_open):
    return sum(2 << k for k, is_one in enumerate(is_open) if is_one)


def test_cuts_are_those_of_the_obvious_way(rng):
    for _ in range(60):
        polygon, corners, sides = opened(), SIDES, ALL_OPEN
        known, is_open = polygon[:2, 1 : corners + 1].T.copy(), [True] * SIDES
        for _ in range(12):
            x, y = rng.normal(size=2)
            side = (float(x), float(y), float(0.5 * (x * x + y * y)))
            how = crossed(polygon, corners, side)
            assert (how[0] == 0) == ((known**2).sum(axis=1) <= 0.5 * side[2]).all()
            if how[1] == 0:
                continue
            corners, sides = cut(polygon, corners, sides, side, how)
            known, is_open = clipped(known, is_open, side)
            np.testing.assert_array_equal(polygon[:2, 1 : corners + 1].T, known)
            assert sides == bits_of(is_open)


@pytest.mark.parametrize("first", range(5))
def test_cuts_do_not_depend_on_which_corner_comes_first(first):
    corners = np.roll(
        [[2.0, 0.0], [1.0, 2.0], [-1.0, 2.0], [-2.0, 0.0], [0.0, -2.0]], first, axis=0
    )
    for side in ((1.0, 0.0, 1.5), (0.0, 1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, 0.5, 0.0)):
        once, often = filled(corners), filled(corners)
        how, sides = crossed(once, 5, side), bits_of([True, False, True, True, False])
        count = cut(once, 5, sides, side, how)
        assert count == polygons._cut_often(often, 5, sides, side)
        np.testing.assert_array_equal(once[:2, : count[0] + 2], often[:2, : count[0] + 2])


def test_a_line_that_leaves_a_polygon_twice_cuts_twice():
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [3.0, 0.5], [2.0, 2.0], [0.0, 0.5]])
    polygon, side = filled(corners), (0.0, 1.0, 1.0)
    how, is_open = crossed(polygon, 6, side), [True, False, True, False, True, True]
    assert how[1] == 4
    count, sides = cut(polygon, 6, bits_of(is_open), side, how)
    known, still = clipped(corners, is_open, side)
    np.testing.assert_array_equal(polygon[:2, 1 : count + 1].T, known)
    assert sides == bits_of(still)


def test_a_polygon_of_too_many_corners_stays_within_its_room():
    angle = np.linspace(0.0, 2.0 * np.pi, polygons.MOST_CORNERS, endpoint=False)
    polygon, side = filled(np.stack([np.cos(angle), np.sin(angle)], axis=1)), (1.0, 0.0, 0.9999)
    how = crossed(polygon, polygons.MOST_CORNERS, side)
    count, _ = cut(polygon, polygons.MOST_CORNERS, 0, side, how)
    assert count == polygons.MOST_CORNERS
