"""Maps of microscopy and cubes of chemistry, written byte by byte from their definitions."""

import gzip
import os
import struct

import numpy as np
import pytest

from resample.reading.limits import SETTING
from resample_formats.maps import Cube, Mrc
from resample_volume.data.recordings import volume_at
from resample_volume.files.source import find_reader, open_volume

AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
BOHR = 0.529177210903
MODES = {0: "i1", 1: "i2", 2: "f4", 6: "u2", 12: "f2"}


@pytest.fixture
def values(rng) -> np.ndarray:
    """Values of sections, rows and columns."""
    return rng.integers(0, 100, (4, 5, 6))


def mrc(values, *, mode=2, order="<", told=(), extended=b"", **words) -> bytes:
    """Write a file; `words` and `told` are words of the header by name, or by number from 1 on."""
    head = bytearray(1024)

    def put(place: int, form: str, *numbers) -> None:
        struct.pack_into(order + form, head, 4 * (place - 1), *numbers)

    sections, rows, columns = values.shape
    put(1, "4i", columns, rows, sections, mode)
    put(5, "3i", *words.get("start", (0, 0, 0)))
    put(8, "3i", *words.get("grid", (columns, rows, sections)))
    put(11, "3f", *words.get("cell", (columns, rows, sections)))
    put(14, "3f", *words.get("angles", (90, 90, 90)))
    put(17, "3i", *words.get("axes", (1, 2, 3)))
    put(23, "2i", words.get("group", 1), len(extended))
    put(50, "3f", *words.get("origin", (0, 0, 0)))
    head[208:216] = b"MAP " + (b"DD\0\0" if order == "<" else b"\x11\x11\0\0")
    for place, form, number in told:
        put(place, form, number)
    kind = MODES.get(mode, "u1")
    return bytes(head) + extended + values.astype(order + kind).tobytes()


