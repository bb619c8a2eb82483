import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers as centers
from resample.cameras.pixels import undistorted_places
from resample_texture.geometry.mappings import pixel_centers
from tests.lenses import COEFFICIENTS, FOLDING, SHAPE
from tests.texture.lens_maps import distorting, undistorting, undistorting_forward

CAMERA = np.array([[90.0, 0.0, 49.0], [0.0, 85.0, 41.0], [0.0, 0.0, 1.0]])
LENSES = {"none": [0.0, 0, 0, 0], **COEFFICIENTS}


@pytest.fixture(params=LENSES)
def lens(request):
    return Camera.from_opencv(CAMERA, np.array(LENSES[request.param]))


def through(lens, x, y):
    """Places in the photo of places in the pinhole's picture, by OpenCV."""
    import cv2

    ray = np.stack([(x - 0.5 - 49) / 90, (y - 0.5 - 41) / 85, np.ones_like(x)], axis=-1)
    places, _ = cv2.projectPoints(
        ray.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), CAMERA, lens.distortion
    )
    return np.moveaxis(places.reshape(*x.shape, 2) + 0.5, -1, 0)


# Taking the distortion out.


def test_undistorting_agrees_with_opencv_s_projection(lens):
    x, y = (np.ascontiguousarray(np.broadcast_to(c, SHAPE)) for c in pixel_centers(SHAPE))
    found = undistorting(lens, SHAPE)
    np.testing.assert_allclose((found.x, found.y), through(lens, x, y), atol=1e-9)


def test_undistorting_agrees_with_opencv_s_map(lens):
    cv2 = pytest.importorskip("cv2")
    pinhole = np.array([[70.0, 0, 45], [0, 75, 38], [0, 0, 1]])
    expected = cv2.initUndistortRectifyMap(
        CAMERA, lens.distortion, None, pinhole, SHAPE[::-1], cv2.CV_32FC1
    )
    found = undistorting(lens, SHAPE, ideal=Camera.from_opencv(pinhole))
    atol = 2e-5  # OpenCV's are float32
    np.testing.assert_allclose((found.x - 0.5, found.y - 0.5), expected, atol=atol)


def test_a_lens_without_distortion_changes_nothing():
    for geometry in (
        undistorting(Camera.from_opencv(CAMERA, np.zeros(4)), SHAPE),
        distorting(Camera.from_opencv(CAMERA, np.zeros(4)), SHAPE),
        undistorting_forward(Camera.from_opencv(CAMERA, np.zeros(4)), SHAPE),
    ):
        expected = np.broadcast_arrays(*pixel_centers(SHAPE))
        np.testing.assert_allclose((geometry.x, geometry.y), expected, atol=1e-12)


def test_beyond_the_fold_a_pinhole_sees_nothing():
    wide = [20.0, 20.0, 49.5, 39.5]
    found = undistorting(
        Camera.from_opencv(CAMERA, np.array(FOLDING)), SHAPE, ideal=Camera.from_opencv(wide)
    )
    column, row = pixel_centers(SHAPE)
    radius = np.hypot((column - 50) / 20, (row - 40) / 20)
    np.testing.assert_array_equal(np.isfinite(found.x), radius**2 < 2 / 3)


def test_a_pole_of_the_denominator_ends_the_picture():
    lens = Camera.from_opencv([20.0, 20.0, 49.5, 39.5], np.array([0, 0, 0, 0, 0, -1.0, 0, 0]))
    column, row = pixel_centers(SHAPE)
    radius = np.hypot((column - 50) / 20, (row - 40) / 20)
    np.testing.assert_array_equal(np.isfinite(undistorting(lens, SHAPE).x), radius < 1)


# Putting it in, and texels on their way out.


def test_distorting_is_undone_by_the_lens(lens):
    found = distorting(lens, SHAPE)
    assert np.isfinite(found.x).all()
    expected = np.broadcast_arrays(*pixel_centers(SHAPE))
    np.testing.assert_allclose(through(lens, found.x, found.y), expected, atol=1e-6)


def test_texels_go_where_the_backward_map_fetches_them(lens):
    forward, backward = undistorting_forward(lens, SHAPE), distorting(lens, SHAPE)
    np.testing.assert_array_equal((forward.x, forward.y), (backward.x, backward.y))


