import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at, orbit
from resample.cameras.viewpoints import Orbit
from resample.painting.scenes import nothing_painted
from resample.resampler import Resampler
from resample.types import Samples

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def seen(pose, point):
    """A point in camera axes: x right, y down, z forward."""
    return pose[:3, :3] @ np.asarray(point, float) + pose[:3, 3]


# Poses.


def test_a_camera_looks_at_its_target():
    pose = look_at((1, 2, 3), (4, -2, 5))
    np.testing.assert_allclose(seen(pose, (1, 2, 3)), 0, atol=1e-12)
    np.testing.assert_allclose(seen(pose, (4, -2, 5)), (0, 0, np.sqrt(29)), atol=1e-12)


def test_up_is_up_in_the_picture():
    pose = look_at((3, -4, 2), (0, 0, 0), (0, 0, 1))
    assert seen(pose, (0, 0, 1))[1] < 0  # y points down
    assert seen(pose, (0, 0, 1))[0] == pytest.approx(0, abs=1e-12)


def test_right_is_right_in_the_picture():
    pose = look_at((0, -5, 0), (0, 0, 0))
    np.testing.assert_allclose(seen(pose, (1, 0, 0)), (1, 0, 5), atol=1e-12)


@pytest.mark.parametrize("forward", [(0, 0, 1), (0, 0, -1)])
def test_up_along_the_view_is_replaced(forward):
    pose = look_at((0, 0, 0), forward, (0, 0, 1))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(seen(pose, forward), (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize(
    ("eye", "target", "up"),
    [
        ((1, 2, 3), (1, 2, 3), (0, 0, 1)),
        ((np.nan, 0, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (np.inf, 0, 0), (0, 0, 1)),
        ((0, 0, 0), (1, 0, 0), (0, np.nan, 1)),
    ],
)
def test_a_view_without_a_direction_is_refused(eye, target, up):
    with pytest.raises(ValueError, match="cannot look at"):
        look_at(eye, target, up)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z", "−z"])
@pytest.mark.parametrize("azimuth", [0, 37, 180, -90])
@pytest.mark.parametrize("elevation", [0, 50, -50, 90, -90])
def test_an_orbit_keeps_its_target_in_the_middle_and_up_above(up, azimuth, elevation):
    pose = orbit((1, 2, 3), 4.0, azimuth, elevation, up)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(seen(pose, (1, 2, 3)), (0, 0, 4), atol=1e-9)
    upward = np.array(AXES[up[-1]]) * (-1 if len(up) > 1 else 1)
    turned = pose[:3, :3] @ upward
    np.testing.assert_allclose(turned[0], 0, atol=1e-9)
    assert turned[1] == pytest.approx(-np.cos(np.radians(elevation)), abs=1e-9)


def test_an_orbit_starts_in_front_and_walks_to_the_right():
    np.testing.assert_allclose(seen(orbit((0, 0, 0), 5, 0, 0), (1, 0, 0)), (1, 0, 5), atol=1e-12)
    np.testing.assert_allclose(seen(orbit((0, 0, 0), 5, 90, 0), (0, 1, 0)), (1, 0, 5), atol=1e-12)
    np.testing.assert_allclose(seen(orbit((0, 0, 0), 5, 0, 90), (0, 0, 5)), 0, atol=1e-12)


def test_an_orbit_over_the_pole_turns_smoothly():
    rotations = [orbit((0, 0, 0), 5, 20, e)[:3, :3] for e in np.arange(80, 101, 1.0)]
    steps = np.abs(np.diff(rotations, axis=0)).max(axis=(1, 2))
    assert steps.max() < 1.01 * np.radians(1)


def test_an_orbit_lists_the_axes_it_knows():
    with pytest.raises(ValueError, match="x, y, z, -x, -y or -z"):
        orbit((0, 0, 0), 5, 0, 0, up="w")


# Projections.


@pytest.mark.parametrize(("height", "width"), [(30, 40), (40, 30)])
def test_the_field_of_view_spans_the_shorter_side(height, width):
    camera = Camera.from_fov(60.0, height=height, width=width)
    assert 2 * np.degrees(np.arctan(15 / camera.fx)) == pytest.approx(60)
    assert camera.fx == camera.fy
    assert (camera.cx, camera.cy) == (width / 2, height / 2)


@pytest.mark.parametrize("fov", [0, 180, -10, 200, np.nan])
def test_a_field_of_view_beyond_half_a_circle_is_refused(fov):
    with pytest.raises(ValueError, match="between 0 and 180"):
        Camera.from_fov(fov, height=10, width=10)


@pytest.mark.parametrize("kind", [Camera.from_intrinsics, Orthographic])
@pytest.mark.parametrize("scales", [(0, 1), (1, -2)])
def test_a_scale_that_is_not_above_zero_is_refused(kind, scales):
    with pytest.raises(ValueError, match=r"above 0|neither can be 0"):
        kind(*scales, 1, 1).view()


@pytest.mark.parametrize("kind", [Camera.from_intrinsics, Orthographic])
@pytest.mark.parametrize("place", range(5))
def test_numbers_that_are_not_finite_are_refused(kind, place):
    numbers = [5.0, 5.0, 1.0, 1.0]
    near = np.nan if place == 4 else 0.0
    if place < 4:
        numbers[place] = np.inf
    with pytest.raises(ValueError, match=r"finite|the near plane at nan"):
        kind(*numbers, near=near)


def test_a_near_plane_behind_the_eye_is_refused_in_perspective_only():
    with pytest.raises(ValueError, match="behind the eye"):
        Camera.from_intrinsics(5, 5, 1, 1, near=-0.1)
    assert Orthographic(5, 5, 1, 1, near=-0.1).view().near == -0.1


MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0])
BAD_POSES = {
    "mirrored": MIRRORED,
    "scaled": np.diag([2.0, 2.0, 2.0, 1.0]),
    "sheared": np.eye(4) + np.eye(4, k=1) * 0.1,
    "nan": np.full((4, 4), np.nan),
    "zero": np.zeros((4, 4)),
}


@pytest.mark.parametrize("kind", [Camera.from_intrinsics, Orthographic])
@pytest.mark.parametrize("pose", BAD_POSES.values(), ids=BAD_POSES)
def test_a_pose_that_is_not_rigid_is_refused(kind, pose):
    with pytest.raises(ValueError, match=r"a pose|the pose"):
        kind(5, 5, 1, 1, pose)


def test_a_pose_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"not \(3, 3\)"):
        Camera.from_intrinsics(5, 5, 1, 1, np.eye(3))


