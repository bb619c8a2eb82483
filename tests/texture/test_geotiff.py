"""GeoTIFF tags and missing values through the command line, read back by pillow."""

from functools import partial
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
from PIL import Image, TiffImagePlugin

from resample.files.images import read_channels
from resample.files.metadata.tags import Tag, add_tags, geo_of, moved, text_tag
from resample_texture import cli
from tests import commands
from tests.commands import store

SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS = 33550, 33922, 34264, 34735, 34736, 34737
FACTS, NODATA = 42112, 42113
AREA = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 2048, 0, 1, 4326)
POINT = (*AREA[:11], 2, *AREA[12:])
PLACED = {SCALE: (10.0, 20.0, 1.0), POINTS: (0.0, 0.0, 0.0, 5e5, 4e6, 7.0), KEYS: AREA}
WORDS_TOO = {NUMBERS: (6378137.0, 298.25), WORDS: "WGS 84|"}
HALF = ["--matrix", "0.5,0,0,0,0.5,0", "--size", "12x8"]
SAME = ["--matrix", "1,0,0,0,1,0"]
TURN = ["--matrix", "0.8,-0.6,12,0.6,0.8,3", "--size", "30x30"]
TILT = ["--corners", "0,0 24,1 20,16 2,14"]
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(levels: np.ndarray, tags: dict[int, object], name: str = "in.tif", **more) -> None:
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in tags.items():
        kinds = {KEYS: 3, WORDS: 2, FACTS: 2, NODATA: 2, 274: 3}
        directory.tagtype[tag] = kinds.get(tag, 12)
        directory[tag] = value
    Image.fromarray(levels).save(name, tiffinfo=directory, **more)


def tags(name: str = "out.tif") -> dict[int, object]:
    with Image.open(name) as image:
        return dict(image.tag_v2)


def place(stored: dict[int, object], x: float, y: float) -> np.ndarray:
    """Where a point, px from the corner, lies on Earth, by the standard's words."""
    shift = 0.5 if stored.get(KEYS) == POINT else 0.0
    if MATRIX in stored:
        matrix = np.reshape(stored[MATRIX], (4, 4))
        return (matrix @ (x - shift, y - shift, 0.0, 1.0))[:2]
    (sx, sy, _), (i, j, _, ex, ey, _) = stored[SCALE], stored[POINTS]
    return np.array([ex + (x - shift - i) * sx, ey - (y - shift - j) * sy])


def ground(stored: tuple[int, ...] = (16, 24), kind: type = np.uint8) -> np.ndarray:
    return np.random.default_rng(2).integers(1, 200, stored).astype(kind)


@pytest.mark.some(2)
@pytest.mark.parametrize("keys", [AREA, POINT])
@pytest.mark.parametrize(
    ("words", "x", "y"),
    [
        (HALF, 3.0, 2.0),
        (TURN, 0.8 * 6 - 0.6 * 4 + 12, 0.6 * 6 + 0.8 * 4 + 3),
        ([*SAME, "--roi", "2,3,5,6"], 4.0, 1.0),
        (["--matrix", "-1,0,24,0,1,0"], 18.0, 4.0),
    ],
)
def test_points_stay_where_they_are_on_earth(keys, words, x, y):
    write(ground(), {**PLACED, **WORDS_TOO, KEYS: keys})
    assert ended("warp", "in.tif", "-o", "out.tif", *words) == 0
    kept = tags()
    assert place(kept, x, y) == pytest.approx(place(tags("in.tif"), 6.0, 4.0), abs=1e-6)
    assert kept[KEYS] == keys
    assert (kept[NUMBERS], kept[WORDS]) == (WORDS_TOO[NUMBERS], WORDS_TOO[WORDS])


def test_what_is_not_turned_keeps_a_scale_and_a_point():
    write(ground(), PLACED)
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF) == 0
    kept = tags()
    assert MATRIX not in kept
    assert kept[SCALE] == (20.0, 40.0, 1.0)
    assert kept[POINTS] == PLACED[POINTS]


def test_a_matrix_is_read_as_well():
    matrix = np.array([[3.0, 4, 0, 5e5], [4, -3, 0, 4e6], [0, 0, 0, 0], [0, 0, 0, 1]])
    write(ground(), {MATRIX: tuple(matrix.ravel()), KEYS: AREA})
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF) == 0
    assert place(tags(), 3.0, 2.0) == pytest.approx(place(tags("in.tif"), 6.0, 4.0))


