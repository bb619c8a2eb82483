"""Clouds read from files: every format gives the same points, and bad files one line."""

import errno
import struct
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest

from conftest import real
from resample import registry
from resample.colors import from_srgb
from resample_points import read_gaussians, read_particles
from resample_points.files.readers import Cloud, is_cloud, read_cloud

RNG = np.random.default_rng(7)
POSITION = RNG.normal(size=(40, 3)).astype(np.float32)
NORMAL = (POSITION / np.linalg.norm(POSITION, axis=1, keepdims=True)).astype(np.float32)
LEVEL = RNG.integers(0, 256, (40, 3), dtype=np.uint8)
COLOR = from_srgb(LEVEL.astype(np.float32) / np.float32(255))

PLY_FIELDS = ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")
PLY_HEADER = (
    "ply\nformat {} 1.0\ncomment made for a test\nelement vertex 40\n"
    + "".join(f"property float {name}\n" for name in PLY_FIELDS[:6])
    + "".join(f"property uchar {name}\n" for name in PLY_FIELDS[6:])
    + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)
PCD_HEADER = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
    "FIELDS x y z rgb normal_x normal_y normal_z _\nSIZE 4 4 4 4 4 4 4 1\nTYPE F F F F F F F U\n"
    "COUNT 1 1 1 1 1 1 1 4\nWIDTH 40\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA {}\n"
)


def _ply(path: Path, encoding: str, with_normals: bool = True) -> Path:
    order = ">" if "big" in encoding else "<"
    kind = [(name, order + "f4") for name in PLY_FIELDS[:6]] + [
        (name, "u1") for name in PLY_FIELDS[6:]
    ]
    points = np.zeros(40, kind)
    for n, name in enumerate(PLY_FIELDS):
        points[name] = np.concatenate([POSITION, NORMAL, LEVEL], axis=1)[:, n]
    header = PLY_HEADER.format(encoding)
    if not with_normals:
        header = "".join(line for line in header.splitlines(True) if " n" not in line)
        points = points[["x", "y", "z", "red", "green", "blue"]]
        points = np.array(points.tolist(), [kind[n] for n in (0, 1, 2, 6, 7, 8)])
    if encoding == "ascii":
        body = "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist()) + "3 0 1 2\n"
        path.write_text(header + body)
    else:
        path.write_bytes(
            header.encode() + points.tobytes() + struct.pack(order + "B3i", 3, 0, 1, 2)
        )
    return path


def _lzf(data: bytes) -> bytes:
    """LZF with references to the byte before wherever bytes repeat."""
    packed, n = bytearray(), 0
    while n < len(data):
        run = 0
        while n > 0 and run < 264 and n + run < len(data) and data[n + run] == data[n - 1]:
            run += 1
        if run >= 9:
            packed += bytes([7 << 5, run - 9, 0])
            n += run
        elif run >= 3:
            packed += bytes([(run - 2) << 5, 0])
            n += run
        else:
            packed += bytes([0, data[n]])
            n += 1
    return bytes(packed)


def _pcd(path: Path, encoding: str) -> Path:
    red, green, blue = LEVEL.astype(np.uint32).T
    columns = [*POSITION.T, (red << 16 | green << 8 | blue).view(np.float32), *NORMAL.T]
    padding = np.zeros((40, 4), np.uint8)
    header = PCD_HEADER.format(encoding).encode()
    if encoding == "ascii":
        rows = zip(*columns, strict=True)
        body = "".join(" ".join(f"{value:.9g}" for value in row) + " 0 0 0 0\n" for row in rows)
        path.write_bytes(header + body.encode())
    elif encoding == "binary":
        table = np.stack(columns, axis=1).view(np.uint8)
        path.write_bytes(header + np.concatenate([table, padding], axis=1).tobytes())
    else:
        data = b"".join(np.ascontiguousarray(column).tobytes() for column in (*columns, padding))
        packed = _lzf(data)
        path.write_bytes(header + struct.pack("<II", len(packed), len(data)) + packed)
    return path


def _cut_off(path: Path) -> None:
    """Lose the end of a file, and what is left of its last line."""
    left = path.read_bytes()[:-200]
    path.write_bytes(left[: left.rindex(b"\n") + 1] if b"ascii" in left else left)