@pytest.mark.parametrize("kind", [Camera.from_intrinsics, Orthographic])
def test_a_pose_may_have_three_rows(kind):
    pose = look_at((1, 2, 3), (0, 0, 0))
    np.testing.assert_array_equal(kind(5, 5, 1, 1, pose[:3]).world_to_camera, pose)


@pytest.mark.parametrize("kind", [Camera.from_intrinsics, Orthographic])
def test_kernels_get_float64_whatever_was_given(kind):
    """Other types would have all kernels compiled once more."""
    view = kind(5, np.float32(5), 1, np.int64(1), np.eye(4, dtype=np.float32), 0).view()
    for array in (view.rotation, view.translation, view.focal, view.principal):
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
    assert type(view.near) is float
    assert type(view.perspective) is bool


@pytest.mark.parametrize(
    ("point", "pixel"), [((0, 0, 4), (8, 6)), ((1, 0, 4), (13, 6)), ((0, 1, 8), (8, 8.5))]
)
def test_a_pinhole_projects_through_the_eye(point, pixel):
    camera = Camera.from_intrinsics(20.0, 20.0, 8.0, 6.0)
    sample = Samples(np.array([point]), np.ones((1, 3)), np.ones(1), 0.1 * np.eye(3))
    record = Resampler(method="paper").footprints(sample, camera, height=12, width=16)[0]
    assert (record["x"], record["y"]) == pytest.approx(pixel)
    assert record["depth"] == point[2]


def test_a_parallel_projection_ignores_depth():
    camera = Orthographic(3.0, 2.0, 8.0, 6.0)
    for depth in (1.0, 7.0):
        sample = Samples(np.array([(1, 2, depth)]), np.ones((1, 3)), np.ones(1), 0.1 * np.eye(3))
        record = Resampler(method="paper").footprints(sample, camera, height=12, width=16)[0]
        assert (record["x"], record["y"], record["depth"]) == pytest.approx((11, 10, depth))


@pytest.mark.parametrize(
    "camera",
    [
        Camera.from_intrinsics(20.0, 20.0, 8.0, 6.0, look_at((0, 0, 0), (0, 0, -1))),
        Orthographic(2.0, 2.0, 8.0, 6.0, look_at((0, 0, 0), (0, 0, -1))),
    ],
)
def test_a_camera_that_looks_away_sees_nothing(camera):
    sample = Samples(np.array([(0, 0, 9)]), np.ones((1, 3)), np.ones(1), np.eye(3))
    frame = Resampler()(sample, camera, height=12, width=16)
    assert not frame.rgba.any()
    assert np.isinf(frame.depth).all()
    assert not frame.coverage.any()


@pytest.mark.parametrize("fov", [0, 40])
@pytest.mark.parametrize("pan", [(0.0, 0.0), (0.25, 0.0), (0.0, -0.1)])
def test_a_panned_orbit_shows_its_center_aside_by_a_share_of_the_shorter_side(fov, pan):
    """To the right and up, however far it is zoomed in."""
    center = np.array([1.0, -2.0, 0.5])
    for zoom in (1.0, 3.0):
        orbit = Orbit(azimuth=30, elevation=20, fov=fov, zoom=zoom, pan=pan)
        camera = orbit.around((center, 2.0), 60, 80)
        place = camera.world_to_camera @ [*center, 1.0]
        per_unit = camera.matrix[0, 0] / place[2] if fov else camera.sx
        assert place[:2] * per_unit == pytest.approx((60 * pan[0], -60 * pan[1]))


def test_a_picture_begins_empty_and_with_values_only_if_asked_for():
    for has_values in (False, True):
        given = {"has_values": True} if has_values else {}
        film, value, tally = nothing_painted(3, 4, 5, **given)
        assert value.shape == ((3, 4) if has_values else (0, 0))
        assert np.isnan(value).all()
        assert (film.rgba == 0).all()
        assert tally.shape == (5, 4)
    assert nothing_painted(3, 4).tally.shape == (1, 4)
