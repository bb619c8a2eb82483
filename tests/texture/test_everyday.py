"""Pictures resized, scaled, rotated and undistorted, by calls and by commands."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from resample.files.images import read_channels, read_image
from resample.files.sequences import frames_of
from resample_texture import BackwardMap, Hybrid, cli, resize, rotate, scale, undistort, warp
from resample_texture.geometry.matrices import scaled_shape, turned_shape
from tests import commands
from tests.commands import HEAVY, imported, store

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
COMMANDS = {
    "resize": ["--size", "12x8"],
    "scale": ["--factor", "0.5"],
    "rotate": ["--degrees", "-30"],
    "undistort": ["--lens", "20,20,12,8,0.1,0.01,0,0"],
}
BENT = ["undistort", "photo.png", "out.png", *COMMANDS["undistort"]]
ROUNDING = 2e-6  # of float32 sums
QUARTERS = [-450, -90, 0, 90, 180, 270, 360, 3690]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, photo):
    """The working folder of every command, with photo.png in it."""
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", photo[..., ::-1])
    return tmp_path


@pytest.fixture
def photo() -> np.ndarray:
    """The levels (16, 24, 3) of photo.png, red first."""
    return np.random.default_rng(11).integers(0, 256, (16, 24, 3), np.uint8)


def means(image, down, across):
    """Means of blocks of pixels."""
    height, width = image.shape[:2]
    blocks = image.reshape(height // down, down, width // across, across, *image.shape[2:])
    return blocks.mean(axis=(1, 3))


def eroded(inside):
    """What lies 3 px or more inside: no cubic reaches beyond the picture from there."""
    whole = inside.astype(np.uint8)
    return cv2.erode(whole, np.ones((7, 7)), borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0


def levels_of(path):
    return np.array(Image.open(path))


# Sizes, against NumPy and OpenCV.


@pytest.mark.parametrize("edge", ["clamp", "transparent"])
@pytest.mark.parametrize(("down", "across"), [(2, 2), (1, 2), (4, 3), (8, 8), (16, 24)])
def test_a_whole_shrink_is_the_mean_of_blocks(rng, edge, down, across):
    image = rng.random((16, 24, 3), np.float32)
    found = resize(image, (16 // down, 24 // across), edge=edge)
    np.testing.assert_allclose(found.image, means(image, down, across), atol=ROUNDING)
    np.testing.assert_allclose(found.coverage, 1.0, atol=ROUNDING)


@pytest.mark.parametrize("shape", [(12, 16), (11, 17), (5, 7), (16, 10), (3, 24)])
def test_any_shrink_of_square_texels_is_opencv_s_area(rng, shape):
    image = rng.random((16, 24, 3), np.float32)
    expected = cv2.resize(image, shape[::-1], interpolation=cv2.INTER_AREA)
    found = resize(image, shape, method=Hybrid(interpolation="nearest"))
    np.testing.assert_allclose(found.image, expected, atol=ROUNDING)


def test_means_of_what_grew_are_the_picture_again(rng):
    image = rng.random((16, 24, 3), np.float32)
    unlimited = Hybrid(interpolation="area-spline:limit=none")
    grown = resize(image, (48, 48), method=unlimited).image
    np.testing.assert_allclose(means(grown, 3, 2), image, atol=ROUNDING)


def test_the_same_size_is_the_same_picture(rng):
    image = rng.random((5, 7))
    np.testing.assert_array_equal(resize(image, (5, 7)).image, image)


def test_a_batch_is_resized_picture_by_picture(rng):
    batch = rng.random((2, 16, 24, 3), np.float32)
    found = resize(batch, (8, 12)).image
    np.testing.assert_array_equal(found[1], resize(batch[1], (8, 12)).image)


def test_a_factor_is_kept_where_the_size_is_rounded(rng):
    image = rng.random((9, 10), np.float32)
    found = scale(image, 0.5).image  # 4.5 rows, of which 5 are shown
    assert found.shape == (5, 5)
    np.testing.assert_allclose(found[:4], means(image[:8], 2, 2), atol=ROUNDING)
    np.testing.assert_allclose(found[4], means(image[8:], 1, 2)[0], atol=ROUNDING)  # clamped


@pytest.mark.parametrize(
    ("factor", "shape"), [((0.5, 0.5), (5, 6)), ((2.0, 1.0), (9, 22)), ((1e-9, 0.1), (1, 1))]
)
def test_sizes_are_rounded_to_the_nearest(factor, shape):
    assert scaled_shape((9, 11), factor) == shape


@pytest.mark.parametrize("factor", [0.0, -1.0, np.inf, np.nan, (1.0, 0.0)])
def test_a_factor_is_above_0(factor):
    with pytest.raises(ValueError, match="give a factor above 0"):
        scale(np.ones((4, 4)), factor)


# Turns, against NumPy and OpenCV.


@pytest.mark.parametrize("degrees", QUARTERS)
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_quarter_turns_are_numpy_s(rng, degrees, kind):
    image = (rng.random((5, 8, 3)) * 255).astype(kind)
    found = rotate(image, degrees)
    np.testing.assert_array_equal(found.image, np.rot90(image, degrees // 90))
    assert (found.coverage == 1.0).all()


def test_a_half_turn_keeps_the_size(rng):
    image = rng.random((5, 8))
    np.testing.assert_array_equal(rotate(image, 180, (5, 8)).image, np.rot90(image, 2))


def test_a_quarter_turn_of_the_same_size_shows_the_middle(rng):
    image = rng.random((6, 8), np.float32)
    turned = rotate(image, 90, (6, 8))
    np.testing.assert_array_equal(turned.image[:, 1:7], np.rot90(image)[1:7])
    assert (turned.coverage[:, [0, 7]] == 0.0).all()


@pytest.mark.parametrize("degrees", [30.0, -12.5, 100.0])
def test_turns_are_opencv_s(rng, degrees):
    image = cv2.GaussianBlur(rng.random((60, 80), np.float32), (0, 0), 3)
    matrix = cv2.getRotationMatrix2D((39.5, 29.5), degrees, 1.0)
    expected = cv2.warpAffine(image, matrix, (80, 60), flags=cv2.INTER_CUBIC)
    found = rotate(image, degrees, (60, 80))
    inside = eroded(found.coverage > 0.999)
    assert inside.mean() > 0.4
    np.testing.assert_allclose(
        found.image[inside], expected[inside], atol=2e-3
    )  # OpenCV's table of 1/32 px, of slopes of 0.05 per px


@pytest.mark.parametrize("degrees", [17.0, -45.0, 123.4, 181.0])
def test_a_turned_picture_is_held_whole_and_no_looser(degrees):
    height, width = turned_shape((30, 50), degrees)
    found = rotate(np.ones((30, 50), np.float32), degrees)
    assert found.image.shape == (height, width)
    assert found.coverage.sum() == pytest.approx(30 * 50, rel=1e-4)
    for side in (found.coverage[0], found.coverage[-1], found.coverage[:, 0]):
        assert side.max() > 0.0


@pytest.mark.parametrize("degrees", [np.nan, np.inf])
def test_an_angle_is_a_number(degrees):
    with pytest.raises(ValueError, match="give a finite number"):
        rotate(np.ones((4, 4)), degrees)


@pytest.mark.parametrize("way", [partial(resize, shape=(2, 2)), partial(rotate, degrees=3)])
@pytest.mark.parametrize("shape", [(4,), (0, 4), (4, 0, 3)])
def test_what_is_no_picture_is_refused(way, shape):
    with pytest.raises(ValueError, match=r"a picture is \(H, W\) or"):
        way(np.ones(shape))


# Commands.


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "shape"),
    [
        (["--size", "12x10"], (10, 12)),
        (["--size", "6"], (4, 6)),
        (["--size", "50%"], (8, 12)),
        (["--size", "12.5 %"], (2, 3)),
        (["--size", "0.25"], (4, 6)),
        (["--size", ".5"], (8, 12)),
        (["--size", "2x"], (32, 48)),
        (["--width", "12"], (8, 12)),
        (["--height", "3"], (3, 5)),
        (["--width", "1"], (1, 1)),
        (["--width", "5", "--height", "6"], (6, 5)),
    ],
)
def test_a_size_is_said_in_many_ways(words, shape):
    assert ended("resize", "photo.png", "out.png", *words) == 0
    assert levels_of("out.png").shape == (*shape, 3)


@pytest.mark.sweep
def test_half_the_size_is_the_mean_of_light_or_of_levels(photo):
    light = read_image("photo.png")
    assert ended("resize", "photo.png", "out.exr", "--size", "50%") == 0
    np.testing.assert_allclose(read_image("out.exr"), means(light, 2, 2), atol=ROUNDING)
    assert ended("resize", "photo.png", "out.png", "--size", "50%", "--no-linear") == 0
    expected = means(photo.astype(float), 2, 2)
    assert np.abs(levels_of("out.png") - expected).max() <= 0.5 + 1e-3


@pytest.mark.parametrize(
    ("size", "row", "column"), [("24x19", 1, 0), ("24x21", 2, 0), ("27x16", 0, 1), ("29x16", 0, 2)]
)
def test_a_padded_picture_keeps_every_level_in_whole_pixels(photo, size, row, column):
    assert ended("resize", "photo.png", "out.png", "--size", size, "--fit", "pad") == 0
    shown = levels_of("out.png")
    inside = np.s_[row : row + 16, column : column + 24]
    np.testing.assert_array_equal(shown[inside][..., :3], photo)
    assert np.count_nonzero(shown[..., 3]) == 16 * 24


@pytest.mark.parametrize(("size", "row", "column"), [("24x13", 2, 0), ("19x16", 0, 3)])
def test_what_covers_a_size_is_cut_off_in_whole_pixels(photo, size, row, column):
    assert ended("resize", "photo.png", "out.png", "--size", size, "--fit", "cover") == 0
    shown = levels_of("out.png")
    height, width = shown.shape[:2]
    np.testing.assert_array_equal(shown, photo[row : row + height, column : column + width])


@pytest.mark.parametrize("words", [["--factor", "0.5"], ["--factor", "0.5,0.25"]])
def test_scale_takes_one_factor_or_two(words):
    assert ended("scale", "photo.png", "out.exr", *words) == 0
    down = 4 if "," in words[1] else 2
    expected = means(read_image("photo.png"), down, 2)
    np.testing.assert_allclose(read_image("out.exr"), expected, atol=ROUNDING)


@pytest.mark.some(1)
@pytest.mark.parametrize("degrees", QUARTERS)
def test_rotate_keeps_every_level_at_quarter_turns(photo, degrees):
    assert ended("rotate", "photo.png", "out.png", "--degrees", degrees) == 0
    np.testing.assert_array_equal(levels_of("out.png"), np.rot90(photo, degrees // 90))


@pytest.mark.sweep
def test_rotate_keeps_the_size_if_asked_for():
    for words, shape in (([], (26, 29)), (["--keep-size"], (16, 24)), (["--expand"], (26, 29))):
        assert ended("rotate", "photo.png", "out.png", "--degrees", "-30", *words) == 0
        assert levels_of("out.png").shape == (*shape, 4)  # the corners are transparent


def test_a_fisheye_s_picture_is_opencv_s(record):
    y, x = np.mgrid[:60, :80] / 8.0
    image = (0.5 + 0.4 * np.sin(x) * np.cos(y)).astype(np.float32)
    store("in.exr", image[..., None], ("Y",))
    camera, bends = [30.0, 31, 39, 30], [-0.05, 0.01, 0, 0]
    turn = cv2.Rodrigues(np.array([0.05, -0.1, 0.02]))[0]
    matrix = np.array([[25.0, 0, 38], [0, 26, 29], [0, 0, 1]])
    maps = cv2.fisheye.initUndistortRectifyMap(
        np.array([[30.0, 0, 39], [0, 31, 30], [0, 0, 1]]),
        np.array(bends), turn, matrix, (80, 60), cv2.CV_32FC1,
    )  # fmt: skip
    expected = cv2.remap(image, *maps, cv2.INTER_CUBIC)
    np.savetxt("turn.txt", turn)
    words = ["--fisheye", "--new-matrix", "25,26,38,29", "--rectify", "turn.txt"]
    lens = ",".join(map(str, camera + bends))
    assert ended("undistort", "in.exr", "out.exr", "--lens", lens, *words) == 0
    u, v = maps
    is_inside = (u > 3) & (u < 76) & (v > 3) & (v < 56)
    assert is_inside.mean() > 0.6
    apart = np.abs(read_channels("out.exr")["Y"] - expected)[is_inside]
    record.error("mean", apart.mean())
    record.error("largest", apart.max())  # means of pixels against values at their centers


@pytest.mark.some(1)
@pytest.mark.parametrize("form", ["toml", "json", "yml"])
def test_a_lens_file_may_say_all_of_it(form):
    turn = cv2.Rodrigues(np.array([0.1, 0.05, -0.2]))[0]
    matrix = [[15.0, 0, 11], [0, 16, 9], [0, 0, 1]]
    facts = {
        "camera_matrix": [[20.0, 0, 12], [0, 20, 8], [0, 0, 1]],
        "distortion_coefficients": [0.1, 0.01, 0.0, 0.0],
        "lens_model": "fisheye",
        "rectification_matrix": turn.tolist(),
        "new_camera_matrix": matrix,
    }
    Path("l.json").write_text(json.dumps(facts))
    Path("l.toml").write_text("\n".join(f"{key} = {json.dumps(facts[key])}" for key in facts))
    storage = cv2.FileStorage("l.yml", cv2.FILE_STORAGE_WRITE)
    for name, value in facts.items():
        storage.write(name, value if isinstance(value, str) else np.array(value))
    storage.release()
    np.savetxt("m.txt", matrix)
    np.save("turn.npy", turn)
    words = ["--fisheye", "--new-matrix", "m.txt", "--rectify", "turn.npy"]
    lens = ["--lens", "20,20,12,8,0.1,0.01,0,0"]
    assert ended("undistort", "photo.png", "said.exr", *lens, *words) == 0
    assert ended("undistort", "photo.png", "file.exr", "--lens", f"l.{form}") == 0
    assert ended("warp", "photo.png", "-o", "warp.exr", "--lens", f"l.{form}") == 0
    for name in ("file.exr", "warp.exr"):
        np.testing.assert_array_equal(read_image(name), read_image("said.exr"))


@pytest.mark.sweep
def test_without_words_undistort_is_warp_with_a_lens():
    for words in ([], ["--inverse"], ["--size", "9x7"]):
        lens = [*COMMANDS["undistort"], *words]
        assert ended("undistort", "photo.png", "here.exr", *lens) == 0
        assert ended("warp", "photo.png", "-o", "there.exr", *lens) == 0
        np.testing.assert_array_equal(read_image("here.exr"), read_image("there.exr"))


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["resize", "scale"])
@pytest.mark.parametrize("words", [[], ["--filter", "gaussian:sigma=0.8"], ["--quality", "2"]])
def test_edges_do_not_fade_whatever_else_is_chosen(name, words):
    assert ended(name, "photo.png", "out.jpg", *COMMANDS[name], *words) == 0  # without alpha
    assert ended(name, "photo.png", "out.png", *COMMANDS[name], *words, "--edge", "mirror") == 0
    assert levels_of("out.png").shape == (8, 12, 3)


def test_a_page_s_edges_do_not_fade_whatever_else_is_chosen():
    words = ["--corners", "0,0 24,0 24,16 0,16", "--filter", "gaussian:sigma=0.8"]
    assert ended("rectify", "photo.png", "-o", "page.jpg", *words) == 0


# What they share with warp.


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize(
    "words",
    [
        ["--method", "cubic"],
        ["--filter", "gaussian:sigma=0.7"],
        ["--interpolation", "nearest"],
        ["--edge", "wrap"],
        ["--no-linear"],
    ],
)
def test_every_choice_changes_the_picture(name, words):
    if name in ("resize", "scale") and words[0] in ("--interpolation", "--edge"):
        words = [*words, "--filter", "gaussian:sigma=1.5"]  # without, the area has no beyond
    assert ended(name, "photo.png", "plain.exr", *COMMANDS[name]) == 0
    assert ended(name, "photo.png", "other.exr", *COMMANDS[name], *words) == 0
    plain, other = (read_image(file)[..., :3] for file in ("plain.exr", "other.exr"))
    assert np.abs(plain - other).max() > 1e-3


@pytest.mark.some(3)
@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_besides_is_that_of_warp(name):
    words = [*COMMANDS[name], "--threads", "1", "--bits", "16", "--roi", "2,1,5,4"]
    besides = ["--coverage", "c.exr", "--stats", "s.json"]
    assert ended(name, "photo.png", "--output", "out.png", *words, *besides) == 0
    assert read_image("out.png").shape[:2] == (4, 5)
    assert next(iter(read_channels("c.exr").values())).shape == (4, 5)
    assert json.loads(Path("s.json").read_text())["size"] == [5, 4]


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
def test_many_pictures_of_many_sizes_go_to_a_folder(name):
    Path("shots").mkdir()
    for n in (1, 2):
        cv2.imwrite(f"shots/{n}.png", np.full((16 * n, 24 * n), 99 * n, np.uint8))
    words = {**COMMANDS, "resize": ["--size", "50%"]}[name]
    for given in (["shots/*.png"], ["shots"], ["shots/1.png", "shots/2.png"]):
        assert ended(name, *given, "made/", *words) == 0
        shapes = [levels_of(f"made/{n}.png").shape[:2] for n in (1, 2)]
        assert abs(2 * shapes[0][0] - shapes[1][0]) <= 1  # a turned one's size is rounded
        assert abs(2 * shapes[0][1] - shapes[1][1]) <= 1


def test_a_film_is_resized_frame_by_frame():
    frames = [Image.new("RGB", (32, 24), color) for color in ("red", "green", "blue")]
    frames[0].save("in.gif", save_all=True, append_images=frames[1:], duration=80)
    assert ended("resize", "in.gif", "out.mp4", "--width", "16") == 0
    made = frames_of(Path("out.mp4"))
    assert made is not None
    assert [picture.data.shape[:2] for picture in made.read()] == [(12, 16)] * 3


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "x", "y"),
    [
        (["resize", "--size", "12x4"], 3.0, 1.0),
        (["scale", "--factor", "2"], 12.0, 8.0),
        (["rotate", "--degrees", "90"], 4.0, 18.0),
        (["rotate", "--degrees", "180", "--keep-size"], 18.0, 12.0),
    ],
)
def test_a_place_on_earth_moves_with_the_picture(words, x, y):
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in (
        (33550, 12, (10.0, 20.0, 1.0)),
        (33922, 12, (0.0, 0.0, 0.0, 5e5, 4e6, 0.0)),
        (34735, 3, (1, 1, 0, 1, 1025, 0, 1, 1)),
    ):
        directory.tagtype[tag], directory[tag] = kind, value
    Image.fromarray(np.full((16, 24), 9, np.uint8)).save("in.tif", tiffinfo=directory)
    name, *others = words
    assert ended(name, "in.tif", "out.tif", *others) == 0
    with Image.open("out.tif") as image:
        tags = dict(image.tag_v2)
    if 34264 in tags:
        found = (np.reshape(tags[34264], (4, 4)) @ (x, y, 0.0, 1.0))[:2]
    else:
        found = tags[33922][3] + x * tags[33550][0], tags[33922][4] - y * tags[33550][1]
    assert found == pytest.approx([5e5 + 6.0 * 10.0, 4e6 - 4.0 * 20.0], abs=1e-6)


@pytest.mark.sweep
@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example(name, capsys):
    assert ended(name, "--help") == 0
    assert f"resample-texture {name} sample:" in capsys.readouterr().out


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        "resize",
        *(pytest.param(name, marks=pytest.mark.sweep) for name in COMMANDS if name != "resize"),
    ],
)
def test_help_imports_nothing_heavy(name):
    assert imported("resample_texture.cli", name, "--help") & HEAVY == set()


@pytest.mark.some(18)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["resize", "photo.png", "out.png"], "give a size, or a width, a height or both"),
        (["resize", "photo.png", "out.png", "--size", "9", "--width", "9"], "give a size, or"),
        (["resize", "photo.png", "out.png", "--size", "0%"], "give a factor above 0"),
        (["resize", "photo.png", "out.png", "--size", "2y"], "give 400, 640x480, 50%, 0.5 or 2x"),
        (["resize", "photo.png", "out.png", "--size", "0x9"], "at least 1"),
        (["resize", "photo.png", "out.png", "--size", "much"], "give 400, 640x480, 50%,"),
        (["resize", "photo.png", "out.png", "--width", "0"], "greater than or equal to 1"),
        (["resize", "photo.png", "out.png", "--size", "9999999999.5"], "together at most"),
        (["resize", "photo.png", "--size", "9"], "give the output after photo.png"),
        (
            ["resize", "photo.png", "out.png", "--size", "9", "--box", "1,x"],
            "box '1,x'; give numbers",
        ),
        (
            ["resize", "photo.png", "out.png", "--size", "9", "--box", "1,2,3"],
            "give left, top, right",
        ),
        (["resize", "--size", "9"], "needs FILES"),
        (["resize", "none.png", "out.png", "--size", "9"], "none.png"),
        (["resize", "photo.png", "out.gif", "--size", "9"], "pictures are written as"),
        (["scale", "photo.png", "out.png"], "needs --factor"),
        (["scale", "photo.png", "out.png", "--factor", "0"], "give a factor above 0"),
        (["scale", "photo.png", "out.png", "--factor", "-1"], "give a factor above 0"),
        (["scale", "photo.png", "out.png", "--factor", "1,2,3"], "give one, or two"),
        (["scale", "photo.png", "out.png", "--factor", "x"], "give numbers"),
        (["rotate", "photo.png", "out.png"], "needs --degrees"),
        (["rotate", "photo.png", "out.png", "--degrees", "nan"], "finite number"),
        (["rotate", "photo.png", "out.png", "--degrees", "left"], "degrees"),
        (["undistort", "photo.png", "out.png"], "needs --lens"),
        (["undistort", "photo.png", "out.png", "--lens", "1,2"], "give fx,fy,cx,cy,k1,k2,p1,p2"),
        (
            ["undistort", "photo.png", "out.png", "--lens", "1,2", "--fisheye"],
            "give fx,fy,cx,cy,k1,k2,k3,k4",
        ),
        (
            ["undistort", "photo.png", "out.png", "--lens", "9,9,5,5,0,0,0,0,0", "--fisheye"],
            "a fisheye lens has 4 finite coefficients",
        ),
        (
            ["undistort", "photo.png", "out.png", "--lens", "plain.toml", "--fisheye"],
            "plain.toml: its lens is a pinhole, not a fisheye",
        ),
        (
            ["undistort", "photo.png", "out.png", "--lens", "odd.toml"],
            "unknown lens model 'mirror'",
        ),
        (["undistort", "photo.png", "out.png", "--lens", "bent.toml"], "bent.toml: the rotation"),
        ([*BENT, "--new-matrix", "1,2"], "--new-matrix: "),
        ([*BENT, "--new-matrix", "0,1,2,3"], "--new-matrix: intrinsics with fx 0"),
        ([*BENT, "--rectify", "2,0,0,0,1,0,0,0,1"], "--rectify: the rotation is not orthonormal"),
        ([*BENT, "--rectify", "none.txt"], "none.txt"),
        (
            ["rotate", "photo.png", "out.png", "--degrees", "9", "--method", "magic"],
            "unknown method",
        ),
    ],
)
def test_a_bad_choice_is_one_line(words, complaint, capsys):
    lens = "camera_matrix = [9, 9, 5, 5]\ndistortion_coefficients = [0, 0, 0, 0]\n"
    Path("plain.toml").write_text(f"{lens}lens_model = 'plumb_bob'")
    Path("odd.toml").write_text(f"{lens}lens_model = 'mirror'")
    Path("bent.toml").write_text(f"{lens}rectification_matrix = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]")
    assert complaint in refused(capsys, *words)


def test_several_pictures_are_not_written_to_a_picture(capsys):
    cv2.imwrite("other.png", np.zeros((4, 4), np.uint8))
    words = ["resize", "photo.png", "photo.png", "other.png", "--size", "9"]
    assert "other.png is not a folder" in refused(capsys, *words)


def test_files_and_pillow_s_images_are_taken_as_warp_takes_them(tmp_path):
    picture = Image.fromarray(np.random.default_rng(1).integers(0, 255, (12, 16, 3), np.uint8))
    path = tmp_path / "photo.png"
    picture.save(path)
    for call in (
        lambda image: resize(image, (6, 8)),
        lambda image: scale(image, 1.5),
        lambda image: rotate(image, 30),
    ):
        expected = call(np.asarray(picture)).image
        np.testing.assert_array_equal(call(path).image, expected)
        np.testing.assert_array_equal(call(str(path)).image, expected)
        np.testing.assert_array_equal(call(picture).image, expected)


# What Python and the command line have in common.


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"shape": 9}, ["--size", "9"]),
        ({"shape": np.int64(48)}, ["--size", "48"]),
        ({"shape": 0.4}, ["--size", "0.4"]),
        ({"shape": 2.0}, ["--size", "2x"]),
        ({"width": 9}, ["--width", "9"]),
        ({"height": 9}, ["--height", "9"]),
        ({"width": 9, "height": 9}, ["--width", "9", "--height", "9"]),
        *(
            ({"shape": (9, 20), "fit": fit}, ["--size", "20x9", "--fit", fit])
            for fit in ("contain", "cover", "stretch", "pad")
        ),
        ({"shape": 9, "fit": "pad"}, ["--size", "9", "--fit", "pad"]),
        ({"width": 9, "height": 9, "fit": "cover"}, ["--width=9", "--height=9", "--fit=cover"]),
        ({"shape": 12, "box": (2.5, 3, 18, 15)}, ["--size", "12", "--box", "2.5,3,18,15"]),
        ({"shape": 0.5, "box": (2, 4, 18, 14)}, ["--size", "50%", "--box", "2,4,18,14"]),
    ],
)
def test_a_size_is_that_of_the_command(photo, given, words):
    ended("resize", "photo.png", "out.png", *words)
    made, written = resize(photo, **given).image, levels_of("out.png")
    assert made.shape[:2] == written.shape[:2]
    close = np.abs(made.astype(int) - written[..., :3]) <= 1  # files are rounded from light
    assert close.all()


def test_one_number_is_the_longer_side(rng):
    assert resize(rng.random((30, 40)), 20).image.shape == (15, 20)
    assert resize(rng.random((40, 30, 3)), 20).image.shape == (20, 15, 3)


def test_padding_is_not_covered(photo):
    padded = resize(photo, (24, 24), fit="pad")
    assert padded.coverage[:, 3].tolist() == [0.0] * 4 + [1.0] * 16 + [0.0] * 4
    np.testing.assert_array_equal(padded.image[4:20], photo)
    assert resize(photo, (24, 24), fit="pad", edge="clamp").coverage.min() == 1.0


@pytest.mark.parametrize("box", [(3, 2, 21, 14), (0, 0, 30, 20), (6, 4, 24, 16)])
def test_a_box_is_pillow_s(rng, box):
    image = rng.random((20, 30)).astype(np.float32)
    size = (box[2] - box[0]) // 3, (box[3] - box[1]) // 2
    pillow = Image.fromarray(image).resize(size, Image.Resampling.BOX, box=box)
    found = resize(image, size[::-1], box=box).image
    np.testing.assert_allclose(found, np.asarray(pillow), atol=ROUNDING)


def test_a_box_fills_what_the_picture_would(photo):
    assert resize(photo, 9, box=(1.5, 2, 22.5, 9)).image.shape == (3, 9, 3)
    part = resize(photo, (14, 42), box=(1.5, 2, 22.5, 9)).image
    matrix = [[2, 0, -3], [0, 2, -4]]
    np.testing.assert_array_equal(part, warp(photo, matrix, (14, 42), edge="clamp").image)
    cut = resize(photo, (8, 8), box=(4, 4, 12, 8), fit="cover").image
    np.testing.assert_array_equal(cut, resize(photo, (8, 8), box=(6, 4, 10, 8)).image)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({}, "give a size, or a width, a height or both"),
        ({"shape": 9, "width": 9}, "give a size, or a width"),
        ({"shape": 0}, "give a height and a width of 1 px or more"),
        ({"shape": 0.0}, "give a factor above 0"),
        ({"shape": np.nan}, "give a factor above 0"),
        ({"width": 0}, "width 0; give a whole number of px, 1 or more"),
        ({"height": 2.5}, r"height 2\.5; give a whole number"),
        ({"shape": 9, "fit": "fill"}, "fit 'fill'; known: contain, cover, stretch, pad"),
        ({"width": 9, "fit": "pad"}, "fit needs a width and a height"),
        ({"shape": 0.5, "fit": "pad"}, "fit needs a width and a height"),
        ({"shape": 9, "box": (0, 0, 25, 4)}, "of a picture of 24 × 16 px; give left, top, right"),
        ({"shape": 9, "box": (4, 0, 4, 4)}, "give left, top, right and bottom of a part"),
        ({"shape": 9, "box": (4, np.nan, 5, 4)}, "give left, top, right and bottom of a part"),
        ({"shape": 9, "box": 4}, "give left, top, right and bottom"),
        ({"shape": 9, "box": (0, 0, 4, 4), "fit": "pad"}, "leave box out, or cut it out first"),
    ],
)
def test_a_size_that_is_none_is_refused_in_a_line(photo, given, complaint):
    with pytest.raises(ValueError, match=complaint) as caught:
        resize(photo, **given)
    assert "\n" not in str(caught.value)


CAMERA = np.array([[20.0, 0, 11.5], [0, 20, 7.5], [0, 0, 1]])


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_a_lens_is_removed_as_opencv_does(photo, count):
    smooth = cv2.resize(photo[:4, :6], (96, 64), interpolation=cv2.INTER_CUBIC).astype(np.float32)
    camera, pinhole = np.diag([4, 4, 1]) @ CAMERA, np.diag([3.5, 3.5, 1]) @ CAMERA
    lens = np.array([-0.2, 0.05, 1e-3, 2e-3, 0.01, 0.02, 0.01, 0, *[1e-3] * 4, 0.01, 0.02])[:count]
    for new in (None, pinhole):
        found = undistort(smooth, camera, lens, new_matrix=new, interpolation="bilinear")
        maps = cv2.initUndistortRectifyMap(camera, lens, None, camera if new is None else new,
                                           (96, 64), cv2.CV_32FC1)  # fmt: skip
        same = warp(smooth, BackwardMap.from_opencv(*maps), (64, 96), interpolation="bilinear")
        inside = eroded(same.coverage == 1)
        np.testing.assert_allclose(found.image[inside], same.image[inside], atol=0.02)  # float32
        opencv = cv2.undistort(smooth, camera, lens, newCameraMatrix=new)
        assert np.abs(found.image - opencv)[inside].mean() < 1.0  # of 255; cv2 takes one place


def test_a_fisheye_is_rectified_as_opencv_does(photo):
    lens, turned = np.array([0.02, -0.01, 3e-3, 1e-3]), cv2.Rodrigues(np.array([0.1, 0.2, 0.05]))[0]
    maps = cv2.fisheye.initUndistortRectifyMap(CAMERA, lens, turned, CAMERA, (30, 20), cv2.CV_32FC1)
    found = undistort(photo, CAMERA, lens, (20, 30), rotation=turned, fisheye=True)
    same = warp(photo, maps, (20, 30))
    assert np.abs(found.image.astype(int) - same.image)[eroded(same.coverage == 1)].max() <= 1


@pytest.mark.parametrize("inverse", [False, True])
def test_undistort_is_that_of_the_command(photo, inverse):
    numbers = "20,20,11.5,7.5,0.1,0.01,0.001,0.002"
    way = ["--inverse"] if inverse else []
    ended("undistort", "photo.png", "out.png", "--lens", numbers, "--edge", "clamp", *way)
    made = undistort(photo, CAMERA, [0.1, 0.01, 1e-3, 2e-3], inverse=inverse, edge="clamp")
    assert np.abs(made.image.astype(int) - levels_of("out.png")).max() <= 1  # rounded from light
    np.testing.assert_array_equal(undistort(photo, CAMERA).image, photo)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ((CAMERA, [0, 0, 0]), "a lens has 4, 5, 8, 12, 14 finite coefficients"),
        ((np.eye(4), None), r"intrinsics have shape \(3, 3\)"),
        ((CAMERA, [0, 0, 0, 0], (0, 5)), "1 px or more"),
    ],
)
def test_a_lens_that_is_none_is_refused_in_a_line(photo, given, complaint):
    with pytest.raises(ValueError, match=complaint):
        undistort(photo, *given)
