"""Cells of points: what lies before all of some lines."""

import numpy as np
import pytest

from resample.engine.jit import kernel
from resample_points.kernels.cells import (
    AWAY,
    BEGIN,
    END,
    SIDES,
    cuts,
    meet,
    no_lines,
    put,
    put_around,
)

FAR = 1e3


@kernel
def cell_before(sides, closed):
    """The cell before a polygon and sides (N, 3): lines, how many are left, corners, reach."""
    lines = no_lines()
    count = put_around(lines.line, 0, closed) if closed else 0
    for n in range(sides.shape[0]):
        put(lines.line, count, sides[n, 0], sides[n, 1], sides[n, 2])
        count += 1
    count, corners, reach = meet(lines, count, FAR)
    return lines, count, corners, reach


@kernel
def is_cut(corner, corners, x, y, away):
    """Whether a line cuts corners off."""
    return cuts(corner, corners, x, y, away)


def cell_of(sides, *, closed=1.0):
    """Corners (N, 2), area and reach of the cell before lines (x, y, away), x and y of any length.

    Closed by a regular polygon of half a width; 0: by nothing.
    """
    sides = np.array([side / np.hypot(*side[:2]) for side in np.reshape(sides, (-1, 3))], float)
    lines, count, corners, reach = cell_before(sides.reshape(-1, 3), closed)
    width = lines.line[END, :count] - lines.line[BEGIN, :count]
    area = 0.5 * float(lines.line[AWAY, :count] @ width)
    return lines.corner[:, :corners].T.copy(), area, reach


def around(corners):
    """Corners in the order of their angles."""
    return corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]


def regular(half):
    angle = 2.0 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    return half / np.cos(np.pi / SIDES) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def area_of(corners):
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def random_sides(rng, count):
    step = rng.normal(size=(count, 2))
    return np.column_stack([step, 0.5 * (step**2).sum(axis=1)])


def test_cells_are_those_of_the_obvious_way(rng):
    for _ in range(60):
        sides, known = random_sides(rng, 12), regular(1.0)
        for side in sides:
            # The obvious way: corners that stay and places where sides meet the line, one by one
            left = []
            for n, here in enumerate(known):
                before = known[n - 1]
                depth, last = (side[0] * x + side[1] * y - side[2] for x, y in (here, before))
                if (depth > 0) != (last > 0):
                    left.append(before + last / (last - depth) * (here - before))
                if depth <= 0:
                    left.append(here)
            known = np.reshape(left, (-1, 2))
        corners, area, reach = cell_of(sides)
        np.testing.assert_allclose(around(corners), around(known), atol=1e-12)
        assert area == pytest.approx(area_of(known), rel=1e-12)
        assert reach == pytest.approx((known**2).sum(axis=1).max(), rel=1e-12)


def test_cells_do_not_depend_on_the_order_of_lines(rng):
    sides = random_sides(rng, 12)
    first = cell_of(sides)
    for _ in range(5):
        corners, area, _ = cell_of(rng.permutation(sides))
        np.testing.assert_allclose(around(corners), around(first[0]), atol=1e-12)
        assert area == pytest.approx(first[1], rel=1e-12)


@pytest.mark.parametrize("turned", np.linspace(0.0, 1.5, 7))
def test_lines_that_are_one_but_for_rounding_count_once(turned, rng):
    c, s = np.cos(turned), np.sin(turned)
    step = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1]]) @ [[c, s], [-s, c]]
    sides = np.column_stack([step, 0.5 * (step**2).sum(axis=1)])
    again = sides * (1.0 + 1e-16 * rng.integers(-2, 3, sides.shape))
    farther = sides * (1.0, 1.0, 1.5)
    corners, area, reach = cell_of(np.concatenate([sides, again, farther, sides]), closed=2.0)
    assert area == pytest.approx(1.0, rel=1e-12)
    assert reach == pytest.approx(0.5, rel=1e-12)
    known = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ [[c, s], [-s, c]]
    apart = np.linalg.norm(corners[:, None] - known, axis=2)
    assert (apart.min(axis=0) < 1e-9).all()
    assert (apart.min(axis=1) < 1e-9).all()


@pytest.mark.parametrize(
    "sides",
    [[], [(1, 0, 1)], [(1, 0, 1), (-1, 0, 1)], [(1, 0, 1), (0, 1, 1)], [(1, 0, 1), (-1, 1, 1)]],
)
def test_lines_that_close_no_cell_reach_far(sides):
    reach = cell_of(sides, closed=0.0)[2]
    assert reach >= FAR**2 if sides else reach == 0.0


def test_a_corner_beyond_a_line_is_cut_off():
    lines, _, corners, _ = cell_before(np.empty((0, 3)), 1.0)
    outer = float(np.linalg.norm(regular(1.0)[0]))
    for angle in np.linspace(0.0, 6.0, 25):
        x, y = float(np.cos(angle)), float(np.sin(angle))
        farthest = (regular(1.0) @ (x, y)).max()
        assert is_cut(lines.corner, corners, x, y, farthest - 1e-9)
        assert not is_cut(lines.corner, corners, x, y, farthest + 1e-9)
        assert not is_cut(lines.corner, corners, x, y, outer + 1e-9)
