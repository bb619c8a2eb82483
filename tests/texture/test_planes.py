import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample_texture.geometry.cameras import plane_homography
from resample_texture.geometry.mappings import source_coordinates

TEXTURE = (40, 60)
ABOVE = np.diag([1.0, -1.0, -1.0, 1.0])  # looks down along −z with +y upwards
TILTED = look_at((2, -3, 4), (0.3, 0.2, 0))


def seen(camera, point):
    """Frame coordinates of a point of the world, and its depth."""
    view = camera.view()
    x, y, depth = view.rotation @ point + view.translation
    scale = view.focal / (depth if view.perspective else 1.0)
    return np.append(scale * (x, y) + view.principal, depth)


def on_plane(u, v, texel_size):
    """A texel coordinate's place in the plane's space."""
    return np.array([texel_size * (u - 30), texel_size * (20 - v), 0.0])


def cameras():
    pose = TILTED
    return [Camera.from_intrinsics(50, 40, 32, 24, pose), Orthographic(30, 25, 32, 24, pose)]


@pytest.mark.parametrize("camera", cameras())
@pytest.mark.parametrize("place", [(0, 0), (60, 0), (60, 40), (17.5, 33.25)])
def test_texels_are_where_the_camera_sees_their_places(camera, place):
    homography = plane_homography(camera, TEXTURE, texel_size=0.05)
    x, y, d = homography.matrix @ [*place, 1.0]
    expected = seen(camera, on_plane(*place, 0.05))
    np.testing.assert_allclose((x / d, y / d), expected[:2], atol=1e-11)


def test_d_is_the_depth_of_a_perspective():
    camera = cameras()[0]
    d = plane_homography(camera, TEXTURE, texel_size=0.05).matrix[2] @ [17.5, 33.25, 1.0]
    assert d == pytest.approx(seen(camera, on_plane(17.5, 33.25, 0.05))[2])


def test_from_above_a_texture_looks_as_it_is():
    # Pose of a camera that looks straight down from a height
    pose = ABOVE.copy()
    pose[2, 3] = 10.0
    camera = Camera.from_intrinsics(100, 100, 30, 20, pose)
    found = plane_homography(camera, TEXTURE, texel_size=0.1)
    np.testing.assert_allclose(found.matrix / found.matrix[2, 2], np.eye(3), atol=1e-12)


def test_from_below_a_texture_is_mirrored():
    camera = Orthographic(1, 1, 30, 20)  # at the origin, looking along +z with y downwards
    found = plane_homography(camera, TEXTURE).matrix
    np.testing.assert_allclose(found, [[1, 0, 0], [0, -1, 40], [0, 0, 1]], atol=1e-12)


def test_a_pose_moves_the_plane():
    pose = np.eye(4)
    pose[:3, 3] = 0.5, -0.25, 1.0
    camera = cameras()[0]
    x, y, d = plane_homography(camera, TEXTURE, texel_size=0.05, pose=pose[:3]).matrix @ [9, 7, 1.0]
    expected = seen(camera, on_plane(9, 7, 0.05) + pose[:3, 3])
    np.testing.assert_allclose((x / d, y / d), expected[:2], atol=1e-11)


def test_a_floor_whose_center_is_behind_the_eye_is_below_the_horizon():
    eye_past_the_center = look_at((0, 4, 1), (0, 14, 1))
    camera = Camera.from_intrinsics(40, 40, 32, 24, eye_past_the_center)
    homography = plane_homography(camera, TEXTURE, texel_size=1.0)
    x, y = source_coordinates(homography, (48, 64), TEXTURE)
    assert np.isnan(x[:24]).all()
    assert np.isfinite(x[24:]).all()
    assert (y[24:] < 16).all()  # ahead of the eye, which stands above v = 20 − 4


def test_a_parallel_projection_has_nothing_behind_the_eye():
    x, _ = source_coordinates(plane_homography(cameras()[1], TEXTURE), (48, 64), TEXTURE)
    assert np.isfinite(x).all()


@pytest.mark.parametrize(
    "camera",
    [
        Camera.from_intrinsics(
            50, 50, 32, 24, look_at((0.3, -3, 0), (0.1, 0, 0.5))
        ),  # the eye is in the plane
        Orthographic(50, 50, 32, 24, look_at((0, -3, 1), (0.7, 0, 1))),
    ],
)
def test_a_plane_seen_edge_on_is_refused(camera):
    with pytest.raises(ValueError, match="edge-on"):
        plane_homography(camera, TEXTURE)


def test_a_plane_may_face_away_from_an_eye_outside_it():
    camera = Camera.from_intrinsics(
        50, 50, 32, 24, look_at((0, -3, 1), (0.7, 0, 1))
    )  # level, above the plane
    assert np.isfinite(plane_homography(camera, TEXTURE).matrix).all()


@pytest.mark.parametrize("texel_size", [0.0, -1.0, np.inf, np.nan])
def test_texels_without_a_size_are_refused(texel_size):
    with pytest.raises(ValueError, match="has no area"):
        plane_homography(cameras()[0], TEXTURE, texel_size=texel_size)


def test_a_texture_without_texels_is_refused():
    with pytest.raises(ValueError, match="has no area"):
        plane_homography(cameras()[0], (0, 5))


@pytest.mark.parametrize("pose", [np.eye(3), np.eye(2), np.zeros(12)])
def test_what_is_no_pose_is_refused(pose):
    with pytest.raises(ValueError, match=r"\(3, 4\) or \(4, 4\)"):
        plane_homography(cameras()[0], TEXTURE, pose=pose)


@pytest.mark.parametrize("pose", [np.zeros((3, 4)), np.full((3, 4), np.nan)])
def test_a_flat_pose_is_refused(pose):
    with pytest.raises(ValueError, match="flat"):
        plane_homography(cameras()[0], TEXTURE, pose=pose)
