"""Folders of pictures, arrays in archives, and files that no reader takes."""

import numpy as np
import pytest
from PIL import Image

from resample_volume.files.source import open_recording, open_volume

VALUES = np.random.default_rng(7).integers(0, 200, (4, 5, 6), np.uint8)  # (Z, Y, X)
MORE = np.random.default_rng(8).integers(0, 200, (2, 3, 4, 5, 6), np.uint16)  # times, channels


@pytest.mark.parametrize("suffix", ["jpg", "bmp", "png"])
def test_a_folder_of_pictures_is_a_stack(tmp_path, suffix):
    for n, plane in enumerate(VALUES):
        Image.fromarray(plane).save(tmp_path / f"slice{n}.{suffix}", quality=100)
    volume = open_volume(tmp_path)
    atol = 3 if suffix == "jpg" else 0
    np.testing.assert_allclose(volume.values.astype(int), VALUES, atol=atol)


def test_npz_of_one_array_is_as_npy(tmp_path):
    np.savez(tmp_path / "a.npz", density=VALUES)
    np.testing.assert_array_equal(open_volume(tmp_path / "a.npz").values, VALUES)
    np.savez_compressed(tmp_path / "b.npz", MORE)
    np.testing.assert_array_equal(open_recording(tmp_path / "b.npz").values, MORE)
    np.savez(tmp_path / "c.npz", one=VALUES, two=VALUES)
    with pytest.raises(ValueError, match="chosen by its name: --reader npz:array=density"):
        open_volume(tmp_path / "c.npz")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("a.mat", "scipy.io.loadmat"),
        ("a.pvd", "ParaView"),
        ("a.vsi", "OME-TIFF"),
        ("a.rec", "nibabel"),
    ],
)
def test_other_kinds_of_files_are_answered_by_what_reads_them(tmp_path, name, match):
    (tmp_path / name).write_bytes(b"something")
    with pytest.raises(ValueError, match=f"{name} is read by none of the readers; .*{match}"):
        open_volume(tmp_path / name)
