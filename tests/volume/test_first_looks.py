"""What a first picture shows of signed values, hot spots and small vessels, and its camera."""

import numpy as np
import pytest
import SimpleITK
from scipy.ndimage import gaussian_filter

from resample.files.images import read_image
from resample_volume import cli
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.presets import FAINT, transfer_for
from resample_volume.classification.value_statistics import survey
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from tests import commands

SIDE = 64


def at(z=0.0, y=0.0, x=0.0, side=SIDE):
    """Distances from a place, voxels from the middle."""
    grid = np.mgrid[:side, :side, :side] - (side - 1) / 2
    return np.sqrt(((grid.T - np.array([z, y, x])) ** 2).sum(axis=-1).T)


def looks(values, name="auto"):
    """Opacities and colors of values."""
    volume = as_volume(values)
    look, span = transfer_for(name, volume), survey(volume).whole
    return lambda value: (look.opacities([value], span)[0], look.colors([value], span)[0])


def waves(noise=0.05):
    """A crest of 5 and a trough of -4, with noise."""
    rng = np.random.default_rng(4)
    values = 5 * np.exp(-((at(x=14) / 9) ** 2)) - 4 * np.exp(-((at(x=-14) / 9) ** 2))
    return (values + rng.normal(0, noise, values.shape)).astype(np.float32)


def test_both_signs_are_seen_and_zero_is_not():
    found = looks(waves())
    (low, blue), (high, red) = found(-3.5), found(3.5)
    assert min(low, high) > 0.4
    assert blue[2] > 2 * blue[0]
    assert red[0] > 2 * red[2]
    assert found(0.0)[0] == found(0.15)[0] == found(-0.15)[0] == 0  # 3 standard deviations
    assert found(-3.0)[0] == pytest.approx(found(3.0)[0])


def test_a_crest_and_a_trough_are_beside_each_other_in_a_first_picture():
    picture = render(waves(), camera=(0, 0), size=(80, 80)).rgba
    is_red, is_blue = (
        (picture[..., 3] > 0.5) & (picture[..., a] > 1.5 * picture[..., b])
        for a, b in ((0, 2), (2, 0))
    )
    assert min(is_red.sum(), is_blue.sum()) > 200
    columns = [np.flatnonzero(mask.any(axis=0)).mean() for mask in (is_red, is_blue)]
    assert abs(columns[0] - columns[1]) > 20


@pytest.mark.parametrize("name", ["RdBu", "coolwarm", "PiYG_r"])
def test_the_middle_of_a_diverging_map_is_zero_and_transparent(name):
    found = looks(waves(), name)
    assert found(0.0)[0] == pytest.approx(0, abs=1e-4)
    assert found(-2.0)[0] > 0.1
    assert found(-2.0)[0] == pytest.approx(found(2.0)[0], abs=1e-3)
    assert found(float(waves().max()))[0] > 0.9


def test_other_maps_rise_from_the_least_value():
    found = looks(waves(), "viridis")
    assert found(-4.0)[0] < found(0.0)[0] < found(4.0)[0]


@pytest.mark.parametrize(
    "values",
    [
        np.where(at() < 20, 40.0, -1000.0).astype(np.float32),  # most is far from zero
        (np.where(at() < 20, 100.0, 0.0) + np.sin(at())).astype(np.float32),  # ringing
    ],
)
def test_a_range_around_zero_alone_makes_no_signed_data(values):
    found = looks(values)
    assert found(float(values.min()))[0] == 0
    assert found(float(values.max()))[0] > 0.5


def emission():
    """Uptake: a body of 0.8, an organ of 2.5, lesions of 6 to 9, a bladder of 20."""
    rng = np.random.default_rng(5)
    values = np.where(at() < 28, 0.8, 0.0)
    for place, radius, uptake in (
        ((10, 0, -8), 8, 2.5), ((15, 5, 12), 2.5, 9), ((0, 0, 15), 2.5, 6), ((-18, 0, 0), 4, 20)
    ):  # fmt: skip
        values[at(*place) < radius] = uptake
    values = gaussian_filter(values, 0.8)
    noise = 0.1 * np.sqrt(np.maximum(values, 0.02)) * rng.standard_normal(values.shape)
    return np.maximum(values + noise, 0).astype(np.float32)


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_hot_spots_are_seen_in_a_body_that_is_a_veil(scale):
    values = scale * emission()
    found = looks(values if scale == 1 else np.rint(values).astype(np.int16))
    air, body, organ, lesion, bladder = (
        found(scale * value)[0] for value in (0.1, 0.8, 2.5, 7.0, 18.0)
    )
    assert air == 0
    assert 0 < body < 0.05  # 56 voxels of it
    assert body < organ < lesion < bladder


def test_lesions_stand_out_of_the_body_in_a_first_picture():
    picture = render(emission(), camera=(0, 0), size=(96, 96)).rgba
    light = picture[..., :3].sum(axis=-1)
    body = np.median(light[picture[..., 3] > 0.3])
    bright = light > 1.3 * body
    assert np.count_nonzero(bright) > 40
    assert np.count_nonzero(picture[..., 3] > 0.3) > 5 * np.count_nonzero(bright)