def refused(reader, path, content, match):
    path.write_bytes(content)
    with pytest.raises(ValueError, match=match) as caught:
        reader(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mode", MODES)
def test_maps_of_every_mode_and_order_of_bytes(mode, order, values, tmp_path):
    path = tmp_path / "a.mrc"
    cell, origin = (12.0, 5.0, 10.0), (-3.0, 4.0, 5.5)
    path.write_bytes(mrc(values, mode=mode, order=order, cell=cell, origin=origin))
    volume = open_volume(path)
    assert np.array_equal(volume.values, values)
    assert volume.values.dtype == np.dtype({12: "f4"}.get(mode, MODES[mode]))
    assert volume.spacing.tolist() == [2, 1, 2.5]
    assert volume.origin.tolist() == [-3, 4, 5.5]
    assert (volume.name, volume.direction.tolist()) == ("a", np.eye(3).tolist())


@pytest.mark.parametrize("axes", [(1, 2, 3), (3, 1, 2), (2, 3, 1), (3, 2, 1)])
def test_columns_rows_and_sections_may_be_any_axes(axes, values, tmp_path):
    path = tmp_path / "a.ccp4"
    start = (7, -2, 3)  # of columns, rows, sections
    path.write_bytes(
        mrc(values, axes=axes, start=start, grid=(10, 20, 40), cell=(5, 20, 10), mode=0)
    )
    volume = Mrc()(path)
    where = np.argsort(axes)  # of x, y, z: column, row or section
    for at in np.ndindex(*values.shape):
        inward = np.array(at[::-1])[where]  # x, y, z
        assert volume.values[tuple(inward[::-1])] == values[at]
    assert volume.spacing.tolist() == [0.5, 1, 0.25]
    assert np.array_equal(volume.origin, volume.spacing * np.array(start)[where])


def test_voxels_are_mapped_and_the_second_header_is_gone_past(values, tmp_path):
    path = tmp_path / "a.map"
    path.write_bytes(mrc(values, extended=b"x" * 160))
    volume = Mrc()(path)
    assert np.array_equal(volume.values, values)
    assert isinstance(volume.values.base, np.memmap) or isinstance(volume.values, np.memmap)


@pytest.mark.parametrize("suffix", [".mrc.gz", ".map.gz", ".ccp4.gz", ".mrcs.gz"])
def test_packed_maps(suffix, values, tmp_path):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(gzip.compress(mrc(values, extended=b"x" * 80)))
    assert isinstance(find_reader(path), Mrc)
    volume = open_volume(path)
    assert np.array_equal(volume.values, values)
    assert volume.name == "a"


def test_oblique_cells_keep_their_lengths_and_angles(values, tmp_path):
    path = tmp_path / "a.map"
    path.write_bytes(mrc(values, angles=(80, 100, 120), cell=(6, 10, 12), start=(1, 2, 3)))
    volume = Mrc()(path)
    assert np.allclose(volume.spacing, (1, 2, 3), rtol=1e-12)
    a, b, c = volume.direction.T
    angles = np.degrees(np.arccos([b @ c, a @ c, a @ b]))
    assert np.allclose(angles, (80, 100, 120), atol=1e-9)
    assert a.tolist() == [1, 0, 0]
    assert np.linalg.det(volume.direction) > 0
    assert np.allclose(volume.origin, 1 * a + 4 * b + 9 * c)


def test_a_stack_of_volumes_is_times_and_one_of_pictures_has_them_as_slices(values, tmp_path):
    path = tmp_path / "a.mrcs"
    path.write_bytes(mrc(values, group=401, grid=(6, 5, 2), cell=(6, 5, 4)))
    held = Mrc().recorded(path)
    assert held.values.shape == (2, 1, 2, 5, 6)
    assert np.array_equal(volume_at(held, 1, None).values, values[2:])
    assert held.spacing.tolist() == [1, 1, 2]
    with pytest.raises(ValueError, match="choose one by time, 0 to 1"):
        Mrc()(path)
    path.write_bytes(mrc(values, group=0, grid=(6, 5, 1), cell=(6, 5, 2)))
    volume = Mrc()(path)
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == [1, 1, 2]
    assert "stack of pictures" in volume.note


def test_bytes_of_imod_have_a_sign_where_its_flag_says_so(values, tmp_path):
    path = tmp_path / "a.mrc"
    for flags, kind in ((1, "int8"), (0, "uint8")):
        told = [(39, "i", 1146047817), (40, "i", flags)]
        path.write_bytes(mrc(values - 50, mode=0, told=told))
        volume = Mrc()(path)
        assert np.array_equal(volume.values, (values - 50).astype(kind))
        assert volume.values.dtype == kind


def test_a_file_without_a_cell_has_steps_of_one(values, tmp_path):
    path = tmp_path / "a.mrc"
    path.write_bytes(mrc(values, cell=(0, 0, 0), grid=(0, 0, 0), angles=(0, 0, 0), axes=(0, 0, 0)))
    assert Mrc()(path).spacing.tolist() == [1, 1, 1]
    damaged = bytearray(mrc(values, order=">"))
    damaged[212:216] = bytes(4)  # without a stamp the order that makes sense
    path.write_bytes(damaged)
    assert np.array_equal(Mrc()(path).values, values)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ({"mode": 3}, "mode 3, complex numbers of 16 bits; write the map"),
        ({"mode": 4}, "mode 4, complex numbers; write"),
        ({"mode": 101}, "mode 101, numbers of 4 bits; convert"),
        ({"mode": 7}, "unknown mode 7; known are 0, 1, 2, 6, 12"),
        ({"axes": (1, 1, 3)}, r"its axes are \(1, 1, 3\)"),
        ({"told": [(24, "i", -5)]}, "its second header has -5 bytes"),
        ({"told": [(1, "i", -5)]}, "is empty"),
        ({"told": [(1, "i", 1 << 30)]}, "needs|bytes"),
        ({"group": 401, "grid": (6, 5, 3)}, "4 sections are no stack of volumes of 3"),
        ({"group": 401, "grid": (6, 5, 0)}, "no stack of volumes of 0"),
        ({"group": 401, "told": [(3, "i", 0)]}, "0 sections are no stack of volumes of 4"),
        ({"cell": (-1, 1, 1)}, "must be positive"),
        ({"cell": (np.nan, 1, 1)}, "must be positive"),
        ({"grid": (6, -5, 4)}, "-5 intervals"),
        ({"cell": (np.inf, 1, 1), "start": (0, 1, 1)}, "must be positive"),
        ({"angles": (np.nan, 90, 90)}, "angles of nan"),
        ({"origin": (np.nan, 0, 0)}, "origin"),
        ({"angles": (90, 0, 90)}, "angles of 90, 0, 90 degrees"),
        ({"angles": (10, 10, 170)}, "no cell has the angles"),
    ],
)
def test_nonsense_in_a_map_is_refused_in_words(words, match, values, tmp_path):
    refused(Mrc(), tmp_path / "a.mrc", mrc(values, **words), match)


