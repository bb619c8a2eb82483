"""COLMAP's binary models, written here byte by byte as its documentation of the format says."""

import struct

import numpy as np
import pytest

from resample.cameras.files import left_out, read_pose, read_poses, read_shot
from resample.cameras.files import read_shots as shots_of
from tests.core.test_pose_files import NAMES, QUATERNIONS, SHIFTS, WORLD_TO_CAMERA, write_colmap

IDS = {  # of colmap/sensor/models.h
    "SIMPLE_PINHOLE": 0,
    "PINHOLE": 1,
    "SIMPLE_RADIAL": 2,
    "RADIAL": 3,
    "OPENCV": 4,
    "OPENCV_FISHEYE": 5,
    "FULL_OPENCV": 6,
    "FOV": 7,
    "SIMPLE_RADIAL_FISHEYE": 8,
    "RADIAL_FISHEYE": 9,
    "THIN_PRISM_FISHEYE": 10,
}
OPENCV = (1, 4, 64, 48, [80.0, 81.0, 30.0, 25.0, -0.1, 0.02, 0.001, -0.002])


def camera_bytes(number, model, width, height, parameters):
    content = number.to_bytes(4, "little") + model.to_bytes(4, "little", signed=True)
    content += width.to_bytes(8, "little") + height.to_bytes(8, "little")
    return content + b"".join(struct.pack("<d", number) for number in parameters)


def picture_bytes(number, quaternion, shift, camera, name, points):
    content = number.to_bytes(4, "little")
    x, y, z, w = quaternion
    content += b"".join(struct.pack("<d", value) for value in (w, x, y, z, *shift))
    content += camera.to_bytes(4, "little") + name.encode() + b"\0"
    content += points.to_bytes(8, "little")
    return content + points * (struct.pack("<dd", 12.5, 7.25) + b"\xff" * 8)


def pictures(cameras=(1, 1, 1), shifts=SHIFTS):
    rows = zip(QUATERNIONS, shifts, cameras, NAMES, [2, 0, 3], strict=True)
    return [picture_bytes(n + 1, *row) for n, row in enumerate(rows)]


def write(folder, given, cameras=None):
    known = [camera_bytes(*OPENCV)] if cameras is None else cameras
    for name, rows in (("images.bin", given), ("cameras.bin", known)):
        (folder / name).write_bytes(len(rows).to_bytes(8, "little") + b"".join(rows))
    return folder


def test_binary_models_are_read_as_text_is(tmp_path):
    (tmp_path / "text").mkdir()
    binary, text = shots_of(write(tmp_path, pictures())), shots_of(write_colmap(tmp_path / "text"))
    for one, other in zip(binary, text, strict=True):
        assert (one.name, one.shape) == (other.name, other.shape)
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.camera.matrix, other.camera.matrix)
        np.testing.assert_array_equal(one.camera.distortion, other.camera.distortion)


@pytest.mark.parametrize("name", ["", "/images.bin"])
def test_a_model_is_named_by_its_folder_or_its_file(tmp_path, name):
    folder = write(tmp_path, pictures())
    np.testing.assert_allclose(read_poses(f"{folder}{name}"), WORLD_TO_CAMERA, atol=1e-12)
    assert read_shot(f"{folder}{name}:c").name == "other/c.png"


def test_poses_need_no_cameras(tmp_path):
    (write(tmp_path, pictures()) / "cameras.bin").unlink()
    assert [shot.camera for shot in shots_of(tmp_path)] == [None] * 3


@pytest.mark.parametrize(
    ("model", "parameters", "distortion"),
    [
        ("SIMPLE_PINHOLE", [80, 30, 25], None),
        ("PINHOLE", [80, 80, 30, 25], None),
        ("SIMPLE_RADIAL", [80, 30, 25, -0.1], [-0.1, 0, 0, 0]),
        ("RADIAL", [80, 30, 25, -0.1, 0.02], [-0.1, 0.02, 0, 0]),
        ("FULL_OPENCV", [80, 80, 30, 25, 1, 2, 3, 4, 5, 6, 7, 8], [1, 2, 3, 4, 5, 6, 7, 8]),
        ("SIMPLE_RADIAL_FISHEYE", [80, 30, 25, -0.1], [-0.1, 0, 0, 0]),
        ("RADIAL_FISHEYE", [80, 30, 25, -0.1, 0.02], [-0.1, 0.02, 0, 0]),
        ("OPENCV_FISHEYE", [80, 80, 30, 25, 1, 2, 3, 4], [1, 2, 3, 4]),
    ],
)
def test_every_model_of_opencv_s_is_read(tmp_path, model, parameters, distortion):
    folder = write(tmp_path, pictures(), [camera_bytes(1, IDS[model], 64, 48, parameters)])
    camera = read_shot(f"{folder}:0").camera
    np.testing.assert_array_equal(camera.matrix, [[80, 0, 30], [0, 80, 25], [0, 0, 1]])
    assert (None if camera.distortion is None else camera.distortion.tolist()) == distortion
    assert camera.model == ("fisheye" if "FISHEYE" in model else "pinhole")


