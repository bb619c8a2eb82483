"""OpenCV's fisheye lens, a rectifying rotation and a new camera matrix, against OpenCV."""

import numpy as np
import pytest

from resample.cameras.calibrations import pinhole_of
from resample.cameras.models import Camera
from resample_texture.geometry.mappings import pixel_centers
from tests.lenses import COEFFICIENTS, SHAPE
from tests.texture.lens_maps import distorting, undistorting, undistorting_forward

cv2 = pytest.importorskip("cv2")

CAMERA = np.array([[40.0, 0.0, 49.0], [0.0, 42.0, 41.0], [0.0, 0.0, 1.0]])
PINHOLE = np.array([[30.0, 0.0, 47.0], [0.0, 33.0, 38.0], [0.0, 0.0, 1.0]])
FISHEYES = {
    "equidistant": [0.0, 0.0, 0.0, 0.0],
    "barrel": [-0.05, 0.01, -0.003, 0.0005],
    "pincushion": [0.1, 0.05, 0.0, 0.0],
}
FOLDING = [-0.5, 0.0, 0.0, 0.0]  # θ (1 − θ² / 2) grows up to θ² = 2 / 3 and then falls
TURNS = {"none": (0.0, 0.0, 0.0), "small": (0.02, -0.1, 0.05), "large": (0.3, 0.5, -0.4)}
FLOAT32 = 3e-5  # px, what OpenCV's maps of about 100 px are rounded to


@pytest.fixture(params=FISHEYES)
def coefficients(request):
    return np.array(FISHEYES[request.param])


@pytest.fixture(params=TURNS)
def rotation(request):
    return cv2.Rodrigues(np.array(TURNS[request.param]))[0]


def wide(coefficients):
    return Camera.from_opencv(CAMERA, coefficients, model="fisheye")


def axes_of(rotation):
    """Depth, in the camera's axes, of the point that each pixel of the pinhole sees."""
    x, y = np.broadcast_arrays(*pixel_centers(SHAPE))
    pixel = np.stack([x - 0.5, y - 0.5, np.ones(SHAPE)], axis=2)
    return pixel @ np.linalg.inv(PINHOLE).T @ rotation


# Taking the distortion out.


def test_a_fisheye_is_undistorted_as_by_opencv(coefficients, rotation):
    expected = cv2.fisheye.initUndistortRectifyMap(
        CAMERA, coefficients, rotation, PINHOLE, SHAPE[::-1], cv2.CV_32FC1
    )
    found = undistorting(
        wide(coefficients), SHAPE, ideal=Camera.from_opencv(PINHOLE), rotation=rotation
    )
    is_seen = np.isfinite(found.x)
    np.testing.assert_array_equal(is_seen, axes_of(rotation)[..., 2] > 0)
    for ours, theirs in zip((found.x, found.y), expected, strict=True):
        np.testing.assert_allclose((ours - 0.5)[is_seen], theirs[is_seen], atol=FLOAT32)


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_a_pinhole_s_lens_is_rectified_as_by_opencv(name, rotation):
    camera = CAMERA * np.array([[3.0, 1, 1], [1, 3.0, 1], [1, 1, 1]])
    lens = np.array(COEFFICIENTS[name])
    matrix = np.array([[110.0, 0, 47], [0, 120, 38], [0, 0, 1]])
    expected = cv2.initUndistortRectifyMap(
        camera, lens, rotation, matrix, SHAPE[::-1], cv2.CV_32FC1
    )
    found = undistorting(
        Camera.from_opencv(camera, lens), SHAPE, ideal=Camera.from_opencv(matrix), rotation=rotation
    )
    is_seen = np.isfinite(found.x)
    assert is_seen.mean() > 0.3
    for ours, theirs in zip((found.x, found.y), expected, strict=True):
        np.testing.assert_allclose((ours - 0.5)[is_seen], theirs[is_seen], rtol=1e-6, atol=FLOAT32)


def test_the_pinhole_is_the_camera_s_own_unless_another_is_given(coefficients):
    expected = cv2.fisheye.initUndistortRectifyMap(
        CAMERA, coefficients, np.eye(3), CAMERA, SHAPE[::-1], cv2.CV_32FC1
    )
    found = undistorting(wide(coefficients), SHAPE)
    np.testing.assert_allclose((found.x - 0.5, found.y - 0.5), expected, atol=FLOAT32)


def test_beyond_the_fold_a_pinhole_sees_nothing():
    found = undistorting(wide(FOLDING), SHAPE, ideal=Camera.from_opencv([20.0, 20.0, 49.5, 39.5]))
    column, row = pixel_centers(SHAPE)
    angle = np.arctan(np.hypot((column - 50) / 20, (row - 40) / 20))
    np.testing.assert_array_equal(np.isfinite(found.x), angle**2 < 2 / 3)