def test_the_place_goes_through_the_turn_of_a_sideways_picture():
    write(ground(), {**PLACED, 274: 6})
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    assert tags().get(274, 1) == 1
    assert place(tags(), 16 - 4.0, 6.0) == pytest.approx(place(tags("in.tif"), 6.0, 4.0))


@pytest.mark.parametrize("words", [TILT, ["--lens", "20,20,12,8,0.1,0.01,0,0"]])
def test_what_is_not_affine_drops_the_place_and_says_so(words, capsys):
    write(ground(), {**PLACED, **WORDS_TOO, NODATA: "0"})
    assert ended("warp", "in.tif", "-o", "out.tif", *words) == 0
    assert not {SCALE, POINTS, MATRIX, KEYS, NUMBERS, WORDS} & set(tags())
    assert tags()[NODATA] == "0"
    error = capsys.readouterr().err
    assert error == "resample: georeference dropped: the warp is not affine\n"


def test_control_points_move_even_so():
    points = (2.0, 3.0, 0.0, 10.0, 50.0, 0.0, 20.0, 13.0, 0.0, 11.0, 49.0, 0.0)
    write(ground(), {POINTS: points, KEYS: AREA})
    assert ended("warp", "in.tif", "-o", "out.tif", *TILT) == 0
    from resample_texture.geometry.matrices import from_corners, page_corners, parse_points

    matrix = from_corners(page_corners((16, 24)), parse_points(TILT[1])).matrix
    kept = np.reshape(tags()[POINTS], (-1, 6))
    for (x, y), found in zip([(2, 3), (20, 13)], kept, strict=True):
        u, v, w = matrix @ (x, y, 1.0)
        assert found[:2] == pytest.approx([u / w, v / w])
    assert kept[:, 3:].tolist() == [[10, 50, 0], [11, 49, 0]]


def test_other_formats_have_no_room_and_it_is_said(capsys):
    write(ground((16, 24, 3)), PLACED)
    assert ended("warp", "in.tif", "-o", "out.png", *SAME) == 0
    first, second = capsys.readouterr().err.splitlines()
    assert first == "resample: out.png cannot store the picture's georeference; .tif can"
    assert "is the picture that was given" in second


@pytest.mark.some(3)
@pytest.mark.parametrize("kind", [np.uint8, np.int32, np.float32])
@pytest.mark.parametrize("edge", ["transparent", "clamp"])
def test_missing_values_weigh_nothing_and_are_written_so(kind, edge):
    levels = np.full((16, 24), 100, kind)
    levels[:8, :8] = 255 if kind is np.uint8 else -9999
    word = str(levels[0, 0])
    write(levels, {**PLACED, NODATA: word})
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF, "--edge", edge) == 0
    with Image.open("out.tif") as image:
        values = np.array(image)
    assert values.dtype == kind
    assert values.shape == (8, 12)
    assert (values[:3, :3] == levels[0, 0]).all()
    is_there = values != levels[0, 0]
    assert is_there[5:, :].all()
    assert is_there[:, 5:].all()
    assert np.allclose(values[is_there], 100, atol=1e-3)
    assert tags()[NODATA] == word


def test_beyond_the_picture_is_missing():
    write(ground(kind=np.float32), {NODATA: "nan"})
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF[:2], "--size", "24x16") == 0
    with Image.open("out.tif") as image:
        values = np.array(image)
    assert np.isnan(values[9:]).all()
    assert np.isfinite(values[:7, :11]).all()


def test_a_color_is_missing_where_all_its_channels_are():
    levels = np.full((16, 24, 3), (0, 90, 30), np.uint8)
    levels[4:8, 4:8] = 0
    write(levels, {**PLACED, NODATA: "0"})
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    with Image.open("out.tif") as image:
        values = np.array(image)
    assert np.array_equal(values[10:], levels[10:])
    assert not values[5:7, 5:7].any()


def test_a_value_that_only_looks_missing_is_moved_beside():
    levels = np.zeros((16, 24), np.float32)
    levels[:, ::2] = 14.0  # whose mean is what stands for nothing
    write(levels, {**PLACED, NODATA: "7"})
    words = ["--matrix", "0.25,0,0,0,0.25,0", "--size", "6x4", "--filter", "box"]
    assert ended("warp", "in.tif", "-o", "out.tif", *words, "--edge", "wrap") == 0
    with Image.open("out.tif") as image:
        values = np.array(image)
    assert not (values == 7).any()
    assert np.allclose(values, 7, atol=1e-3)


