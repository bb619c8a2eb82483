import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Homography,
    oriented,
    pixel_centers,
    source_coordinates,
)

IDENTITY = np.eye(3)
# A floor: d = v + 1 is the depth, the horizon is the target's line y = 8, the near edge y = 48.
FLOOR = np.array([[10.0, 32.0, -18.0], [0.0, 8.0, 48.0], [0.0, 1.0, 1.0]])


def moved(matrix, u, v):
    """Places of source points in the target, and their d."""
    x, y, d = matrix @ np.stack([u, v, np.ones_like(u, float)])
    return x / d, y / d, d


def naive_source(matrix, shape):
    """Every pixel by itself: the source point that lands on its center, if d is above 0 there."""
    found = np.full((2, *shape), np.nan)
    for row in range(shape[0]):
        for column in range(shape[1]):
            place = np.linalg.solve(matrix, [column + 0.5, row + 0.5, 1.0])
            if place[2] == 0:  # on the horizon
                continue
            u, v = place[:2] / place[2]
            if moved(matrix, u, v)[2] > 0:
                found[:, row, column] = u, v
    return found


# Homographies.


@pytest.mark.parametrize(
    ("matrix", "complaint"),
    [
        (np.eye(2), r"\(3, 3\), not \(2, 2\)"),
        (np.ones((2, 3)), r"\(3, 3\), not \(2, 3\)"),
        (np.diag([1, np.nan, 1]), "finite"),
        (np.diag([1, 1, np.inf]), "finite"),
        (np.zeros((3, 3)), "no inverse"),
        (np.diag([1, 1, 0]), "no inverse"),
        (np.ones((3, 3)), "no inverse"),
        (np.arange(1, 10).reshape(3, 3), "no inverse"),
        (np.arange(1, 10).reshape(3, 3) / 10, "no inverse"),
        ([[1, 2, 500], [2, 4, 300], [0, 0, 1]], "no inverse"),
        (np.diag([1, 1, 1e-320]), "no inverse"),
        (1e120 * np.eye(3), "no inverse in float64"),
        (1e-120 * np.eye(3), "no inverse in float64"),
    ],
)
def test_a_matrix_that_is_no_homography_is_refused(matrix, complaint):
    with pytest.raises(ValueError, match=complaint):
        Homography(matrix)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1e-3, 1e-3, 1]),
        np.diag([1e-3, 1e3, 1]),
        np.diag([1e6, 1e6, 1]),
        [[1, 0, 1e8], [0, 1, -1e8], [0, 0, 1]],
        [[1e-3, 0, 1e5], [0, 1e-3, 1e5], [1e-9, 0, 1]],
        1e-40 * FLOOR,
        1e40 * FLOOR,
    ],
)
def test_strong_scalings_are_homographies(matrix):
    matrix = Homography(np.asarray(matrix, float))
    np.testing.assert_allclose(matrix.matrix @ matrix.inverse(), IDENTITY, atol=1e-7)


def test_a_homography_keeps_its_own_numbers():
    given = np.eye(3)
    homography = Homography(given)
    given[0, 2] = 7
    np.testing.assert_array_equal(homography.matrix, IDENTITY)


# What is in front of the eye.


@pytest.mark.parametrize("scale", [1.0, -1.0, 1e-30, -3e30])
def test_scale_and_sign_of_a_matrix_mean_nothing(scale):
    expected = source_coordinates(Homography(FLOOR), (48, 64), (20, 20))
    found = source_coordinates(Homography(scale * FLOOR), (48, 64), (20, 20))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_source_s_center_is_in_front_of_the_eye():
    horizon_at_row_7 = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, -7]])
    assert moved(oriented(horizon_at_row_7, (20, 4)), 2, 10)[2] > 0
    assert moved(oriented(horizon_at_row_7, (10, 4)), 2, 5)[2] > 0


def test_without_a_size_the_first_texel_is_in_front_of_the_eye():
    assert moved(oriented(np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, -7]])), 0.5, 0.5)[2] > 0


def test_of_a_horizon_through_the_center_either_sign_gives_one_half():
    across = np.array([[1.0, 0, 0], [0, 0, 1], [-0.1, 0.3, -0.3 * 10 + 0.1 * 15]])
    np.testing.assert_array_equal(oriented(across, (20, 30)), oriented(-across, (20, 30)))


def test_a_signed_homography_may_have_its_center_behind_the_eye():
    signed = Homography(-FLOOR, is_signed=True)
    x, _ = source_coordinates(signed, (48, 64), (20, 20))
    assert np.isnan(x[8:]).all()
    assert np.isfinite(x[:8]).all()