def _is_the_cloud(cloud: Cloud) -> None:
    np.testing.assert_array_equal(cloud.position, POSITION)
    np.testing.assert_array_equal(cloud.normal, NORMAL)
    np.testing.assert_array_equal(cloud.color, COLOR)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_reads_the_same_in_every_encoding(tmp_path, encoding):
    _is_the_cloud(read_cloud(_ply(tmp_path / "a.ply", encoding)))


# What unpacks them is compiled for them alone.
PACKED = pytest.mark.sweep


@pytest.mark.parametrize(
    "encoding", ["ascii", "binary", pytest.param("binary_compressed", marks=PACKED)]
)
def test_pcd_reads_the_same_in_every_encoding(tmp_path, encoding):
    _is_the_cloud(read_cloud(_pcd(tmp_path / "a.pcd", encoding)))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_ply_without_normals_has_none(tmp_path, encoding):
    cloud = read_cloud(_ply(tmp_path / "a.ply", encoding, with_normals=False))
    assert cloud.normal.shape == (0, 3)
    np.testing.assert_array_equal(cloud.color, COLOR)


def test_pcd_may_pack_colors_into_whole_numbers(tmp_path):
    path = tmp_path / "a.pcd"
    path.write_text(
        "FIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\nPOINTS 1\nDATA ascii\n1 2 3 4278190335\n"
    )
    np.testing.assert_array_equal(read_cloud(path).color, [[0, 0, 1]])


def test_points_that_are_no_numbers_are_left_out(tmp_path):
    path = tmp_path / "a.pcd"
    path.write_text(
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 3\nDATA ascii\n0 0 1\nnan nan nan\n1 0 1\n"
    )
    np.testing.assert_array_equal(read_cloud(path).position, [[0, 0, 1], [1, 0, 1]])


@pytest.mark.parametrize("between", [" ", ", ", ";"])
def test_columns_of_text_are_places_and_colors(tmp_path, between):
    path = tmp_path / "a.xyz"
    rows = np.concatenate([POSITION.astype(str), LEVEL.astype(str)], axis=1)
    path.write_text("# x y z r g b\n" + "\n".join(between.join(row) for row in rows))
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.position, POSITION, rtol=1e-7)  # as many digits as float32 has
    np.testing.assert_allclose(cloud.color, COLOR, rtol=1e-6)


def test_columns_of_text_with_fractions_are_colors_up_to_1(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("0 0 1 1 0.5 0\n")
    np.testing.assert_allclose(read_cloud(path).color[0], [1, 0.214041, 0], atol=1e-6)


def test_xyzn_holds_normals(tmp_path):
    path = tmp_path / "a.xyzn"
    path.write_text("0 0 1 0 0 -1\n")
    cloud = read_cloud(path)
    assert cloud.color.shape == (0, 3)
    np.testing.assert_array_equal(cloud.normal, [[0, 0, -1]])


def test_arrays_come_as_they_are(tmp_path):
    path = tmp_path / "a.npz"
    radius = np.full(40, 0.5, np.float32)
    np.savez(path, position=POSITION.astype(np.float64) + 1e7, color=COLOR, radius=radius)
    cloud = read_cloud(path)
    assert cloud.position.dtype == np.float64
    np.testing.assert_array_equal(cloud.position, POSITION.astype(np.float64) + 1e7)
    np.testing.assert_array_equal(cloud.radius, radius)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", b"", r"\.pcd, \.ply"),
        ("a.ply", b"solid\n", "end_header"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "no element vertex"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n", "PLY header"),
        ("a.pcd", b"FIELDS x y z\nDATA ascii\n", "PCD header"),
        ("a.pcd", b"FIELDS x\nSIZE 4\nTYPE F\nPOINTS 1\nDATA ascii\n1\n", "no x, y and z"),
        ("a.xyz", b"1 2\n", "2 columns"),
        ("a.xyz", b"1 2 three\n", "table of numbers"),
        ("a.xyz", b"", "no points"),
        ("a.xyz", b"nan nan nan\n", "no points"),
        ("a.xyz", b"\xff\xfe\x00", "not a text file"),
    ],
)
def test_what_is_no_cloud_is_refused_in_one_line(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


GAUSSIAN = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "f_rest_0",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
]
PACKED_GAUSSIAN = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]


@pytest.mark.parametrize("names", [GAUSSIAN, PACKED_GAUSSIAN])
def test_gaussians_are_refused_by_what_they_are(tmp_path, names):
    path = tmp_path / "scene.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement chunk 0\nelement vertex 1\n"
        + "".join(f"property float {name}\n" for name in names)
        + f"end_header\n{'0 ' * len(names)}\n"
    )
    with pytest.raises(ValueError, match=r"^scene\.ply: holds 3D Gaussians .*x y z red") as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


