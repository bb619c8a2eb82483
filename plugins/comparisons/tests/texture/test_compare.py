import math

import numpy as np
import pytest

from resample.colors import to_srgb
from resample.files.images import read_image
from resample.measuring import compare as measuring
from resample.measuring.compare import enlarged
from resample_comparisons.options import method_names
from resample_comparisons.texture import compare
from resample_comparisons.texture.compare import Judge, measured, sheet, source_values, timed
from resample_comparisons.texture.scenes import ComparedView
from resample_texture.geometry.mappings import Homography
from resample_texture.types import Edge, Warped

LINEAR = "hybrid:interpolation=area-spline:limit=none"  # as the truth is
MIXED = np.array([[0.5, 0.1, 2], [0, 1.2, 3], [0, 0.004, 1]])


@pytest.fixture
def scene(rng) -> ComparedView:
    coarse = rng.random((10, 10, 3))
    source = np.repeat(np.repeat(coarse, 8, 0), 8, 1).astype(np.float32)
    return ComparedView(source, Homography(MIXED), (64, 48))


@pytest.mark.sweep
def test_there_is_a_row_for_each_zone_and_method(scene):
    comparison = Judge().compare("title", scene, ["bilinear", "cubic"])
    pairs = [(row["zone"], row["method"]) for row in comparison.rows]
    assert pairs == [(z, m) for z in comparison.zones for m in ("bilinear", "cubic")]
    assert next(iter(comparison.zones)) == "whole"
    assert comparison.methods == ["bilinear", "cubic"]


@pytest.mark.sweep
def test_supersampling_is_nearer_to_the_truth_than_one_sample(scene, record):
    rows = Judge().compare("t", scene, ["bilinear", "opencv-supersample:n=8"]).rows
    assert rows[1]["psnr"] > rows[0]["psnr"] + 3
    record.quality("supersampling", rows[1]["psnr"])
    assert rows[1]["flip"] < rows[0]["flip"]


@pytest.mark.sweep
def test_a_gaussian_truth_favors_a_gaussian_method(scene, record):
    psnr = {
        kind: Judge(kind).compare("t", scene, [LINEAR]).rows[0]["psnr"]
        for kind in ("box", "gaussian")
    }
    assert psnr["box"] > psnr["gaussian"] + 3
    record.quality("box", psnr["box"])


@pytest.mark.sweep
def test_encoded_values_are_compared_as_they_are(scene):
    comparison = Judge(linear=False).compare("t", scene, ["bilinear"])
    linear = Judge().compare("t", scene, ["bilinear"])
    encoded = to_srgb(comparison.screens["bilinear"])
    assert np.allclose(encoded, linear.screens["bilinear"], atol=1e-6)  # float32


def test_values_to_filter_are_light_or_encoded():
    light = np.full((2, 2, 1), 0.5, np.float32)
    assert source_values(light, linear=True) is light
    assert np.array_equal(source_values(light, linear=False), to_srgb(light))


def test_an_error_outside_of_a_zone_does_not_count(rng):
    truth = rng.random((32, 32, 3)).astype(np.float32)
    screen = truth.copy()
    screen[:16] = 0
    mask = np.zeros((32, 32), bool)
    mask[16:] = True
    assert measured(screen, truth, mask) == {"psnr": math.inf, "ssim": 1.0, "flip": 0.0}


def test_an_error_is_laid_upon_the_zones_pixels(rng):
    truth = rng.random((64, 64, 3)).astype(np.float32)
    screen = np.clip(truth + rng.normal(0, 0.1, truth.shape), 0, 1).astype(np.float32)
    whole = measured(screen, truth, np.ones((64, 64), bool))
    half = np.zeros((64, 64), bool)
    half[:32] = True
    part = measured(screen, truth, half)
    assert part["psnr"] == pytest.approx(whole["psnr"], abs=0.3)
    assert part["ssim"] == pytest.approx(whole["ssim"], abs=0.03)  # the windows at the border
    assert part["flip"] == pytest.approx(whole["flip"], rel=0.05)


def test_a_time_is_the_median_of_warm_runs(scene, monkeypatch):
    runs: list[int] = []

    def method(source, _geometry, shape, _edge):
        runs.append(1)
        return Warped(np.zeros((*shape, source.shape[2]), np.float32), np.ones(shape, np.float32))

    clock = iter([0, 0, 0.001, 0.1, 1, 1.003, 1.1, 2, 2.002, 9])
    monkeypatch.setattr(measuring.time, "perf_counter", lambda: next(clock))
    _, milliseconds = timed(method, scene, Edge.CLAMP)
    assert milliseconds == pytest.approx(2)
    assert len(runs) == 4


@pytest.mark.sweep
def test_a_sheet_has_a_line_for_each_picture_with_its_details(scene, tmp_path):
    comparison = Judge().compare("t", scene, ["bilinear", "cubic"])
    sheet(comparison, tmp_path / "s.png", zoom=2)
    picture = read_image(tmp_path / "s.png")
    assert picture.shape[0] > 3 * 2 * 64
    assert picture.shape[1] > len(comparison.zones) * 2 * 48


def test_a_detail_lies_in_its_zone_where_most_is_to_be_seen():
    mask = np.zeros((200, 200), bool)
    mask[:, 100:] = True
    screen = np.zeros((200, 200, 3), np.float32)
    screen[::2, :100] = 1
    screen[140::2, 120:] = 1
    rows, columns = compare._busiest(screen, mask)
    assert columns.start >= 100
    assert rows.stop > 160


def test_enlarged_pixels_are_squares():
    detail = np.arange(12, dtype=np.float32).reshape(2, 2, 3)
    assert np.array_equal(enlarged(detail, 7)[::3, ::3], detail)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("bilinear,hybrid", ["bilinear", "hybrid"]),
        (" bilinear , oiio,", ["bilinear", "oiio"]),
        (
            "oiio:filter=cubic,opencv-supersample:n=4,kernel=linear,points",
            ["oiio:filter=cubic", "opencv-supersample:n=4,kernel=linear", "points"],
        ),
        ("hybrid,hybrid:quality=4,hybrid", ["hybrid", "hybrid:quality=4"]),
    ],
)
def test_commas_separate_methods_and_their_parameters(text, names):
    assert method_names(text) == names


def test_no_method_is_refused():
    with pytest.raises(ValueError, match="give methods to compare"):
        method_names(" , ")
