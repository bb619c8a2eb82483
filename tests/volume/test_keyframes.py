import json
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.keyframes import Keyframes, keyframes_of, read_keyframes
from resample.cameras.models import Camera
from resample.cameras.viewpoints import Orbit, Spot

ANGLES = """
[[camera]]
time = 1
azimuth = 30
elevation = 20

[[camera]]
time = 2
azimuth = 90
elevation = 20
zoom = 4
fov = 50

[[camera]]
time = 5
azimuth = 390
elevation = -10
zoom = 0.25
"""
PLACES = """
[[camera]]
time = 0
eye = [0, -9, 0]
target = [0, 0, 0]

[[camera]]
time = 1
eye = [9, 0, 0]
target = [0, 0, 1]
fov = 60
near = 2

[[camera]]
time = 3
eye = [9, 0, 5]
target = [0, 0, 1]
"""


def written(folder, text) -> Path:
    path = folder / "film.toml"
    path.write_text(text)
    return path


def turned(azimuth) -> Camera:
    """A calibrated camera 9 before the origin that was turned about the upward axis, degrees."""
    a = np.radians(azimuth)
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]]
    pose[2, 3] = 9
    return Camera.from_intrinsics(100.0 + azimuth, 200.0 + azimuth, 50.0, 60.0, pose, 0.5)


def eye_of(camera):
    view = camera.view()
    return -view.rotation.T @ view.translation


def test_a_file_has_a_time_and_a_camera_for_each_keyframe(tmp_path):
    keyframes = read_keyframes(written(tmp_path, ANGLES))
    assert keyframes.time.tolist() == [1, 2, 5]
    assert keyframes.duration == 4
    assert keyframes.camera == [Orbit(30, 20), Orbit(90, 20, 4.0, 50.0), Orbit(390, -10, 0.25)]


def test_angles_pass_through_all_keyframes(tmp_path):
    keyframes = read_keyframes(written(tmp_path, ANGLES))
    first, second, *_, last = keyframes.between(5)
    for seen, wanted in zip((first, second, last), keyframes.camera, strict=True):
        numbers = [seen.azimuth, seen.elevation, seen.zoom, seen.fov]
        assert numbers == pytest.approx(
            [wanted.azimuth, wanted.elevation, wanted.zoom, wanted.fov], rel=1e-12
        )


def test_places_pass_through_all_keyframes(tmp_path):
    keyframes = read_keyframes(written(tmp_path, PLACES))
    made = keyframes.between(4)
    for n, wanted in zip((0, 1, 3), keyframes.camera, strict=True):
        assert isinstance(made[n], Spot)
        for name in ("eye", "target", "up", "fov", "near"):
            assert getattr(made[n], name) == pytest.approx(getattr(wanted, name))


def test_calibrated_cameras_pass_through_all_keyframes():
    keyframes = Keyframes(np.array([0.0, 1.0, 4.0]), [turned(0.0), turned(90.0), turned(100.0)])
    made = keyframes.between(5)
    for n, wanted in zip((0, 1, 4), keyframes.camera, strict=True):
        assert made[n].world_to_camera == pytest.approx(wanted.world_to_camera, abs=1e-12)
        numbers = (made[n].fx, made[n].fy, made[n].cx, made[n].cy, made[n].near)
        assert numbers == pytest.approx((wanted.fx, wanted.fy, wanted.cx, wanted.cy, wanted.near))


def test_nothing_goes_beyond_the_keyframes(tmp_path):
    for camera in read_keyframes(written(tmp_path, ANGLES)).between(200):
        assert 30 <= camera.azimuth <= 390
        assert -10 <= camera.elevation <= 20
        assert 0.25 <= camera.zoom <= 4
        assert 30 <= camera.fov <= 50


def test_what_does_not_change_between_two_keyframes_stays():
    time = np.array([0.0, 1.0, 2.0, 3.0])
    held = Keyframes(time, [Orbit(0), Orbit(40), Orbit(40), Orbit(90)]).between(31)[10:21]
    assert {camera.azimuth for camera in held} == {40.0}


def test_between_two_keyframes_angles_move_evenly_and_zooms_by_equal_factors():
    made = Keyframes(np.array([0.0, 1.0]), [Orbit(0, 10, 8.0), Orbit(80, 20, 0.5)]).between(5)
    assert [camera.azimuth for camera in made] == pytest.approx([0, 20, 40, 60, 80])
    assert [camera.elevation for camera in made] == pytest.approx([10, 12.5, 15, 17.5, 20])
    assert [camera.zoom for camera in made] == pytest.approx([8, 4, 2, 1, 0.5])


def test_angles_move_without_jumps_of_speed(tmp_path):
    keyframes = read_keyframes(written(tmp_path, ANGLES))
    azimuth = np.array([camera.azimuth for camera in keyframes.between(4001)])
    speed = np.diff(azimuth)
    assert np.abs(np.diff(speed)).max() < 0.01 * speed.max()  # of 1000 steps a second


def test_between_two_calibrated_cameras_the_turn_is_even_and_the_eye_goes_straight():
    keyframes = Keyframes(np.array([0.0, 1.0]), [turned(0.0), turned(90.0)])
    first, *_, last = made = keyframes.between(5)
    forward = np.array([camera.view().rotation[2] for camera in made])
    assert (forward[1:] * forward[:-1]).sum(axis=1) == pytest.approx(np.cos(np.pi / 8))
    assert eye_of(made[2]) == pytest.approx((eye_of(first) + eye_of(last)) / 2)
    assert made[2].fx == pytest.approx(np.sqrt(100 * 190))


