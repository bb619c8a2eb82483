import io

import numpy as np
import pytest
from rich.console import Console

from resample.colors import to_srgb
from resample.files.images import read_image
from resample.files.saving import write_png
from resample.measuring.compare import (
    LINE,
    MARGIN,
    contact_sheet,
    measure_files,
    plain,
    shown,
    table,
)


@pytest.fixture
def images(rng) -> dict[str, np.ndarray]:
    return {
        "first [a]": rng.random((4, 6, 3), np.float32),
        "second $x_1$": rng.random((5, 3, 4), np.float32),
        "third": np.ones((4, 6, 4), np.float32),
    }


def blocks(sheet: np.ndarray, image: np.ndarray, zoom: int) -> bool:
    """Whether the sheet holds the picture with each of its pixels as a square."""
    wanted = np.repeat(np.repeat(image, zoom, 0), zoom, 1)
    windows = np.lib.stride_tricks.sliding_window_view(sheet, wanted.shape[:2], axis=(0, 1))
    corner = windows[..., 0, 0] == wanted[0, 0]
    return any(
        np.array_equal(np.moveaxis(windows[row, column], 0, 2), wanted)
        for row, column in np.argwhere(corner.all(axis=2))
    )


def levels(image: np.ndarray) -> np.ndarray:
    return np.round(shown(image) * 255).astype(np.uint8)


@pytest.mark.some(1)
@pytest.mark.parametrize("columns", [None, 1, 2, 3])
def test_every_pixel_becomes_a_square_of_the_same_color(tmp_path, images, columns):
    contact_sheet(images, tmp_path / "sheet.png", zoom=8, columns=columns)
    sheet = levels(read_image(tmp_path / "sheet.png"))
    for image in images.values():
        assert blocks(sheet, levels(image), 8)


def test_small_pictures_are_enlarged_to_be_seen(tmp_path, images):
    contact_sheet(images, tmp_path / "sheet.png")
    sheet = read_image(tmp_path / "sheet.png")
    assert sheet.shape[1] == MARGIN + 3 * (192 + MARGIN)


