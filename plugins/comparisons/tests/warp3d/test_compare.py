import math
from dataclasses import dataclass

import numpy as np
import pytest

from resample import registry
from resample.colors import from_srgb, to_srgb
from resample.files.images import read_image
from resample_comparisons.warp3d.compare import (
    WarpCase,
    busiest,
    compare_cases,
    compare_scene,
    compare_view,
    screen_of,
    sheet,
)
from resample_comparisons.warp3d.scoring import ScoringTarget
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Rendered

SIZE = 32
SHAPE = (SIZE, SIZE)


@dataclass(frozen=True)
class Copy:
    """The source's colors wherever they were, with a given coverage."""

    coverage: float = 1.0

    def __call__(self, source, equation, shape):  # noqa: ARG002 - a method's role
        full = np.full(shape, self.coverage, np.float32)
        image = np.asarray(source.color * self.coverage, np.float32)
        return Rendered(image, full, full, full, np.zeros(shape, np.bool_))


@dataclass(frozen=True)
class Nothing:
    """Holes alone."""

    def __call__(self, source, equation, shape):  # noqa: ARG002 - a method's role
        empty = np.zeros(shape, np.float32)
        image = np.zeros((*shape, source.color.shape[2]), np.float32)
        return Rendered(image, empty, empty, empty, np.zeros(shape, np.bool_))


METHODS = {"copy": Copy(), "half": Copy(0.5), "nothing": Nothing()}


@pytest.fixture(autouse=True)
def simple_methods(monkeypatch):
    def build(group, name):
        assert group == "warps"
        if name not in METHODS:
            raise LookupError(f"unknown {name}")
        return METHODS[name]

    monkeypatch.setattr(registry, "build", build)


@pytest.fixture
def source(rng):
    color = rng.random((*SHAPE, 3)).astype(np.float32)
    nearness = np.full(SHAPE, 1.0, np.float32)
    nearness[8:20, 8:20] = 2.0
    return prepare(DepthImage(color, nearness))


@pytest.fixture
def same(source):
    """Comparison with the source's own view."""
    return compare_view(source, of_rectified(0.0), source.color, None, ["copy", "nothing"])


@pytest.fixture(scope="module")
def scene_comparison():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "build", lambda _, name: METHODS[name])
        return compare_scene(["copy", "nothing"], SIZE, ["side", "in3"])


@pytest.mark.sweep
def test_there_is_a_row_for_each_view_and_method(scene_comparison):
    rows = [(row["view"], row["method"]) for row in scene_comparison.rows]
    assert rows == [(view, name) for view in ("side", "in3") for name in ("copy", "nothing")]


def test_rows_have_all_measures(scene_comparison):
    keys = ["view", "method", "psnr", "black psnr", "edge psnr", "ssim", "iv-psnr", "hole %", "ms"]
    assert all(list(row) == keys for row in scene_comparison.rows)


def test_the_truth_is_the_first_picture_of_a_view(scene_comparison):
    assert list(scene_comparison.pictures) == ["side", "in3"]
    assert all(
        list(pictures) == ["truth", "copy", "nothing"]
        for pictures in scene_comparison.pictures.values()
    )


def test_holes_of_an_empty_picture_are_all_of_it(scene_comparison):
    assert [row["hole %"] for row in scene_comparison.rows] == [0.0, 100.0, 0.0, 100.0]


def test_a_method_that_is_right_has_no_error(same):
    assert same.rows[0]["psnr"] == math.inf


def test_coverage_is_taken_out_of_colors(source):
    comparison = compare_view(source, of_rectified(0.0), source.color, None, ["half"])
    assert comparison.rows[0]["psnr"] > 100  # but for rounding


def test_only_pixels_of_the_mask_count(source):
    mask = np.zeros(SHAPE, np.bool_)
    mask[4:12, 4:12] = True
    truth = np.where(mask[..., None], source.color, np.float32(0))
    comparison = compare_view(source, of_rectified(0.0), truth, mask, ["copy"])
    assert comparison.rows[0]["psnr"] == math.inf