# Putting it in, and texels on their way out.


def test_texels_go_where_opencv_s_points_do(coefficients, rotation):
    x, y = np.broadcast_arrays(*pixel_centers(SHAPE))
    points = np.stack([x.ravel(), y.ravel()], axis=1)[:, None] - 0.5
    expected = cv2.fisheye.undistortPoints(
        points, CAMERA, coefficients, R=rotation, P=PINHOLE
    ).reshape(*SHAPE, 2)
    found = undistorting_forward(
        wide(coefficients), SHAPE, ideal=Camera.from_opencv(PINHOLE), rotation=rotation
    )
    place = np.stack([found.x, found.y], axis=2) - 0.5
    is_near = np.isfinite(place).all(axis=2) & (np.abs(place) < 500).all(axis=2)
    is_near &= np.hypot((x - 49.5) / 40, (y - 41.5) / 42) < np.pi / 2  # OpenCV takes no more
    assert is_near.mean() > 0.5
    np.testing.assert_allclose(place[is_near], expected[is_near], atol=1e-3)


def test_distorting_is_undone_by_undistorting(coefficients, rotation):
    lens, ideal = wide(coefficients), Camera.from_opencv(PINHOLE)
    there = distorting(lens, SHAPE, ideal=ideal, rotation=rotation)
    is_seen = np.isfinite(there.x) & (np.hypot(there.x, there.y) < 1e4)
    ray = np.stack([there.x - 0.5, there.y - 0.5, np.ones(SHAPE)], axis=2)[is_seen]
    ray = ray @ np.linalg.inv(PINHOLE).T @ rotation
    back = cv2.fisheye.projectPoints(
        ray[:, None], np.zeros(3), np.zeros(3), CAMERA, np.asarray(coefficients)
    )[0].reshape(-1, 2)
    x, y = np.broadcast_arrays(*pixel_centers(SHAPE))
    expected = np.stack([x[is_seen], y[is_seen]], axis=1) - 0.5
    np.testing.assert_allclose(back, expected, atol=1e-6)
    assert is_seen.mean() > 0.5


def test_where_no_light_comes_through_there_is_nothing():
    lens = Camera.from_opencv([45.0, 45.0, 49.5, 39.5], FOLDING, model="fisheye")
    found = distorting(lens, SHAPE)
    column, row = pixel_centers(SHAPE)
    radius = np.hypot((column - 50) / 45, (row - 40) / 45)
    rim = np.sqrt(2 / 3) * 2 / 3  # θ (1 − θ² / 2) at θ² = 2 / 3
    np.testing.assert_array_equal(np.isfinite(found.x), radius < rim)


@pytest.mark.some(1)
def test_texels_go_where_the_backward_map_fetches_them(coefficients, rotation):
    ways = (undistorting_forward, distorting)
    forward, backward = (way(wide(coefficients), SHAPE, rotation=rotation) for way in ways)
    np.testing.assert_array_equal((forward.x, forward.y), (backward.x, backward.y))


def test_the_middle_of_the_picture_stays_where_it_is(coefficients):
    lens = Camera.from_opencv([40.0, 40.0, 50.0, 40.0], coefficients, model="fisheye")
    for geometry in (undistorting(lens, SHAPE), distorting(lens, SHAPE)):
        assert (geometry.x[40, 50], geometry.y[40, 50]) == (50.5, 40.5)


# What is given.


def test_a_projection_of_three_by_four_is_a_new_matrix():
    projection = np.column_stack([PINHOLE, [12.0, 0.0, 0.0]])
    np.testing.assert_array_equal(pinhole_of(projection).matrix, pinhole_of(PINHOLE).matrix)


@pytest.mark.parametrize("count", [1, 3, 5, 8])
def test_another_count_of_coefficients_is_refused(count):
    with pytest.raises(ValueError, match="a fisheye lens has 4 finite coefficients"):
        Camera.from_opencv(CAMERA, np.zeros(count), model="fisheye")


def test_coefficients_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="4 finite coefficients"):
        Camera.from_opencv(CAMERA, [0, np.nan, 0, 0], model="fisheye")


def test_an_unknown_model_lists_the_known_ones():
    with pytest.raises(ValueError, match="known: pinhole, fisheye"):
        Camera.from_opencv(CAMERA, np.zeros(4), model="mirror")


@pytest.mark.parametrize(
    ("rotation", "complaint"),
    [
        (np.eye(2), r"a matrix \(3, 3\)"),
        (np.diag([1.0, 1.0, 1.1]), "not orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), "mirrors"),
        (np.full((3, 3), np.nan), "finite"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation, complaint):
    with pytest.raises(ValueError, match=complaint):
        undistorting(wide(np.zeros(4)), SHAPE, rotation=rotation)
