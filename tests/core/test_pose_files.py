import json

import numpy as np
import pytest

from resample.cameras.files import KINDS, left_out, read_pose, read_poses, read_shot, read_shots
from resample.cameras.poses import from_quaternion

QUATERNIONS = np.array([[0.1, -0.2, 0.3, 0.9], [-0.4, 0.1, 0.0, 0.8], [0.0, 0.7, 0.0, -0.7]])
QUATERNIONS /= np.linalg.norm(QUATERNIONS, axis=1)[:, None]
SHIFTS = np.array([[1.5, -0.25, 3.0], [0.0, 2.0, -1.0], [-7.0, 0.5, 0.125]])
NAMES = ["images/a.png", "images/b.png", "other/c.png"]
AXES = np.diag([1.0, -1.0, -1.0, 1.0])
FACTS = {"w": 64, "h": 48, "fl_x": 80.0, "fl_y": 81.0, "cx": 30.0, "cy": 25.0}
LENS = {"k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -2e-3}


def rotation(quaternion):
    """Rotation of a unit quaternion x, y, z, w by turning the axes with it (Rodrigues)."""
    vector, w = quaternion[:3], quaternion[3]
    axes = np.eye(3)
    twice = 2 * np.cross(vector, axes)
    return (axes + w * twice + np.cross(vector, twice)).T


def pose(quaternion, shift):
    full = np.eye(4)
    full[:3, :3], full[:3, 3] = rotation(quaternion), shift
    return full


WORLD_TO_CAMERA = [pose(q, t) for q, t in zip(QUATERNIONS, SHIFTS, strict=True)]
CAMERA_TO_WORLD = [np.linalg.inv(matrix) for matrix in WORLD_TO_CAMERA]
BACK_QUATERNIONS = QUATERNIONS * [-1, -1, -1, 1]


def numbers(row):
    return " ".join(f"{number:.17g}" for number in np.ravel(row))


def back_lines():
    """Lines tx ty tz qx qy qz qw, camera to world."""
    rows = zip(CAMERA_TO_WORLD, BACK_QUATERNIONS, strict=True)
    return [numbers([*matrix[:3, 3], *quaternion]) for matrix, quaternion in rows]


def write_matrices(folder):
    path = folder / "poses.txt"
    rows = np.concatenate(WORLD_TO_CAMERA)
    path.write_text("# world to camera\n" + "\n".join(map(numbers, rows)) + "\n")
    return path


def write_npy(folder):
    np.save(folder / "poses.npy", WORLD_TO_CAMERA)
    return folder / "poses.npy"


def write_tum(folder):
    path = folder / "groundtruth.txt"
    lines = [f"1305031102.{n} {line}" for n, line in enumerate(back_lines())]
    path.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines))
    return path


def write_icl(folder):
    path = folder / "pose.txt"
    path.write_text("\n".join(back_lines()) + "\n\n")
    return path


def write_log(folder):
    path = folder / "trajectory.log"
    blocks = [
        "\n".join([f"{n} {n} {n + 1}", *map(numbers, matrix)])
        for n, matrix in enumerate(CAMERA_TO_WORLD)
    ]
    path.write_text("\n".join(blocks))
    return path


def write_nerf(folder, facts=None):
    path = folder / "transforms.json"
    frames = [
        {"file_path": name, "transform_matrix": (matrix @ AXES).tolist()}
        for name, matrix in zip(NAMES, CAMERA_TO_WORLD, strict=True)
    ]
    path.write_text(json.dumps({**(facts or {}), "frames": frames}))
    return path


def write_colmap(folder, camera="1 OPENCV 64 48 80 81 30 25 -0.1 0.02 0.001 -0.002"):
    lines = ["# Image list with two lines of data per image:"]
    for n, (q, t) in enumerate(zip(QUATERNIONS, SHIFTS, strict=True)):
        lines.append(f"{n + 1} {numbers([q[3], *q[:3], *t])} 1 {NAMES[n]}")
        lines.append("" if n == 1 else "12.5 7.25 -1 3 4 8")  # a picture may have no points
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "cameras.txt").write_text(f"# CAMERA_ID, MODEL, ...\n{camera}\n")
    return folder