def test_titles_and_captions_are_written(tmp_path):
    black = {"title": np.zeros((10, 10, 3), np.float32)}
    sheets = []
    for captions in (None, {"title": "38.2 dB"}):
        contact_sheet(black, tmp_path / "sheet.png", captions=captions, zoom=10)
        sheets.append(read_image(tmp_path / "sheet.png"))
    assert (sheets[0][: MARGIN + 14, :, 0] < 0.5).any()
    assert (sheets[1][-20:, :, 0] < 0.5).any()
    assert not (sheets[0][-20:, :, 0] < 0.5).any()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [({"columns": 0}, "columns is a positive number, not 0"), ({"zoom": -1}, "zoom is a positive")],
)
def test_a_sheet_refuses_impossible_numbers(tmp_path, images, arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        contact_sheet(images, tmp_path / "sheet.png", **arguments)


def test_a_sheet_needs_a_picture_and_a_name_of_its_kind(tmp_path, images):
    with pytest.raises(ValueError, match="at least one picture"):
        contact_sheet({}, tmp_path / "sheet.png")
    with pytest.raises(ValueError, match=r"written as \.png"):
        contact_sheet(images, tmp_path / "sheet.jpg")


def test_gray_is_shown_as_equal_channels():
    image = np.full((1, 1, 1), 0.2, np.float32)
    np.testing.assert_array_equal(shown(image)[0, 0], to_srgb(np.full(3, 0.2, np.float32)))


def test_transparency_shows_the_background():
    image = np.array([[[0.1, 0.0, 0.0, 0.5]]], np.float32)
    np.testing.assert_allclose(
        shown(image, (1, 1, 0))[0, 0], to_srgb(np.array([0.6, 0.5, 0.0])), rtol=1e-6
    )


def test_files_are_measured_as_shown(tmp_path):
    for name, value in (("a", 0.5), ("b", 0.6)):
        write_png(
            tmp_path / f"{name}.png", np.full((16, 16, 4), [value, value, value, 1], np.float32)
        )
    rows, pictures = measure_files([tmp_path / "a.png"], tmp_path / "b.png")
    difference = to_srgb(np.array(0.6)) - to_srgb(np.array(0.5))
    assert rows[0]["rms"] == pytest.approx(difference, abs=1 / 255)
    assert list(pictures) == [str(tmp_path / "b.png"), str(tmp_path / "a.png")]


def test_files_of_different_sizes_are_refused(tmp_path):
    write_png(tmp_path / "a.png", np.zeros((4, 5, 4), np.float32))
    write_png(tmp_path / "b.png", np.zeros((4, 6, 4), np.float32))
    with pytest.raises(ValueError, match=r"5 × 4 px, .* is 6 × 4 px"):
        measure_files([tmp_path / "a.png"], tmp_path / "b.png")


ROWS = [{"picture": "[red]a", "psnr": 31.41592}, {"picture": "b", "psnr": float("inf")}]


def test_the_plain_table_is_aligned():
    assert plain(ROWS) == "picture  psnr\n[red]a   31.42\nb        inf\n"


def test_the_table_for_terminals_shows_names_as_they_are():
    console = Console(file=io.StringIO(), width=80)
    console.print(table(ROWS))
    text = console.file.getvalue()
    assert all(word in text for word in ("picture", "psnr", "[red]a", "31.42", "inf"))


def test_a_table_without_rows_is_empty():
    assert plain([]) == ""
    assert table([]).row_count == 0


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_each_cell_of_a_sheet_is_a_sheet_of_its_own(tmp_path, columns):
    """Title above and caption below it; both are shortened to the width of a cell."""
    images = {f"picture {n}": np.full((6, 8, 3), 0.1 * n, np.float32) for n in range(4)}
    captions = {title: f"{title} of many in a row" for title in images}
    contact_sheet(images, tmp_path / "all.png", columns=columns, captions=captions, zoom=9)
    whole = read_image(tmp_path / "all.png")
    height, width = 6 * 9 + 2 * LINE + MARGIN, 8 * 9 + MARGIN
    for n, title in enumerate(images):
        one = {title: images[title]}
        contact_sheet(one, tmp_path / "one.png", captions=captions, zoom=9)
        alone = read_image(tmp_path / "one.png")[MARGIN:, MARGIN:]
        assert alone.shape[:2] == (height, width)
        top, left = n // columns * height + MARGIN, n % columns * width + MARGIN
        here = whole[top : top + height, left : left + width]
        np.testing.assert_allclose(here, alone, atol=0.2)  # of letters between pixels


def test_a_title_lies_above_its_picture_and_a_caption_below(tmp_path):
    picture = {"t": np.full((6, 8, 3), 0.2, np.float32)}
    contact_sheet(picture, tmp_path / "a.png", captions={"t": "c"}, zoom=9)
    ink = read_image(tmp_path / "a.png")[..., 0] < 0.5
    above, below = MARGIN + LINE, MARGIN + LINE + 6 * 9
    rows = np.flatnonzero(ink[:, : MARGIN + 7].any(axis=1))
    assert set(rows) >= set(range(above, below))
    for first, band in ((MARGIN, rows[rows < above]), (below, rows[rows >= below])):
        assert len(band) > 3
        assert first < band.min() <= band.max() < first + LINE


def test_of_a_long_title_the_end_is_kept(tmp_path):
    black = np.zeros((6, 8, 3), np.float32)  # a cell of 72 px holds 11 letters
    inks = []
    for title in ("a folder/last.png", "other folder/last.png", "last.png"):
        contact_sheet({title: black}, tmp_path / "a.png", zoom=9)
        inks.append(read_image(tmp_path / "a.png")[: MARGIN + LINE])
    np.testing.assert_array_equal(inks[0], inks[1])
    assert not np.array_equal(inks[0], inks[2])


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (4, 4), (5, 3), (9, 3), (10, 4)])
def test_up_to_four_pictures_lie_side_by_side_and_more_in_a_square(tmp_path, count, columns):
    images = {str(n): np.ones((2, 3, 3), np.float32) for n in range(count)}
    contact_sheet(images, tmp_path / "a.png", zoom=4)
    height, width = read_image(tmp_path / "a.png").shape[:2]
    rows = -(-count // columns)
    assert (height, width) == (
        MARGIN + rows * (2 * 4 + 2 * LINE + MARGIN), MARGIN + columns * (3 * 4 + MARGIN),
    )  # fmt: skip