def test_pixels_above_the_horizon_see_nothing():
    x, y = source_coordinates(Homography(FLOOR), (48, 64), (20, 20))
    assert np.isnan(x[:8]).all()
    assert np.isnan(y[:8]).all()
    assert np.isfinite(x[8:]).all()
    assert np.isfinite(y[8:]).all()


def test_pixels_below_the_horizon_see_the_floor():
    x, y = source_coordinates(Homography(FLOOR), (48, 64), (20, 20))
    column, row = pixel_centers((48, 64))
    depth = 40 / (row[8:] - 8)  # y = 8 + 40 / d
    np.testing.assert_allclose(y[8:], np.broadcast_to(depth - 1, (40, 64)), rtol=1e-12)
    # x = 32 + (10 u − 50) / d
    np.testing.assert_allclose(x[8:], 5 + (column - 32) * depth / 10, rtol=1e-12, atol=1e-11)


def test_a_pixel_on_the_horizon_sees_nothing():
    half_a_pixel_up = np.array([[1, 0, 0], [0, 1, -0.5], [0, 0, 1]])
    x, _ = source_coordinates(Homography(half_a_pixel_up @ FLOOR), (48, 64), (20, 20))
    assert np.isnan(x[:8]).all()  # the center of row 7 is on it
    assert np.isfinite(x[8:]).all()


# Source coordinates.


@pytest.mark.parametrize("shift", [(0, 0), (3, -5), (-4096, 70000)])
def test_whole_shifts_are_exact(shift):
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]], float)
    x, y = source_coordinates(Homography(matrix), (4, 6))
    column, row = pixel_centers((4, 6))
    np.testing.assert_array_equal(x, np.broadcast_to(column - shift[0], (4, 6)))
    np.testing.assert_array_equal(y, np.broadcast_to(row - shift[1], (4, 6)))


@pytest.mark.sweep
@given(
    st.lists(st.floats(-0.9, 0.9), min_size=6, max_size=6),
    st.lists(st.floats(-0.12, 0.12), min_size=2, max_size=2),
)
@example([0.5, 0.0, 0.0, -0.5, -0.5, 0.0], [0.0, 0.0625])  # a pixel's center on the horizon
@settings(max_examples=60, deadline=None)
def test_homographies_agree_with_the_naive_loop(affine, perspective):
    matrix = np.eye(3) + np.append(affine, [*perspective, 0.0]).reshape(3, 3)
    assume(np.linalg.cond(matrix) < 1e4)
    x, y = source_coordinates(Homography(matrix), (6, 9), (8, 8))
    expected = naive_source(oriented(matrix, (8, 8)), (6, 9))
    is_clear = np.abs(np.nan_to_num(expected)).max(axis=0) < 1e6  # away from the horizon
    np.testing.assert_allclose(x[is_clear], expected[0][is_clear], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(y[is_clear], expected[1][is_clear], rtol=1e-6, atol=1e-6)


@pytest.mark.sweep
@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_a_homography_brings_the_source_coordinates_back(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + rng.uniform(-1, 1, (3, 3)) * [[0.6, 0.6, 20], [0.6, 0.6, 20], [0.03] * 3]
    homography = Homography(matrix)
    x, y = source_coordinates(homography, (5, 7), (16, 16))
    column, row = (np.broadcast_to(c, (5, 7)) for c in pixel_centers((5, 7)))
    seen = np.hypot(x, y) < 1e5  # away from the horizon
    back_x, back_y, d = moved(homography.oriented((16, 16)), x[seen], y[seen])
    assert (d > 0).all()
    np.testing.assert_allclose(back_x, column[seen], atol=1e-6)
    np.testing.assert_allclose(back_y, row[seen], atol=1e-6)


def test_a_backward_map_is_its_source_coordinates():
    x, y = np.mgrid[0:3, 0:4].astype(float)
    found = source_coordinates(BackwardMap(x, y), (3, 4))
    np.testing.assert_array_equal(found, (x, y))


def test_a_map_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"map of \(3, 4\) pixels does not fit"):
        source_coordinates(BackwardMap(np.zeros((3, 4)), np.zeros((3, 4))), (4, 3))


def test_a_forward_map_has_no_source_coordinates():
    with pytest.raises(ValueError, match="or its inverse"):
        source_coordinates(ForwardMap(np.zeros((3, 4)), np.zeros((3, 4))), (3, 4))


@pytest.mark.parametrize("shape", [(0, 5), (5, 0), (-1, 5)])
def test_a_target_without_pixels_is_refused(shape):
    with pytest.raises(ValueError, match="is empty"):
        source_coordinates(Homography(IDENTITY), shape)


# Maps.


@pytest.mark.parametrize("kind", [ForwardMap, BackwardMap])
@pytest.mark.parametrize(
    ("x", "y", "complaint"),
    [
        (np.zeros((3, 4)), np.zeros((4, 3)), "one size"),
        (np.zeros(3), np.zeros(3), "one size"),
        (np.zeros((0, 4)), np.zeros((0, 4)), "one size"),
        (np.zeros((2, 2), complex), np.zeros((2, 2)), "real numbers"),
        (np.full((2, 2), "a"), np.zeros((2, 2)), "real numbers"),
        (np.zeros((2, 2), bool), np.zeros((2, 2)), "real numbers"),
    ],
)
def test_what_is_no_map_is_refused(kind, x, y, complaint):
    with pytest.raises(ValueError, match=complaint):
        kind(x, y)


@pytest.mark.parametrize("kind", [ForwardMap, BackwardMap])
@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_a_place_that_is_no_number_is_none_in_both_directions(kind, hole):
    x, y = np.zeros((2, 2), np.float32), np.ones((2, 2), np.float32)
    x[0, 1] = hole
    y[1, 0] = hole
    found = kind(x, y)
    np.testing.assert_array_equal(found.x, [[0, np.nan], [np.nan, 0]])
    np.testing.assert_array_equal(found.y, [[1, np.nan], [np.nan, 1]])


def test_maps_are_float64():
    found = BackwardMap(np.zeros((2, 2), np.int16), np.zeros((2, 2), np.float32))
    assert found.x.dtype == found.y.dtype == np.float64


def test_a_flow_moves_texels_from_their_centers():
    flow = np.zeros((2, 3, 2), np.float32)
    flow[1, 2] = 10, -20
    found = ForwardMap.from_flow(flow)
    np.testing.assert_array_equal(found.x, [[0.5, 1.5, 2.5], [0.5, 1.5, 12.5]])
    np.testing.assert_array_equal(found.y, [[0.5, 0.5, 0.5], [1.5, 1.5, -18.5]])


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 3), (2, 4, 5), (0, 5, 2)])
def test_what_is_no_flow_is_refused(shape):
    with pytest.raises(ValueError, match=r"\(H, W, 2\)"):
        ForwardMap.from_flow(np.zeros(shape))


