"""What `resample-volume` makes of projections, classification, cuts, labels and color bars."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.files.images import read_channels, read_image
from resample_volume import cli
from resample_volume.files.generated import checker_box, vessel_tree
from tests import commands

BOX = "checker-box:size=16,block=4"  # values 64 and 192
TREE = "vessel-tree:size=24"
SMALL = ["--size", "32"]
SIZED = ("--spacing", "1x1x1")  # so that nothing is assumed
POST = ["--classify", "post"]
HIT = ["--projection", "first-hit", "--iso"]
ALL = ["maximum", "average", "additive", "first-hit"]
# Bytes lie in 16 bits, for which all of a painter is compiled anew: composited they are tried.
SINGLE = "box.npy", "tree.npy"
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    for name, made in zip(SINGLE, (checker_box(16, 4), vessel_tree(24)), strict=True):
        np.save(name, made.values.astype(np.float32))
    return tmp_path


def drawn(*words: object, volume: str = BOX) -> dict[str, np.ndarray]:
    """Channels (32, 32) that `render` writes."""
    assert ended("render", volume, "-o", "out.exr", *SMALL, *words) == 0
    return read_channels("out.exr")


def shown(*words: object, volume: str = BOX, size: str = "32") -> np.ndarray:
    """Picture (H, W, 3) that `render` writes, sRGB."""
    assert ended("render", volume, "-o", "out.png", "--size", size, *words) == 0
    return read_image("out.png")


# What pictures show


@pytest.mark.sweep
@pytest.mark.parametrize("projection", ALL)
def test_every_projection_draws_depth_where_there_is_something(projection):
    iso = ["--iso", 100] if projection == "first-hit" else []
    channels = drawn("--projection", projection, *iso, volume="tree.npy")
    seen = channels["G"] > 0.01 * channels["G"].max()
    assert seen.any()
    assert np.isfinite(channels["Z"][seen]).all()
    assert np.isinf(channels["Z"][0, 0])
    assert channels["A"].max() <= 1 + 1e-6


@pytest.mark.sweep
def test_an_x_ray_is_zero_and_known_where_nothing_is():
    channels = drawn("--projection", "additive", volume="tree.npy")
    assert channels["A"].min() == 1
    assert channels["G"][0, 0] == 0
    assert channels["G"].max() == 1


@pytest.mark.sweep
@pytest.mark.parametrize("projection", ["maximum", "average", "additive"])
def test_values_are_gray_levels_unless_a_transfer_function_is_chosen(projection):
    gray = shown("--projection", projection, volume="tree.npy")
    assert gray.max() > (0.005 if projection == "average" else 0.3)  # a mean of almost nothing
    assert np.ptp(gray, axis=2).max() < 1e-6


@pytest.mark.sweep
def test_the_largest_value_is_white_and_the_least_black():
    gray = shown("--projection", "maximum", "--fov", 0, "--camera", "0/0/1", volume="box.npy")
    assert np.median(gray[8:24, 8:24]) > 0.8  # of blocks behind each other one is bright
    assert gray.max() > 0.99
    assert gray[0].max() == 0


@pytest.mark.sweep
def test_a_surface_is_framed_like_the_voxels_that_it_is_of():
    pre, post = (drawn(*words, volume=TREE)["A"] > 0.1 for words in ([], POST))
    for axis in (0, 1):  # surfaces lie a little inside of the voxels' kernels
        inner, outer = (np.flatnonzero(seen.any(axis=axis)) for seen in (post, pre))
        assert np.ptp(inner) >= np.ptp(outer) - 6


@pytest.mark.sweep
def test_a_cut_through_noise_is_lit_as_the_plane_that_it_is(rng, record):
    values = rng.integers(180, 220, (24, 24, 24), dtype=np.uint8)
    values[:, :, :2] = 0
    np.save("noise.npy", values)
    view = ["--camera", "0/0/2", "--fov", 0, "--clip", "0/1/0", "--light", "1/-1/1"]
    Path("white.toml").write_text(
        'points = [{ value = 60, color = "gray", opacity = 0 },'
        ' { value = 100, color = "gray", opacity = 0.8 }]'
    )
    np.save("single.npy", values.astype(np.float32))
    for words, volume in (([], "noise.npy"), (POST, "noise.npy"), ([*HIT, 100], "single.npy")):
        look = [*view, *words, "--transfer", "white.toml"]
        middle = shown(*look, volume=volume)[8:24, 8:24, 0]
        assert middle.min() > 0.1
        record.error("spread", middle.std())


@pytest.mark.sweep
def test_labels_recolor_and_hide():
    values = np.zeros((16, 16, 16), np.uint8)
    values[:, :, 8:] = 1
    np.save("labels.npy", values)
    front = ["--camera", "0/0/1", "--fov", 0]
    plain = shown(*front)
    half = shown(*front, "--labels", "labels.npy", "--label", "1:hidden").max(axis=2) > 0.1
    red = shown(*front, "--labels", "labels.npy", "--label", "1:color=red")
    assert half.any(axis=0).sum() < 0.7 * half.any(axis=1).sum()
    assert np.array_equal(red[:, :12], plain[:, :12])
    assert red[16, 22, 0] > 3 * red[16, 22, 2]


@pytest.mark.sweep
def test_what_is_cropped_is_not_drawn():
    channels = drawn("--crop", "0:8,:,:", "--camera", "0/0/1", "--fov", 0)
    seen = channels["A"] > 0.5
    assert np.ptp(np.flatnonzero(seen.any(axis=0))) < 0.65 * np.ptp(
        np.flatnonzero(seen.any(axis=1))
    )


# Color bars


@pytest.mark.sweep
@pytest.mark.parametrize("words", [[], POST, *(["--projection", name] for name in ALL[:3])])
def test_a_color_bar_widens_the_picture(words):
    volume = "box.npy" if "--projection" in words else BOX
    bar = shown(*words, "--color-bar", volume=volume, size="96")
    assert bar.shape[0] == 96
    assert bar.shape[1] > 120


@pytest.mark.sweep
def test_an_x_rays_bar_does_not_depend_on_the_transfer_function():
    draw = partial(shown, "--projection", "additive", "--color-bar", volume="box.npy", size="96")
    assert np.array_equal(draw(), draw("--transfer", "viridis"))


# Statistics


# Volumes that hold little or nothing


@pytest.mark.sweep
@pytest.mark.parametrize("words", [POST, *(["--projection", name] for name in ALL[:3]), [*HIT, 8]])
def test_a_volume_of_missing_values_is_an_empty_picture_and_a_line(words, capsys):
    np.save("nan.npy", np.full((6, 6, 6), np.nan, np.float32))
    assert not shown(*words, volume="nan.npy").any()
    assert capsys.readouterr().err.startswith("resample: nothing to see: all voxels are")


@pytest.mark.sweep
@pytest.mark.parametrize("words", [POST, *(["--projection", name] for name in ALL[:3])])
@pytest.mark.parametrize("name", ["half", "even"])
def test_missing_and_even_values_are_drawn_without_a_word(name, words, rng, capsys):
    values = rng.random((12, 12, 12)).astype(np.float32)
    values[:, :, 6:], values[0, 0, 0] = np.nan, np.inf
    np.save("half.npy", values)
    np.save("even.npy", np.full((8, 8, 8), 9, np.int16))
    assert ended("render", f"{name}.npy", "-o", "out.exr", *SMALL, *words, *SIZED) == 0
    assert np.isfinite(read_image("out.exr")).all()
    assert capsys.readouterr().err == ""


@pytest.mark.sweep
def test_what_is_wholly_cut_away_is_an_empty_picture_and_a_line(capsys):
    cut = ("--clip", "1/0/0/100")
    for words, said in (
        ((), "the picture is empty: nothing visible lies in it"),
        (("--classify", "pre"), "nothing to see: all voxels are transparent, missing or cut away"),
    ):
        assert not shown(*cut, *words).any()
        assert said in capsys.readouterr().err


@pytest.mark.sweep
def test_a_normal_may_be_of_any_length(capsys):
    pictures = [shown("--clip", f"{length}/0/0") for length in ("1", "1e300", "1e-300")]
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])
    assert capsys.readouterr().err == ""


# Bad input


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([*POST, "--order", "every-sample"], "post needs the order rays, not"),
        ([*POST, "--order", "rays:step=0"], "a step of 0"),
        ([*POST, "--order", "rays:sharpness=2"], "the sharpness is 2"),
        ([*POST, "--order", "rays", "--method", "splats"], "rays paint no samples"),
        (["--classify", "pre", "--order", "rays"], "so it needs the classification post"),
        (["--projection", "maximum", "--labels", "labels.npy"], "labels color voxels"),
        (
            ["--projection", "maximum", "--order", "axis-sheets"],
            "maximum needs the order rays, not",
        ),
        (["--projection", "maximum", "--depth-cue", 0.5], "depth-cue dims light"),
        ([*HIT, 100, "--gradient-opacity", "0.1/0.5"], "gradient-opacity fades voxels, so it"),
        (
            ["--projection", "additive", "--gradient-opacity", "0.1/0.5"],
            "needs the projection composite, not additive",
        ),
        (["--iso", 4], "first-hit needs an iso value, and no other"),
        (["--projection", "first-hit"], "first-hit needs an iso value"),
        ([*HIT, "nan"], "iso: Input should be a finite number"),
        (["--method", "ewa", "--footprint", "affine"], "ewa goes with the footprint exact"),
        (["--order", "image-sheets:thickness=0"], "thickness must be above 0"),
        (["--order", "sheets"], "known orders: axis-sheets, every-sample, image-sheets"),
        (["--label", "1:hidden"], "give the volume of labels, too"),
        (["--depth-cue", "2"], "depth_cue: Input should be less than or equal to 1"),
        (["--color-bar"], "a color bar is at least 64 px high, not 32"),
    ],
)
def test_what_does_not_go_together_is_refused_before_any_work(
    words, complaint, monkeypatch, capsys
):
    def work(*_):
        raise AssertionError("the volume was read")

    monkeypatch.setattr("resample_volume.command.inputs.open_volume", work)
    assert complaint in refused(capsys, "render", BOX, "-o", "out.png", *SMALL, *words)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([*HIT, 300], "there is no surface of the value 300: checker-box holds 64 to 192"),
        ([*HIT, 64], "there is no surface of the value 64"),
        ([*HIT, -5], "there is no surface of the value -5"),
        ([*HIT, 100, "--transfer", "surfaces"], "the projection first-hit shows values, which"),
        (["--projection", "maximum", "--transfer", "surfaces"], "take one of values alone"),
        (["--crop", "8:8,:,:"], "crop '8:8,:,:', x: '8:8' holds none of the 16 voxels"),
        (["--clip", "0/0/0"], "the normal must not be 0,0,0"),
        (["--clip", "1/0/0/nan"], "clip '1/0/0/nan'; give a normal"),
        (["--labels", "small.npy"], "labels of 4 x 4 x 4 voxels do not fit a volume of 16 x 16"),
        (["--labels", "nosuch.npy"], "nosuch.npy: there is no such file"),
    ],
)
def test_what_does_not_fit_the_volume_is_one_line(words, complaint, capsys):
    np.save("small.npy", np.zeros((4, 4, 4), np.uint8))
    assert complaint in refused(capsys, "render", BOX, "-o", "out.png", *SMALL, *words)


@pytest.mark.sweep
def test_a_color_bar_is_for_pictures_of_the_screen(capsys):
    error = refused(capsys, "render", BOX, "-o", "out.exr", "--size", "96", "--color-bar")
    assert "out.exr: a color bar has no depth; write a .png, or leave it out" in error


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--difference"], "differences are shown in a picture; give its name by --output"),
        (["--peer", "vtk", "--crop", "0:8,:,:"], "VTK does not get crop; leave out either"),
        (["--peer", "vtk", "--clip", "1/0/0"], "VTK does not get clip"),
        (["--peer", "vtk", "--projection", "maximum"], "VTK does not get the projection maximum"),
        (["--peer", "vtk", "--depth-cue", 0.5], "VTK does not get depth-cue"),
    ],
)
def test_compare_refuses_what_cannot_be_compared(words, complaint, capsys):
    assert complaint in refused(capsys, "compare", BOX, *SMALL, *words)


# Help


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        "render",
        *(
            pytest.param(name, marks=pytest.mark.sweep)
            for name in ("compare", "animate", "figures")
        ),
    ],
)
def test_help_shows_neither_empty_flags_nor_empty_defaults(name, capsys):
    assert ended(name, "--help") == 0
    text = capsys.readouterr().out
    assert "--empty-" not in text
    assert "default: ()" not in text
    assert 'default: ""' not in text