def test_another_pinhole_is_regarded_on_the_way_back(lens):
    same, other = (
        distorting(lens, SHAPE),
        distorting(lens, SHAPE, ideal=Camera.from_opencv([45, 170, 10, 20])),
    )
    np.testing.assert_allclose(other.x, (same.x - 0.5 - 49) / 2 + 10.5, atol=1e-9)
    np.testing.assert_allclose(other.y, (same.y - 0.5 - 41) * 2 + 20.5, atol=1e-9)


def test_where_no_light_comes_through_there_is_nothing():
    lens = Camera.from_opencv([45.0, 45.0, 49.5, 39.5], np.array(FOLDING))
    found = distorting(lens, SHAPE)
    column, row = pixel_centers(SHAPE)
    radius = np.hypot((column - 50) / 45, (row - 40) / 45)
    rim = np.sqrt(2 / 3) * 2 / 3  # r (1 − r² / 2) at r² = 2 / 3
    np.testing.assert_array_equal(np.isfinite(found.x), radius < rim)


def test_what_comes_through_is_on_the_near_side_of_the_fold():
    found = distorting(Camera.from_opencv([45.0, 45.0, 49.5, 39.5], np.array(FOLDING)), SHAPE)
    radius = np.hypot((found.x - 50) / 45, (found.y - 40) / 45)
    assert np.nanmax(radius) < np.sqrt(2 / 3)


def test_a_strong_lens_is_undone_far_from_its_axis():
    strong = Camera.from_opencv([90.0, 90, 96, 54], LENSES["rational"])
    wide = Camera.from_opencv([25.0, 25, 96, 54])  # sees as far as 4 from the axis, at distance 1
    seen = undistorting(strong, (108, 192), ideal=wide)  # one turns back at 3.6
    place = np.stack([seen.x, seen.y], axis=2)
    found = undistorted_places(strong, place, wide)
    there = np.isfinite(seen.x)
    np.testing.assert_allclose(
        found[there], centers((108, 192))[there], atol=1e-3
    )  # flat near the fold


def test_a_frame_s_blocks_do_not_show():
    wide = Camera.from_opencv([900.0, 900.0, 199.5, 99.5], np.array(LENSES["prism"]))
    whole = distorting(wide, (200, 400))  # three blocks
    part = distorting(wide, (81, 400))  # its first 81 rows, in one
    np.testing.assert_array_equal(whole.x[:81], part.x)


# Bad input.


@pytest.mark.parametrize("count", [0, 1, 3, 6, 13, 15])
def test_another_count_of_coefficients_is_refused(count):
    with pytest.raises(ValueError, match="4, 5, 8, 12, 14 finite coefficients"):
        Camera.from_opencv(CAMERA, np.zeros(count))


def test_coefficients_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="finite coefficients"):
        Camera.from_opencv(CAMERA, np.array([0, np.nan, 0, 0]))


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(2),
        np.zeros((3, 3)),
        [90, 85, 49],
        [0, 85, 49, 41],
        [90, 85, np.inf, 41],
        [[90, 0, 49], [0, 85, 41], [0, 0, 2]],
        [[90, 0, 49], [0, 85, 41], [1e-3, 0, 1]],
    ],
)
def test_what_is_no_camera_matrix_is_refused(matrix):
    with pytest.raises(ValueError, match="intrinsics"):
        Camera.from_opencv(matrix, np.zeros(4))


def test_skew_is_regarded_on_both_sides_of_the_lens():
    matrix = np.array([[90.0, 7.0, 49.0], [0.0, 85.0, 41.0], [0.0, 0.0, 1.0]])
    skewed = Camera.from_opencv(matrix, LENSES["barrel"])
    straight = Camera.from_opencv(CAMERA, LENSES["barrel"])
    found, expected = (undistorting(c, SHAPE, ideal=straight) for c in (skewed, straight))
    np.testing.assert_allclose(found.y, expected.y, atol=1e-12)
    np.testing.assert_allclose(found.x, expected.x + 7.0 * (expected.y - 41.5) / 85.0, atol=1e-12)


def test_four_numbers_are_a_camera_matrix():
    expected = np.array([[90, 0, 49.5], [0, 85, 41.5], [0, 0, 1]])
    np.testing.assert_array_equal(Camera.from_opencv([90, 85, 49, 41]).matrix, expected)


def test_a_frame_without_pixels_is_refused():
    with pytest.raises(ValueError, match="pictures of one size"):
        undistorting(Camera.from_opencv(CAMERA, np.zeros(4)), (0, 5))