def test_with_a_background_nothing_is_missing():
    levels = np.full((16, 24), 100, np.float32)
    levels[:8] = -1
    write(levels, {NODATA: "-1"})
    words = [*HALF, "--background", "black"]
    assert ended("warp", "in.tif", "-o", "out.tif", *words) == 0
    assert read_channels("out.tif")["Y"].min() >= 0


def test_integers_of_a_place_are_no_colors():
    levels = np.zeros((16, 24), np.uint16)
    levels[::2] = 60_000
    write(levels, PLACED)
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF, "--edge", "wrap") == 0
    with Image.open("out.tif") as image:
        values = np.array(image)
    assert np.abs(values.astype(int) - 30_000).max() <= 1


def test_statistics_are_dropped_and_other_facts_kept():
    facts = (
        '<GDALMetadata>\n  <Item name="STATISTICS_MEAN" sample="0">7</Item>\n'
        '  <Item name="SCALE" sample="0" role="scale">0.1</Item>\n</GDALMetadata>\n'
    )
    write(ground(), {**PLACED, FACTS: facts})
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    kept = tags()[FACTS]
    assert "STATISTICS" not in kept
    assert 'role="scale">0.1<' in kept


@pytest.mark.parametrize("is_placed", [True, False])
def test_more_bands_than_colors_are_all_kept(is_placed):
    bands = np.random.default_rng(1).integers(0, 256, (16, 24, 5), np.uint8)
    target = OpenImageIO.ImageOutput.create("in.tif")
    spec = OpenImageIO.ImageSpec(24, 16, 5, "uint8")
    spec.channelnames, spec.alpha_channel = ("R", "G", "B", "near", "far"), -1
    target.open("in.tif", spec)
    target.write_image(bands)
    target.close()
    if is_placed:
        placed = {KEYS: Tag(3, np.array(AREA, np.uint16)), SCALE: Tag(12, np.array(PLACED[SCALE]))}
        add_tags(Path("in.tif"), [{**placed, POINTS: Tag(12, np.array(PLACED[POINTS]))}])
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME) == 0
    assert np.array_equal(OpenImageIO.ImageInput.open("out.tif").read_image("uint8"), bands)


def test_a_missing_value_that_does_not_fit_is_not_claimed():
    store("in.tif", np.random.default_rng(1).random((16, 24, 1)), ("Y",))
    add_tags(Path("in.tif"), [{NODATA: text_tag("-9999")}])
    assert ended("warp", "in.tif", "-o", "out.tif", *SAME, "--bits", "8") == 0
    assert NODATA not in tags()


def test_a_turn_there_and_back_is_the_same_place():
    geo = geo_of({})
    assert geo is None
    given = {SCALE: Tag(12, np.array(PLACED[SCALE])), POINTS: Tag(12, np.array(PLACED[POINTS]))}
    geo = geo_of(given)
    matrix = np.array([[0.8, -0.6, 3.0], [0.6, 0.8, -2.0], [0, 0, 1]])
    again = moved(moved(geo, matrix), np.linalg.inv(matrix))
    assert np.allclose(again.matrix, geo.matrix, rtol=1e-12, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-5, 0.05, 3e4])
def test_a_scale_stays_a_scale_however_fine_the_units_are(scale):
    """As of degrees: hundredths of one are a kilometre."""
    write(ground(), {**PLACED, SCALE: (scale, 2 * scale, 1.0)})
    assert ended("warp", "in.tif", "-o", "out.tif", *HALF) == 0
    kept = tags()
    assert MATRIX not in kept
    assert kept[SCALE] == pytest.approx((2 * scale, 4 * scale, 1.0))


@pytest.mark.parametrize(("x", "y"), [(-1, 1), (1, -1)])
def test_a_mirrored_picture_has_a_matrix_as_a_scale_is_above_0(x, y):
    write(ground(), PLACED)
    mirror = f"{x},0,{24 * (x < 0)},0,{y},{16 * (y < 0)}"
    assert ended("warp", "in.tif", "-o", "out.tif", "--matrix", mirror) == 0
    assert MATRIX in tags()
    assert SCALE not in tags()