def test_light_is_compared_as_a_screen_shows_it(source):
    light = np.asarray(from_srgb(np.full((*SHAPE, 3), 0.5, np.float32)))
    brighter = np.asarray(from_srgb(np.full((*SHAPE, 3), 0.6, np.float32)))
    even = source._replace(color=light)
    comparison = compare_view(even, of_rectified(0.0), brighter, None, ["copy"])
    assert comparison.rows[0]["psnr"] == pytest.approx(20.0, abs=1e-3)


def test_half_covered_light_is_half_of_it_over_black(source):
    light = source._replace(color=np.asarray(from_srgb(np.full((*SHAPE, 3), 0.5, np.float32))))
    dimmed = float(to_srgb(0.5 * from_srgb(np.array(0.5))))
    comparison = compare_view(light, of_rectified(0.0), light.color, None, ["half"])
    assert comparison.rows[0]["black psnr"] == pytest.approx(-20 * math.log10(0.5 - dimmed))


def test_encoded_values_are_compared_as_they_are(source):
    whole = np.ones(SHAPE, np.bool_)
    truth = source.color + np.float32(0.1)
    case = WarpCase(
        "here", source, of_rectified(0.0), ScoringTarget(truth, whole, whole), is_light=False
    )
    comparison = compare_cases([case], ["copy"])
    assert comparison.rows[0]["psnr"] == pytest.approx(20.0, abs=1e-3)


def test_a_gray_picture_is_shown_in_three_channels(source):
    gray = source._replace(color=source.color[..., :1])
    case = WarpCase(
        "", gray, of_rectified(0.0), ScoringTarget(source.color, *[np.ones(SHAPE, np.bool_)] * 2)
    )
    screen = screen_of(case, Copy()(gray, case.equation, SHAPE))
    assert screen.image.shape == screen.over_black.shape == (*SHAPE, 3)
    assert screen.covered.all()


def test_a_mask_of_another_size_is_refused(source):
    with pytest.raises(ValueError, match="4 × 5 px does not fit a view of 32 × 32"):
        compare_view(source, of_rectified(0.0), source.color, np.ones((5, 4), np.bool_), ["copy"])


def test_a_view_of_something_else_is_refused(source):
    with pytest.raises(ValueError, match="no part of the true view is in the source"):
        compare_view(source, of_rectified(1000.0), source.color, None, ["copy"])


def test_unknown_views_are_listed():
    with pytest.raises(LookupError, match="known: side, back4"):
        compare_scene(["copy"], SIZE, ["sideways"])


def test_no_methods_are_refused():
    with pytest.raises(ValueError, match="give methods"):
        compare_scene([], SIZE)


def test_the_detail_is_where_methods_err_at_edges():
    mask, edge = np.ones((2, *SHAPE), np.bool_)
    edge[:, :16] = False
    error = np.zeros(SHAPE, np.float32)
    error[4, 4] = error[24, 24] = 1.0
    rows, columns = busiest([error], ScoringTarget(np.zeros((*SHAPE, 3)), mask, edge), 8)
    assert rows.start <= 24 < rows.stop
    assert columns.start <= 24 < columns.stop


def test_the_sheet_has_two_lines_for_each_view(scene_comparison, tmp_path):
    sheet(scene_comparison, tmp_path / "sheet.png", zoom=2)
    height, width, _ = read_image(tmp_path / "sheet.png").shape
    cell = 2 * SIZE
    assert 4 * cell < height < 4 * cell + 250
    assert 3 * cell < width < 3 * cell + 100


def test_sheets_are_png(scene_comparison, tmp_path):
    with pytest.raises(ValueError, match=r"\.png"):
        sheet(scene_comparison, tmp_path / "sheet.jpg")