def write_open3d(folder, inner=None):
    """`PinholeCameraTrajectory`: matrices are lists of their columns."""
    matrix = [80, 0, 0, 0, 81, 0, 29.5, 24.5, 1]
    intrinsic = {"width": 64, "height": 48, "intrinsic_matrix": matrix} if inner is None else inner
    cameras = [
        {"class_name": "PinholeCameraParameters", "extrinsic": list(pose.T.ravel()),
         "intrinsic": intrinsic, "version_major": 1}
        for pose in np.array(WORLD_TO_CAMERA)
    ]  # fmt: skip
    path = folder / "trajectory.json"
    path.write_text(json.dumps({"class_name": "PinholeCameraTrajectory", "parameters": cameras}))
    return path


WRITERS = {
    "matrix": write_matrices,
    "npy": write_npy,
    "tum": write_tum,
    "icl": write_icl,
    "log": write_log,
    "nerf": write_nerf,
    "open3d": write_open3d,
    "colmap": write_colmap,
}


@pytest.fixture(params=WRITERS)
def path(request, tmp_path):
    return WRITERS[request.param](tmp_path)


# Files.


def test_every_kind_of_file_gives_the_same_poses(path):
    np.testing.assert_allclose(read_poses(path), WORLD_TO_CAMERA, atol=1e-12)


def test_a_frame_is_picked_by_number(path):
    np.testing.assert_allclose(read_pose(f"{path}:2"), WORLD_TO_CAMERA[2], atol=1e-12)


def test_without_a_frame_a_file_of_several_is_refused(path):
    with pytest.raises(LookupError, match=r"holds 3 poses; pick one as .*:N, N from 0 to 2"):
        read_pose(str(path))


def test_a_frame_beyond_the_last_is_refused(path):
    with pytest.raises(LookupError, match="no frame 3; it has the frames 0 to 2"):
        read_pose(f"{path}:3")


@pytest.mark.parametrize("rows", [3, 4])
def test_a_file_of_one_matrix_needs_no_frame(tmp_path, rows):
    path = tmp_path / "pose.txt"
    path.write_text(str(WORLD_TO_CAMERA[0][:rows].tolist()).replace("], ", "],\n"))
    np.testing.assert_allclose(read_pose(str(path)), WORLD_TO_CAMERA[0], atol=1e-15)


@pytest.mark.parametrize("writer", [write_nerf, write_colmap])
@pytest.mark.parametrize("frame", ["images/b.png", "b.png", "b"])
def test_a_frame_is_picked_by_its_picture(tmp_path, writer, frame):
    assert read_shot(f"{writer(tmp_path)}:{frame}").name == "images/b.png"


def test_a_frame_is_picked_by_its_time(tmp_path):
    found = read_pose(f"{write_tum(tmp_path)}:1305031102.1")
    np.testing.assert_allclose(found, WORLD_TO_CAMERA[1], atol=1e-12)


def test_a_name_that_no_frame_has_is_refused(tmp_path):
    with pytest.raises(LookupError, match=r"no frame 'd\.png'.* such as images/a\.png"):
        read_shot(f"{write_nerf(tmp_path)}:d.png")


def test_a_name_that_several_frames_have_is_refused(tmp_path):
    path = write_nerf(tmp_path)
    path.write_text(path.read_text().replace("other/c", "other/b"))
    with pytest.raises(LookupError, match=r"several frames 'b\.png': images/b\.png, other/b\.png"):
        read_shot(f"{path}:b.png")


# Cameras of files.


def test_nerf_s_intrinsics_are_read(tmp_path):
    camera = read_shot(f"{write_nerf(tmp_path, {**FACTS, **LENS})}:b.png").camera
    np.testing.assert_array_equal(camera.matrix, [[80, 0, 30], [0, 81, 25], [0, 0, 1]])
    np.testing.assert_array_equal(camera.distortion, [*LENS.values(), 0])


def test_colmap_s_camera_is_nerf_s(tmp_path):
    colmap = read_shot(f"{write_colmap(tmp_path)}:b.png")
    nerf = read_shot(f"{write_nerf(tmp_path, {**FACTS, **LENS})}:b.png")
    np.testing.assert_array_equal(colmap.camera.matrix, nerf.camera.matrix)
    np.testing.assert_array_equal(colmap.camera.distortion, nerf.camera.distortion[:4])
    assert colmap.shape == nerf.shape == (48, 64)


def test_a_camera_has_its_pose(tmp_path):
    shot = read_shot(f"{write_colmap(tmp_path)}:1")
    np.testing.assert_array_equal(shot.camera.world_to_camera, shot.pose)


