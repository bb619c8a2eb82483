"""Files of OpenVDB, as OpenVDB 10 wrote them."""

import sys

import numpy as np
import pytest

from resample_formats.openvdb import Vdb
from resample_volume.files.source import open_volume
from tests.vdb_files import BALL, GRIDS, TILES

VALUES = np.arange(60, dtype=np.float32).reshape(3, 4, 5).transpose(2, 1, 0)  # (Z, Y, X)


@pytest.fixture
def put(tmp_path):
    pytest.importorskip("tinyvdb")

    def write(content, name="a.vdb"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


def test_the_grid_named_density_is_read_with_its_place(put):
    volume = open_volume(put(GRIDS))
    assert np.array_equal(volume.values, VALUES)
    assert volume.values.dtype == np.float32
    assert volume.origin.tolist() == [0.5, 8, -1]  # OpenVDB's indexToWorld((-1, 6, 2))
    assert (volume.direction * volume.spacing).tolist() == [[0.5, 0, 0], [0, 1, 0], [0, 0, -2]]
    assert volume.note == "density: 98.3 % of the voxels are active, others are its background, 0"


def test_another_grid_is_chosen_by_its_name_and_its_lattice_may_be_oblique(put):
    volume = Vdb("heat")(put(GRIDS))
    assert np.array_equal(volume.values, VALUES + 1)
    np.testing.assert_allclose(volume.origin, [0.5, 8.3, 7])
    last = volume.origin + volume.direction @ (volume.spacing * [2, 3, 4])
    np.testing.assert_allclose(last, [1.5, 12.3, 15])  # OpenVDB's indexToWorld((1, 9, 6))


def test_voxels_off_the_band_of_a_level_set_have_no_value(put):
    volume = open_volume(put(BALL))
    assert volume.values.shape == (7, 7, 7)
    assert np.isfinite(volume.values).sum() == 250
    assert np.isnan(volume.values[0, 0, 0])
    assert volume.values[6, 3, 3] == 1  # 3 from the middle of a ball of radius 2
    assert "others have no value" in volume.note


@pytest.mark.parametrize(
    ("content", "part", "match"),
    [
        (TILES, "", "4097 active voxels, of which 4096 lie in tiles, .*; write it as .npy"),
        (GRIDS, "wind", r"vdb:part=NAME \(wind given\): density \(float\).*wind \(vec3s\)"),
        (GRIDS, "rain", r"\(rain given\)"),
        (GRIDS[:9000], "", "is damaged or no OpenVDB file"),
        (GRIDS[:60], "", "is damaged or no OpenVDB file"),
        (b"neither fish nor flesh", "", "is damaged or no OpenVDB file"),
    ],
    ids=["tiles", "vectors", "unknown", "cut off", "head", "other"],
)
def test_what_cannot_be_read_of_openvdb_is_said_in_a_line(content, part, match, put):
    path = put(content)
    with pytest.raises(ValueError, match=match) as caught:
        Vdb(part)(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_grid_of_two_far_voxels_is_no_volume_of_all_between(put, monkeypatch):
    import tinyvdb

    class Far:
        name, type_name, metadata = "density", "Tree_float_5_4_3", {}

        def to_sparse(self):
            places = np.array([[0, 0, 0], [2000000, 2000000, 2000000]], np.int32)
            return {"coords": places.tobytes(), "values": np.ones(2, np.float32).tobytes()}

    class File:
        grid_count = 1

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def read_grids(self):
            pass

        def grid(self, _):
            return Far()

    monkeypatch.setattr(tinyvdb, "open", lambda _: File())
    with pytest.raises(ValueError, match=r"that unpack to .* over the limit"):
        Vdb()(put(GRIDS))


def test_a_library_that_fails_within_is_said_in_a_line(put, monkeypatch):
    import tinyvdb

    def opened(_):
        raise SystemError("returned a result with an exception set")

    monkeypatch.setattr(tinyvdb, "open", opened)
    with pytest.raises(ValueError, match="is damaged or no OpenVDB file: returned a result"):
        Vdb()(put(GRIDS))


def test_without_the_extra_files_of_openvdb_are_refused_with_its_name(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tinyvdb", None)
    (tmp_path / "a.vdb").write_bytes(GRIDS)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[vdb\]', or write it as"):
        open_volume(tmp_path / "a.vdb")