@pytest.mark.sweep
def test_calibrated_cameras_turn_without_jumps_of_speed():
    time = np.array([0.0, 1.0, 2.0])
    made = Keyframes(time, [turned(0.0), turned(60.0), turned(80.0)]).between(2001)
    forward = np.array([camera.view().rotation[2] for camera in made])
    speed = np.linalg.norm(np.diff(forward, axis=0), axis=1)
    assert np.abs(np.diff(speed)).max() < 0.01 * speed.max()  # of 1000 steps a second


def test_extreme_zooms_and_lenses_are_reached():
    ends = [Orbit(zoom=1e6, fov=1e-3), Orbit(zoom=1e-6, fov=179.999)]
    first, *_, last = Keyframes(np.array([0.0, 0.3]), ends).between(7)
    assert (first.zoom, last.zoom) == pytest.approx((1e6, 1e-6), rel=1e-9)


def test_a_size_in_the_file_makes_a_calibrated_camera(tmp_path):
    size = "width = 40\nheight = 20\n"
    text = PLACES.replace("fov = 60\nnear = 2\n", "").replace("target", f"{size}target")
    made = read_keyframes(written(tmp_path, text)).between(3)
    assert all(isinstance(camera, Camera) for camera in made)


FIRST = "[[camera]]\ntime = 0\n"
EYE = "eye = [0, -9, 0]\ntarget = [0, 0, 0]\n"
BAD = {
    "": "camera: Field required",
    "[[camera]": "film.toml: ",
    "camera = 3": "camera: Input should be a valid list",
    "[camera]\ntime = 1": "camera: Input should be a valid list",
    FIRST: "camera: List should have at least 2 items",
    f"speed = 2\n{FIRST}{FIRST}": "speed: Extra inputs are not permitted",
    f"{FIRST}[[camera]]\nazimuth = 1": "camera.1.time: Field required",
    f'{FIRST}[[camera]]\ntime = "soon"': "camera.1.time: Input should be a valid number",
    f"{FIRST}[[camera]]\ntime = inf": "camera.1.time: Input should be a finite number",
    f"{FIRST}[[camera]]\ntime = 0": r"camera.1.time: must be after camera.0's 0 \(got 0\)",
    f"{FIRST}[[camera]]\ntime = -1": r"camera.1.time: must be after camera.0's 0 \(got -1\)",
    f"{FIRST}[[camera]]\ntime = 1\nazimut = 3": "camera.1: azimut: Extra inputs are not permitted",
    f"{FIRST}[[camera]]\ntime = 1\nzoom = 0": "camera.1: a zoom of 0; it must be above 0",
    f"{FIRST}[[camera]]\ntime = 1\nfov = 0": r"camera.1.fov: parallel projection \(0\) and persp",
    f"{FIRST}[[camera]]\ntime = 1\nup = 'x'": r"camera.1.up: must be camera.0's 'z' \(got 'x'\)",
    f"{FIRST}[[camera]]\ntime = 1\n{EYE}": "camera.1 is given by eye and target and camera.0 by an",
    f"{FIRST}{EYE}[[camera]]\ntime = 1\n{EYE}up = [1, 2]": "camera.1: up: List should have",
}


@pytest.mark.parametrize(("text", "complaint"), BAD.items())
def test_a_file_that_is_none_of_keyframes_is_one_line_that_names_it(text, complaint, tmp_path):
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=complaint) as caught:
        read_keyframes(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        read_keyframes(tmp_path / "none.toml")
    (tmp_path / "film.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"film\.toml: "):
        read_keyframes(tmp_path / "film.toml")


POSES = "0 0 -9 0 0 0 0 1\n1 1 -9 0 0 0 0 1\n2 4 -9 0 0 0 0 1\n"  # TUM: time, place, x, y, z, w


def test_a_file_of_poses_alone_is_a_way_one_second_apart(tmp_path):
    (tmp_path / "way.txt").write_text(POSES)
    way = keyframes_of(tmp_path / "way.txt", 40.0)
    assert way.duration == 2
    np.testing.assert_allclose(
        [spot.eye for spot in way.camera], [[0, -9, 0], [1, -9, 0], [4, -9, 0]]
    )
    assert {spot.fov for spot in way.camera} == {40.0}


def test_one_pose_is_no_way(tmp_path):
    (tmp_path / "way.txt").write_text(POSES.splitlines()[0])
    with pytest.raises(ValueError, match="one pose; a camera path needs two or more"):
        keyframes_of(tmp_path / "way.txt", 40.0)


def test_calibrated_cameras_of_one_size_fit_any_picture(tmp_path):
    frames = [
        {"file_path": f"{n}.png", "transform_matrix": np.diag([1, -1, -1, 1]).tolist()}
        for n in range(2)
    ]
    facts = {"w": 40, "h": 20, "fl_x": 30, "cx": 19, "cy": 9, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(facts))
    (middle,) = keyframes_of(tmp_path / "transforms.json", 40.0).between(3)[1:2]
    camera = middle.sized(40, 80)
    np.testing.assert_allclose([camera.fx, camera.cx, camera.cy], [60, 38, 18], rtol=1e-12)


def test_a_lens_between_keyframes_is_refused(tmp_path):
    row = "fx = 9\nfy = 9\ncx = 1\ncy = 1\ndistortion = [0.1, 0, 0, 0]\n"
    row += "world_to_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]\n"
    text = "".join(f"[[camera]]\ntime = {n}\n{row}" for n in range(2))
    with pytest.raises(ValueError, match=r"film\.toml: a lens"):
        read_keyframes(written(tmp_path, text))


def test_an_eye_that_meets_its_target_is_refused():
    ends = [Spot([0, y, 0], [0, -y, 0], [0, 0, 1], 30.0, 0.0) for y in (-1.0, 1.0)]
    with pytest.raises(ValueError, match="cannot look at"):
        Keyframes(np.array([0.0, 1.0]), ends).between(3)
