import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import SimpleITK

from resample import registry
from resample_volume.files import source
from resample_volume.files.dicom import Dicom
from resample_volume.files.nifti import Nifti
from resample_volume.files.readers import Npy, Raw
from resample_volume.files.source import (
    describe,
    find_reader,
    generate,
    open_recording,
    open_volume,
)
from resample_volume.files.tiff import TiffStack
from resample_volume.types import Volume

SUFFIXES = [
    (name, suffix)
    for name in registry.names("readers")
    for suffix in registry.load("readers", name).suffixes
]


def volume(values: np.ndarray) -> Volume:
    return Volume(values, np.ones(3), np.zeros(3), np.eye(3), "made")


@pytest.mark.parametrize(("name", "suffix"), SUFFIXES)
def test_every_installed_reader_is_found_by_its_suffixes(name, suffix, tmp_path):
    for written in (suffix, suffix.upper()):
        assert type(find_reader(tmp_path / f"a{written}")) is registry.load("readers", name)


def test_the_longest_suffix_wins(tmp_path):
    assert isinstance(find_reader(tmp_path / "a.nii.gz"), Nifti)
    assert isinstance(find_reader(tmp_path / "a.raw.gz"), Raw)


def test_an_unknown_suffix_lists_the_known(tmp_path):
    (tmp_path / "a.odd").write_text("")
    with pytest.raises(
        ValueError, match=r"a.odd has no known suffix; known are \.bmp \.ccp4 .*\.raw"
    ):
        open_volume(tmp_path / "a.odd")


def test_a_file_of_another_application_names_it(tmp_path):
    (tmp_path / "a.xyz").write_text("")
    with pytest.raises(ValueError, match="resample-points reads such files"):
        open_volume(tmp_path / "a.xyz")


def test_an_unknown_name_lists_the_generated():
    with pytest.raises(FileNotFoundError, match="no such file; generated volumes are checker-box"):
        open_volume("cheker-box")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"a.nrrd: there is no such file$"):
        open_volume(tmp_path / "a.nrrd")


def test_a_file_is_read_by_name_as_by_path(tmp_path):
    values = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    np.save(tmp_path / "a.npy", values)
    assert np.array_equal(open_volume(str(tmp_path / "a.npy")).values, values)
    assert np.array_equal(open_volume(tmp_path / "a.npy").values, values)


def test_a_given_reader_reads_what_its_suffix_does_not_tell(tmp_path):
    (tmp_path / "a.xyz").write_bytes(bytes(range(24)))
    found = open_volume(
        tmp_path / "a.xyz", registry.build("readers", "raw:shape=4x3x2,dtype=uint8")
    )
    assert found.values.shape == (2, 3, 4)


def test_a_folder_is_read_by_what_it_holds(tmp_path):
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(ValueError, match="holds no slices"):
        find_reader(tmp_path)
    (tmp_path / "1.png").write_bytes(b"")
    assert isinstance(find_reader(tmp_path), TiffStack)
    (tmp_path / "IM0001").write_bytes(bytes(128) + b"DICM")
    with pytest.raises(ValueError, match=r"files of \.dcm and \.png; give one of them"):
        find_reader(tmp_path)
    (tmp_path / "1.png").unlink()
    assert isinstance(find_reader(tmp_path), Dicom)


def test_a_folder_of_slices_is_a_volume(tmp_path, rng):
    values = rng.integers(0, 255, (3, 4, 5)).astype(np.uint8)
    for z, plane in enumerate(values):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(plane), str(tmp_path / f"{z}.png"))
    assert np.array_equal(open_volume(tmp_path).values, values)


def test_a_plugin_is_found_by_its_suffix(tmp_path, monkeypatch):
    @dataclass(frozen=True)
    class Text:
        suffixes: ClassVar[tuple[str, ...]] = (".volume.txt",)

        def __call__(self, path):
            return volume(np.loadtxt(path).reshape(2, 2, 2))

    monkeypatch.setattr(source.registry, "names", lambda _: ["text"])
    monkeypatch.setattr(source.registry, "load", lambda *_: Text)
    monkeypatch.setattr(source.registry, "build", lambda *_: Text())
    (tmp_path / "a.volume.txt").write_text("0 1 2 3 4 5 6 7")
    assert open_volume(tmp_path / "a.volume.txt").values[1, 1, 1] == 7


