"""Clouds as scanners, CloudCompare and meshes write them: each is read, or refused in one line."""

import struct
from importlib.util import find_spec

import numpy as np
import pytest

from resample.colors import from_srgb
from resample_points import Cloud, prepare_cloud, read_cloud

RNG = np.random.default_rng(11)
PLACE = RNG.normal(size=(8, 3)).astype(np.float32)
LEVEL = RNG.integers(0, 256, (8, 3), dtype=np.uint8)
LEVEL[0, 0] = 255
COLOR = from_srgb(LEVEL / np.float32(255))
STRENGTH = np.arange(8) * 10


def lines(*columns):
    table = np.concatenate([np.asarray(column).reshape(8, -1) for column in columns], axis=1)
    return "\n".join(" ".join(f"{value:.9g}" for value in row) for row in table.tolist()) + "\n"


def text(path, content):
    path.write_text(content, encoding="utf-8")
    return read_cloud(path)


def is_the_cloud(cloud):
    np.testing.assert_allclose(cloud.position, PLACE, rtol=1e-7)
    np.testing.assert_allclose(cloud.color, COLOR, rtol=1e-6)


@pytest.mark.parametrize("name", ["a.pts", "a.xyz", "a.txt"])
def test_a_line_with_the_number_of_points_is_skipped(tmp_path, name):
    cloud = text(tmp_path / name, "8\n" + lines(PLACE, STRENGTH, LEVEL))
    is_the_cloud(cloud)
    np.testing.assert_array_equal(cloud.columns["intensity"], STRENGTH)


def test_pts_files_hold_several_scans(tmp_path):
    rows = lines(PLACE, STRENGTH, LEVEL).splitlines(True)
    is_the_cloud(text(tmp_path / "a.pts", "".join(["3\n", *rows[:3], "5\n", *rows[3:]])))


def test_pts_without_colors_are_gray_by_their_intensity(tmp_path):
    cloud = text(tmp_path / "a.pts", "8\n" + lines(PLACE, STRENGTH - 2048))
    white = np.quantile(STRENGTH, 0.98)
    np.testing.assert_allclose(cloud.color[:, 1], np.minimum(STRENGTH / white, 1), rtol=1e-5)


def test_text_with_fewer_points_than_it_says_is_cut_off(tmp_path):
    with pytest.raises(OSError, match="cut off: 8 of 9 points are there"):
        text(tmp_path / "a.pts", "9\n" + lines(PLACE, STRENGTH, LEVEL))


def test_headers_and_counts_of_cloudcompare_are_read(tmp_path):
    head = "//X Y Z R G B Scan_angle Nx Ny Nz\n8\n"
    cloud = text(tmp_path / "a.asc", head + lines(PLACE, LEVEL, STRENGTH, PLACE))
    is_the_cloud(cloud)
    np.testing.assert_allclose(cloud.normal, PLACE, rtol=1e-7)
    np.testing.assert_array_equal(cloud.columns["Scan_angle"], STRENGTH)


def test_float_colors_of_cloudcompare_are_read(tmp_path):
    is_the_cloud(text(tmp_path / "a.asc", "//X Y Z Rf Gf Bf\n" + lines(PLACE, LEVEL / 255)))


def test_quoted_headers_after_a_mark_of_byte_order_are_read(tmp_path):
    rows = lines(PLACE, LEVEL).replace(" ", ",")
    is_the_cloud(text(tmp_path / "a.csv", '\ufeff"X","Y","Z","Red","Green","Blue"\n' + rows))


def test_seven_columns_may_have_their_value_last(tmp_path):
    cloud = text(tmp_path / "a.xyz", lines(PLACE, LEVEL, STRENGTH + 0.5))
    is_the_cloud(cloud)
    np.testing.assert_array_equal(cloud.columns["value"], STRENGTH + 0.5)


def test_six_columns_with_vectors_of_length_one_are_normals(tmp_path):
    normal = PLACE / np.linalg.norm(PLACE, axis=1, keepdims=True)
    cloud = text(tmp_path / "a.xyz", lines(PLACE, normal))
    assert cloud.color.shape == (0, 3)
    np.testing.assert_allclose(cloud.normal, normal, rtol=1e-6)


@pytest.mark.parametrize("name", ["a.bin", "a.pcd.bin"])
def test_scans_of_kitti_and_nuscenes_are_gray_by_their_intensity(tmp_path, name):
    path, share = tmp_path / name, (STRENGTH / 70).astype(np.float32)
    more = [np.arange(8)] if "pcd" in name else []
    np.column_stack([PLACE, share, *more]).astype("<f4").tofile(path)
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.position, PLACE)
    np.testing.assert_array_equal(cloud.columns["intensity"], share)
    white = np.quantile(share, 0.98)
    np.testing.assert_allclose(cloud.color[:, 0], np.minimum(share / white, 1), rtol=1e-5)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\0" * 15, "not a multiple of 16"),
        (b"", "not a multiple of 16"),
        (struct.pack("<4f", 0, np.nan, 0, 0), "NaN"),
        (struct.pack("<2d", 1234.5678, -0.1), "not a KITTI scan"),
    ],
)
def test_bytes_that_are_no_scan_are_refused(tmp_path, content, message):
    path = tmp_path / "points3D.bin"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


