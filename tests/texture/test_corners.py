from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from resample_texture.geometry.mappings import source_coordinates
from resample_texture.geometry.matrices import (
    from_corners,
    order_corners,
    page_corners,
    parse_points,
    rectified_shape,
)

PAGE = np.array([[10.0, 20.0], [500.0, 30.0], [490.0, 700.0], [5.0, 680.0]])
SQUARE = page_corners((100, 100))


def moved(matrix, points):
    """Points (N, 2) after a homography, and their d."""
    full = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return full[:, :2] / full[:, 2:], full[:, 2]


def turned(points, degrees):
    a = np.radians(degrees)
    return points @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


# Homographies of four corners.


def test_corners_go_to_corners():
    found, _ = moved(from_corners(PAGE, SQUARE).matrix, PAGE)
    np.testing.assert_allclose(found, SQUARE, atol=1e-10)


@pytest.mark.sweep
@given(st.lists(st.floats(-40, 40), min_size=16, max_size=16))
@settings(max_examples=60, deadline=None)
def test_jittered_corners_go_to_jittered_corners(jitter):
    source, target = np.reshape(jitter, (2, 4, 2)) + page_corners((200, 300))
    found, d = moved(from_corners(source, target).matrix, source)
    np.testing.assert_allclose(found, target, atol=1e-9)
    assert (d > 0).all()


def test_corners_agree_with_opencv():
    cv2 = pytest.importorskip("cv2")
    expected = cv2.getPerspectiveTransform(PAGE.astype(np.float32), SQUARE.astype(np.float32))
    found = from_corners(PAGE, SQUARE).matrix
    np.testing.assert_allclose(found / found[2, 2], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -7.0), (12345.0, 0.5)])
def test_shifted_corners_are_that_shift_exactly(shift):
    found = from_corners(PAGE + 0.25, PAGE + 0.25 + shift).matrix
    np.testing.assert_array_equal(found, [[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]])


def test_an_affine_map_has_no_perspective_at_all():
    found = from_corners(SQUARE, SQUARE @ [[1.7, 0.2], [-0.3, 0.9]] + [3, 5]).matrix
    np.testing.assert_allclose(found[2], [0, 0, 1], atol=1e-15)


def test_mirrored_corners_are_seen():
    found, d = moved(from_corners(SQUARE, SQUARE[::-1]).matrix, SQUARE)
    np.testing.assert_allclose(found, SQUARE[::-1], atol=1e-10)
    assert (d > 0).all()


def test_corners_far_from_the_origin_keep_their_places():
    found, _ = moved(from_corners(PAGE + 1e6, SQUARE + 1e6).matrix, PAGE + 1e6)
    np.testing.assert_allclose(found, SQUARE + 1e6, atol=1e-3)  # 1e6 px in 16 digits, twice


def test_the_corners_are_in_front_of_the_eye_even_if_the_picture_s_center_is_not():
    road = np.array([[45.0, 80.0], [55.0, 80.0], [100.0, 100.0], [0.0, 100.0]])  # horizon: row 77.8
    x, y = source_coordinates(from_corners(road, SQUARE), (100, 100), (100, 100))
    assert np.isfinite(x).all()
    assert y.min() > 80


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [1, 1], [2, 2], [0, 5]],
        [[0, 0], [0, 0], [2, 2], [0, 5]],
        [[0, 0], [9, 0], [9, 9], [0, 1e-9]],
        [[1e6, 0], [1e6, 1], [1e6, 2], [0, 5]],
        np.zeros((4, 2)),
    ],
)
def test_three_corners_on_a_line_are_refused(corners):
    with pytest.raises(ValueError, match="source's points lie on a line or coincide"):
        from_corners(corners, SQUARE)
    with pytest.raises(ValueError, match="target's points lie on a line or coincide"):
        from_corners(SQUARE, corners)


@pytest.mark.parametrize("order", [(0, 2, 1, 3), (1, 0, 2, 3), (0, 1, 3, 2)])
def test_corners_in_two_orders_are_refused(order):
    with pytest.raises(ValueError, match="give both in the same order"):
        from_corners(PAGE, SQUARE[list(order)])


