"""Clouds of laser scanners: LAS, LAZ and COPC are read as they were written, or refused."""

import struct
import sys
from itertools import pairwise

import numpy as np
import pytest

from resample.colors import from_srgb
from resample_points.cli import app
from resample_points.data import parts as clouds_in_parts
from resample_points.data.columns import BRIGHT
from resample_points.files.readers import read_cloud
from resample_points.geometry.spacing import prepare_cloud
from tests.laser import CENTER, SCALE, copc_of, las_of

pytest.importorskip("laspy", reason="the extra las is not installed")
pytest.importorskip("lazrs", reason="the extra las is not installed")

RNG = np.random.default_rng(3)
COUNT = 60
STEPS = RNG.integers(0, 9000, (COUNT, 3))
PLACE = STEPS * np.float64(SCALE) + np.array(CENTER)
LEVEL = RNG.integers(0, 65536, (COUNT, 3), dtype=np.uint16)
NAMES = ("red", "green", "blue")
KINDS = [(3, "1.2", False), (2, "1.2", True), (7, "1.4", False), (7, "1.4", True), (8, "1.4", True)]


def columns(some=slice(None), level=LEVEL):
    parts = dict(zip("xyz", PLACE[some].T, strict=True))
    if level is not None:
        parts |= dict(zip(NAMES, level[some].T, strict=True))
    return parts | {"intensity": np.arange(COUNT)[some] * 100}


def put(path, data):
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(("point_format", "version", "packed"), KINDS)
def test_places_and_colors_are_those_that_were_written(tmp_path, point_format, version, packed):
    data = las_of(columns(), point_format=point_format, version=version, packed=packed)
    cloud = read_cloud(put(tmp_path / ("a.laz" if packed else "a.las"), data))
    assert cloud.position.dtype == np.float64
    np.testing.assert_array_equal(cloud.position, PLACE)
    np.testing.assert_array_equal(cloud.color, from_srgb(LEVEL / np.float32(65535)))
    np.testing.assert_array_equal(cloud.columns["intensity"], np.arange(COUNT) * 100)


def test_places_far_from_the_origin_keep_their_distances(tmp_path):
    cloud = read_cloud(put(tmp_path / "a.las", las_of(columns())))
    discs = prepare_cloud(cloud, radius=1.0)
    order = np.lexsort(discs.position.T)
    expected = PLACE - discs.origin
    found = discs.position[order].astype(np.float64)
    # Within half a step of the file: float32 has steps of 0.5 at 5,120,000.
    np.testing.assert_allclose(found, expected[np.lexsort(expected.T)], atol=0.5 * SCALE)


def test_colors_of_eight_bits_in_sixteen_are_taken_as_such(tmp_path):
    low = LEVEL >> 8
    cloud = read_cloud(put(tmp_path / "a.las", las_of(columns(level=low))))
    np.testing.assert_array_equal(cloud.color, from_srgb(low / np.float32(255)))


def test_points_without_colors_have_their_intensities(tmp_path):
    black = las_of(columns(level=LEVEL * 0))
    for data in (black, las_of(columns(level=None), point_format=1)):
        cloud = read_cloud(put(tmp_path / "a.las", data))
        white = np.quantile(np.arange(COUNT) * 100, BRIGHT)
        gray = np.minimum(np.arange(COUNT) * 100 / white, 1)
        np.testing.assert_allclose(cloud.color, np.repeat(gray[:, None], 3, axis=1), rtol=1e-6)


def test_points_without_colors_and_intensities_have_those_of_their_classes(tmp_path):
    number = np.arange(COUNT) % 3
    parts = columns(level=None) | {"intensity": np.zeros(COUNT), "classification": number}
    cloud = read_cloud(put(tmp_path / "a.las", las_of(parts, point_format=6, version="1.4")))
    assert len(np.unique(cloud.color, axis=0)) == 3
    assert all(len(np.unique(cloud.color[number == n], axis=0)) == 1 for n in range(3))