@pytest.mark.parametrize(
    ("model", "focal", "distortion"),
    [
        ("SIMPLE_PINHOLE 64 48 80 30 25", 80, None),
        ("PINHOLE 64 48 80 81 30 25", 81, None),
        ("SIMPLE_RADIAL 64 48 80 30 25 -0.1", 80, [-0.1, 0, 0, 0]),
        ("RADIAL 64 48 80 30 25 -0.1 0.02", 80, [-0.1, 0.02, 0, 0]),
        ("FULL_OPENCV 64 48 80 81 30 25 1 2 3 4 5 6 7 8", 81, [1, 2, 3, 4, 5, 6, 7, 8]),
        ("SIMPLE_RADIAL_FISHEYE 64 48 80 30 25 -0.1", 80, [-0.1, 0, 0, 0]),
        ("RADIAL_FISHEYE 64 48 80 30 25 -0.1 0.02", 80, [-0.1, 0.02, 0, 0]),
        ("OPENCV_FISHEYE 64 48 80 81 30 25 1 2 3 4", 81, [1, 2, 3, 4]),
    ],
)
def test_every_model_of_colmap_that_opencv_has_is_read(tmp_path, model, focal, distortion):
    camera = read_shot(f"{write_colmap(tmp_path, '1 ' + model)}:0").camera
    np.testing.assert_array_equal(camera.matrix, [[80, 0, 30], [0, focal, 25], [0, 0, 1]])
    assert (None if camera.distortion is None else camera.distortion.tolist()) == distortion
    assert camera.model == ("fisheye" if "FISHEYE" in model else "pinhole")


@pytest.mark.parametrize("said", [{"camera_model": "OPENCV_FISHEYE"}, {"is_fisheye": True}])
def test_a_fisheye_of_nerf_is_read(tmp_path, said):
    facts = {**FACTS, **said, "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}
    camera = read_shot(f"{write_nerf(tmp_path, facts)}:0").camera
    assert (camera.model, camera.distortion.tolist()) == ("fisheye", [0.1, 0.2, 0.3, 0.4])


def test_an_angle_of_view_needs_the_frame_s_width(tmp_path):
    camera = read_shot(
        f"{write_nerf(tmp_path, {'camera_angle_x': np.pi / 2, 'w': 64, 'h': 48})}:0"
    ).camera
    np.testing.assert_allclose(camera.matrix, [[32, 0, 32], [0, 32, 24], [0, 0, 1]])


def test_an_angle_of_view_takes_the_size_of_the_picture_itself(tmp_path):
    cv2 = pytest.importorskip("cv2")
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images/a.png"), np.zeros((48, 64), np.uint8))
    shot = read_shot(f"{write_nerf(tmp_path, {'camera_angle_x': np.pi / 2})}:0")
    assert (shot.shape, shot.camera.matrix[0, 0]) == ((48, 64), pytest.approx(32))


# Quaternions.


def test_quaternions_turn_as_rodrigues_says():
    for quaternion in QUATERNIONS:
        np.testing.assert_allclose(from_quaternion(quaternion), rotation(quaternion), atol=1e-15)


def test_a_quarter_turn_about_z_takes_x_to_y():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(from_quaternion([0, 0, half, half])[:, 0], [0, 1, 0], atol=1e-15)


def test_a_rounded_quaternion_gives_a_rotation():
    found = from_quaternion(np.round(QUATERNIONS[0], 3))
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("given", [[0, 0, 0, 0], [0, 0, 0, 1.1], [np.nan, 0, 0, 1]])
def test_a_quaternion_of_another_length_is_refused(given):
    with pytest.raises(ValueError, match="instead of 1"):
        from_quaternion(given)


# Bad files.

BAD = {
    "empty.txt": ("", "not recognised as a file of poses; say which it is: matrix, tum"),
    "words.txt": ("no pose at all\n" * 4, "line 1: could not convert"),
    "rows.txt": ("1 2 3 4 5 6 7 8 9 10 11 12\n", "not recognised"),  # KITTI: its way is not said
    "five.txt": ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 0 0 0\n", "not recognised"),
    "scaled.txt": ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "pose 0: the pose's rotation"),
    "quaternion.txt": ("0 0 0 0 0 0 2\n", "line 1: the quaternion"),
    "cut.log": ("0 0 1\n1 0 0 0\n0 1 0 0\n", "not a trajectory"),
    "empty.log": ("", "holds no poses"),
    "broken.json": ('{"frames": [', "broken.json: Expecting value"),
    "list.json": ("[1, 2]", "no list of frames"),
    "nothing.json": ('{"frames": [{}]}', "frame 0 has no transform_matrix"),
    "ragged.json": ('{"frames": [{"transform_matrix": [[1], [2, 3]]}]}', "frame 0: "),
    "endless.json": ('{"w": Infinity, "h": 9, "frames": [{"transform_matrix": %s}]}', "infinity"),
    "number.json": ('{"frames": [7]}', "frame 0: "),
    "images.txt": ("1 1 0 0 0 0 0 0 1\n\n", "line 1: a picture has 10 words, not 9"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_no_file_of_poses_is_an_error_of_one_line(tmp_path, name):
    content, complaint = BAD[name]
    (tmp_path / name).write_text(content.replace("%s", str(np.eye(4).tolist())))
    with pytest.raises(ValueError, match=complaint) as caught:
        read_shots(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "record3d"])  # a zip file
def test_bytes_that_are_no_text_are_an_error_of_one_line(tmp_path, kind):
    (tmp_path / "poses").write_bytes(b"\xff\xfe\x00" * 50)
    with pytest.raises(ValueError, match="poses is not a text"):
        KINDS[kind](tmp_path / "poses")


@pytest.mark.parametrize("given", [np.eye(3), np.array(["a"]), np.ones(5)])
def test_an_npy_without_a_pose_is_refused(tmp_path, given):
    np.save(tmp_path / "pose.npy", given)
    with pytest.raises(ValueError, match=r"pose\.npy"):
        read_shots(tmp_path / "pose.npy")


def test_an_npz_in_the_place_of_an_npy_is_refused(tmp_path):
    np.savez(tmp_path / "pose.npz", np.eye(4))
    path = (tmp_path / "pose.npz").rename(tmp_path / "pose.npy")
    with pytest.raises(OSError, match=r"pose\.npy holds .*: the magic string is not correct"):
        read_shots(path)


def test_an_empty_text_holds_no_matrix(tmp_path):
    (tmp_path / "pose.txt").touch()
    with pytest.raises(ValueError, match=r"pose\.txt has 0 rows"):
        KINDS["matrix"](tmp_path / "pose.txt")


def test_frames_of_nerf_need_no_picture(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame = {"transform_matrix": AXES.tolist()}
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [frame]}))
    np.testing.assert_array_equal(read_pose("transforms.json"), np.eye(4))