def vessels():
    """A trunk of radius 5 and 240, beside it lines of radius 1 and 70 in 20, with noise of 6."""
    rng = np.random.default_rng(6)
    grid = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    values = np.full((SIDE,) * 3, 20.0)
    values[np.hypot(grid[1], grid[2]) < 5] = 240
    for z in (-20, -5, 10, 25):
        line = np.hypot(grid[0] - z - 0.2 * grid[2], grid[1] - 4)
        values = np.maximum(values, 20 + 50 * np.clip(1.5 - line, 0, 1))
    return np.clip(values + rng.normal(0, 6, values.shape), 0, 255).astype(np.uint8)


def test_small_vessels_beside_a_large_one_are_seen_and_noise_is_not():
    found = looks(vessels())
    assert found(70)[0] == pytest.approx(FAINT, abs=0.1)
    assert found(20 + 18)[0] == 0  # 3 standard deviations
    assert found(230)[0] > 0.7
    picture = render(vessels(), camera=(0, 0), size=(128, 128)).rgba[..., 3]
    for beside in (picture[:, 34:42], picture[:, 86:94]):
        is_seen = (beside > 0.3).mean(axis=1) > 0.5
        assert np.count_nonzero(np.diff(is_seen.astype(int)) == 1) == 4


@pytest.mark.parametrize("blur", [0.8, 3.0])
def test_edges_of_a_dense_ball_are_no_faint_structure(blur, rng):
    ball = gaussian_filter(np.where(at() < 15, 200.0, 10.0), blur)
    values = np.clip(ball + rng.normal(0, 3, ball.shape), 0, 255).astype(np.uint8)
    assert looks(values)(60)[0] == 0


def scanned(rng, table=True):
    """A head of radius 36 mm on a headrest and a table, Hounsfield units."""
    side = 96
    z, y, x = np.mgrid[:side, :side, :side] - (side - 1) / 2
    values = np.full((side,) * 3, -1000.0)
    values[np.sqrt(x**2 + y**2 + z**2) < 24] = 40
    if table:
        around = np.hypot(x, y)
        values[(around > 28) & (around < 30) & (y > 5)] = 100
        values[(y > 35) & (y < 45)] = -850
        values[((np.abs(y - 35) < 1) | (np.abs(y - 45) < 1)) & (np.abs(x) < 46)] = 250
    values = (values + rng.normal(0, 15, values.shape)).astype(np.int16)
    return as_volume(values)._replace(spacing=np.full(3, 1.5))


def test_a_table_and_a_headrest_do_not_count_for_the_camera(rng):
    found = Subject.of(scanned(rng), Appearance()).sphere
    assert found.radius == pytest.approx(24 * 1.5, abs=6)  # reach of kernels, a step
    np.testing.assert_allclose(found.center, 0, atol=3)


def test_what_is_cropped_to_the_table_is_framed(rng):
    found = Subject.of(scanned(rng), Appearance(crop=":,80:,:")).sphere
    assert found.radius > 50
    assert found.center[1] > 40


def test_specks_far_from_an_object_do_not_count_for_the_camera(rng):
    values = np.where(at() < 12, 200, 0).astype(np.uint8)
    for place in rng.integers(0, SIDE, (12, 3)):
        values[tuple(place)] = 200
    ball = Subject.of(as_volume(values), Appearance("100..")).sphere
    assert ball.radius == pytest.approx(12 + 2, abs=1.5)  # the reach of kernels


def test_many_small_parts_all_count():
    values = np.zeros((SIDE,) * 3, np.uint8)
    for place in ((8, 8, 8), (56, 56, 56), (8, 56, 30)):
        values[tuple(slice(n - 2, n + 2) for n in place)] = 200
    assert Subject.of(as_volume(values), Appearance("100..")).sphere.radius > 38


@pytest.mark.parametrize("shape", [(12, 50, 40), (60, 10, 10), (30, 30, 30)])
def test_a_first_picture_is_filled(tmp_path, shape):
    values = np.zeros((SIDE,) * 3, np.uint8)
    values[tuple(slice(2, 2 + size) for size in shape)] = 200
    np.save(tmp_path / "a.npy", values)
    words = ("render", tmp_path / "a.npy", "-o", tmp_path / "a.png", "--size", "160x120")
    assert commands.ended(cli.app, *words) == 0
    seen = read_image(tmp_path / "a.png").any(axis=-1)
    share = [np.ptp(np.flatnonzero(seen.any(axis=axis))) / seen.shape[1 - axis] for axis in (0, 1)]
    assert 0.8 <= max(share) <= 0.97


def test_info_says_where_no_orientation_is_stated(tmp_path, capsys):
    np.save(tmp_path / "a.npy", vessels())
    assert commands.ended(cli.app, "info", tmp_path / "a.npy") == 0
    assert "--up -z" in capsys.readouterr().out
    image = SimpleITK.GetImageFromArray(vessels())
    SimpleITK.WriteImage(image, str(tmp_path / "a.nii"))
    assert commands.ended(cli.app, "info", tmp_path / "a.nii") == 0
    assert "--up" not in capsys.readouterr().out