# OpenCV's maps.


def opencv_map():
    rng = np.random.default_rng(5)
    return (rng.uniform(-40, 900, (2, 12, 17))).astype(np.float32)


def test_opencv_counts_from_pixel_centers():
    x, y = opencv_map()
    found = BackwardMap.from_opencv(x, y)
    np.testing.assert_array_equal(found.x, x.astype(float) + 0.5)
    np.testing.assert_array_equal(found.y, y.astype(float) + 0.5)


def test_opencv_maps_may_be_one_array():
    x, y = opencv_map()
    together = BackwardMap.from_opencv(np.dstack([x, y]))
    apart = BackwardMap.from_opencv(x, y)
    np.testing.assert_array_equal((together.x, together.y), (apart.x, apart.y))


def test_opencv_s_fixed_point_maps_are_decoded_as_by_opencv():
    cv2 = pytest.importorskip("cv2")
    pair = cv2.convertMaps(*opencv_map(), cv2.CV_16SC2)
    expected = BackwardMap.from_opencv(*cv2.convertMaps(*pair, cv2.CV_32FC1))
    found = BackwardMap.from_opencv(*pair)
    np.testing.assert_array_equal((found.x, found.y), (expected.x, expected.y))


def test_a_map_reads_what_remap_reads():
    cv2 = pytest.importorskip("cv2")
    ramp = np.arange(20, dtype=np.float32) * np.ones((10, 1), np.float32)
    x = np.array([[3.25, 7.5], [11.0, 15.75]], np.float32)
    seen = cv2.remap(ramp, x, np.full_like(x, 4), cv2.INTER_LINEAR)
    # The ramp's value at a pixel's center is its column.
    np.testing.assert_allclose(BackwardMap.from_opencv(x, x).x - 0.5, seen, atol=1e-5)


@pytest.mark.parametrize(
    ("first", "second", "complaint"),
    [
        (np.zeros((4, 5), np.float32), np.zeros((5, 4), np.float32), "one size"),
        (np.zeros((4, 5), np.float32), None, r"\(H, W, 2\)"),
        (np.zeros((4, 5, 2), np.int16), np.zeros((5, 4), np.uint16), "do not fit"),
        (np.zeros((4, 5, 2), np.int16), np.zeros((4, 5), np.float32), "int16 and uint16"),
        (np.zeros((4, 5, 2), np.float32), np.zeros((4, 5), np.uint16), "int16 and uint16"),
        (np.zeros((4, 5, 3), np.float32), None, r"\(H, W, 2\)"),
    ],
)
def test_opencv_maps_that_do_not_fit_are_refused(first, second, complaint):
    with pytest.raises(ValueError, match=complaint):
        BackwardMap.from_opencv(first, second)