def test_two_readers_of_one_suffix_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(source.registry, "names", lambda _: ["npy", "other"])
    monkeypatch.setattr(source.registry, "load", lambda *_: Npy)
    with pytest.raises(
        ValueError, match=r"choose a reader; npy and other read \.npy \(--reader npy"
    ):
        find_reader(tmp_path / "a.npy")


def test_a_broken_plugin_hurts_only_who_needs_it(tmp_path, monkeypatch):
    def load(_, name):
        if name == "broken":
            raise LookupError("reader 'broken' cannot be imported")
        return Npy

    monkeypatch.setattr(source.registry, "names", lambda _: ["broken", "npy"])
    monkeypatch.setattr(source.registry, "load", load)
    assert isinstance(find_reader(tmp_path / "a.npy"), Npy)
    with pytest.raises(ValueError, match="reader 'broken' cannot be imported"):
        find_reader(tmp_path / "a.xyz")


def test_generated_volumes_take_parameters():
    assert open_volume("checker-box:size=8, block=2").values.shape == (8, 8, 8)
    assert generate("marschner-lobb:size=5,alpha=0.5").values.shape == (5, 5, 5)


def test_a_file_is_preferred_to_a_generated_volume(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "checker-box").write_text("")
    with pytest.raises(ValueError, match="no known suffix"):
        open_volume("checker-box")


@pytest.mark.parametrize("text", ["sise=8", "size=8.5", "size", "size=", "size=1,,"])
def test_wrong_parameters_name_the_right_ones(text):
    with pytest.raises(ValueError, match="not a parameter; checker-box takes size=100, block=10"):
        open_volume(f"checker-box:{text}")


def test_an_unknown_generator_lists_the_known():
    with pytest.raises(ValueError, match="generated are checker-box, marschner-lobb, vessel-tree"):
        generate("marshmallow")


def test_a_description_is_plain(rng):
    values = rng.normal(size=(4, 5, 6)).astype(np.float32)
    facts = describe(volume(values), bins=8)
    assert json.loads(json.dumps(facts))["shape"] == [6, 5, 4]
    assert facts["range"] == (values.min(), values.max())
    assert facts["histogram"] == np.histogram(values, 8)[0].tolist()
    assert facts["dtype"] == "float32"


def test_what_is_no_number_is_counted_apart():
    values = np.array([[[0, np.nan], [1, np.inf]], [[4, -np.inf], [2, np.nan]]])
    facts = describe(volume(values), bins=4)
    assert facts["range"] == (0, 4)
    assert (facts["nan"], facts["infinite"]) == (2, 2)
    assert facts["histogram"] == [1, 1, 1, 1]


def test_a_volume_without_numbers_has_no_range():
    facts = describe(volume(np.full((2, 2, 2), np.nan)))
    assert facts["range"] is None
    assert sum(facts["histogram"]) == 0


def test_a_histogram_without_bins_is_refused():
    with pytest.raises(ValueError, match="at least 1 bin"):
        describe(volume(np.zeros((2, 2, 2))), bins=0)


def test_slabs_change_nothing(rng, monkeypatch):
    made = volume(rng.integers(0, 255, (9, 4, 4)).astype(np.uint8))
    whole = describe(made)
    monkeypatch.setattr("resample_volume.data.values.CHUNK", 40)
    assert describe(made) == whole


def test_a_constant_volume_has_one_full_bin():
    facts = describe(volume(np.full((2, 2, 2), 7, np.uint8)))
    assert facts["range"] == (7, 7)
    assert sorted(facts["histogram"])[-2:] == [0, 8]


@pytest.mark.sweep
def test_compressed_raw_and_its_header_agree(volumes):
    raw = open_volume(volumes / "engine_256x256x128_uint8.raw.gz")
    assert np.array_equal(raw.values, open_volume(volumes / "engine.nhdr").values)
    assert raw.name == "engine"


@pytest.mark.sweep
def test_built_in_data_are_opened_by_name(tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(tmp_path))
    given = open_volume("sample:vessel-tree:size=8")
    assert np.array_equal(given.values, open_volume("vessel-tree:size=8").values)
    assert open_recording("sample:vessel-tree:size=8").values.shape == (1, 1, 8, 8, 8)
    with pytest.raises(LookupError, match="vessel-trees"):
        open_volume("sample:vessel-trees")


@pytest.mark.parametrize("name", source.OWN)
def test_a_reader_is_found_by_its_suffixes_before_it_is_imported(name):
    assert source.OWN[name] == registry.load("readers", name).suffixes
