"""Hounsfield units: told by files, by the user, or assumed of values that look it."""

import numpy as np
import pytest
import SimpleITK

from resample_volume.classification.value_statistics import Units, survey, units_of
from resample_volume.command.choices import ReadOptions
from resample_volume.command.inputs import opened
from resample_volume.files.dicom import Dicom
from resample_volume.files.nifti import Nifti
from resample_volume.files.nrrd import Nrrd
from resample_volume.inputs import as_volume

NRRD = """NRRD0004
type: short
dimension: 3
sizes: 4 4 4
spacings: 1 1 1
encoding: raw
endian: little
{more}
"""


def head(rng, air=-1000.0):
    """Air around flesh around bone, Hounsfield units with noise."""
    z, y, x = np.mgrid[:32, :32, :32] - 15.5
    away = np.sqrt(x**2 + y**2 + z**2)
    inside = np.where(away < 6, 900.0, 40.0)
    return np.where(away < 13, inside, air) + rng.normal(0, 12, away.shape)


@pytest.mark.parametrize(
    ("more", "units"),
    [
        ("", ""),
        ('sample units: "HU"\n', "hu"),
        ("sample units: Hounsfield units\n", "hu"),
        ('sample units: "1/mm"\n', ""),
        ("units:=HU\n", "hu"),
    ],
)
def test_nrrd_tells_units(more, units, tmp_path):
    (tmp_path / "a.nrrd").write_bytes(NRRD.format(more=more).encode() + bytes(128))
    assert Nrrd()(tmp_path / "a.nrrd").units == units


def test_nifti_tells_units_by_its_intent(tmp_path):
    image = SimpleITK.GetImageFromArray(np.zeros((4, 4, 4), np.int16))
    for name in ("a.nii", "b.nii"):
        SimpleITK.WriteImage(image, str(tmp_path / name))
    data = bytearray((tmp_path / "b.nii").read_bytes())
    data[328:330] = b"HU"  # intent_name
    (tmp_path / "b.nii").write_bytes(data)
    assert [Nifti()(tmp_path / name).units for name in ("a.nii", "b.nii")] == ["", "hu"]


@pytest.mark.parametrize(
    ("tags", "units"),
    [
        ({"0008|0060": "CT"}, "hu"),
        ({"0008|0060": "MR"}, ""),
        ({"0008|0060": "CT", "0028|1054": "ED"}, ""),
    ],
)
def test_dicom_is_in_hounsfield_units_where_it_is_ct(tags, units, tmp_path):
    volume = SimpleITK.GetImageFromArray(np.zeros((3, 8, 8), np.int16))
    for z in range(3):
        plane = volume[:, :, z]
        place = {"0020|0032": f"0\\0\\{z}", "0020|0037": "1\\0\\0\\0\\1\\0", "0020|000e": "1.2"}
        for tag, value in (tags | place | {"0008|0018": f"1.3.{z}"}).items():
            plane.SetMetaData(tag, value)
        writer = SimpleITK.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(str(tmp_path / f"{z}.dcm"))
        writer.Execute(plane)
    assert Dicom()(tmp_path).units == units


def test_values_that_look_it_are_assumed_to_be_hounsfield_units(rng):
    values = head(rng)
    assert survey(as_volume(values.astype(np.int16))).units == Units(0.0, is_assumed=True)
    assert survey(as_volume(values.astype(np.float32))).units == Units(0.0, is_assumed=True)
    stored = np.clip(values + 1024, 0, 4095).astype(np.uint16)
    assert survey(as_volume(stored)).units == Units(1024.0, is_assumed=True)


def test_other_values_are_not(rng):
    others = {
        "even": rng.uniform(-1000, 1000, (24, 24, 24)),
        "noise": rng.normal(0, 300, (24, 24, 24)),
        "mri": np.abs(rng.normal(900, 300, (24, 24, 24))) * (rng.random((24, 24, 24)) > 0.4),
        "bytes": head(rng) // 8 + 130,
        "no tissue": np.where(head(rng) < -500, -1000.0, 900.0),
    }
    for name, values in others.items():
        dtype = np.uint8 if name == "bytes" else np.int16
        assert survey(as_volume(values.astype(dtype))).units == Units(), name


def test_what_is_told_comes_before_what_it_looks_like(rng):
    volume = as_volume(head(rng).astype(np.int16))
    levels = survey(volume).levels
    assert units_of(volume._replace(units="none"), levels) == Units()
    assert units_of(volume._replace(units="hu+1024"), levels) == Units(1024.0)
    flat = as_volume(np.zeros((4, 4, 4), np.uint8))._replace(units="hu")
    assert survey(flat).units == Units(0.0)


def test_the_command_line_tells_units():
    assert opened(ReadOptions(units="hu+1024"), "checker-box:size=4").units == "hu+1024"
    assert opened(ReadOptions(), "checker-box:size=4").units == ""