@pytest.mark.parametrize("count", [0, 100, 1023, 1024, 1500])
def test_maps_that_are_cut_off_are_refused(count, values, tmp_path):
    content = mrc(values)
    refused(Mrc(), tmp_path / "a.mrc", content[:count], "cut off|wanted")
    packed = gzip.compress(content)
    refused(Mrc(), tmp_path / "a.mrc.gz", packed[: min(count, len(packed) - 9)], "cut off|damaged")


def test_a_small_map_does_not_unpack_to_gigabytes(tmp_path, monkeypatch):
    monkeypatch.setenv(SETTING, "unpacked=100000,ratio=2")
    content = mrc(np.zeros((40, 60, 60)))
    refused(Mrc(), tmp_path / "a.mrc.gz", gzip.compress(content), "that unpack to")


# Cubes


def cube(values, *, unit=1, steps=AXES, origin=(0, 0, 0), parts=0, nval=""):
    """Write a cube of values (X, Y, Z), or (X, Y, Z, C) of orbitals."""
    lines = ["title", "loops: x, y, z", f"{-2 if parts else 2} {origin[0]} {origin[1]} {origin[2]}"]
    lines[-1] += nval
    for count, step in zip(values.shape, steps, strict=False):
        lines.append(f"{unit * count:5d} {step[0]:.6f} {step[1]:.6f} {step[2]:.6f}")
    lines += ["8 8.0 0.1 0.2 0.3", "1 1.0 0.4 0.5 0.6"]
    if parts:
        lines.append(" ".join(map(str, [parts, *range(1, parts + 1)])))
    for row in values.reshape(*values.shape[:2], -1).reshape(-1, values[0, 0].size):
        words = [f"{number:.5E}" for number in row]
        lines += [" ".join(words[n : n + 6]) for n in range(0, len(words), 6)]
    return "\n".join(lines).encode() + b"\n"


@pytest.mark.parametrize(("unit", "scale"), [(1, BOHR), (-1, 1.0)])
def test_cubes_are_in_bohr_or_angstroms_by_their_sign(unit, scale, rng, tmp_path):
    values = rng.integers(-99999, 99999, (3, 4, 7)) / 1e7
    path = tmp_path / "a.cube"
    steps = np.diag([0.5, 1, 2])
    path.write_bytes(cube(values, unit=unit, steps=steps, origin=(-1, 2, 3)))
    volume = open_volume(path)
    assert np.array_equal(volume.values, values.transpose(2, 1, 0).astype(np.float32))
    assert np.allclose(volume.spacing, scale * np.array([0.5, 1, 2]), rtol=1e-14)
    assert np.allclose(volume.origin, scale * np.array([-1, 2, 3]), rtol=1e-14)


def test_axes_of_a_cube_may_be_turned_or_oblique(rng, tmp_path):
    steps = np.array([[0.6, 0.8, 0], [-0.8, 1.6, 0], [0, 0.3, -0.4]])
    path = tmp_path / "a.cub"
    path.write_bytes(cube(rng.random((3, 4, 5)), unit=-1, steps=steps))
    volume = Cube()(path)
    assert np.allclose(volume.direction * volume.spacing, steps.T)
    assert np.allclose(np.linalg.norm(volume.direction, axis=0), 1)


