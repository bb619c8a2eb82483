"""Kernels that are a formula each, run as plain Python, against NumPy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from resample.engine import vectors
from resample.engine.cells import scattering
from resample.engine.ellipsoids import footprints, lanes, outlines
from resample.engine.ellipsoids.footprints import Eye
from resample.engine.mixtures import models
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
from resample.types import Absorbing, Linear, Place
from tests.kernels import run_in_python


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


@pytest.mark.parametrize("depth", [0.0, 1e-3, 0.4, 2.0, 30.0])
def test_splats_absorb_as_their_depth_or_as_a_layer_says(monkeypatch, depth):
    """A line integral times a factor is what the change of the transmittance is taken of."""
    run_in_python(monkeypatch, lanes)
    integral = np.float32(0.5)
    absorbing, linear = Absorbing(peak=0.5), Linear(layer=0.25)
    factor, is_thin = lanes._depth_per(absorbing, np.float32(2 * depth))
    assert is_thin == (depth <= 1.0)
    assert lanes._absorbed(absorbing, factor * integral, is_thin) == pytest.approx(
        np.expm1(-depth), rel=1e-3, abs=1e-6
    )
    factor, is_thin = lanes._share_per(linear, np.float32(4 * depth))
    assert is_thin
    change = lanes._as_it_is(linear, factor * integral, is_thin)
    assert change == pytest.approx(np.expm1(-depth) * integral / 0.25, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("taps", [1, 2, 4])
def test_a_point_lies_between_the_pixels_that_its_filter_meets(taps):
    batch = SimpleNamespace(along_x=np.zeros(3), along_y=np.zeros(3), pixel=np.zeros(3, np.int64))
    plain(scattering._fill_point)(batch, 1, np.array([13.7, 25.2]), taps, (10, 20, 8))
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


@pytest.mark.parametrize("is_far", [True, False])
def test_sides_of_a_canvas_are_planes_that_balls_touch(rng, monkeypatch, is_far):
    """Through the eye where rays meet there, else along the axis; in radii of a ball beyond it."""
    run_in_python(monkeypatch, outlines, vectors)
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)
    eye = Eye(turn.tolist(), tuple(shift), 30.0, 40.0, 9.0, 7.0, 0.1, is_far)
    radius, pad, size = 0.3, 1.5, (6, 8)
    shape = SimpleNamespace(covariance=(radius**2 * np.eye(3)).tolist())
    found = np.array(outlines.sides_of(eye, shape, Place(2.0, 3.0, 2), size, pad))
    # Edges through the centers of the outermost sub-pixels, of half a pixel each.
    left, right, top, bottom = 2.0 + 0.25, 2.0 + 4.0 - 0.25, 3.0 + 0.25, 3.0 + 3.0 - 0.25
    left, right, top, bottom = left - pad, right + pad, top - pad, bottom + pad
    ends = [(left, 0, -1), (right, 0, 1), (top, 1, -1), (bottom, 1, 1)]
    for place in rng.uniform(-5.0, 5.0, (20, 3)):
        x, y, z = turn @ place + shift
        for side, (edge, axis, sign) in zip(found, ends, strict=True):
            focal, middle, at = (30.0, 9.0, x) if axis == 0 else (40.0, 7.0, y)
            per_depth = (edge - middle) / focal
            away = (at - per_depth * z) / math.hypot(1.0, per_depth) if is_far else at - per_depth
            assert side[:3] @ place + side[3] == pytest.approx(sign * away / radius - 1.0, abs=1e-6)


@pytest.mark.parametrize("subpixels", [1, 3])
def test_a_splat_s_rectangle_holds_the_sub_pixels_whose_centers_lie_in_it(rng, subpixels):
    """Cut to its canvas; empty where its place is not a number, and left alone if planes cut it."""
    bound, place = plain(models._bound), Place(2.0, 3.0, subpixels)
    window = SimpleNamespace(place=place, height=5 * subpixels, width=7 * subpixels)
    sides = [outlines.LEFT, outlines.RIGHT, outlines.TOP, outlines.BOTTOM]
    at = np.uint64(0)
    for middle, half in rng.uniform([[-2, -2], [0, 0]], [[12, 12], [4, 4]], (100, 2, 2)):
        room = np.full(outlines.SCRATCH_SIZE, -7.0, np.float32)
        for is_cut in (1.0, 0.0):
            room[outlines.CUT] = is_cut
            bound(room, at, tuple(middle), tuple(half), window)
            left, right, top, bottom = (int(room[side]) for side in sides)
            if is_cut:
                assert (left, right, top, bottom) == (-7, -7, -7, -7)
        x = place.x + (np.arange(window.width) + 0.5) / subpixels
        y = place.y + (np.arange(window.height) + 0.5) / subpixels
        np.testing.assert_array_equal(
            np.arange(left, right), np.flatnonzero(abs(x - middle[0]) <= half[0])
        )
        np.testing.assert_array_equal(
            np.arange(top, bottom), np.flatnonzero(abs(y - middle[1]) <= half[1])
        )
    bound(room, at, (np.nan, np.nan), (1.0, 1.0), window)
    assert room[outlines.LEFT] == room[outlines.RIGHT]


@pytest.mark.parametrize("is_far", [True, False])
@pytest.mark.parametrize("subpixels", [1, 3])
def test_outlines_of_balls_hold_the_sub_pixels_that_their_rays_meet(
    rng, monkeypatch, is_far, subpixels
):
    """As first sub-pixels and one past the last, on a canvas."""
    run_in_python(monkeypatch, outlines, vectors, footprints)
    radius, focal, middle, count = 0.5, (30.0, 40.0), (9.0, 7.0), 40
    eye = Eye(np.eye(3).tolist(), (0.0, 0.0, 0.0), *focal, *middle, 0.1, is_far)
    unit = (np.eye(3) / radius).tolist()
    shape = SimpleNamespace(
        to_unit=unit, from_unit=(radius * np.eye(3)).tolist(),
        covariance=(radius**2 * np.eye(3)).tolist(),
        across=(1 / focal[0] / radius, 0.0, 0.0), down=(0.0, 1 / focal[1] / radius, 0.0),
    )  # fmt: skip
    place, height, width = Place(2.0, 3.0, subpixels), 12 * subpixels, 16 * subpixels
    home, spread = (2.0, 10.0, 3.0, 9.0), (3.0, 3.0, 0.0) if is_far else (0.4, 0.4, 0.0)
    position = (rng.uniform(-1, 1, (count, 3)) * spread + [0, 0, 8.0]).astype(np.float32)
    room = np.zeros(outlines.SCRATCH_SIZE, np.float32)
    setup = SimpleNamespace(optics=(eye, shape, None))
    window = outlines.Window(place, height, width, home, None)
    outlines.form_batch(room, position.reshape(-1), None, count, setup, window)
    for n, (x, y, z) in enumerate(position.astype(float)):
        left, right, top, bottom = (
            int(room[int(side) + n])
            for side in (outlines.LEFT, outlines.RIGHT, outlines.TOP, outlines.BOTTOM)
        )
        for at, axis, edge, size, found in (
            (x, 0, place.x, width, (left, right)), (y, 1, place.y, height, (top, bottom))
        ):  # fmt: skip
            center = edge + (np.arange(size) + 0.5) / subpixels
            slope = (center - middle[axis]) / focal[axis]
            # Distance of the ball from the plane of all rays of a column or a row.
            away = np.abs(at - slope * z) / np.hypot(1, slope) if is_far else np.abs(at - slope)
            meets = np.flatnonzero(away <= radius)
            np.testing.assert_array_equal(np.arange(*found), meets)
        on = np.array([x, y]) / (z if is_far else 1.0) * focal + middle
        is_home = bool(2.0 <= on[0] < 10.0 and 3.0 <= on[1] < 9.0)
        assert bool(room[int(outlines.HOME) + n]) is is_home
        assert room[int(outlines.X) + n] == pytest.approx(on[0], rel=1e-5)
        assert room[int(outlines.Y) + n] == pytest.approx(on[1], rel=1e-5)
        assert room[int(outlines.DEPTH) + n] == np.float32(z)
        ends = room[[int(side) + n for side in (outlines.LEFT, outlines.RIGHT)]].tolist()
        ends += room[[int(side) + n for side in (outlines.TOP, outlines.BOTTOM)]].tolist()
        assert all(end.is_integer() for end in ends)
        assert room[int(outlines.CUT) + n] == 0.0
