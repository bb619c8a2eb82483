"""Color bars: sizes, colors, scales, and pictures beside them."""

import subprocess
import sys

import numpy as np
import pytest

from resample.measuring.color_bars import ticks_of, with_color_bar
from resample_volume.annotations import color_bar
from resample_volume.classification.presets import PRESETS, load_transfer
from resample_volume.classification.transfer import Faded, Region, RegionTransfer, from_points

BYTE = (0.0, 255.0)
WHITE, GREEN = (1.0, 1.0, 1.0), (0.0, 1.0, 0.0)
REGIONS = RegionTransfer((Region((0, 128), GREEN, 1.0, (50, float("inf"))),))


@pytest.mark.some(1)
@pytest.mark.parametrize("height", [64, 77, 150, 401])
@pytest.mark.parametrize("name", ["engine", "viridis", "surfaces"])
def test_a_bar_is_as_high_as_asked_for_and_opaque(name: str, height: int) -> None:
    bar = color_bar(load_transfer(name), BYTE, height, title=name)
    assert bar.shape[0] == height
    assert bar.shape[2] == 4
    assert bar.dtype == np.float32
    assert (bar[..., 3] == 1).all()
    assert 0 <= bar.min() <= bar.max() <= 1


@pytest.mark.parametrize("transfer", [from_points([(0, GREEN, 1.0)]), REGIONS])
def test_what_is_opaque_has_its_own_color(transfer: object) -> None:
    bar = color_bar(transfer, BYTE, 200)[..., :3]
    assert ((bar == GREEN).all(axis=2)).sum() > 500


@pytest.mark.sweep
def test_what_is_transparent_is_a_checkerboard() -> None:
    bar = color_bar(from_points([(0, GREEN, 0.0)]), BYTE, 200)[..., :3]
    for gray in (0.16, 0.42):
        assert (np.abs(bar - gray).max(axis=2) < 0.005).sum() > 500  # of 256 levels


@pytest.mark.sweep
def test_the_greatest_value_is_at_the_top() -> None:
    bar = color_bar(from_points([(0, GREEN, 1.0), (128, GREEN, 1.0), (128, WHITE, 0.0)]), BYTE, 300)
    rows = np.flatnonzero((bar[..., :3] == GREEN).all(axis=2).any(axis=1))
    assert rows.min() > 0.4 * 300


def test_gradients_grow_to_the_right() -> None:
    bar = color_bar(REGIONS, BYTE, 300)
    is_green = (bar[..., :3] == GREEN).all(axis=2)
    right = np.flatnonzero(is_green.any(axis=0))
    assert right.min() > 80  # 50 of 62.5, in a panel of some 140 px


@pytest.mark.sweep
def test_a_step_narrower_than_a_row_is_not_lost() -> None:
    line = [(100, GREEN, 0.0), (100, GREEN, 1.0), (100.2, GREEN, 1.0), (100.2, GREEN, 0.0)]
    plain = color_bar(from_points([(0, GREEN, 0.0)]), BYTE, 150)
    assert np.abs(color_bar(from_points(line), BYTE, 150) - plain).max() > 0.1


@pytest.mark.sweep
def test_text_is_light_on_dark_and_dark_on_light() -> None:
    dark = color_bar(load_transfer("gray"), BYTE, 100)
    light = color_bar(load_transfer("gray"), BYTE, 100, background=WHITE)
    assert (dark[0, :, :3] == 0).all()
    assert (light[0, :, :3] == 1).all()
    assert dark[:, -20:].max() > 0.5
    assert light[:, -20:].min() < 0.5


@pytest.mark.some(2)
@pytest.mark.parametrize("span", [(0.0, 0.0), (-7.0, -7.0), (1e-9, 3e-9), (-1e20, 1e30)])
@pytest.mark.parametrize("name", ["gray", "surfaces", "engine"])
def test_any_range_of_data_has_a_bar(name: str, span: tuple[float, float]) -> None:
    assert color_bar(load_transfer(name), span, 100).shape[0] == 100


def test_a_faded_function_is_drawn_over_its_gradients() -> None:
    faded = Faded(PRESETS["bone"](), (0.1, 0.5))
    assert color_bar(faded, BYTE, 100, steep=30.0).shape[0] == 100


@pytest.mark.parametrize(
    ("span", "texts"),
    [
        ((0.0, 255.0), ["0", "50", "100", "150", "200", "250"]),
        ((-1024.0, 3071.0), ["−1000", "0", "1000", "2000", "3000"]),
        (
            (1e6, 1e6 + 3),
            ["1000000", "1000000.5", "1000001", "1000001.5", "1000002", "1000002.5", "1000003"],
        ),
        ((0.0, 3.2e-6), ["0", "1e−06", "2e−06", "3e−06"]),
        ((0.0, 1.0), ["0", "0.2", "0.4", "0.6", "0.8", "1"]),
    ],
)
def test_ticks_are_round_values_that_differ(span: tuple[float, float], texts: list[str]) -> None:
    assert list(ticks_of(span, 6).values()) == texts


def test_a_long_title_is_shortened() -> None:
    long = color_bar(load_transfer("gray"), BYTE, 100, title="m" * 90)
    assert long.shape[1] < 250


def test_a_bar_of_too_few_px_is_refused() -> None:
    with pytest.raises(ValueError, match=r"at least 64 px high \(got 63\)"):
        color_bar(load_transfer("gray"), BYTE, 63)


def test_a_bar_stands_to_the_right_of_a_picture(rng: np.random.Generator) -> None:
    alpha = rng.random((64, 30, 1)).astype(np.float32)
    picture = np.concatenate([alpha * rng.random((64, 30, 3)), alpha], axis=2).astype(np.float32)
    bar = np.ones((64, 9, 4), np.float32)
    beside = with_color_bar(picture, bar)
    np.testing.assert_array_equal(beside[:, :30], picture)
    np.testing.assert_array_equal(beside[:, 30:], bar)
    behind = with_color_bar(picture, bar, WHITE)
    np.testing.assert_allclose(behind[:, :30, :3], picture[..., :3] + 1 - alpha, atol=1e-6)
    assert (behind[..., 3] == 1).all()


def test_a_bar_of_another_height_is_refused() -> None:
    with pytest.raises(ValueError, match="a bar of 65 px does not fit a picture of 64 px"):
        with_color_bar(np.zeros((64, 8, 4), np.float32), np.zeros((65, 8, 4), np.float32))


def test_the_modules_load_without_heavy_libraries() -> None:
    heavy = {"numba", "matplotlib", "scipy", "cv2", "PIL"}
    code = (
        "import sys, resample_volume.annotations, resample_volume.classification.labels;"
        "import resample_volume.voxels.framing;"
        f"sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
