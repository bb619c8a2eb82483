import numpy as np
import pytest

from resample.files.images import read_image
from resample_comparisons.texture import scenes
from resample_figures.figure_5 import FIGURE, FloorPicture, compare_floors, generated, write_figures


@pytest.fixture
def floors(monkeypatch):
    monkeypatch.setattr(scenes, "SMALLEST_SIDE", 192)
    return compare_floors({"checker": FloorPicture(scenes.checker(192, 4))}, ["points", "bilinear"])


def test_the_figure_shows_points_the_hybrid_and_backward_mapping():
    assert list(FIGURE)[:3] == ["points", "hybrid", "bilinear"]
    assert [title[:3] for title in FIGURE.values()][:3] == ["(a)", "(b)", "(c)"]


@pytest.mark.sweep
def test_points_leave_holes_where_texels_grow(floors):
    comparison = floors["checker"]
    near = comparison.zones["magnified"]
    is_hole = (comparison.screens["points"] == 0).all(axis=2) & near
    is_black = (comparison.screens["bilinear"] == 0).all(axis=2) & near
    assert is_hole.sum() > 1.2 * is_black.sum()


@pytest.mark.sweep
def test_every_picture_the_sheet_and_the_table_are_written(floors, tmp_path):
    table = write_figures(tmp_path, floors, FIGURE, "sheet.png")
    assert {path.name for path in tmp_path.iterdir()} == {
        *("checker-truth.png", "checker-points.png", "checker-bilinear.png"),
        *("sheet.png", "table.txt"),
    }
    assert (tmp_path / "table.txt").read_text() == table
    assert table.split()[:6] == ["picture", "zone", "method", "psnr", "ssim", "flip"]


@pytest.mark.sweep
def test_single_pictures_are_1_to_1(floors, tmp_path):
    write_figures(tmp_path, floors, FIGURE, "sheet.png")
    assert read_image(tmp_path / "checker-points.png").shape == (96, 96, 3)


@pytest.mark.sweep
def test_names_of_files_are_plain(monkeypatch, tmp_path):
    monkeypatch.setattr(scenes, "SMALLEST_SIDE", 64)
    white = FloorPicture(np.ones((64, 64, 1), np.float32))
    floors = compare_floors({"x": white}, ["opencv-supersample:n=2"])
    write_figures(tmp_path, floors, {}, "sheet.png")
    assert (tmp_path / "x-opencv-supersample-n-2.png").is_file()


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["checker", pytest.param("bricks", marks=pytest.mark.sweep)])
def test_what_is_generated_is_known_finer(name):
    picture, fine = generated(name)
    assert picture.shape[:2] == (1024, 1024)
    assert fine.shape[:2] == (1024 * scenes.FINER, 1024 * scenes.FINER)
    np.testing.assert_allclose(picture[0, 0], fine[: scenes.FINER, : scenes.FINER].mean((0, 1)))
