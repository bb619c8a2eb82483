"""Kernels that are a formula each, run as plain Python, against NumPy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from resample.engine.cells import parts
from resample.engine.rays import meshes
from resample.engine.rays.meshes import _behind, _mean
from resample.engine.vectors import (
    column,
    combine,
    cross,
    dot,
    matrix_of,
    multiply,
    scaled,
    vector_at,
)
from resample.engine.windows import footprints as pixels


def plain(kernel):
    """A kernel's body, which is not compiled."""
    return kernel.__wrapped__


def test_products_of_vectors_are_numpy_s(rng):
    u, v = rng.standard_normal((2, 3))
    assert plain(dot)(u, v) == pytest.approx(u @ v)
    np.testing.assert_allclose(plain(cross)(u, v), np.cross(u, v))
    np.testing.assert_allclose(plain(combine)(u, 2.5, v), u + 2.5 * v)
    np.testing.assert_allclose(plain(scaled)(-1.5, v), -1.5 * v)


def test_products_of_matrices_are_numpy_s(rng):
    array, v = rng.standard_normal((3, 3)), rng.standard_normal(3)
    rows = plain(matrix_of)(array)
    np.testing.assert_array_equal(rows, array)
    np.testing.assert_allclose(plain(multiply)(rows, tuple(v)), array @ v)
    for c in range(3):
        np.testing.assert_array_equal(plain(column)(rows, c), array[:, c])
    flat = np.arange(12, dtype=np.float32)
    assert plain(vector_at)(flat, np.uint64(2)) == (6.0, 7.0, 8.0)


def test_what_corners_have_is_mixed_by_their_shares(rng):
    corners, shares = rng.standard_normal((5, 3)), np.array([0.2, 0.3, 0.5])
    mesh = meshes.Triangles(*[None] * len(meshes.Triangles._fields))
    mesh = mesh._replace(face=np.array([[0, 1, 2], [4, 1, 3]]))
    hit = 7.0, 1, shares[1], shares[2]
    np.testing.assert_allclose(plain(_mean)(corners, mesh, hit), shares @ corners[[4, 1, 3]])


def ray(rng, opacity, **changed):
    """Color, opacity, weighed depth, first depth, visibility, value and its presence."""
    part = [*opacity * rng.random(3), opacity, 3.0, 2.0, 0.5, 7.0, 0.0]
    for place, value in changed.items():
        part[int(place[1:])] = value
    return tuple(part)


def test_of_two_parts_of_a_ray_the_one_behind_is_seen_through_the_other(rng):
    front, back = ray(rng, 0.25), ray(rng, 0.5, _5=9.0, _6=0.7, _7=8.0, _8=1.0)
    seen = plain(_behind)(front, back)
    np.testing.assert_allclose(seen[:5], np.array(front[:5]) + 0.75 * np.array(back[:5]))
    assert seen[5:] == (2.0, 0.7, 8.0, 1.0)


@pytest.mark.parametrize("place", [3, 6])
def test_a_part_that_is_empty_and_measures_nothing_hides_nothing(rng, place):
    nothing = ray(rng, 0.0, _5=np.inf, _6=0.0)
    back = ray(rng, 0.5)
    assert plain(_behind)(nothing, back) is back
    some = list(nothing)
    some[place] = 0.5
    assert plain(_behind)(tuple(some), back) is not back


def test_the_first_depth_is_the_nearest_that_there_is(rng):
    front, back = ray(rng, 0.3, _5=np.inf), ray(rng, 0.5, _5=4.0)
    assert plain(_behind)(front, back)[5] == 4.0
    assert plain(_behind)(back, front)[5] == 4.0


@pytest.mark.parametrize("taps", [1, 2, 4])
def test_a_point_lies_between_the_pixels_that_its_filter_meets(taps):
    batch = SimpleNamespace(along_x=np.zeros(3), along_y=np.zeros(3), pixel=np.zeros(3, np.int64))
    plain(parts._fill_point)(batch, 1, np.array([13.7, 25.2]), taps, (10, 20, 8))
    column, row = math.floor(3.7 - taps / 2 + 0.5), math.floor(5.2 - taps / 2 + 0.5)
    assert batch.pixel[1] == 8 * row + column
    assert batch.along_x[1] == pytest.approx(3.7 - taps / 2 + 0.5 - column)
    assert batch.along_y[1] == pytest.approx(5.2 - taps / 2 + 0.5 - row)


@pytest.mark.parametrize("finest", [1.0, 0.25])
def test_pixels_have_so_many_parts_that_boxes_stand_for_each(rng, finest):
    """Neither side of a part slants too much, nor does a part; along the axes there is one."""
    parts_of = plain(pixels.parts_of)
    for _ in range(50):
        (ux, vx), (uy, vy) = sides = rng.uniform(-3.0, 3.0, (2, 2))
        across, down = parts_of(pixels.PixelFootprint(0.0, 0.0, *map(tuple, sides)), finest)
        leanest = pixels.LEANEST * finest * (1.0 + 1e-9)
        assert abs(ux * vx) / across**2 <= leanest
        assert abs(uy * vy) / down**2 <= leanest
        assert max(abs(ux * uy), abs(vx * vy)) / (across * down) <= finest * (1.0 + 1e-9)
    upright = pixels.PixelFootprint(0.0, 0.0, (9.0, 0.0), (0.0, 7.0))
    assert parts_of(upright, finest) == (1, 1)
    longest = pixels.PixelFootprint(0.0, 0.0, (1e6, 1e6), (-1e6, 1e6))
    assert parts_of(longest, finest) == (pixels.MOST_PARTS, pixels.MOST_PARTS)