def test_a_missing_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.txt:3"):
        read_pose("nowhere.txt:3")


def test_a_folder_without_a_model_says_what_to_write(tmp_path):
    with pytest.raises(ValueError, match=r"no images\.bin and no images\.txt; give the folder"):
        read_shots(tmp_path)


@pytest.mark.parametrize(
    ("camera", "complaint"),
    [
        (
            "1 FOV 64 48 80 80 30 25 0.5",
            r"cameras\.txt: line 2: COLMAP's model 'FOV' is not known; known: SIMPLE",
        ),
        ("1 PINHOLE 64 48 80 81 30", "PINHOLE has a width, a height and 4 numbers, not 5"),
        ("1", "model '' is not known"),
        ("2 PINHOLE 64 48 80 81 30 25", r"cameras\.txt has no camera 1"),
        ("1 PINHOLE 64 48 0 81 30 25", "singular"),
        ("1 PINHOLE 0 48 80 81 30 25", "pictures of 0 x 48 pixels"),
        ("1 PINHOLE nan 48 80 81 30 25", "pictures of nan x 48 pixels"),
        ("1 PINHOLE inf 48 80 81 30 25", "cannot convert float infinity"),
        ("one PINHOLE 64 48 80 81 30 25", r"cameras\.txt: line 2: invalid literal"),
    ],
)
def test_cameras_of_colmap_that_cannot_be_had_are_refused(tmp_path, camera, complaint):
    with pytest.raises(ValueError, match=complaint):
        read_shots(write_colmap(tmp_path, camera))


@pytest.mark.parametrize(
    ("facts", "complaint"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "undistort the pictures first"),
        ({"camera_model": "OPENCV", "is_fisheye": True}, "undistort the pictures first"),
        ({"k4": 0.1}, "undistort the pictures first"),
        ({"camera_angle_x": 0, "w": 64, "h": 48}, "cannot see an angle of 0"),
        ({"camera_angle_x": "wide", "w": 64, "h": 48}, "frame 0: "),
    ],
)
def test_cameras_of_nerf_that_cannot_be_had_are_refused(tmp_path, facts, complaint):
    with pytest.raises(ValueError, match=complaint):
        read_shots(write_nerf(tmp_path, facts))


# What cannot be had does not spoil the rest.


