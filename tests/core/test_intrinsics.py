import subprocess
import sys

import numpy as np
import pytest

from resample.cameras.models import Camera, Convention, distortion
from resample.cameras.pixels import distorted_places, pixel_centers, undistorted_places
from resample.cameras.poses import camera_to_world, from_opengl
from tests.lenses import COEFFICIENTS, FOLDING, SHAPE

MATRIX = np.array([[90.0, 2.0, 49.0], [0.0, -85.0, 41.0], [0.0, 0.0, 1.0]])


def turned(angle):
    """Pose of a camera turned about y, rad, and moved."""
    pose = np.eye(4)
    pose[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    pose[:3, 3] = 0.3, -0.2, 0.1
    return pose


def seen(camera, point):
    """Place of a point of the world, px, by the definition of the camera."""
    x = camera.world_to_camera[:3, :3] @ point + camera.world_to_camera[:3, 3]
    homogeneous = camera.matrix @ x
    return homogeneous[:2] / homogeneous[2]


# Intrinsics.


def test_the_convention_of_opencv_counts_from_pixel_centers():
    corner = Camera.from_intrinsics(525, 525, 320, 240)
    opencv = Camera.from_intrinsics(525, 525, 319.5, 239.5, convention="opencv")
    np.testing.assert_array_equal(opencv.matrix, corner.matrix)


def test_the_first_pixel_s_center_is_at_a_half():
    camera = Camera.from_intrinsics(525, 525, 0, 0, convention=Convention.OPENCV)
    np.testing.assert_array_equal(seen(camera, np.array([0.0, 0.0, 1.0])), [0.5, 0.5])


def test_an_unknown_convention_names_the_known_ones():
    with pytest.raises(ValueError, match="known: corner, opencv"):
        Camera.from_intrinsics(1, 1, 0, 0, convention="center")


def test_a_field_of_view_fills_the_shorter_side():
    camera = Camera.from_fov(90, 60, 100)
    np.testing.assert_allclose(seen(camera, np.array([0.0, 1.0, 1.0])), [50, 60])


def test_a_field_of_view_of_180_degrees_is_refused():
    with pytest.raises(ValueError, match="between 0 and 180"):
        Camera.from_fov(180, 60, 100)


def test_resizing_scales_every_place():
    camera = Camera(MATRIX, turned(0.2))
    point = np.array([0.4, -0.3, 2.0])
    smaller = camera.resized((80, 100), (20, 50))
    np.testing.assert_allclose(seen(smaller, point), seen(camera, point) * [0.5, 0.25], rtol=1e-12)


def test_resizing_to_nothing_is_refused():
    with pytest.raises(ValueError, match="resized"):
        Camera(MATRIX).resized((80, 100), (0, 100))


def test_moving_keeps_intrinsics_and_lens():
    camera = Camera(MATRIX, distortion=np.array(FOLDING)).moved(turned(0.1))
    np.testing.assert_array_equal(camera.matrix, MATRIX)
    np.testing.assert_array_equal(camera.distortion, FOLDING)


@pytest.mark.parametrize(
    ("matrix", "complaint"),
    [
        (np.diag([0.0, 1.0, 1.0]), "singular"),
        (np.diag([1.0, 0.0, 1.0]), "singular"),
        (np.diag([1.0, np.nan, 1.0]), "finite"),
        (np.diag([1.0, 1.0, 2.0]), r"\[0, 0, 1\]"),
        (MATRIX.T, "skew"),
        (np.eye(3)[:2], r"shape \(3, 3\)"),
    ],
)
def test_what_is_no_matrix_of_intrinsics_is_refused(matrix, complaint):
    with pytest.raises(ValueError, match=complaint):
        Camera(matrix)


def test_a_negative_focal_length_mirrors_the_picture_alone():
    upright = Camera.from_intrinsics(90, 85, 49, 41, world_to_camera=turned(0.3))
    mirrored = Camera.from_intrinsics(90, -85, 49, 41, world_to_camera=turned(0.3))
    point = np.array([0.4, -0.3, 2.0])
    x, y = seen(upright, point)
    np.testing.assert_allclose(seen(mirrored, point), [x, 82 - y])


# Poses.


def test_the_pose_of_a_rounded_text_file_becomes_a_rotation():
    camera = Camera(MATRIX, np.round(turned(0.7), 4))
    rotation = camera.world_to_camera[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


def test_a_pose_of_three_rows_gets_its_fourth():
    np.testing.assert_array_equal(Camera(MATRIX, turned(0.0)[:3]).world_to_camera, turned(0.0))


def test_a_pose_that_is_not_rigid_is_refused_with_how_far_it_is():
    pose = turned(0.3)
    pose[:3, :3] *= 1.01
    with pytest.raises(ValueError, match=r"off by up to 0\.0201, allowed is 0\.0002"):
        Camera(MATRIX, pose)


@pytest.mark.parametrize(
    ("pose", "complaint"),
    [
        (np.diag([1.0, 1, -1, 1]), "mirrors"),
        (np.diag([1.0, 1, np.inf, 1]), "finite"),
        (turned(0.3).T, r"last row is 0 0 0 1, not 0\.3 -0\.2 0\.1 1; is it transposed"),
        (np.eye(3), r"shape \(3, 4\) or \(4, 4\)"),
    ],
)
def test_what_is_no_pose_is_refused(pose, complaint):
    with pytest.raises(ValueError, match=complaint):
        Camera(MATRIX, pose)


def test_camera_to_world_is_the_inverse():
    np.testing.assert_allclose(camera_to_world(turned(0.4)) @ turned(0.4), np.eye(4), atol=1e-15)


def test_a_camera_of_opengl_sees_up_as_up():
    pose = from_opengl(np.eye(4))  # at the origin, y up, along −z
    camera = Camera.from_fov(90, 100, 100, pose)
    x, y = seen(camera, np.array([0.1, 0.2, -1.0]))
    assert (x > 50, y < 50) == (True, True)


# Lenses.


@pytest.fixture(params=COEFFICIENTS)
def camera(request):
    return Camera(MATRIX, distortion=np.array(COEFFICIENTS[request.param]))


def test_undistorted_places_go_back_through_opencv_s_lens(camera):
    cv2 = pytest.importorskip("cv2")
    place = undistorted_places(camera, pixel_centers(SHAPE)).reshape(-1, 2)
    ray = np.column_stack([place, np.ones(len(place))]) @ np.linalg.inv(camera.matrix).T
    bent = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), np.eye(3), camera.distortion)[0][:, 0]
    found = bent @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    atol = 2e-7  # px; Newton's method stops at 1e-7, along either axis
    np.testing.assert_allclose(found.reshape(*SHAPE, 2), pixel_centers(SHAPE), atol=atol)