HEAD = "ply\nformat {} 1.0\n"
CAMERA = "element camera 2\nproperty float at\n"
STRIPS = "element strip 3\nproperty list uchar ushort of\nproperty double w\n"
VERTEX = (
    "element vertex 8\nproperty float x\nproperty list int short seen\nproperty float y\n"
    "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
)


def strange_ply(encoding):
    """PLY with elements before its vertices, which have lists of several lengths."""
    head = (HEAD.format(encoding) + CAMERA + STRIPS + VERTEX).encode()
    if encoding == "ascii":
        rows = [
            f"{x} 2 7 9 {y} {z}" if n % 3 else f"{x} 0 {y} {z}"
            for n, (x, y, z) in enumerate(PLACE.tolist())
        ]
        rows = [f"{row} {r} {g} {b}\n" for row, (r, g, b) in zip(rows, LEVEL.tolist(), strict=True)]
        return head + ("1\n2\n3 1 2 3 0.5\n0 0.5\n1 9 0.5\n" + "".join(rows)).encode()
    order = ">" if "big" in encoding else "<"
    body = struct.pack(order + "2f", 1, 2)
    for own in ((1, 2, 3), (), (9,)):
        body += struct.pack(f"{order}B{len(own)}Hd", len(own), *own, 0.5)
    for n, ((x, y, z), level) in enumerate(zip(PLACE.tolist(), LEVEL.tolist(), strict=True)):
        own = (7, 9) if n % 3 else ()
        body += struct.pack(f"{order}fi{len(own)}h2f3B", x, len(own), *own, y, z, *level)
    return head + body


ENCODINGS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_ply_has_lists_and_other_elements_before_its_vertices(tmp_path, encoding):
    path = tmp_path / "a.ply"
    path.write_bytes(strange_ply(encoding))
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.position, PLACE)
    np.testing.assert_array_equal(cloud.color, COLOR)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_ply_file_cut_off_anywhere_is_refused_in_one_line(tmp_path, encoding):
    path, whole = tmp_path / "a.ply", strange_ply(encoding)
    begin = whole.index(b"end_header\n") + len("end_header\n")
    ends = range(begin, len(whole) - 10, 7)
    for end in ends:
        path.write_bytes(whole[:end])
        with pytest.raises((OSError, ValueError), match=r"cut off|lacks a number") as caught:
            read_cloud(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("property list float int of", "must be a whole number"),
        ("property list uchar of", "nor a list of numbers"),
        ("property string of", "neither a number"),
    ],
)
def test_properties_that_cannot_be_read_are_named(tmp_path, line, message):
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{line}\nend_header\n")
    with pytest.raises(ValueError, match=message):
        read_cloud(path)


def test_lists_of_negative_length_are_refused(tmp_path):
    path = tmp_path / "a.ply"
    head = HEAD.format("binary_little_endian") + "element vertex 1\nproperty list char int of\n"
    path.write_bytes((head + "end_header\n").encode() + b"\xff\0\0\0\0")
    with pytest.raises(ValueError, match="a list of -1 numbers"):
        read_cloud(path)


def typed_ply(kind, level, encoding="binary_little_endian"):
    """PLY of places and levels of a type, as NumPy and PLY name it."""
    name, word = kind
    fields = [(axis, "<f4") for axis in "xyz"] + [(c, "<" + name) for c in ("red", "green", "blue")]
    rows = np.array([(*p, *c) for p, c in zip(PLACE.tolist(), level.tolist(), strict=True)], fields)
    head = HEAD.format(encoding) + "element vertex 8\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property {word} {c}\n" for c in ("red", "green", "blue")) + "end_header\n"
    if encoding == "ascii":
        return (head + lines(PLACE, level)).encode()
    return head.encode() + rows.tobytes()


@pytest.mark.parametrize("encoding", ENCODINGS[:2])
@pytest.mark.parametrize(
    "kind", [("f4", "float"), ("f8", "double"), ("u2", "ushort"), ("i4", "int")]
)
def test_levels_of_8_bits_are_found_in_any_type(tmp_path, kind, encoding):
    path = tmp_path / "a.ply"
    path.write_bytes(typed_ply(kind, LEVEL, encoding))
    np.testing.assert_allclose(read_cloud(path).color, COLOR, rtol=1e-6)