def test_a_corner_inside_the_other_three_is_refused():
    with pytest.raises(ValueError, match="no camera sees"):
        from_corners(SQUARE, [[0, 0], [100, 0], [30, 30], [0, 100]])


@pytest.mark.parametrize(
    ("corners", "complaint"),
    [
        (np.zeros((3, 2)), r"\(4, 2\), not \(3, 2\)"),
        (np.zeros(8), r"\(4, 2\), not \(8,\)"),
        ([[0, 0], [9, 0], [9, np.nan], [0, 9]], "finite"),
        ([[0, 0], [9, 0], [9, np.inf], [0, 9]], "finite"),
        ([[0, 0], [9, 0], [9, 1e200], [0, 9]], "within 1e"),
    ],
)
def test_what_is_not_four_corners_is_refused(corners, complaint):
    with pytest.raises(ValueError, match=complaint):
        from_corners(corners, SQUARE)


# Points as they are written.


@pytest.mark.parametrize(
    "text",
    ["10,20 500,30 490,700 5,680", "10,20;500,30;490,700;5,680", "10, 20, 500, 30, 490 700 5 680"],
)
def test_eight_numbers_are_four_points(text):
    np.testing.assert_array_equal(parse_points(text), PAGE)


@pytest.mark.parametrize(
    "text", ["", "1,2 3,4 5,6", "1,2 3,4 5,6 7", "1,2 3,4 5,6 7,x", "nan," * 8]
)
def test_a_text_that_is_not_four_points_is_refused(text):
    with pytest.raises(ValueError, match="is not four points like"):
        parse_points(text)


# Pages.


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_corners_in_any_order_are_put_in_order(order):
    np.testing.assert_array_equal(order_corners(PAGE[list(order)]), PAGE)


@pytest.mark.parametrize("degrees", [-44, -20, 0, 33, 44])
@pytest.mark.parametrize("shape", [(30, 300), (300, 30), (100, 100)])
def test_a_page_turned_by_less_than_45_degrees_keeps_its_top(degrees, shape):
    page = turned(page_corners(shape), degrees)
    np.testing.assert_array_equal(order_corners(page[[2, 0, 3, 1]]), page)


@pytest.mark.parametrize("degrees", [45, 135, -45])
def test_a_page_turned_by_45_degrees_has_no_top(degrees):
    with pytest.raises(ValueError, match="turned by 45 degrees"):
        order_corners(turned(SQUARE, degrees))


def test_corners_of_no_convex_shape_have_no_order():
    with pytest.raises(ValueError, match="do not bound a convex shape"):
        order_corners([[0, 0], [100, 0], [30, 30], [0, 100]])


def test_corners_on_a_line_have_no_order():
    with pytest.raises(ValueError, match="page's points lie on a line"):
        order_corners([[0, 0], [100, 0], [50, 0], [0, 100]])


@pytest.mark.sweep
@given(st.integers(0, 10**6))
@example(665)  # narrow and askew: the likest square puts the page's bottom above its top
@example(112569)
@settings(max_examples=60, deadline=None)
def test_ordered_corners_run_clockwise_from_the_top_left(seed):
    page = np.random.default_rng(seed).uniform(0, 100, (4, 2))
    try:
        top_left, top_right, bottom_right, bottom_left = order_corners(page)
    except ValueError:
        assume(False)
    assert (top_right + bottom_right)[0] > (top_left + bottom_left)[0]
    assert (bottom_left + bottom_right)[1] > (top_left + top_right)[1]


def test_the_shape_of_an_upright_page_is_its_own():
    assert rectified_shape(page_corners((297, 210)) + 17) == (297, 210)


def test_the_shape_of_a_page_is_the_mean_of_its_opposite_sides():
    trapezoid = [[30, 0], [70, 0], [100, 40], [0, 40]]
    assert rectified_shape(trapezoid) == (50, 70)


def test_a_page_is_at_least_a_pixel():
    assert rectified_shape(page_corners((1, 1)) * 0.3) == (1, 1)


def test_crossed_corners_are_no_page():
    with pytest.raises(ValueError, match="give top left, top right, bottom right, bottom left"):
        rectified_shape(PAGE[[0, 2, 1, 3]])