def test_a_camera_of_text_that_cannot_be_had_spares_the_others(tmp_path):
    camera = "1 PINHOLE 64 48 80 81 30 25\n2 FOV 64 48 80 81 30 25 0.5\n3 PINHOLE 64 48 80 x 30 25"
    path = write_colmap(tmp_path, camera) / "images.txt"
    lines = path.read_text().splitlines()
    lines[3], lines[5] = lines[3].replace(" 1 ima", " 2 ima"), lines[5].replace(" 1 oth", " 3 oth")
    path.write_text("\n".join(lines))
    assert [shot.name for shot in read_shots(tmp_path)] == [NAMES[0]]
    with pytest.raises(ValueError, match="line 3: COLMAP's model 'FOV' is not known"):
        read_shot(f"{tmp_path}:b")
    with pytest.raises(ValueError, match="line 4: could not convert string to float: 'x'"):
        read_shot(f"{tmp_path}:c")
    np.testing.assert_allclose(read_poses(tmp_path), WORLD_TO_CAMERA, atol=1e-12)


def test_a_frame_of_nerf_that_cannot_be_had_spares_the_others(tmp_path):
    path = write_nerf(tmp_path, FACTS)
    facts = json.loads(path.read_text())
    facts["frames"][0]["camera_model"] = "EQUIRECTANGULAR"
    facts["frames"][1]["transform_matrix"][0][0] = 5
    path.write_text(json.dumps(facts))
    assert read_shot(f"{path}:2").shape == (48, 64)
    np.testing.assert_allclose(read_pose(f"{path}:a"), WORLD_TO_CAMERA[0], atol=1e-12)
    for name, complaint in (("a", "frame 0: its lens"), ("b", "frame 1: ")):
        with pytest.raises(ValueError, match=complaint):
            read_shot(f"{path}:{name}")


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        ("1305031102.1 0 0 0 0 0 0 0", "line 3: the quaternion"),
        ("1305031102.1 nan nan nan nan nan nan nan", "line 3: "),
        ("1305031102.1 0 0", "line 3: 3 numbers instead of 8"),
    ],
)
def test_a_lost_frame_of_tum_spares_the_others(tmp_path, damage, complaint):
    path = write_tum(tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], damage, *lines[3:]]))
    np.testing.assert_allclose(read_pose(f"{path}:2"), WORLD_TO_CAMERA[2], atol=1e-12)
    assert len(read_poses(path)) == 2
    assert left_out(path, poses=True).startswith("1 of 3 cameras are left out: ")
    with pytest.raises(ValueError, match=complaint):
        read_pose(f"{path}:1305031102.1")


def test_one_table_of_many_that_cannot_be_had_spares_the_others(tmp_path):
    path = tmp_path / "cameras.toml"
    path.write_text(
        "[[camera]]\ntime = 1\neye = [0, -3, 0]\ntarget = [0, 0, 0]\n"
        "[[camera]]\ntime = 2\neye = [0, 0, 0]\ntarget = [0, 0, 0]\n"
    )
    assert len(read_poses(path)) == 1
    with pytest.raises(ValueError, match=r"camera\.1: "):
        read_pose(f"{path}:1")


# Open3D.


def test_a_trajectory_of_open3d_has_its_intrinsics(tmp_path):
    shot = read_shot(f"{write_open3d(tmp_path)}:1")
    expected = [[80, 0, 30], [0, 81, 25], [0, 0, 1]]  # its pixel centers are at + 0
    np.testing.assert_allclose(shot.camera.matrix, expected, atol=1e-12)
    np.testing.assert_allclose(shot.camera.world_to_camera, WORLD_TO_CAMERA[1], atol=1e-12)
    assert shot.shape == (48, 64)


def test_one_camera_of_open3d_is_a_file_of_one_pose(tmp_path):
    facts = json.loads(write_open3d(tmp_path).read_text())["parameters"][2]
    path = tmp_path / "one.json"
    path.write_text(json.dumps(facts))
    np.testing.assert_allclose(read_pose(str(path)), WORLD_TO_CAMERA[2], atol=1e-12)


def test_open3d_without_intrinsics_has_poses(tmp_path):
    shot = read_shot(f"{write_open3d(tmp_path, {})}:1")
    assert shot.camera is None
    np.testing.assert_allclose(shot.pose, WORLD_TO_CAMERA[1], atol=1e-12)


def test_an_incomplete_camera_of_open3d_is_refused(tmp_path):
    path = tmp_path / "bad.json"
    path.write_text('{"parameters": [{"extrinsic": [1, 0, 0]}]}')
    with pytest.raises(ValueError, match="camera 0: its extrinsic has 3 numbers, not 16"):
        read_shot(str(path))