# What cannot be had does not spoil the rest.


@pytest.mark.parametrize(
    ("camera", "complaint"),
    [
        ((7, IDS["FOV"], 64, 48, [80, 80, 30, 25, 0.5]), "camera 7: COLMAP's model 'FOV' is not"),
        ((7, IDS["THIN_PRISM_FISHEYE"], 64, 48, [1] * 12), "'THIN_PRISM_FISHEYE' is not known"),
        ((7, IDS["PINHOLE"], 64, 48, [80, np.nan, 30, 25]), "camera 7: intrinsics are finite"),
        ((7, IDS["PINHOLE"], 64, 0, [80, 80, 30, 25]), "pictures of 64 x 0 pixels"),
        ((9, IDS["PINHOLE"], 64, 48, [80, 80, 30, 25]), r"cameras\.bin has no camera 7"),
    ],
)
def test_a_camera_that_cannot_be_had_spares_the_others(tmp_path, camera, complaint):
    cameras = [camera_bytes(*camera), camera_bytes(*OPENCV)]
    folder = write(tmp_path, pictures((1, 7, 1)), cameras)
    assert [shot.name for shot in shots_of(folder)] == [NAMES[0], NAMES[2]]
    assert read_shot(f"{folder}:2").camera.distortion is not None
    with pytest.raises(ValueError, match=complaint) as caught:
        read_shot(f"{folder}:b.png")
    assert "\n" not in str(caught.value)
    np.testing.assert_allclose(read_pose(f"{folder}:b.png"), WORLD_TO_CAMERA[1], atol=1e-12)
    assert left_out(folder).startswith("1 of 3 cameras are left out: ")
    assert left_out(folder, poses=True) is None


def test_what_follows_an_unknown_model_is_not_guessed(tmp_path):
    cameras = [camera_bytes(*OPENCV), camera_bytes(7, 99, 64, 48, [1, 2]), camera_bytes(*OPENCV)]
    folder = write(tmp_path, pictures((1, 7, 8)), cameras)
    assert [shot.name for shot in shots_of(folder)] == [NAMES[0]]
    with pytest.raises(ValueError, match="COLMAP's model 'number 99' is not known"):
        read_shot(f"{folder}:1")
    with pytest.raises(ValueError, match="cameras after camera 7 cannot be read"):
        read_shot(f"{folder}:2")


def test_a_damaged_pose_spares_the_others(tmp_path):
    folder = write(tmp_path, pictures(shifts=[*SHIFTS[:2], [0, np.nan, 0]]))
    assert len(shots_of(folder)) == 2
    with pytest.raises(ValueError, match=r"images\.bin: picture 2: a pose has finite numbers"):
        read_pose(f"{folder}:c")
    assert left_out(folder, poses=True).startswith("1 of 3 cameras are left out: ")


# Files that end too early, or are none.


@pytest.mark.parametrize("name", ["images.bin", "cameras.bin"])
def test_a_cut_off_file_is_refused_in_one_line_wherever_it_ends(tmp_path, name):
    path = write(tmp_path, pictures()) / name
    content = path.read_bytes()
    for size in range(len(content)):
        path.write_bytes(content[:size])
        with pytest.raises(ValueError, match=f"{name} is cut off") as caught:
            shots_of(tmp_path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["images.bin", "cameras.bin"])
@pytest.mark.parametrize("content", [b"\xff" * 300, b"PK\x03\x04" * 90, b"\x01" + b"\xff" * 5000])
def test_a_file_of_something_else_is_refused_in_one_line(tmp_path, name, content):
    (write(tmp_path, pictures()) / name).write_bytes(content)
    with pytest.raises(ValueError, match=f"{name} is cut off") as caught:
        shots_of(tmp_path)
    assert "\n" not in str(caught.value)


def test_points_beyond_the_end_are_refused(tmp_path):
    absurd = pictures()[1][:-8] + (2**63).to_bytes(8, "little")
    with pytest.raises(ValueError, match=r"images\.bin is cut off in picture 0, after \d+ bytes"):
        shots_of(write(tmp_path, [absurd]))


def test_a_model_without_pictures_holds_no_poses(tmp_path):
    with pytest.raises(ValueError, match="holds no poses"):
        shots_of(write(tmp_path, []))
