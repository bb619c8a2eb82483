import struct

import numpy as np
import pytest

from resample_texture.geometry import mappings
from resample_texture.geometry.mappings import read_map


def numbers(height=3, width=5):
    return np.random.default_rng(2).uniform(-9, 99, (height, width, 2)).astype(np.float32)


def flow_file(path, pairs):
    height, width = pairs.shape[:2]
    path.write_bytes(struct.pack("<fii", 202021.25, width, height) + pairs.astype("<f4").tobytes())
    return path


def picture_file(path, pairs, names):
    import OpenImageIO

    height, width = pairs.shape[:2]
    spec = OpenImageIO.ImageSpec(width, height, pairs.shape[2], OpenImageIO.FLOAT)
    if names:
        spec.channelnames = names
    target = OpenImageIO.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_image(np.ascontiguousarray(pairs))
    target.close()
    return path


def test_an_array_file_is_read(tmp_path):
    np.save(tmp_path / "map.npy", numbers())
    np.testing.assert_array_equal(read_map(tmp_path / "map.npy"), numbers())


@pytest.mark.parametrize("names", [("x", "y"), ("map_x", "map_y"), ("u", "v"), ("one", "two")])
def test_an_archive_of_two_arrays_is_read(tmp_path, names):
    x, y = np.moveaxis(numbers(), 2, 0)
    np.savez(tmp_path / "map.npz", **{names[0]: x, names[1]: y})
    np.testing.assert_array_equal(read_map(tmp_path / "map.npz"), numbers())


def test_a_flow_file_is_read(tmp_path):
    found = read_map(flow_file(tmp_path / "a.flo", numbers()))
    np.testing.assert_array_equal(found, numbers())


@pytest.mark.parametrize("unknown", [2e9, np.nan, np.inf])
def test_what_a_flow_file_does_not_know_is_no_number(tmp_path, unknown):
    flow = numbers()
    flow[1, 2, 1] = unknown
    found = read_map(flow_file(tmp_path / "a.flo", flow))
    assert np.isnan(found[1, 2]).all()
    assert np.isnan(found).sum() == 2


@pytest.mark.parametrize("suffix", [".exr", ".tif"])
def test_a_picture_of_two_channels_is_read(tmp_path, suffix):
    path = picture_file(tmp_path / f"map{suffix}", numbers(), ())
    np.testing.assert_array_equal(read_map(path), numbers())


@pytest.mark.parametrize("names", [("X", "Y", "B"), ("R", "G", "B"), ("u", "v", "weight")])
def test_a_picture_s_channels_are_found_by_name(tmp_path, names):
    third = np.dstack([numbers(), np.ones((3, 5), np.float32)])
    path = picture_file(tmp_path / "map.exr", third, names)
    np.testing.assert_array_equal(read_map(path), numbers())


@pytest.mark.parametrize("shape", [(4, 5), (2, 4, 5), (0, 4, 2)])
def test_an_array_of_another_shape_is_refused(tmp_path, shape):
    np.save(tmp_path / "map.npy", np.zeros(shape))
    with pytest.raises(ValueError, match=r"map.npy: a map holds two numbers per pixel"):
        read_map(tmp_path / "map.npy")


def test_channels_without_a_meaning_are_refused(tmp_path):
    np.savez(tmp_path / "map.npz", a=np.zeros((2, 2)), b=np.zeros((2, 2)), c=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="two channels, or channels X and Y; here are a, b, c"):
        read_map(tmp_path / "map.npz")


def test_arrays_of_two_sizes_are_refused(tmp_path):
    np.savez(tmp_path / "map.npz", x=np.zeros((2, 3)), y=np.zeros((3, 2)))
    with pytest.raises(ValueError, match="not pictures of one size"):
        read_map(tmp_path / "map.npz")


@pytest.mark.parametrize("name", ["map.npy", "map.npz", "map.exr"])
@pytest.mark.parametrize("content", [b"", b"nothing like it", b"PK\x03\x04 torn", b"\x93NUMPY\x01"])
def test_a_damaged_file_is_refused_in_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(OSError, match=rf"{name}[^\n]*$"):
        read_map(tmp_path / name)


@pytest.mark.parametrize("name", ["map.npy", "map.npz", "map.exr", "map.flo"])
def test_a_missing_file_is_named(tmp_path, name):
    with pytest.raises(FileNotFoundError, match=name):
        read_map(tmp_path / name)


@pytest.mark.parametrize("content", [b"", b"PIEH", b"something else entirely"])
def test_a_file_without_the_magic_number_is_no_flow(tmp_path, content):
    (tmp_path / "a.flo").write_bytes(content)
    with pytest.raises(ValueError, match=r"is not a \.flo file"):
        read_map(tmp_path / "a.flo")


@pytest.mark.parametrize(("width", "height"), [(5, 4), (0, 0), (-5, -3), (1 << 30, 1 << 30)])
def test_a_flow_file_of_another_length_is_damaged(tmp_path, width, height):
    data = struct.pack("<fii", 202021.25, width, height) + bytes(8 * 15)
    (tmp_path / "a.flo").write_bytes(data)
    with pytest.raises(OSError, match="is damaged"):
        read_map(tmp_path / "a.flo")


@pytest.mark.parametrize("names", [("X", "Y"), ("a", "b")])
def test_two_channels_are_a_map_of_pairs(names):
    x, y = np.arange(12.0).reshape(3, 4), np.ones((3, 4))
    found = mappings._two_of(dict(zip(names, (x, y), strict=True)), "a.exr")
    np.testing.assert_array_equal(found, np.dstack([x, y]))
