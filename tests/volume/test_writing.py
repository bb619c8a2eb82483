import numpy as np
import pytest

from resample.colors import to_srgb
from resample.measuring.color_bars import check_bar
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume.annotations import with_bar
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.files.generated import vessel_tree
from resample_volume.files.readers import Npy
from resample_volume.files.source import SUFFIXES, open_volume, write_volume
from resample_volume.types import Volume

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_what_is_written_is_read_back(tmp_path, rng, suffix, kind, mirror):
    values = (100 * rng.random((3, 4, 5))).astype(kind)
    direction = TURNED * [1, 1, mirror]
    given = Volume(values, np.array([1, 1.5, 2]), np.array([-3, 4, 5]), direction, "given")
    write_volume(tmp_path / f"a b{suffix}", given)
    found = open_volume(tmp_path / f"a b{suffix}")
    assert np.array_equal(found.values, values)
    if suffix != ".npy":  # keeps the values alone
        assert found.spacing == pytest.approx(given.spacing)
        assert found.origin == pytest.approx(given.origin)
        assert found.direction == pytest.approx(given.direction, abs=1e-6)
    assert [path.name for path in tmp_path.iterdir()] == [f"a b{suffix}"]


def test_suffixes_are_known_in_capitals(tmp_path):
    values = np.zeros((2, 3, 4), np.uint8)
    volume = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "given")
    for name in ("A.NPY", "A.NII.GZ", "A.MHA"):
        write_volume(tmp_path / name, volume)
        assert open_volume(tmp_path / name).values.shape == (2, 3, 4)


def test_a_mapped_volume_is_written_to_its_own_file(tmp_path):
    values = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    np.save(tmp_path / "a.npy", values)
    mapped = Npy()(tmp_path / "a.npy")
    write_volume(tmp_path / "a.npy", mapped)
    assert np.array_equal(np.load(tmp_path / "a.npy"), values)


@pytest.mark.parametrize("name", ["a.foo", "a", "a.vti", "a.nhdr", ".nii.g"])
def test_an_unknown_suffix_lists_the_known(tmp_path, name):
    volume = Volume(np.zeros((2, 2, 2)), np.ones(3), np.zeros(3), np.eye(3), "given")
    with pytest.raises(ValueError, match=r"volumes are written as \.nrrd, \.mha, \.nii"):
        write_volume(tmp_path / name, volume)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.nrrd", "a.nii.gz"])
def test_what_cannot_be_written_leaves_nothing(tmp_path, name):
    complex_values = np.zeros((2, 2, 2, 3, 4))  # SimpleITK writes no five dimensions there
    volume = Volume(complex_values, np.ones(3), np.zeros(3), np.eye(3), "given")
    with pytest.raises((OSError, RuntimeError)):
        write_volume(tmp_path / name, volume)
    assert not list(tmp_path.iterdir())


# Color bars

XRAY = Resampler(order=Rays(), projection=Projection.ADDITIVE)
TREE = vessel_tree(16)


@pytest.mark.parametrize("resampler", [Resampler(), XRAY])
def test_a_bar_leaves_the_picture_as_it_is(resampler):
    frame = render(TREE, resampler=resampler, size=(40, 96))
    drawn = with_bar(frame, TREE, Appearance(), resampler, None)
    assert np.array_equal(drawn.rgba[:, :40], frame.rgba)
    assert drawn.rgba.shape[1] > 60
    assert drawn.rgba[:, 40:, 3].min() == 1


@pytest.mark.sweep
def test_an_x_rays_bar_is_the_light_of_its_sums():
    frame = render(TREE, resampler=XRAY, size=(40, 96))
    bar = with_bar(frame, TREE, Appearance(), XRAY, None).rgba[:, 40:]
    column = bar[24:74, 12, 0]  # within the bar, from the top down
    assert np.abs(np.diff(column, 2)).max() < 0.01  # light falls evenly, as the sums do
    assert column[0] > column[-1] + 0.5
    assert np.isclose(to_srgb(frame.rgba[..., 0].max()), 1)


def test_a_bar_is_for_png_and_has_a_least_height(tmp_path):
    check_bar(tmp_path / "a.PNG", 64)
    with pytest.raises(ValueError, match=r"a\.exr: a color bar has no depth"):
        check_bar(tmp_path / "a.exr", 64)
    with pytest.raises(ValueError, match="at least 64 px high, not 63"):
        check_bar(tmp_path / "a.png", 63)