def test_undistorted_places_agree_with_opencv_s_where_it_converges():
    cv2 = pytest.importorskip("cv2")
    matrix, weak = np.array([[90.0, 0, 49], [0, 85, 41], [0, 0, 1]]), np.array([-0.05, 0.01, 0, 0])
    centers = pixel_centers(SHAPE).reshape(-1, 1, 2)
    expected = cv2.undistortPoints(centers, matrix, weak, P=matrix)
    found = undistorted_places(Camera(matrix, distortion=weak), pixel_centers(SHAPE)).reshape(
        -1, 1, 2
    )
    np.testing.assert_allclose(found, expected, atol=1e-3)  # OpenCV takes five steps


def test_distorting_leads_back(camera):
    place = distorted_places(camera, undistorted_places(camera, pixel_centers(SHAPE)))
    np.testing.assert_allclose(place, pixel_centers(SHAPE), atol=2e-7)


def test_a_lens_that_does_nothing_is_none():
    camera = Camera(MATRIX, distortion=np.zeros(5))
    assert camera.distortion is None


def test_places_that_no_light_reaches_are_not_numbers():
    camera = Camera.from_fov(90, 80, 100).moved(np.eye(4))
    camera = Camera(camera.matrix, distortion=np.array(FOLDING))
    radius = np.hypot(*np.moveaxis((pixel_centers(SHAPE) - [50, 40]) / 40, 2, 0))
    farthest = np.sqrt(2 / 3) * (1 - 1 / 3)
    is_lost = np.isnan(undistorted_places(camera, pixel_centers(SHAPE))).any(axis=2)
    np.testing.assert_array_equal(is_lost, radius > farthest)


def test_places_beyond_the_fold_are_not_distorted_back_into_the_picture():
    camera = Camera(np.eye(3), distortion=np.array(FOLDING))
    assert np.isnan(distorted_places(camera, np.array([1.2, 0.0]))).all()


def test_the_fold_is_where_the_radius_stops_to_grow():
    assert distortion(np.array(FOLDING)).fold == pytest.approx(2 / 3)  # its square


@pytest.mark.parametrize("given", [[0.1], [0.1, 0, 0, np.nan], [0.1] * 6])
def test_other_counts_of_coefficients_are_refused(given):
    with pytest.raises(ValueError, match="4, 5, 8, 12, 14 finite coefficients"):
        Camera(MATRIX, distortion=np.array(given))


@pytest.mark.parametrize(
    ("camera", "complaint"),
    [
        (Camera(np.diag([5.0, 5.0, 1.0]), distortion=np.array(FOLDING)), "a lens .* distorts"),
        (Camera(MATRIX), "without skew, not with fx 90, fy -85 and skew 2"),
    ],
)
def test_what_painters_of_scenes_do_not_know_of_a_camera_is_refused(camera, complaint):
    with pytest.raises(ValueError, match=complaint):
        camera.view()


def test_importing_cameras_and_files_of_poses_loads_nothing_heavy():
    code = (
        "import sys, resample.cameras.files\n"
        "heavy = {'numba', 'cv2', 'OpenImageIO', 'scipy', 'trimesh', 'matplotlib', 'PIL'}\n"
        "print(*sorted(heavy & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""
