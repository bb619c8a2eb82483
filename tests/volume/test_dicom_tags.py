"""Tags of DICOM that are not as they should be: refused by their names."""

import io
import struct

import numpy as np
import pytest

from resample_volume.files.dicom import Dicom
from tests.fuzz.corpus import dicoms

pydicom = pytest.importorskip("pydicom")
CONTENT = dicoms()[2].files["a.dcm"]  # three frames


def read(path, content):
    path.write_bytes(content)
    return Dicom()(path)


def changed(**values):
    told = pydicom.dcmread(io.BytesIO(CONTENT))
    for key, value in values.items():
        setattr(told, key, value)
    file = io.BytesIO()
    told.save_as(file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("Rows", [4, 5], "one whole number"),
        ("Columns", None, "one whole number"),
        ("NumberOfFrames", ["3", "4"], "one whole number"),
        ("SamplesPerPixel", [1, 2], "one whole number"),
        ("BitsAllocated", [16, 16], "one whole number"),
        ("BitsAllocated", 13, "1, 8, 16, 32 or 64"),
        ("BitsStored", [12, 12], "one whole number"),
        ("BitsStored", 99, "1 to 16"),
        ("PixelRepresentation", [0, 1], "one whole number"),
        ("PhotometricInterpretation", ["RGB", "RGB"], "one text"),
        ("PixelSpacing", ["1", "2", "3"], "1 or 2 finite numbers"),
        ("ImagePositionPatient", ["1", "2"], "3 finite numbers"),
        ("ImageOrientationPatient", ["1", "0"], "6 finite numbers"),
        ("RescaleSlope", ["1", "2"], "1 finite number"),
        ("RescaleIntercept", "1e400", "1 finite number"),
        ("SpacingBetweenSlices", ["1", "2"], "1 finite number"),
        ("SliceThickness", ["1", "2"], "1 finite number"),
        ("GridFrameOffsetVector", "5", "3 finite numbers"),
    ],
)
def test_a_tag_with_other_values_is_named(key, value, allowed, tmp_path):
    with pytest.raises(ValueError, match=rf"its {key} is .*, where {allowed} (is|are)\)$"):
        read(tmp_path / "a.dcm", changed(**{key: value}))


@pytest.mark.parametrize("key", ["PixelSpacing", "RescaleSlope", "ImagePositionPatient"])
def test_an_empty_tag_is_one_that_is_left_out(key, tmp_path):
    assert read(tmp_path / "a.dcm", changed(**{key: ""})).values.shape == (3, 7, 8)


def test_one_of_several_texts_serves_where_any_does(tmp_path):
    assert read(tmp_path / "a.dcm", changed(Modality=["CT", "MR"])).units == "hu"


@pytest.mark.parametrize("claimed", [0xFFFFFFFE, 0x7FFFFFFF, 400])
def test_elements_that_claim_more_bytes_than_there_are_are_refused(claimed, tmp_path):
    place = CONTENT.rindex(b"\xe0\x7f\x10\x00") + 8
    content = CONTENT[:place] + struct.pack("<I", claimed) + CONTENT[place + 4 :]
    with pytest.raises(ValueError, match=rf"claims {claimed} bytes, 336 are there"):
        np.asarray(read(tmp_path / "a.dcm", content).values)


def test_a_cut_file_says_where_it_ends(tmp_path):
    with pytest.raises(ValueError, match="claims 336 bytes, 333 are there"):
        read(tmp_path / "a.dcm", CONTENT[:-3])
