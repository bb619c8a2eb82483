"""Files of intrinsics, written here as Open3D, ROS and OpenCV write them."""

import json

import cv2
import numpy as np
import pytest

from resample.cameras.calibrations import read_calibration, read_intrinsics
from resample.reading.texts import yaml_of

MATRIX = [[525.5, 0.0, 320.25], [0.0, 526.5, 240.75], [0.0, 0.0, 1.0]]  # centers at 0
HALVES = [[525.5, 0.0, 320.75], [0.0, 526.5, 241.25], [0.0, 0.0, 1.0]]
BENDS = {
    "plumb_bob": [0.1, -0.2, 0.001, 0.002, 0.03],
    "rational_polynomial": [0.1, -0.2, 0.001, 0.002, 0.03, 0.01, 0.02, 0.003],
    "equidistant": [0.1, -0.02, 0.003, 0.004],
}
FISHEYE = "equidistant"
NEW = [[500.0, 0.0, 310.0, 0.0], [0.0, 500.0, 230.0, 0.0], [0.0, 0.0, 1.0, 0.0]]


def flat(rows):
    return [float(number) for row in rows for number in row]


def calibrator(model):
    """What ROS's camera_calibration writes (camera_calibration_parsers)."""
    return f"""image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: {flat(MATRIX)}
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(BENDS[model])}
  data: {BENDS[model]}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [500, 0, 310, 0,
         0, 500, 230, 0, 0, 0, 1, 0]
"""


def first_message(model):
    """What `rostopic echo` prints of ROS 1."""
    return f"""header:
  seq: 12
  stamp:
    secs: 1
    nsecs: 200
  frame_id: "camera: left"   # where it is
height: 480
width: 640
distortion_model: "{model}"
D: {BENDS[model]}
K: {flat(MATRIX)}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: {flat(NEW)}
binning_x: 0
roi:
  x_offset: 0
  do_rectify: False
---
height: 9
"""


def second_message(model):
    """What `ros2 topic echo` prints of ROS 2."""
    lists = {"d": BENDS[model], "k": flat(MATRIX), "r": flat(np.eye(3)), "p": flat(NEW)}
    blocks = "".join(
        f"{name}:\n" + "".join(f"- {number}\n" for number in given) for name, given in lists.items()
    )
    head = "header:\n  stamp:\n    sec: 1\n  frame_id: camera\nheight: 480\nwidth: 640\n"
    return f"{head}distortion_model: {model}\n{blocks}binning_x: 0\n---\n"


@pytest.mark.parametrize("model", BENDS)
@pytest.mark.parametrize("form", [calibrator, first_message, second_message])
def test_camera_info_of_ros_is_read(tmp_path, form, model):
    (tmp_path / "info.yaml").write_text(form(model))
    for read in (read_calibration, read_intrinsics):
        found = read(str(tmp_path / "info.yaml"))
        np.testing.assert_array_equal(found.camera.matrix, HALVES)
        np.testing.assert_array_equal(found.camera.distortion, BENDS[model])
        assert found.camera.model == ("fisheye" if model == FISHEYE else "pinhole")
        np.testing.assert_array_equal(
            found.pinhole.matrix, [[500, 0, 310.5], [0, 500, 230.5], [0, 0, 1]]
        )
        np.testing.assert_array_equal(found.rotation, np.eye(3))
        assert found.shape == (480, 640)


def test_a_camera_of_ros_without_distortion_is_a_pinhole(tmp_path):
    text = first_message("plumb_bob").replace(str(BENDS["plumb_bob"]), "[]")
    (tmp_path / "info.yaml").write_text(text)
    assert read_calibration(str(tmp_path / "info.yaml")).camera.distortion is None


@pytest.mark.parametrize("is_whole", [False, True])
def test_a_pinhole_of_open3d_is_read(tmp_path, is_whole):
    columns = flat(np.transpose(MATRIX))
    facts = {"width": 640, "height": 480, "intrinsic_matrix": columns}
    if is_whole:  # PinholeCameraParameters
        pose = flat(np.eye(4))
        facts = {"class_name": "PinholeCameraParameters", "extrinsic": pose, "intrinsic": facts}
    (tmp_path / "camera.json").write_text(json.dumps(facts))
    for read in (read_calibration, read_intrinsics):
        found = read(str(tmp_path / "camera.json"))
        np.testing.assert_array_equal(found.camera.matrix, HALVES)
        assert (found.camera.distortion, found.shape) == (None, (480, 640))


@pytest.mark.parametrize("form", ["yml", "xml", "json"])
@pytest.mark.parametrize("is_fisheye", [0, 1])
def test_a_calibration_of_opencv_is_read(tmp_path, form, is_fisheye):
    path = str(tmp_path / f"camera.{form}")
    bends = BENDS["equidistant"]
    storage = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("fisheye_model", is_fisheye)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array([bends]))
    storage.release()
    found = read_intrinsics(path)
    np.testing.assert_array_equal(found.camera.matrix, HALVES)
    np.testing.assert_array_equal(found.camera.distortion, bends)
    assert found.camera.model == ("fisheye" if is_fisheye else "pinhole")
    assert found.shape == (480, 640)


def test_intrinsics_need_no_lens_and_a_lens_does(tmp_path):
    path = str(tmp_path / "camera.yml")
    storage = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    storage.write("K", np.array(MATRIX))
    storage.release()
    np.testing.assert_array_equal(read_intrinsics(path).camera.matrix, HALVES)
    with pytest.raises(ValueError, match=r"camera\.yml: it has none of distortion_coefficients"):
        read_calibration(path)


