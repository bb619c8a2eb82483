"""Depth of unknown scale and shift, and pictures for two eyes."""

import re
from functools import partial

import cv2
import numpy as np
import pytest

from resample.files.images import read_image
from resample.files.pictures import Kind, Picture
from resample_warp3d import cli
from resample_warp3d.command import stereo
from resample_warp3d.depth.encodings import RelativeDepth
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SHAPE = (24, 32)
FAST = ["--method", "mcmillan-zbuffer"]
FOCAL = 40.0
SEEN = ["--intrinsics", f"{FOCAL},{FOCAL},16,12"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command: color.png, and depth of a wall with a box before it."""
    monkeypatch.chdir(tmp_path)
    color = np.random.default_rng(7).integers(0, 256, (*SHAPE, 3), np.uint8)
    cv2.imwrite("color.png", color)
    cv2.imwrite("gray.png", color[..., 0])
    z = np.full(SHAPE, 8.0, np.float32)
    z[8:16, 12:20] = 4.0
    np.save("z.npy", z)
    np.save("rel.npy", 37.0 * (1.0 / z))


# Encodings


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 0.0), (37.0, -5.0), (0.002, 1e3)])
def test_scale_and_shift_make_no_difference(rng, scale, shift):
    share = rng.random(SHAPE)
    share[0, :2] = 0.0, 1.0
    nearness = RelativeDepth(2.0, 16.0).nearness(scale * share + shift)
    spread = nearness.astype(float) - nearness.min()
    np.testing.assert_allclose(spread / spread.max(), share, atol=2e-6)


def test_the_ends_of_the_range_are_near_and_far():
    share = np.repeat(np.linspace(0, 1, 24), 100).reshape(24, 100)
    nearness = RelativeDepth(2.0, 16.0).nearness(255 * share)
    np.testing.assert_allclose(nearness[:, 0], share[:, 0] * (1 / 2 - 1 / 16) + 1 / 16, rtol=1e-6)
    z = 1.0 / RelativeDepth(2.0, 16.0, is_distance=True).nearness(255 * share)
    np.testing.assert_allclose(z[:, 0], 2 + share[:, 0] * 14, rtol=1e-6)


def test_whole_numbers_need_no_scale_and_0_is_the_farthest():
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    nearness = RelativeDepth().nearness(levels)
    assert nearness[0, 0] == pytest.approx(0.1, abs=1e-3)
    step = RelativeDepth().quantum(levels)
    assert step == pytest.approx(float(np.diff(nearness.ravel())[100]), rel=1e-2)


def test_stray_numbers_do_not_stretch_the_range(rng, record):
    depth = rng.random((100, 100))
    plain = RelativeDepth().nearness(depth)
    depth[50, 50] = 1e6
    record.error("largest", np.abs(RelativeDepth().nearness(depth) - plain)[depth < 2].max())


def test_what_is_no_number_is_unknown(rng):
    depth = rng.random(SHAPE)
    depth[3, :3] = np.nan, np.inf, -np.inf
    nearness = RelativeDepth().nearness(depth)
    assert (nearness[3, :3] == 0).all()
    assert (nearness > 0).sum() == depth.size - 3


def test_two_levels_are_two_depths():
    mask = np.zeros(SHAPE, np.uint8)
    mask[0, 0] = 255
    assert set(np.unique(RelativeDepth(1.0, 10.0).nearness(mask))) == {np.float32(0.1), 1.0}


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: RelativeDepth(4.0, 2.0), "near 4 is not below far 2"),
        (lambda: RelativeDepth(0.0), "near 0.0 is not finite and above 0"),
        (lambda: RelativeDepth(1.0, np.inf, is_distance=True), "need a finite far"),
        (lambda: RelativeDepth().nearness(np.ones(SHAPE)), "the same everywhere"),
        (lambda: RelativeDepth().nearness(np.full(SHAPE, np.nan)), "the same everywhere"),
    ],
)
def test_what_tells_nothing_is_refused(make, complaint):
    with pytest.raises(ValueError, match=complaint):
        make()


# Commands


@pytest.mark.sweep
def test_relative_depth_shows_a_picture_and_says_what_it_takes_for_granted(capsys):
    words = ["render", "color.png", "rel.npy", "--depth-kind", "relative", "--move", ".1,0,0"]
    assert ended(*words, "-o", "out.png") == 0
    said = capsys.readouterr().err
    assert (
        "assumed a depth of 1 to 10 units (--near, --far) and a field of view of 60 degrees" in said
    )
    assert read_image("out.png")[..., 3].mean() > 0.8


@pytest.mark.sweep
def test_relative_depth_of_a_known_range_is_depth():
    words = ["color.png", "rel.npy", "--depth-kind", "relative", "--near", "4", "--far", "8", *SEEN]
    assert ended("render", *words, "--move", ".3,0,0", "-o", "rel.exr") == 0
    assert ended("render", "color.png", "z.npy", *SEEN, "--move", ".3,0,0", "-o", "z.exr") == 0
    np.testing.assert_allclose(read_image("rel.exr"), read_image("z.exr"), atol=1e-5)


@pytest.mark.sweep
def test_a_film_of_a_photo_and_relative_depth_is_one_command():
    words = ["color.png", "rel.npy", "--depth-kind", "relative", "--frames", "2"]
    assert ended("animate", *words, "-o", "film.gif") == 0


def two_eyes(*words):
    """Picture of the other eye, by depth z."""
    given = ["color.png", "z.npy", "--depth-kind", "z", *SEEN]
    assert ended("stereo", *given, "-o", "out.exr", *words) == 0
    return read_image("out.exr")


@pytest.mark.sweep
def test_what_is_in_the_screen_stays_and_nearer_things_go_left():
    # parallax of the box: 40 px · 0.8 · (1/4 − 1/8) = 4 px
    source, right = read_image("color.png"), two_eyes(*FAST, "--eyes", "0.8", "--zero-plane", "8")
    np.testing.assert_allclose(right[:8, :, :3], source[:8], atol=1e-5)
    np.testing.assert_allclose(right[8:16, 8:16, :3], source[8:16, 12:20], atol=1e-5)


@pytest.mark.sweep
def test_a_screen_in_front_pushes_the_wall_to_the_right():
    source, right = read_image("color.png"), two_eyes(*FAST, "--eyes", "0.8", "--zero-plane", "4")
    np.testing.assert_allclose(right[8:16, 12:20, :3], source[8:16, 12:20], atol=1e-5)
    np.testing.assert_allclose(right[:8, 4:, :3], source[:8, :28], atol=1e-5)


def test_parallax_is_comfortable_by_default(capsys):
    two_eyes()
    assert "the screen is 8 away: parallax from 0.0 to 0.5 px" in capsys.readouterr().err


@pytest.mark.sweep
def test_depth_and_disparity_agree():
    np.save("disparity.npy", 40 * 0.8 / np.load("z.npy"))
    assert ended("stereo", "color.png", "disparity.npy", "-o", "pair.exr") == 0
    by_depth = two_eyes("--eyes", "0.8", "--zero-plane", "1e9")
    np.testing.assert_allclose(by_depth, read_image("pair.exr"), atol=1e-5)


@pytest.mark.sweep
@pytest.mark.parametrize("made", ["left", "right"])
def test_both_pictures_stand_in_one(made):
    words = ["--eye-distance", "0.8", "--eyes", made, "--fill"]
    source, other = read_image("color.png"), two_eyes(*words)
    beside = two_eyes(*words, "--layout", "side-by-side")
    above = two_eyes(*words, "--layout", "top-bottom")
    first, second = (source, other) if made == "right" else (other, source)
    np.testing.assert_allclose(beside, np.concatenate([first, second], axis=1), atol=1e-6)
    np.testing.assert_allclose(above, np.concatenate([first, second], axis=0), atol=1e-6)
    mixed = two_eyes(*words, "--layout", "anaglyph")
    np.testing.assert_allclose(mixed[..., 0], first[..., 0], atol=1e-6)
    np.testing.assert_allclose(mixed[..., 1:], second[..., 1:], atol=1e-6)


def test_layouts_have_their_usual_names():
    words = ["--eyes", "0.8", "--fill", "--layout"]
    beside = two_eyes(*words, "sbs")
    left, right = beside[:, :32], beside[:, 32:]
    np.testing.assert_array_equal(two_eyes(*words, "cross-eyed"), np.hstack([right, left]))
    for name in ("ou", "tab", "top-and-bottom"):
        np.testing.assert_array_equal(two_eyes(*words, name), np.vstack([left, right]))
    rows = two_eyes(*words, "row-interlaced")
    np.testing.assert_allclose(rows[::2], 0.5 * (left[::2] + left[1::2]), atol=1e-6)
    np.testing.assert_allclose(rows[1::2], 0.5 * (right[::2] + right[1::2]), atol=1e-6)
    luma = left @ np.array([0.2126, 0.7152, 0.0722])
    half = two_eyes(*words, "half-color")
    np.testing.assert_allclose(half[..., 0], luma, atol=1e-6)
    np.testing.assert_allclose(half[..., 1:], right[..., 1:], atol=1e-6)


@pytest.mark.parametrize("layout", stereo.ANAGLYPHS)
def test_anaglyphs_are_gray_where_both_eyes_see_one_gray(layout):
    gray = np.float32([[[0.2] * 3, [0.7] * 3]])
    picture = Picture(gray, Kind(("R", "G", "B"), 8, is_encoded=True))
    np.testing.assert_allclose(stereo.together(picture, picture, layout).data, gray, atol=2e-3)


def test_parallax_is_given_in_shares_of_the_width(capsys):
    two_eyes("--divergence", "10", "--convergence", "25")
    told = capsys.readouterr().err
    behind, before = map(float, re.search(r"parallax from (\S+) to (\S+) px", told).groups())
    assert abs(before - behind - 3.2) < 0.11  # px of 32
    assert abs(-behind / (before - behind) - 0.25) < 0.04


def test_holes_stay_holes_in_both_pictures():
    beside = two_eyes("--eyes", "0.8", "--layout", "side-by-side", "--no-fill")
    assert beside.shape == (24, 64, 4)
    assert (beside[:, :32, 3] == 1).all()
    assert beside[:, 32:, 3].min() == 0
    mixed = two_eyes("--eyes", "0.8", "--layout", "anaglyph", "--no-fill")
    np.testing.assert_allclose(mixed[..., 3], beside[:, 32:, 3], atol=1e-6)
    assert (mixed[..., :3] <= mixed[..., 3:] + 1e-6).all()


def test_an_anaglyph_of_gray_pictures_is_red_and_cyan():
    given = ["gray.png", "z.npy", "--depth-kind", "z", *SEEN, "--eyes", "0.8"]
    assert ended("stereo", *given, "--layout", "anaglyph", "-o", "out.exr") == 0
    mixed = read_image("out.exr")
    np.testing.assert_allclose(mixed[..., 0], read_image("gray.png")[..., 0], atol=1e-6)
    np.testing.assert_array_equal(mixed[..., 1], mixed[..., 2])


def test_the_picture_of_a_lens_is_straightened_beside_its_partner():
    lens = ["--lens", f"{FOCAL},{FOCAL},16,12,-0.2,0.05,0,0"]
    given = ["color.png", "z.npy", "--depth-kind", "z", *lens, "--eyes", "1e-6"]
    assert ended("stereo", *given, "--layout", "side-by-side", "-o", "out.exr") == 0
    both = read_image("out.exr")
    np.testing.assert_allclose(both[:, :32], both[:, 32:], atol=1e-3)


@pytest.mark.parametrize(
    ("file", "options", "kind"),
    [
        ("levels.png", [], ["--depth-kind", "relative"]),
        ("fine.png", [], ["--depth-kind", "relative"]),
        ("mm.png", [], ["--depth-kind", "z", "--depth-scale", "1000"]),
        ("mm.png", ["--depth-scale", "1000"], ["--depth-kind", "z"]),
        ("levels.png", ["--disparity-scale", "16"], ["--depth-kind", "pair"]),
        ("z.npy", ["--eyes", "0.1"], ["--depth-kind", "z"]),
        ("z.npy", [], ["--depth-kind", "pair"]),
    ],
)
def test_the_kind_of_depth_is_recognised_and_said(file, options, kind, capsys):
    z = np.load("z.npy")
    cv2.imwrite("levels.png", (1000 / z).astype(np.uint8))
    cv2.imwrite("fine.png", (240_000 / z).astype(np.uint16))
    cv2.imwrite("mm.png", (1000 * z).astype(np.uint16))
    given = ["stereo", "color.png", file, *options]
    assert ended(*given, "-o", "assumed.png") == 0
    said = capsys.readouterr().err
    assert (" ".join(kind) in said) == (not options or options[0] == "--eyes")
    assert ended(*given, *kind, "-o", "told.png") == 0
    np.testing.assert_array_equal(read_image("assumed.png"), read_image("told.png"))


def test_eyes_that_see_the_same_picture_are_told(capsys):
    np.save("rel.npy", np.load("rel.npy") / 37)
    assert ended("stereo", "color.png", "rel.npy", "-o", "out.png") == 0
    assert (
        "the eyes see the same picture: disparities are at most 0.25 px" in capsys.readouterr().err
    )


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--depth-kind", "pair", "--eyes", "0.1"], "--eye-distance needs depth, by --depth-kind"),
        (["--depth-kind", "pair", "--zero-plane", "2"], "--zero-plane needs depth"),
        (["--depth-kind", "relative", "--depth-scale", "9"], "relative depth has no scale"),
        (
            ["--depth-kind", "z", "--near", "9"],
            "--near belongs to --depth-kind inverse or relative",
        ),
        (["--depth-kind", "z", "--eyes", "0"], "greater than 0"),
        (["--depth-kind", "relative", "--near", "9", "--far", "3"], "near 9 is not below far 3"),
        (["--layout", "mono"], "layout"),
        (["--eyes", "1", "--divergence", "2", "--depth-kind", "z"], "both say the parallax"),
    ],
)
def test_choices_that_do_not_fit_are_refused_in_one_line(capsys, words, complaint):
    given = ["stereo", "color.png", "z.npy", "-o", "out.png", *words]
    assert complaint in refused(capsys, *given)
