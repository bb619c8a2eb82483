import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample_warp3d.depth.equation import (
    between,
    inverse,
    lens_places,
    of_rectified,
    places,
    warp_places,
)
from resample_warp3d.types import DepthImage
from tests.warp3d.naive_sheet import EMPTY, camera_at

SKEWED = Camera.from_intrinsics(80, -70, 31, 22, skew=3)  # y upward
ROUND = 1e-9  # px, of float64


def point_cloud(rng, count=200):
    """Points of the world before the cameras of these tests."""
    return rng.uniform((-2, -2, 3), (2, 2, 9), (count, 3))


def projected(camera, point):
    """Places (N, 2) and z (N,) of the world's points, straight from the pinhole's definition."""
    seen = point @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    place = seen @ camera.matrix.T
    return place[:, :2] / place[:, 2:], seen[:, 2]


TARGETS = {
    "moved": camera_at((0.4, -0.2, 0.5), 0.1, 0.3),
    "zoomed": camera_at((0.1, 0.0, -0.5), focal=200.0, shape=(30, 90)),
    "mirrored": Camera(
        SKEWED.matrix @ np.diag([-1.0, 1, 1]), camera_at((0, 0.1, 0)).world_to_camera
    ),
    "upside down": SKEWED.moved(camera_at((0.3, 0.1, -1.0), -0.2).world_to_camera),
}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("source", [camera_at((0.1, 0.2, 0.0), 0.05), SKEWED])
def test_it_takes_places_and_nearness_where_both_cameras_see_a_point(source, target, rng):
    point = point_cloud(rng)
    place, depth = projected(source, point)
    expected, expected_depth = projected(TARGETS[target], point)
    given, nearness = warp_places(between(source, TARGETS[target]), place, 1 / depth)
    np.testing.assert_allclose(given, expected, atol=ROUND)
    np.testing.assert_allclose(nearness, 1 / expected_depth, rtol=1e-12)


def test_of_a_plane_it_is_the_homography_with_the_planes_normal(rng):
    source, target = camera_at(), TARGETS["moved"]
    equation = between(source, target)
    normal = np.array([0.3, -0.2, 1.0]) / 5.0  # of the plane normal · X = 1
    linear = normal @ np.linalg.inv(source.matrix)  # nearness by homogeneous px
    place = rng.uniform(0, 64, (50, 2))
    homogeneous = np.column_stack([place, np.ones(50)])
    seen = homogeneous @ (equation.matrix + np.outer(equation.epipole, linear)).T
    given, _ = warp_places(equation, place, homogeneous @ linear)
    np.testing.assert_allclose(given, seen[:, :2] / seen[:, 2:], atol=ROUND)


@pytest.mark.parametrize("target", TARGETS)
def test_its_inverse_leads_back(target, rng):
    place, depth = projected(SKEWED, point_cloud(rng))
    equation = between(SKEWED, TARGETS[target])
    there = warp_places(equation, place, 1 / depth)
    back, nearness = warp_places(inverse(equation), *there)
    np.testing.assert_allclose(back, place, atol=ROUND)
    np.testing.assert_allclose(nearness, 1 / depth, rtol=1e-12)


def test_the_inverse_is_the_equation_of_the_cameras_exchanged():
    source, target = camera_at((0.1, 0, 0), 0.2), TARGETS["zoomed"]
    given, expected = inverse(between(source, target)), between(target, source)
    np.testing.assert_allclose(given.matrix, expected.matrix, atol=1e-12)
    np.testing.assert_allclose(given.epipole, expected.epipole, atol=1e-12)


def test_a_pure_rotation_does_not_depend_on_depth(rng):
    equation = between(camera_at((1, 2, 3)), camera_at((1, 2, 3), 0.2, 0.4))
    place = rng.uniform(0, 64, (50, 2))
    near, far = (warp_places(equation, place, np.full(50, n))[0] for n in (10.0, 0.0))
    np.testing.assert_allclose(near, far, atol=ROUND)


def test_the_epipole_is_where_the_target_sees_the_sources_eye():
    source, target = camera_at((0.5, 0.3, 4.0)), camera_at()
    epipole = between(source, target).epipole
    expected, _ = projected(target, np.array([[0.5, 0.3, 4.0]]))
    np.testing.assert_allclose(epipole[:2] / epipole[2], expected[0], atol=ROUND)


def test_what_is_infinitely_far_only_turns(rng):
    source, target = camera_at(), camera_at((3, 1, 2), 0.2)
    turned = camera_at((0, 0, 0), 0.2)
    place = rng.uniform(0, 64, (50, 2))
    given, nearness = warp_places(between(source, target), place, np.zeros(50))
    expected, _ = warp_places(between(source, turned), place, np.zeros(50))
    np.testing.assert_allclose(given, expected, atol=ROUND)
    assert not nearness.any()


@pytest.mark.parametrize("fraction", [1.0, -1.0, 0.5])
def test_rectified_pairs_move_by_their_fraction_of_the_disparity(fraction, rng):
    place, disparity = rng.uniform(0, 64, (50, 2)), rng.uniform(1, 30, 50)
    moved, nearness = warp_places(of_rectified(fraction), place, disparity)
    np.testing.assert_allclose(moved[:, 0], place[:, 0] - fraction * disparity, atol=ROUND)
    np.testing.assert_array_equal(moved[:, 1], place[:, 1])
    np.testing.assert_array_equal(nearness, disparity)


def test_a_rectified_pair_is_two_cameras_beside_each_other():
    left, right = camera_at(), camera_at((0.25, 0, 0))
    place, depth = np.array([[10.0, 20.0], [40.5, 3.0]]), np.array([2.0, 5.0])
    disparity = 64.0 * 0.25 / depth
    given, _ = warp_places(of_rectified(1.0), place, disparity)
    expected, _ = warp_places(between(left, right), place, 1 / depth)
    np.testing.assert_allclose(given, expected, atol=ROUND)


def test_behind_the_eye_there_is_no_place():
    place, nearness = warp_places(
        between(camera_at(), camera_at((0, 0, 3.0))), np.array([[32.0, 32.0]]), np.array([0.5])
    )
    assert np.isnan(place).all()
    assert np.isnan(nearness).all()


def test_samples_lie_at_pixel_centers_unless_the_lens_says_otherwise(rng):
    nearness, bent = np.ones((2, 3)), rng.random((2, 3, 2))
    center = places(DepthImage(EMPTY, nearness, EMPTY))
    np.testing.assert_array_equal(center[1, 2], [2.5, 1.5])
    assert center.shape == (2, 3, 2)
    np.testing.assert_array_equal(places(DepthImage(EMPTY, nearness, bent)), bent)


def test_a_camera_without_a_lens_has_no_places_of_one():
    assert lens_places(SKEWED, (80, 100)).shape == (0, 0, 2)


def test_a_parallel_camera_is_none_of_depth_images():
    with pytest.raises(ValueError, match="needs a Camera; got Orthographic"):
        between(SKEWED, Orthographic(5, 5, 1, 1))