def test_orbitals_are_channels(rng, tmp_path):
    values = rng.integers(0, 999, (2, 3, 4, 5))
    for name, content in {
        "a.cube": cube(values, parts=5),
        "b.cube": cube(values, nval=" 5"),
    }.items():
        path = tmp_path / name
        path.write_bytes(content)
        held = Cube().recorded(path)
        assert held.values.shape == (1, 5, 4, 3, 2)
        one = volume_at(held, None, 3)
        assert np.array_equal(one.values, values[..., 3].transpose(2, 1, 0))
        with pytest.raises(ValueError, match="by channel, 0 to 4"):
            Cube()(path)


def test_exponents_of_fortran_are_understood(tmp_path):
    head = cube(np.zeros((2, 2, 2)))
    words = b"1.5D-05 1.25-101 -2.5d+01 3.0E+00\n1 -1. .5 0\n"
    path = tmp_path / "a.cube"
    path.write_bytes(head[: head.index(b"0.6\n") + 4] + words)
    wanted = np.array([1.5e-5, 0, -25, 3, 1, -1, 0.5, 0], np.float32)
    assert np.array_equal(Cube()(path).values.transpose(2, 1, 0).ravel(), wanted)


CUBE = cube(np.ones((2, 3, 4)))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "not a Gaussian cube"),
        (b"neither fish nor flesh\n" * 50, "not a Gaussian cube: atoms and the origin"),
        (CUBE[:-30], "cut off"),
        (CUBE[:60], "voxels along"),
        (CUBE[:-20] + b"fishes\n", "cut off|damaged"),
        (CUBE.replace(b"1.00000E+00", b"fishandeggs"), "damaged: could not convert"),
        (CUBE + b"1.0\n", "more than its 24 numbers"),
        (CUBE.replace(b"    2 1.0", b"   -2 1.0"), "same sign"),
        (CUBE.replace(b"    2 1.0", b"    0 1.0"), "is empty"),
        (CUBE.replace(b"    2 1.0", b"99999 1.0"), "cut off"),
        (CUBE.replace(b"    2 1.0", b"999999999999 1.0"), "cut off|needs"),
        (CUBE.replace(b"    2 1.000000", b"    2 nan"), "must be positive|not finite"),
        (CUBE.replace(b"    2 1.000000", b"    2 1e300"), "must be positive|scene units"),
        (CUBE.replace(b"    2 1.000000", b"    2 inf"), "must be positive"),
        (CUBE.replace(b"    2 1.000000", b"    2 0.000000"), "must be positive"),
        (CUBE.replace(b"\n2 0 0 0", b"\n99999999 0 0 0"), "over the limit"),
        (CUBE.replace(b"\n2 0 0 0", b"\n3 0 0 0"), "an atom has five numbers"),
        (CUBE.replace(b"\n2 0 0 0", b"\n2 0 0 0 -1"), "have -1 numbers"),
        (CUBE.replace(b"\n2 0 0 0", b"\n-2 0 0 0"), "not a whole number|orbitals"),
    ],
)
def test_nonsense_in_a_cube_is_refused_in_words(content, match, tmp_path):
    refused(Cube(), tmp_path / "a.cube", content, match)


def test_cubes_larger_than_a_text_may_be_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(SETTING, "text=100")
    refused(Cube(), tmp_path / "a.cube", CUBE, "over the limit of .*text=")


@pytest.mark.parametrize("end", ["mrc", "map.gz", "cube"])
def test_names_that_are_no_utf8_are_read(end, values, tmp_path):
    content = {"mrc": mrc(values), "map.gz": gzip.compress(mrc(values)), "cube": CUBE}[end]
    path = tmp_path / os.fsdecode(b"caf\xe9." + end.encode())
    path.write_bytes(content)
    assert open_volume(path).name == "caf\udce9"


@pytest.mark.parametrize("name", ["a.mrc", "a.cube", "a.vtk", "a.mrc.gz"])
def test_pipes_are_no_maps(name, tmp_path):
    os.mkfifo(tmp_path / name)
    with pytest.raises(OSError, match="is a device or a pipe"):
        open_volume(tmp_path / name)