def test_points_with_an_opacity_are_points(tmp_path):
    path = tmp_path / "a.ply"
    names = ["x", "y", "z", "opacity", "scale_0"]
    lines = "".join(f"property float {name}\n" for name in names)
    header = f"ply\nformat ascii 1.0\nelement vertex 1\n{lines}end_header\n"
    path.write_text(header + "1 2 3 4 5\n")
    np.testing.assert_array_equal(read_cloud(path).position, [[1, 2, 3]])


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_a_ply_file_that_is_cut_off_says_so(tmp_path, encoding):
    path = _ply(tmp_path / "a.ply", encoding)
    _cut_off(path)
    with pytest.raises(OSError, match="cut off"):
        read_cloud(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_a_pcd_file_that_is_cut_off_says_so(tmp_path, encoding):
    path = _pcd(tmp_path / "a.pcd", encoding)
    _cut_off(path)
    with pytest.raises(OSError, match="cut off"):
        read_cloud(path)


@pytest.mark.sweep
def test_damaged_packing_is_noticed(tmp_path):
    path = _pcd(tmp_path / "a.pcd", "binary_compressed")
    content = bytearray(path.read_bytes())
    first = content.index(b"binary_compressed\n") + len("binary_compressed\n") + 8
    content[first] = 0xFF  # a reference to bytes before the first
    path.write_bytes(content)
    with pytest.raises(OSError, match="damaged"):
        read_cloud(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_cloud(tmp_path / "none.ply")


def test_the_scan_has_normals_and_colors():
    cloud = read_cloud(real("meshes/pointclouds/frag_115.ply"))
    assert [part.shape for part in cloud[:4]] == [(64365, 3), (64365, 3), (64365, 3), (0,)]


def test_arrays_with_a_wrong_checksum_are_damaged(tmp_path):
    path = tmp_path / "cloud.npz"
    np.savez(path, position=np.arange(300.0).reshape(100, 3))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(OSError, match=r"cloud\.npz is damaged: .*CRC") as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


def test_arrays_without_a_position_are_no_cloud(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, color=COLOR, radius=np.ones(40))
    assert not is_cloud(path)
    with pytest.raises(ValueError, match=r"a\.npz: has no array position; a cloud has position"):
        read_cloud(path)


def test_a_file_that_is_absent_or_damaged_is_no_cloud(tmp_path):
    assert not is_cloud(tmp_path / "absent.npz")
    (tmp_path / "b.npz").write_bytes(b"PK")
    assert not is_cloud(tmp_path / "b.npz")


@pytest.mark.parametrize(
    ("name", "shape"), [("normal", (40, 2)), ("color", (39, 3)), ("radius", (3,))]
)
def test_an_array_that_does_not_fit_the_positions_is_refused(tmp_path, name, shape):
    np.savez(tmp_path / "a.npz", position=POSITION, **{name: np.ones(shape)})
    with pytest.raises(ValueError, match=f"{name} has the shape"):
        read_cloud(tmp_path / "a.npz")


@pytest.mark.parametrize("reader", [read_cloud, read_gaussians, read_particles])
@pytest.mark.parametrize("name", ["absent.ply", "no folder/absent.npz"])
def test_a_file_that_is_absent_is_told_as_the_system_does(tmp_path, reader, name):
    with pytest.raises(FileNotFoundError) as caught:
        reader(tmp_path / name)
    assert caught.value.errno == errno.ENOENT
    assert caught.value.filename == str(tmp_path / name)


def test_a_package_can_read_a_further_format(tmp_path, monkeypatch):
    fake = EntryPoint("two", "package:read_two", "resample.clouds")
    monkeypatch.setattr(registry, "entry_points", EntryPoints([fake]).select)
    made = Cloud(np.eye(2, 3), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    monkeypatch.setattr(EntryPoint, "load", lambda _: lambda path: made if path.stat() else None)
    path = tmp_path / "a.two"
    path.write_text("points")
    assert is_cloud(path)
    np.testing.assert_array_equal(read_cloud(path).position, np.eye(2, 3))
    with pytest.raises(ValueError, match=r"clouds are read from \.two"):
        read_cloud(path.rename(tmp_path / "a.xyz"))