def test_intrinsics_are_fitted_to_pictures_of_the_same_proportions(tmp_path):
    (tmp_path / "info.yaml").write_text(calibrator("plumb_bob"))
    found = read_intrinsics(str(tmp_path / "info.yaml"))
    assert found.sized(480, 640) is found.camera
    np.testing.assert_allclose(found.sized(240, 320).matrix[:2], np.array(HALVES)[:2] / 2)
    assert found.sized(160, 213).fx == pytest.approx(525.5 * 213 / 640)  # rounded
    with pytest.raises(ValueError, match="640 x 480 pixels do not fit a picture of 480 x 480"):
        found.sized(480, 480)


BAD = {
    "empty.yaml": ("", "it is empty"),
    "words.yaml": ("no camera at all\n", "line 1: it is not a name with a value"),
    "open.yaml": ("K: [1, 2,\n  3", "line 3: did not find expected ',' or ']'"),
    "after.yaml": ("K: [1, 2] 3", "line 1: did not find expected key"),
    "comma.yaml": ("K: [1, [2] 3]", "line 1: did not find expected ',' or ']'"),
    "anchor.yaml": ("K: &a [1, 2]", "line 1: anchors are not allowed"),
    "indent.yaml": ("a: 1\n  b: 2\n", "line 2: mapping values are not allowed in this context"),
    "alias.yaml": ("K: [1, 2]\nD: *K", "line 2: anchors are not allowed"),
    "laughs.yaml": ("a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]", "line 1: anchors"),
    "merge.yaml": ("a: {b: 1}\n<<: *a", "line 2: anchors are not allowed"),
    "key.yaml": ("? [1, 2]\n: 3", "line 1: a name is a text"),
    "quote.yaml": ("a: 1\nb: 'x", "line 2: found unexpected end of stream"),
    "list.yaml": ("- 1\n- 2\n", "line 1: it is not a name with a value"),
    "deep.yaml": ("a: " + "[" * 99 + "]" * 99, "too deep"),
    "steps.yaml": ("".join(f"{' ' * n}a:\n" for n in range(99)), "too deep"),
    "other.yaml": ("a: 1\n", "it has none of camera_matrix"),
    "model.yaml": ("distortion_model: fov\nK: [1]", "cannot reshape array of size 1"),
    "name.yaml": ("distortion_model: fov\nD: [1]", "unknown lens model 'fov'; known: pinhole"),
    "zero.yaml": (f"distortion_model: plumb_bob\nK: {[0] * 8 + [1]}\nD: []", "singular"),
    "size.yaml": (f"height: -2\nwidth: 3\nK: {MATRIX}\nD: [0, 0, 0, 0]", "pictures of 3 x -2"),
    "count.yaml": (calibrator("equidistant").replace("equidistant", "plumb_bob2"), "plumb_bob2"),
    "rows.yaml": (calibrator("plumb_bob").replace("rows: 1", "rows: 7"), "cannot reshape"),
    "bytes.yaml": ("\x00\x01", "line 1: control characters are not allowed"),
    "cut.json": ('{"intrinsic_matrix": [1,', "Expecting value"),
    "few.json": ('{"intrinsic_matrix": [1, 2]}', "its intrinsic_matrix has 2 numbers, not 9"),
    "none.json": ('{"intrinsic": {}}', "has no intrinsic_matrix"),
    "word.json": ('{"intrinsic": 7}', "word.json: "),
    "transposed.json": (json.dumps({"intrinsic_matrix": flat(MATRIX)}), "0, 0, 1"),
    "opencv.yml": ("%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n", "opencv.yml"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_is_no_camera_is_an_error_of_one_line(tmp_path, name):
    content, complaint = BAD[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=complaint) as caught:
        read_calibration(str(tmp_path / name))
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("form", [calibrator, first_message, second_message])
def test_a_file_cut_off_before_its_end_is_an_error_of_one_line(tmp_path, form):
    text, path = form("plumb_bob"), tmp_path / "info.yaml"
    whole = text.index("\n", text.lower().index("k:" if "k:" in text.lower() else "data"))
    for size in range(0, whole - 20, 3):
        path.write_text(text[:size])
        with pytest.raises(ValueError, match="info") as caught:
            read_calibration(str(path))
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("is_compiled", [True, False])
def test_yaml_of_calibrations_knows_numbers_texts_and_lists(is_compiled, monkeypatch):
    if not is_compiled:  # as PyYAML is where it has no wheel
        monkeypatch.delattr("yaml.CSafeLoader")
    text = """%YAML 1.2
---
one: 1   # a comment
half: .5
'far': .inf
nothing:
text: "a: b # c"
path: a/b:c
rows: [[1, 2], [3, 4,],
  'x']
items:
  - 1e-3
  - two
within:
    deeper: {value}
tagged: !!opencv-matrix
   rows: 3
made: !!python/object/apply:os.system [exit]
last: 3
last: -2
...
beyond: 1
""".replace("{value}", "-1.5")
    assert yaml_of(text) == {
        "one": 1,
        "half": 0.5,
        "far": np.inf,
        "nothing": None,
        "text": "a: b # c",
        "path": "a/b:c",
        "rows": [[1, 2], [3, 4], "x"],
        "items": [0.001, "two"],
        "within": {"deeper": -1.5},
        "tagged": {"rows": 3},
        "made": ["exit"],
        "last": -2,
    }
