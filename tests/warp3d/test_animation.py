import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.poses import camera_to_world
from resample.files.animations import write_film
from resample_warp3d.command.animation import (
    PATHS,
    NearbyPath,
    Range,
    check_path,
    on_screen,
    poses_between,
    poses_of,
    shots,
    stepped,
)
from resample_warp3d.types import Warped

HERE, ROOM = np.eye(4), Range(near=2.0, middle=4.0)


def eye(pose: np.ndarray) -> np.ndarray:
    """Where a camera is in the world."""
    return camera_to_world(pose)[:3, 3]


@pytest.mark.parametrize(
    ("move", "turn", "seen"),
    [
        ((1, 0, 0), (0, 0, 0), (-1, 0, 5)),
        ((0, 1, 0), (0, 0, 0), (0, -1, 5)),
        ((0, 0, 1), (0, 0, 0), (0, 0, 4)),
        ((0, 0, 0), (90, 0, 0), (-5, 0, 0)),  # turned right: what was ahead is on the left
        ((0, 0, 0), (0, 90, 0), (0, 5, 0)),  # turned up: it is below
    ],
)
def test_moves_and_turns_go_the_way_they_say(move, turn, seen):
    pose = stepped(move, turn)
    assert np.allclose(pose[:3, :3] @ (0, 0, 5) + pose[:3, 3], seen)


def test_a_clockwise_roll_lowers_the_right_side_of_the_camera():
    pose = stepped((0, 0, 0), (0, 0, 90))
    assert np.allclose(pose[:3, :3] @ (0, 1, 0), (1, 0, 0))  # what was below is on the right


def test_turns_follow_moves():
    assert np.allclose(eye(stepped((1, 2, 3), (30, 20, 10))), (1, 2, 3))


@pytest.mark.parametrize("path", PATHS)
def test_paths_are_closed_and_stay_near(path):
    flight = NearbyPath(path, 12)
    places = np.array([eye(flight.pose(n, HERE, ROOM)) for n in range(13)])
    assert np.allclose(places[0], places[12])
    assert np.abs(places).max() <= 0.3 * ROOM.near + 1e-12
    assert np.ptp(places, axis=0).max() > 0.1 * ROOM.near


@pytest.mark.parametrize("path", ["sway", "orbit"])
def test_what_is_in_the_middle_stays_in_the_middle(path):
    flight = NearbyPath(path, 12)
    for n in range(12):
        pose = flight.pose(n, HERE, ROOM)
        seen = pose[:3, :3] @ (0, 0, ROOM.middle) + pose[:3, 3]
        assert abs(seen[0] / seen[2]) < 1e-12
        assert abs(seen[1] / seen[2]) < 5e-5  # the order of two turns


def test_a_path_begins_at_the_pictures_own_pose():
    start = stepped((1, 2, 3), (40, 0, 0))
    here = NearbyPath("dolly", 4).pose(2, HERE, ROOM)
    assert np.allclose(NearbyPath("dolly", 4).pose(2, start, ROOM), here @ start)


def test_the_amount_is_a_share_of_what_is_near():
    right = eye(NearbyPath("sway", 4, 0.25).pose(1, HERE, ROOM))
    assert right[0] == pytest.approx(0.25 * ROOM.near)


def test_the_range_ignores_what_is_unknown():
    nearness = np.array([[0, 0.5, 0.25], [0.25, 0.25, 0]], np.float32)
    assert Range.of(nearness).middle == pytest.approx(4)
    assert Range.of(nearness).near < 4


def test_eyes_move_in_straight_lines_between_poses():
    poses = [stepped((0, 0, 0)), stepped((2, 0, 0), (60, 0, 0))]
    made = poses_between(poses, 3)
    assert np.allclose(made[1], stepped((1, 0, 0), (30, 0, 0)))
    assert np.allclose([made[0], made[2]], poses)


def test_a_single_pose_is_repeated():
    assert len(poses_between([HERE], 3)) == 3


def test_a_file_of_poses_is_a_path(tmp_path):
    file = tmp_path / "poses.txt"
    poses = [stepped((n, 0, 0)) for n in range(3)]
    np.savetxt(file, np.concatenate(poses))
    assert np.allclose(poses_of(str(file), None, None, HERE, ROOM), poses)
    assert len(poses_of(str(file), 7, None, HERE, ROOM)) == 7


@pytest.mark.parametrize(
    ("path", "frames", "amount", "complaint"),
    [
        ("fly", 4, None, "unknown path 'fly'; known: sway, orbit, dolly, or a file"),
        ("sway", 0, None, "0 frames; 1 to 10000 are allowed"),
        ("sway", 4, float("nan"), "give a share above 0"),
        ("none.txt", None, None, "none.txt"),
        ("none.txt", None, 0.1, "an amount belongs to the paths sway"),
    ],
)
def test_a_path_is_checked(path, frames, amount, complaint):
    with pytest.raises((ValueError, OSError), match=complaint):
        check_path(path, frames, amount)


def test_frames_are_those_of_the_poses(tmp_path):
    camera, poses = Camera.from_fov(60, 4, 6), [stepped((n / 4, 0, 0)) for n in range(3)]
    job: dict[str, object] = {"a": 1}
    film = lambda seen: np.full((4, 6, 3), eye(seen.world_to_camera)[0]), lambda seen: seen, job
    made = shots(poses, camera, film)
    assert [int(made.frame(n)[0, 0, 0]) for n in range(3)] == [0, 64, 128]  # of 255, rounded
    other = shots(poses[:2], camera, film)
    assert made.job["path"] != other.job["path"]
    write_film(tmp_path / "frames", made, 24)  # the job is JSON


def warped(channels: int) -> Warped:
    """One pixel, half covered by white light."""
    half = np.full((1, 1), 0.5, np.float32)
    image = np.full((1, 1, channels), 0.5, np.float32)
    return Warped(image, half, half, np.zeros((1, 1), np.uint8), half, half)


@pytest.mark.parametrize(("channels", "has_alpha"), [(1, False), (3, False), (2, True), (4, True)])
def test_what_is_not_covered_shows_the_background(channels, has_alpha):
    screen = on_screen(warped(channels), has_alpha=has_alpha, background=(0.5, 0.5, 0.5))
    assert np.allclose(screen, 0.8808, atol=1e-3)  # sRGB of 0.75


def test_pictures_that_are_no_color_are_refused():
    with pytest.raises(ValueError, match="a picture of 5 channels"):
        on_screen(warped(5), has_alpha=False, background=(0, 0, 0))