@pytest.mark.parametrize("kind", [("f4", "float"), ("u2", "ushort"), ("u4", "uint")])
def test_levels_of_16_bits_are_found_in_any_type(tmp_path, kind):
    path, level = tmp_path / "a.ply", LEVEL.astype(np.uint16) * 257
    path.write_bytes(typed_ply(kind, level))
    np.testing.assert_allclose(read_cloud(path).color, COLOR, rtol=1e-6)


def test_floats_slightly_above_1_are_bright_not_black(tmp_path):
    path, share = tmp_path / "a.ply", LEVEL / np.float32(250)
    path.write_bytes(typed_ply(("f4", "float"), share))
    np.testing.assert_allclose(read_cloud(path).color, from_srgb(share), rtol=1e-6)


def test_white_is_found_in_the_whole_file_not_in_its_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("resample_points.files.plain.STEP", 3)
    path, level = tmp_path / "a.ply", np.full((8, 3), 100, np.uint16)
    level[7] = 60_000
    path.write_bytes(typed_ply(("u2", "ushort"), level))
    expected = from_srgb(level / np.float32(65535))
    np.testing.assert_allclose(read_cloud(path).color, expected, rtol=1e-6)


def test_levels_of_arrays_are_no_light(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, position=PLACE, color=LEVEL)
    np.testing.assert_allclose(read_cloud(path).color, COLOR, rtol=1e-6)
    with pytest.raises(ValueError, match=r"color of a cloud holds levels \(uint8\)"):
        prepare_cloud(Cloud(PLACE, np.empty((0, 3)), LEVEL, np.empty(0)))


@pytest.mark.skipif(find_spec("pye57") is None, reason="the extra e57 is not installed")
class TestE57:
    """Scans that pye57 wrote."""

    def write(self, path, *scans):
        import pye57

        file = pye57.E57(str(path), mode="w")
        for data, choices in scans:
            named = {
                f"cartesian{axis}": column for axis, column in zip("XYZ", PLACE.T, strict=True)
            }
            file.write_scan_raw(named | data, **choices)
        file.close()

    def levels(self):
        return {
            f"color{name}": column
            for name, column in zip(("Red", "Green", "Blue"), LEVEL.T, strict=True)
        }

    def test_all_scans_are_read_at_their_poses(self, tmp_path):
        path, turn = tmp_path / "a.e57", np.sqrt(0.5)
        moved = {"rotation": np.array([turn, 0, 0, turn]), "translation": np.array([5e6, 1, 2])}
        self.write(path, (self.levels(), {}), (self.levels(), moved))
        cloud = read_cloud(path)
        x, y, z = PLACE.astype(np.float64).T
        expected = np.stack([5e6 - y, 1 + x, 2 + z], axis=1)  # a quarter turn to the left
        np.testing.assert_allclose(cloud.position[:8], PLACE, rtol=1e-7)
        np.testing.assert_allclose(cloud.position[8:], expected, atol=2e-9)
        np.testing.assert_allclose(cloud.color, np.tile(COLOR, (2, 1)), rtol=1e-6)

    def test_invalid_points_are_left_out_and_intensity_is_gray(self, tmp_path):
        path, bad = tmp_path / "a.e57", np.arange(8) % 4 == 1
        data = {
            "intensity": STRENGTH.astype(np.float32),
            "cartesianInvalidState": bad.astype(np.int8),
        }
        self.write(path, (data, {}))
        cloud = read_cloud(path)
        np.testing.assert_allclose(cloud.position, PLACE[~bad], rtol=1e-7)
        own = STRENGTH[~bad]
        white = np.quantile(own, 0.98)
        np.testing.assert_allclose(cloud.color[:, 2], np.minimum(own / white, 1), rtol=1e-5)

    def test_scans_without_colors_are_gray_beside_those_with_colors(self, tmp_path):
        path = tmp_path / "a.e57"
        self.write(path, (self.levels(), {}), ({}, {}))
        gray = from_srgb(np.float32(0.5))
        np.testing.assert_allclose(read_cloud(path).color[8:], np.full((8, 3), gray), rtol=1e-6)

    @pytest.mark.parametrize("end", [4, 40, 900, 1500])
    def test_a_file_that_is_cut_off_is_refused_in_one_line(self, tmp_path, end):
        path = tmp_path / "a.e57"
        self.write(path, (self.levels(), {}))
        path.write_bytes(path.read_bytes()[:end])
        with pytest.raises((ValueError, OSError), match=r"damaged|not an E57") as caught:
            read_cloud(path)
        assert "\n" not in str(caught.value)


def test_e57_without_its_reader_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pye57", None)
    (tmp_path / "a.e57").write_bytes(b"ASTM-E57")
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[e57\]'"):
        read_cloud(tmp_path / "a.e57")