def test_withheld_points_are_left_out(tmp_path):
    held = np.arange(COUNT) % 4 == 0
    data = las_of(columns() | {"withheld": held})
    np.testing.assert_array_equal(read_cloud(put(tmp_path / "a.las", data)).position, PLACE[~held])


@pytest.mark.parametrize("pages", [1, 2])
def test_levels_of_copc_are_left_out_from_the_finest_on(tmp_path, pages):
    ends = (0, 5, 20, COUNT)
    chunks = [columns(slice(*pair)) for pair in pairwise(ends)]
    path = put(tmp_path / "a.copc.laz", copc_of(chunks, pages=pages))
    for level, count in enumerate((COUNT, 20, 5)):
        np.testing.assert_array_equal(read_cloud(path, level=level).position, PLACE[:count])
    with pytest.raises(ValueError, match="has levels 0 to 2, but no level 3"):
        read_cloud(path, level=3)


def test_a_file_without_levels_has_none(tmp_path):
    path = put(tmp_path / "a.laz", las_of(columns(), packed=True))
    with pytest.raises(ValueError, match="no levels"):
        read_cloud(path, level=1)
    with pytest.raises(ValueError, match="no levels"):
        read_cloud(put(tmp_path / "a.xyz", b"0 0 0\n"), level=1)


def test_what_does_not_fit_into_memory_names_the_level_that_does(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))
    chunks = [columns(slice(0, 20)), columns(slice(20, COUNT))]
    path = put(tmp_path / "a.copc.laz", copc_of(chunks))
    free = 30 * clouds_in_parts.PER_POINT
    monkeypatch.setattr(clouds_in_parts, "available_memory", lambda: free)
    with caplog.at_level("INFO", "resample"):
        np.testing.assert_array_equal(read_cloud(path).position, PLACE)
    assert "a.copc.laz has 60 points" in caplog.text
    assert "; --level 1 fits" in caplog.text


@pytest.mark.parametrize("packed", [False, True])
def test_files_that_are_cut_off_are_refused(tmp_path, packed):
    data = las_of(columns(), packed=packed)
    for length in (3, 100, 300, len(data) - 40):
        with pytest.raises(OSError, match=r"damaged|cut off"):
            read_cloud(put(tmp_path / "a.laz", data[:length]))


def test_sizes_that_a_file_cannot_have_are_refused_before_memory_is_taken(tmp_path):
    data = bytearray(las_of(columns(), point_format=7, version="1.4", packed=True))
    (start,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, start)
    for place in (100, start + 8 + 36 + 4, table + 4):  # of header, of a chunk's layers, of chunks
        changed = bytearray(data)
        struct.pack_into("<I", changed, place, 0xFFFFFFF0)
        with pytest.raises(OSError, match=r"does not fit|layers of its points|missing"):
            read_cloud(put(tmp_path / "a.laz", changed))


def test_pages_of_levels_that_name_each_other_are_refused(tmp_path):
    data = bytearray(copc_of([columns(), columns()], pages=2))
    root, size = struct.unpack_from("<2Q", data, 375 + 54 + 40)
    struct.pack_into("<Qi", data, root + 32 + 16, root, size)
    with pytest.raises(OSError, match="a page of its levels is missing"):
        read_cloud(put(tmp_path / "a.copc.laz", data), level=1)


def test_without_the_extra_it_is_named(tmp_path, monkeypatch):
    path = put(tmp_path / "a.las", las_of(columns()))
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[las\]'"):
        read_cloud(path)


def test_a_command_shows_them_and_says_where_they_are(tmp_path, capsys):
    path = put(tmp_path / "a.copc.laz", copc_of([columns(), columns(slice(0, 9))]))
    target = tmp_path / "a.png"
    words = ["render", str(path), "--level", "1", "--size", "24", "--no-cache", "-o", str(target)]
    app(words, result_action="return_value")
    assert target.is_file()
    assert "a.copc.laz is centered near 435004" in capsys.readouterr().err
