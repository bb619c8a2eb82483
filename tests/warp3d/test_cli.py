import json
import math
import signal
import struct
import subprocess
import sys
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image

from conftest import real
from resample.files.images import read_channels, read_image
from resample_warp3d import cli
from resample_warp3d.types import Hole
from tests import commands
from tests.commands import store
from tests.intrinsics import write_intrinsics
from tests.processes import PATIENCE

EYE = ["--intrinsics", "20,20,16,12"]
FAST = ["--method", "mcmillan-zbuffer"]
STAY = ["--size", "32x24"]
RIGHT = ["--move", "0.2,0,0"]  # 2 px of the wall at 2, 8 px of nothing
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, with color.png and depth.png.

    A box at 1 stands before a wall at 2, in thousandths; the color is noise.
    """
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(11)
    cv2.imwrite("color.png", rng.integers(0, 256, (24, 32, 3), np.uint8))
    depth = np.full((24, 32), 2000, np.uint16)
    depth[8:16, 12:20] = 1000
    cv2.imwrite("depth.png", depth)
    return tmp_path


def render(*words: object, color: str = "color.png", depth: str = "depth.png") -> list[object]:
    """Words of a command that renders thousandths."""
    scale = ["--depth-scale", 1000] if depth.endswith(".png") else []
    return ["render", color, depth, *EYE, *scale, *words]


def moved(*words: object, **files: str) -> np.ndarray:
    """What `render` makes, in linear light, premultiplied."""
    assert ended(*render(*words, "-o", "out.exr", **files)) == 0
    return read_image("out.exr")


def pose(path: str, x: float = 0.0) -> str:
    """Write a pose of a camera at x."""
    matrix = np.eye(4)
    matrix[0, 3] = -x
    np.savetxt(path, matrix)
    return path


# Pictures in and out


@pytest.mark.sweep
def test_a_picture_that_stays_where_it_is_keeps_every_level():
    assert ended(*render("-o", "out.png", *STAY)) == 0
    written = cv2.imread("out.png", cv2.IMREAD_UNCHANGED)
    assert np.array_equal(written[..., :3], cv2.imread("color.png"))


@pytest.mark.sweep
def test_a_wall_moves_by_its_disparity():
    picture, source = moved(*RIGHT, *FAST), read_image("color.png")
    assert np.allclose(picture[:8, :30, :3], source[:8, 2:], atol=1e-6)  # float32 of levels


@pytest.mark.sweep
def test_what_no_view_shows_is_transparent():
    picture = moved(*RIGHT, *FAST)
    assert picture.shape == (24, 32, 4)
    assert not picture[:, 30:].any()


@pytest.mark.sweep
def test_the_default_method_moves_things_too(record):
    picture, source = moved(*RIGHT), read_image("color.png")
    record.error("mean", np.abs(picture[2:6, 2:28, :3] - source[2:6, 4:30]).mean())


@pytest.mark.sweep
def test_transparency_is_added_once(rng):
    store("in.exr", rng.random((24, 32, 4)), ("R", "G", "B", "A"))
    moved(*RIGHT, *FAST, color="in.exr")
    assert sorted(read_channels("out.exr")) == sorted("RGBA")


@pytest.mark.sweep
def test_any_number_of_channels_stays_that_number(rng):
    store("in.exr", rng.random((24, 32, 6)), tuple("uvwxyz"))
    moved(*STAY, *FAST, "--fill", color="in.exr")
    assert sorted(read_channels("out.exr")) == sorted("uvwxyz")


@pytest.mark.sweep
def test_filled_pictures_are_opaque():
    assert moved(*RIGHT, *FAST, "--fill").shape == (24, 32, 3)
    assert ended(*render(*RIGHT, *FAST, "--fill", "-o", "out.jpg")) == 0


@pytest.mark.sweep
def test_holes_are_filled_by_a_layer_behind_what_hides():
    words = [*RIGHT, "--fill"]
    picture, layer = moved(*words), moved(*words, "--fill-by", "layer")
    assert layer.shape == picture.shape == (24, 32, 3)
    assert not np.array_equal(layer, picture)
    both = [*words, "--view", f"color.png,depth.png,{pose('t.txt', 0.02)}"]
    assert not np.array_equal(moved(*both, "--fill-by", "layer"), moved(*both))
    # A wall hides nothing, so there is no layer.
    cv2.imwrite("flat.png", np.full((24, 32), 2000, np.uint16))
    flat = moved(*words, "--fill-by", "layer", depth="flat.png")
    assert np.array_equal(flat, moved(*words, depth="flat.png"))


def test_a_layer_belongs_to_filling(capsys):
    words = render(*RIGHT, "--fill-by", "layer", "-o", "out.png")
    assert "--fill-by layer belongs to --fill; give both" in refused(capsys, *words)


@pytest.mark.sweep
def test_a_jpeg_is_black_where_nothing_is_or_has_a_background():
    assert ended(*render(*RIGHT, *FAST, "-o", "out.jpg")) == 0
    assert read_image("out.jpg")[:, -1].mean() < 0.1
    assert ended(*render(*RIGHT, *FAST, "-o", "out.jpg", "--background", "white")) == 0
    assert read_image("out.jpg")[:, -1].mean() > 0.9  # JPEG's loss beside noise


@pytest.mark.sweep
def test_a_picture_has_as_many_bits_as_asked_for():
    assert ended(*render(*RIGHT, *FAST, "-o", "out.png", "--bits", 16)) == 0
    assert cv2.imread("out.png", cv2.IMREAD_UNCHANGED).dtype == np.uint16


@pytest.mark.sweep
@pytest.mark.parametrize("method", ["hybrid", "mcmillan-zbuffer"])
def test_labels_are_not_mixed(method, rng):
    labels = rng.integers(1, 7, (24, 32), np.uint16) * 1000 + 7
    cv2.imwrite("names.png", labels)
    words = [*RIGHT, "--unmixed", "--method", method, "-o", "out.png"]
    assert ended(*render(*words, color="names.png")) == 0
    assert set(np.unique(cv2.imread("out.png", -1))) <= {0, *np.unique(labels)}


def test_labels_refuse_what_mixes(capsys):
    words = render(*RIGHT, "--unmixed", "-o", "out.png")
    assert "leave out one of --unmixed and --fill" in refused(capsys, *words, "--fill")
    assert "mesh mixes colors; for labels take hybrid" in refused(
        capsys, *words, "--method", "mesh"
    )


# What is known beside the picture


def test_holes_are_named_by_their_colors():
    assert ended(*render(*RIGHT, *FAST, "-o", "out.png", "--holes", "holes.png")) == 0
    with Image.open("holes.png") as written:
        codes, colors = np.array(written), np.array(written.convert("RGBA"))
    assert codes[2, 31] == Hole.OUTSIDE
    assert codes[2, 10] == Hole.NONE
    assert Hole.DISOCCLUDED in codes[8:16]
    assert colors[2, 31].tolist() == [128, 128, 128, 255]
    assert colors[codes == Hole.DISOCCLUDED][0].tolist() == [255, 0, 255, 255]
    assert colors[2, 10, 3] == 0


@pytest.mark.sweep
def test_holes_are_told(capsys):
    assert ended(*render(*RIGHT, *FAST, "-o", "out.png")) == 0
    error = capsys.readouterr().err
    assert "% hidden in the source" in error
    assert "% outside the source" in error
    assert "--holes shows them, --fill fills them" in error


@pytest.mark.sweep
@pytest.mark.parametrize("suffix", ["exr", "npy", "png"])
def test_depth_is_written_in_three_forms(suffix):
    name = f"d.{suffix}"
    words = ["--move", "0,0,0.5", *FAST, "--size", "16x12", "-o", "o.png", "--depth-output", name]
    assert ended(*render(*words)) == 0
    if suffix == "png":
        depth = cv2.imread(name, cv2.IMREAD_UNCHANGED) / 1000
    else:
        depth = np.load(name) if suffix == "npy" else read_channels(name)["Z"]
    assert depth[2, 2] == pytest.approx(1.5, abs=1e-3)  # thousandths


def test_coverage_is_a_picture_of_shares():
    assert ended(*render(*RIGHT, *FAST, "-o", "o.png", "--coverage", "c.png")) == 0
    share = cv2.imread("c.png", 0)
    assert (share[0, 5], share[0, 31]) == (255, 0)


@pytest.mark.some(1)
@pytest.mark.parametrize(("name", "kind"), [("m.ply", "mesh"), ("m.glb", "points")])
def test_the_source_is_exported(name, kind):
    words = [*STAY, *FAST, "-o", "o.png", "--export", name, "--export-as", kind]
    assert ended(*render(*words)) == 0
    read = trimesh.load(name)
    assert np.allclose(np.abs(read.bounds[:, 2]), sorted([1, 2], reverse=name == "m.glb"), atol=0.2)


@pytest.mark.sweep
def test_stats_tell_sizes_shares_and_times():
    assert ended(*render(*RIGHT, *FAST, "-o", "out.png", "--stats", "s.json")) == 0
    stats = json.loads(Path("s.json").read_text())
    assert (stats["sources"], stats["size"]) == ([[32, 24]], [32, 24])
    assert 0.5 < stats["covered"] < 1
    assert sum(stats["holes"].values()) == pytest.approx(1, abs=1e-5)
    assert {"read", "prepare", "warp", "write"} == set(stats["seconds"])


# Depth and cameras


def test_every_encoding_of_the_same_depth_gives_the_same_picture():
    z = cv2.imread("depth.png", cv2.IMREAD_UNCHANGED) / 1000.0
    y, x = np.mgrid[:24, :32] + 0.5
    length = np.sqrt(1 + ((x - 16) / 20) ** 2 + ((y - 12) / 20) ** 2)
    forms = {
        "z": (z, []),
        "ray": (z * length, []),
        "inverse": (1 / z, []),
        "disparity": (20 * 0.5 / z - 3, ["--baseline", 0.5, "--doffs", 3]),
    }
    expected = moved(*RIGHT, *FAST)
    for kind, (numbers, more) in forms.items():
        np.save("d.npy", numbers)
        words = [*RIGHT, *FAST, "--depth-kind", kind, *more]
        assert np.array_equal(moved(*words, depth="d.npy"), expected), kind


@pytest.mark.sweep
def test_a_pose_file_and_a_move_say_the_same():
    expected = moved(*RIGHT, *FAST)
    assert np.array_equal(moved("--pose", pose("t.txt", 0.2), *FAST), expected)
    there = ["--source-pose", pose("s.txt", 5), "--pose", pose("t.txt", 5.2)]
    assert np.allclose(moved(*there, *FAST), expected, atol=1e-5)  # sums of larger numbers


@pytest.mark.sweep
def test_a_field_of_view_stands_for_intrinsics():
    focal = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, *FAST]
    assert ended(*focal, "--fov", 2 * np.degrees(np.arctan(12 / 20)), "-o", "out.exr") == 0
    assert np.array_equal(read_image("out.exr"), moved(*RIGHT, *FAST))


@pytest.mark.sweep
def test_opencvs_convention_counts_from_pixel_centers():
    words = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, *FAST]
    opencv = ["--intrinsics", "20,20,15.5,11.5", "--convention", "opencv", "-o", "out.exr"]
    assert ended(*words, *opencv) == 0
    assert np.array_equal(read_image("out.exr"), moved(*RIGHT, *FAST))


@pytest.mark.sweep
def test_another_size_shows_the_same_view():
    assert moved(*FAST, "--size", "16x12").shape[:2] == (12, 16)
    half = moved(*FAST, "--size", "16x12", "--target-intrinsics", "10,10,8,6")
    assert np.array_equal(half, moved(*FAST, "--size", "16x12"))


@pytest.mark.sweep
def test_a_lens_bends_the_picture():
    words = [
        "render",
        "color.png",
        "depth.png",
        "--depth-scale",
        1000,
        *FAST,
        *STAY,
        "-o",
        "out.exr",
    ]
    bent = []
    for lens in ("20,20,15.5,11.5,0,0,0,0", "20,20,15.5,11.5,-0.2,0.05,0,0"):
        assert ended(*words, "--lens", lens) == 0
        bent.append(read_image("out.exr"))
    assert np.array_equal(bent[0], moved(*FAST, *STAY))
    assert not np.array_equal(bent[1], bent[0])


def test_coefficients_of_a_lens_go_with_intrinsics_from_elsewhere():
    plain = moved(*FAST, *STAY)
    bent = moved(*FAST, *STAY, "--lens", "k=-0.2,0.05,0,0")
    assert not np.array_equal(bent, plain)
    assert np.array_equal(moved(*FAST, *STAY, "--lens", "k=0,0,0,0"), plain)


@pytest.mark.sweep
def test_further_views_cover_more():
    words = ["--move", "0.4,0,0", *FAST]
    one = moved(*words)
    both = moved(*words, "--view", f"color.png,depth.png,{pose('t.txt', 0.4)}")
    assert one[..., 3].mean() < 0.95
    assert both[..., 3].mean() == pytest.approx(1)


@pytest.mark.sweep
def test_statistics_say_how_views_were_matched():
    bright = np.minimum(cv2.imread("color.png") // 2 + 60, 255)
    cv2.imwrite("bright.png", bright)
    words = ["--move", "0.1,0,0", *FAST, "-o", "out.png", "--stats", "stats.json"]
    view = ["--view", f"bright.png,depth.png,{pose('t.txt')}"]
    assert ended(*render(*words, *view)) == 0
    matched = json.loads(Path("stats.json").read_text())["views"]
    assert [each["depth_factor"] for each in matched] == [1, 1]
    assert len(matched[0]["gain"]) == len(matched[0]["bias"]) == 3
    assert ended(*render(*words, *view, "--plain")) == 0
    plain = json.loads(Path("stats.json").read_text())["views"]
    assert [each["gain"] for each in plain] == [[1, 1, 1], [1, 1, 1]]
    assert ended(*render(*words)) == 0
    assert "views" not in json.loads(Path("stats.json").read_text())


def test_several_views_of_labels_are_not_mixed(rng):
    labels = rng.integers(1, 7, (24, 32), np.uint16) * 1000 + 7
    cv2.imwrite("names.png", labels)
    cv2.imwrite("other.png", labels + 7000)
    view = ["--view", f"other.png,depth.png,{pose('t.txt', 0.4)}"]
    assert ended(*render(*RIGHT, "--unmixed", *view, "-o", "out.png", color="names.png")) == 0
    known = {0, *np.unique(labels), *np.unique(labels + 7000)}
    assert set(np.unique(cv2.imread("out.png", -1))) <= known


@pytest.mark.sweep
def test_the_number_of_threads_changes_no_pixel():
    assert np.array_equal(moved(*RIGHT), moved(*RIGHT, "--threads", 1))


def test_a_doubtful_scale_is_said(capsys):
    words = ["render", "color.png", "depth.png", *EYE, *FAST, "-o", "out.png", *STAY]
    assert ended(*words, "--depth-scale", 0.5) == 0
    assert "check the depth's scale" in capsys.readouterr().err


def test_looking_away_is_said(capsys):
    assert ended(*render("--turn", "180,0,0", "-o", "out.png", *FAST)) == 0
    assert "no part of the source is in view" in capsys.readouterr().err


def test_colors_that_are_no_numbers_are_holes(capsys):
    values = np.ones((24, 32, 3), np.float32)
    values[3, 4] = np.nan
    store("gap.exr", values, ("R", "G", "B"))
    picture = moved(*STAY, *FAST, color="gap.exr")
    assert picture[3, 4, 3] == 0
    assert np.isfinite(picture).all()
    assert "1 pixels have colors that are not numbers" in capsys.readouterr().err


def test_pictures_of_one_pixel_are_rendered():
    cv2.imwrite("dot.png", np.full((1, 1, 3), 99, np.uint8))
    cv2.imwrite("dot-depth.png", np.full((1, 1), 2000, np.uint16))
    words = ["render", "dot.png", "dot-depth.png", "--depth-scale", 1000, "--fov", 60]
    assert ended(*words, "--size", "1", "-o", "out.png") == 0
    assert cv2.imread("out.png").tolist() == [[[99, 99, 99]]]


# Bad input


@pytest.mark.some(12)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "give a viewpoint: --pose FILE, or --move x,y,z"),
        (["--move", "1,2"], "move '1,2'; give 3 numbers"),
        (["--turn", "a,b,c"], "turn 'a,b,c'; give 3 numbers"),
        ([*RIGHT, "--pose", "none.txt"], "none.txt"),
        ([*RIGHT, "--size", "0"], "both sides must be at least 1"),
        ([*RIGHT, "--target-intrinsics", "1,2,3"], "give fx,fy,cx,cy"),
        ([*RIGHT, "--lens", "1,1,0,0,1,2,3,4"], "not both"),
        ([*RIGHT, "--lens", "k=1,2,3"], "4, 5, 8, 12"),
        ([*RIGHT, "--fov", "60"], "give one of --intrinsics and --fov"),
        ([*RIGHT, "--method", "magic"], "unknown warp 'magic'"),
        ([*RIGHT, "--noise", "-1"], "greater than or equal to 0"),
        ([*RIGHT, "--threads", "0"], "greater than or equal to 1"),
        ([*RIGHT, "--depth-kind", "disparity"], "disparity needs --baseline"),
        ([*RIGHT, "--near", "1"], "--near belongs to --depth-kind inverse"),
        ([*RIGHT, "--depth-kind", "inverse", "--near", "1"], "needs near and far"),
        ([*RIGHT, "--view", "a.png,b.png"], "give COLOR,DEPTH,POSE"),
        ([*RIGHT, "--view", "a.png,b.png,c.txt"], "a.png: there is no such file"),
        ([*RIGHT, "--background", "mud"], "give none, #rrggbb or a color's name"),
        ([*RIGHT, "--bits", "32"], ".png has 8 or 16 bits per channel, not 32"),
        ([*RIGHT, "--holes", "h.jpg"], "holes are written as .png"),
        ([*RIGHT, "--depth-output", "d.jpg"], "depth is written as .exr, .npy or .png"),
        ([*RIGHT, "--export", "m.obj"], "written as .ply or .glb"),
        ([*RIGHT, "--coverage", "./out.png"], "cannot be written twice"),
        ([*RIGHT, "--stats", "none/s.json"], "cannot be written"),
    ],
)
def test_a_bad_choice_is_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, *render("-o", "out.png", *words))


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["out.gif", "out", "none/out.png", "folder.png"])
def test_an_output_that_cannot_be_written_is_found_before_any_work(name, monkeypatch, capsys):
    Path("folder.png").mkdir()
    monkeypatch.setattr("resample_warp3d.command.inputs.read_view", None)
    assert name in refused(capsys, *render(*RIGHT, "-o", name))


@pytest.mark.sweep
def test_intrinsics_are_asked_for(capsys):
    words = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, "-o", "out.png"]
    assert "give --intrinsics fx,fy,cx,cy or a --lens, or --fov 60 if they are unknown" in refused(
        capsys, *words
    )
    assert "singular" in refused(capsys, *words, "--intrinsics", "0,20,16,12")


@pytest.mark.sweep
def test_whole_numbers_need_their_scale(capsys):
    words = ["render", "color.png", "depth.png", *EYE, *RIGHT, "-o", "out.png"]
    assert "needs its scale" in refused(capsys, *words)


def test_a_size_mismatch_names_both(capsys):
    cv2.imwrite("small.png", np.full((10, 12), 1000, np.uint16))
    error = refused(capsys, *render(*RIGHT, "-o", "out.png", depth="small.png"))
    assert "color.png has 32 x 24 pixels, small.png has 12 x 10" in error


def test_a_file_without_any_depth_is_one_line(capsys):
    cv2.imwrite("none.png", np.zeros((24, 32), np.uint16))
    error = refused(capsys, *render(*RIGHT, "-o", "out.png", depth="none.png"))
    assert "none.png has no depth at all" in error


@pytest.mark.sweep
def test_poses_that_are_none_say_how_far_they_are_off(capsys):
    np.savetxt("scaled.txt", np.diag([2.0, 2, 2, 1]))
    error = refused(capsys, *render("--pose", "scaled.txt", "-o", "out.png"))
    assert "scaled.txt" in error
    assert "not orthonormal: R Rᵀ is off by up to 3" in error


@pytest.mark.sweep
@pytest.mark.parametrize("which", ["color", "depth"])
def test_damaged_files_are_one_line(which, capsys):
    data = Path(f"{which}.png").read_bytes()
    Path("cut.png").write_bytes(data[: len(data) // 2])
    Path("text.png").write_text("no picture")
    Path("empty.png").write_bytes(b"")
    for name in ("cut.png", "text.png", "empty.png", "gone.png"):
        words = render(*RIGHT, "-o", "out.png", **{which: name})
        assert name in refused(capsys, *words)


def test_a_target_larger_than_the_memory_is_refused_before_any_work(monkeypatch, capsys):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 30)
    monkeypatch.setattr("resample_warp3d.command.rendering.sourced", None)
    error = refused(capsys, *render(*RIGHT, "-o", "out.png", "--size", "8000x8000"))
    assert "a picture of 8000 x 8000 pixels needs" in error


# Stereo


def rectified() -> None:
    """Write disparity.npy: a wall at 2 px and a box at 6 px."""
    disparity = np.full((24, 32), 2.0, np.float32)
    disparity[8:16, 12:20] = 6
    np.save("disparity.npy", disparity)


def shifted(*words: object) -> np.ndarray:
    assert ended("stereo", "color.png", "disparity.npy", "-o", "out.exr", *FAST, *words) == 0
    return read_image("out.exr")


def test_things_are_further_left_in_the_right_picture():
    rectified()
    source, right = read_image("color.png"), shifted()
    assert np.allclose(right[:8, :30, :3], source[:8, 2:], atol=1e-6)  # float32 of levels
    assert np.allclose(right[8:16, 6:14, :3], source[8:16, 12:20], atol=1e-6)


@pytest.mark.sweep
def test_the_right_picture_leads_to_the_left_one():
    rectified()
    source, left = read_image("color.png"), shifted("--eyes", "left")
    assert np.allclose(left[:8, 2:, :3], source[:8, :30], atol=1e-6)
    assert np.array_equal(left, shifted("--fraction", "-1"))
    assert np.array_equal(left, shifted("--from", "right"))


@pytest.mark.sweep
def test_half_of_the_way_is_half_of_the_disparity():
    rectified()
    source = read_image("color.png")
    assert np.allclose(shifted("--fraction", 0.5)[:8, :31, :3], source[:8, 1:], atol=1e-6)


@pytest.mark.sweep
def test_stereo_writes_holes_and_fills_them():
    rectified()
    shifted("--holes", "holes.png", "--coverage", "c.png")
    with Image.open("holes.png") as holes:
        assert (np.array(holes)[:8, 30:] == Hole.OUTSIDE).all()
    filled = shifted("--fill")
    assert filled.shape[2] == 3
    assert not np.array_equal(shifted("--fill", "--fill-by", "layer"), filled)


@pytest.mark.sweep
def test_stereo_refuses_a_missing_depth_in_one_line(capsys):
    assert "none.png" in refused(capsys, "stereo", "color.png", "none.png", "-o", "out.png")


@pytest.mark.sweep
@pytest.mark.slow
def test_the_readmes_stereo_command_runs():
    cones = real("depth/middlebury2003_cones")
    words = [str(cones / "im2.png"), str(cones / "disp2.png"), "--disparity-scale", "4"]
    assert ended("stereo", *words, "-o", "right.png", "--fill") == 0
    made, truth = read_image("right.png"), read_image(cones / "im6.png")
    error = np.sqrt(np.mean((made - truth) ** 2))
    assert error < 0.08  # exposure, and what had to be made up


# Animations


def film(*words: object, frames: int = 3) -> list[object]:
    depth = ["depth.png", "--depth-scale", 1000]
    return ["animate", "color.png", *depth, *EYE, *FAST, "--frames", frames, *words]


@pytest.mark.sweep
def test_a_film_is_filled_by_a_layer():
    for name, words in (("picture", ["--fill"]), ("layer", ["--fill", "--fill-by", "layer"])):
        assert ended(*film("-o", name, *words)) == 0
    frames = [sorted(Path(name).glob("*.png")) for name in ("picture", "layer")]
    pairs = [[cv2.imread(str(file)) for file in pair] for pair in zip(*frames, strict=True)]
    assert len(pairs) == 3
    assert not all(np.array_equal(*pair) for pair in pairs)


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["a.mp4", "a.webp", "a.gif", "a.apng", "frames"])
def test_animate_writes_every_form(name):
    assert ended(*film("-o", name)) == 0
    assert {path.name for path in Path().iterdir()} == {"color.png", "depth.png", name}
    if name == "frames":
        assert len(list(Path(name).glob("frame-*.png"))) == 3


@pytest.mark.sweep
@pytest.mark.parametrize("path", ["orbit", "dolly"])
def test_paths_differ(path):
    for name, words in (("a", []), ("b", ["--path", path])):
        assert ended(*film("-o", name, *words)) == 0
    assert Path("a/frame-0001.png").read_bytes() != Path("b/frame-0001.png").read_bytes()


@pytest.mark.sweep
def test_a_file_of_poses_is_followed():
    np.savetxt("poses.txt", np.concatenate([np.eye(4)] * 2))
    words = ["animate", "color.png", "depth.png", *EYE, "--depth-scale", 1000, "-o", "frames"]
    assert ended(*words, "--path", "poses.txt", *FAST) == 0
    assert len(list(Path("frames").glob("frame-*.png"))) == 2
    still = cv2.imread("frames/frame-0001.png")
    assert np.array_equal(still, cv2.imread("color.png"))


@pytest.mark.sweep
def test_a_run_goes_on_where_it_ended():
    assert ended(*film("-o", "frames")) == 0
    kept = Path("frames/frame-0000.png").stat().st_mtime_ns
    whole = Path("frames/frame-0002.png").read_bytes()
    Path("frames/frame-0002.png").unlink()
    assert ended(*film("-o", "frames", "--resume")) == 0
    assert Path("frames/frame-0000.png").stat().st_mtime_ns == kept
    assert Path("frames/frame-0002.png").read_bytes() == whole


@pytest.mark.sweep
@pytest.mark.parametrize(
    "words", [["--amount", 0.2], ["--size", 16], ["--fill"], ["--background", "red"]]
)
def test_another_job_is_not_gone_on_with(words, capsys):
    assert ended(*film("-o", "frames")) == 0
    error = refused(capsys, *film("-o", "frames", "--resume", *words))
    assert "frames of another animation" in error


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "a.avi"], "animations are written as .mp4, .webp, .gif, .apng or a folder"),
        (["-o", "none/a.mp4"], "cannot be written"),
        (["-o", "a.gif", "--fps", "0"], "0 frames per second"),
        (["-o", "a.gif", "--path", "walk"], "known: sway, orbit, dolly, or a file of poses"),
        (["-o", "a.gif", "--path", "walk.txt"], "walk.txt"),
        (["-o", "a.gif", "--amount", "0"], "greater than 0"),
        (["-o", "a.gif", "--size", "0"], "at least 1"),
    ],
)
def test_animate_refuses_in_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, *film(*words))


def test_a_number_of_frames_is_checked(capsys):
    assert "0 frames; 1 to 10000" in refused(capsys, *film("-o", "a.gif", frames=0))


KILLED = """
import os, signal, sys
from resample_warp3d.command import rendering
whole = rendering.on_screen
made = []

def killing(*arguments, **choices):
    if len(made) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    made.append(1)
    return whole(*arguments, **choices)

rendering.on_screen = killing
from resample_warp3d.cli import main
main()
"""


@pytest.mark.sweep
@pytest.mark.slow
def test_a_killed_run_is_gone_on_with():
    words = [str(word) for word in film("-o", "a.gif")]
    killed = subprocess.run([sys.executable, "-c", KILLED, *words], check=False, timeout=PATIENCE)
    assert killed.returncode == -signal.SIGKILL
    assert not Path("a.gif").exists()
    assert len(list(Path(".a.gif.frames").glob("frame-*.png"))) == 2
    assert ended(*words, "--resume") == 0
    with Image.open("a.gif") as animation:
        assert animation.n_frames == 3
    assert sorted(path.name for path in Path().iterdir()) == ["a.gif", "color.png", "depth.png"]


# Comparisons, figures and the demo

METHODS = ["--methods", "mcmillan-zbuffer,mcmillan"]


@pytest.mark.sweep
def test_methods_are_compared_in_the_generated_scene(capsys):
    words = ["--size", "48", "--views", "side, in3", "-o", "sheet.png"]
    assert ended("compare", "--scene", "generated", *METHODS, *words) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split()[:3] == ["view", "method", "psnr"]
    assert [row.split()[:2] for row in rows] == [
        [view, method] for view in ("side", "in3") for method in METHODS[1].split(",")
    ]
    assert Path("sheet.png").stat().st_size > 1000


def test_methods_are_compared_with_a_true_picture(capsys, record):
    assert ended(*render(*RIGHT, *FAST, "--background", "black", "-o", "true.png")) == 0
    capsys.readouterr()
    words = ["compare", "color.png", "depth.png", *EYE, "--depth-scale", 1000, *RIGHT, *METHODS]
    assert ended(*words, "--truth", "true.png", "--json") == 0
    first, _ = json.loads(capsys.readouterr().out)
    # Of 8 bits of its own picture; JSON has no infinity.
    record.quality("picture", math.inf if first["psnr"] is None else first["psnr"])


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--methods", "magic"], "unknown warp 'magic'"),
        (["--methods", ""], "give methods to compare"),
        (["--views", "above"], "unknown view 'above'; known: side"),
        (["--scene", "sea"], "Choose from"),
        (["--size", "0"], "at least 1"),
        (["-o", "sheet.jpg"], "contact sheets are written as .png"),
        (["-o", "none/sheet.png"], "cannot be written"),
        (["color.png", "depth.png"], "give COLOR, DEPTH and --truth"),
        (["color.png", "depth.png", "--scene", "generated"], "takes no files"),
        (["--truth", "color.png"], "takes no files"),
    ],
)
def test_compare_refuses_in_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "compare", *words)


@pytest.mark.sweep
def test_figures_write_a_sheet_the_pictures_and_the_numbers(capsys):
    assert ended("figures", "-o", "deep/figures", "--size", "48", *METHODS) == 0
    written = {path.name for path in Path("deep/figures").iterdir()}
    assert {"figure-6.png", "figure-6.json", "reference.png", "mcmillan-zoom.png"} <= written
    assert "mcmillan-zbuffer" in capsys.readouterr().out


def test_figures_take_ones_own_pictures(capsys):
    words = ["figures", "color.png", "depth.png", *EYE, "--depth-scale", 1000, *RIGHT]
    assert ended(*words, "-o", "figures", *METHODS) == 0
    assert Path("figures/figure-6.png").is_file()
    assert "hole %" in capsys.readouterr().out
    assert "give COLOR and DEPTH" in refused(capsys, "figures", "color.png", "-o", "figures")


@pytest.mark.sweep
def test_figures_refine_depth_as_they_are_told():
    pictures = []
    for refine in ("none", "sharpen"):
        words = ["figures", "color.png", "depth.png", *EYE, "--depth-scale", 1000, *RIGHT]
        assert ended(*words, "--refine", refine, "-o", refine, "--methods", "hybrid,mcmillan") == 0
        pictures.append(Path(refine, "hybrid.png").read_bytes())
    assert pictures[0] != pictures[1]


@pytest.mark.sweep
@pytest.mark.slow
def test_the_demo_says_where_its_pictures_are(folder, monkeypatch, capsys):
    monkeypatch.setitem(cli.DEMO, "sway.gif", cli.DEMO["sway.gif"].replace("24", "2"))
    assert ended("demo", "-o", "demo") == 0
    assert capsys.readouterr().out == f"The pictures are in {folder / 'demo'}\n"
    assert set(cli.DEMO) == {path.name for path in Path("demo").iterdir()}


# Pixel filters


@pytest.mark.sweep
def test_a_filter_blurs_or_sharpens_what_is_rendered():
    usual = moved(*RIGHT)
    given = moved(*RIGHT, "--filter", "gaussian:sigma=0.6")
    inner = slice(2, 6), slice(4, 24)
    assert given[inner][..., :3].std() < 0.8 * usual[inner][..., :3].std()
    np.testing.assert_array_equal(moved(*RIGHT, "--filter", "area"), usual)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--filter", "gausian"], "gaussian"),
        (["--filter", "tent", *FAST], "copies samples to whole pixels"),
        (["--filter", "tent", "--unmixed"], "leave out one of --unmixed and --filter"),
    ],
)
def test_filters_that_cannot_be_are_refused(words, message, capsys):
    assert message in refused(capsys, *render(*RIGHT, *words, "-o", "out.png"))


# Depth that does not fit


@pytest.mark.sweep
def test_what_was_done_about_depth_stands_in_the_statistics():
    moved(*RIGHT, *FAST, "--stats", "stats.json")
    (refined,) = json.loads(Path("stats.json").read_text())["refine"]
    assert refined["chosen"] == "none"
    assert (refined["unknown"], refined["enlargement"], refined["confidence"]) == (0.0, 1, 1.0)


def test_depth_of_half_the_size_is_brought_to_the_picture(capsys):
    cv2.imwrite("half.png", cv2.imread("depth.png", cv2.IMREAD_UNCHANGED)[::2, ::2])
    picture = moved(*RIGHT, *FAST, "--stats", "stats.json", depth="half.png")
    (refined,) = json.loads(Path("stats.json").read_text())["refine"]
    assert picture.shape == (24, 32, 4)
    assert refined["chosen"] == "snap"
    assert "--refine none keeps it unchanged" in capsys.readouterr().err


def test_refining_is_switched_off_by_one_option(capsys):
    cv2.imwrite("half.png", np.full((12, 16), 2000, np.uint16))
    picture = moved(*RIGHT, *FAST, "--refine", "none", depth="half.png")
    assert "edges moved" not in capsys.readouterr().err
    assert np.allclose(picture[:, :30, :3], read_image("color.png")[:, 2:], atol=1e-6)


def test_a_refining_that_is_none_names_the_known_ones(capsys):
    error = refused(capsys, *render(*RIGHT, "-o", "out.png", "--refine", "blur"))
    assert "snap" in error
    assert "sharpen" in error


def test_a_depth_camera_beside_the_pictures_is_brought_to_it():
    depth = np.full((24, 32), 2000, np.uint16)
    depth[8:16, 12:20] = 1000
    cv2.imwrite("beside.png", np.roll(depth, -4, axis=1))  # of the box; the wall moves by 2
    words = ["--depth-intrinsics", "20,20,16,12", "--depth-pose", pose("beside.txt", 0.2)]
    moved(*STAY, "--refine", "none", *words, "--depth-output", "z.npy", depth="beside.png")
    found = np.load("z.npy")
    assert np.allclose(found[9:15, 13:19], 1, rtol=1e-3)
    assert np.allclose(found[:6, 4:], 2, rtol=1e-3)
    assert np.isinf(found[:, :1]).all()


@pytest.mark.sweep
def test_what_a_depth_camera_beside_the_picture_does_not_see_is_filled(capsys):
    depth = np.full((24, 32), 2000, np.uint16)
    depth[8:16, 12:20] = 1000
    cv2.imwrite("color.png", np.repeat(depth[..., None] / 10, 3, axis=2).astype(np.uint8))
    cv2.imwrite("beside.png", np.roll(depth, -4, axis=1))  # of the box; the wall moves by 2
    words = ["--depth-intrinsics", "20,20,16,12", "--depth-pose", pose("beside.txt", 0.2)]
    moved(*STAY, *words, "--depth-output", "z.npy", depth="beside.png")
    assert "depth: small gaps filled" in capsys.readouterr().err
    found = np.load("z.npy")[:, 2:]  # the picture's left border is beyond the depth camera's
    np.testing.assert_allclose(found, depth[:, 2:] / 1000, rtol=1e-3)


@pytest.mark.sweep
def test_depth_of_every_fourth_row_is_interpolated_and_the_command_says_so(capsys):
    depth = np.full((24, 32), 2000, np.uint16)
    depth[:, 12:20] = 1000
    cv2.imwrite("color.png", np.repeat(depth[..., None] / 10, 3, axis=2).astype(np.uint8))
    rows = np.zeros_like(depth)
    rows[1::4] = depth[1::4]
    cv2.imwrite("rows.png", rows)
    moved(*STAY, "--depth-output", "z.npy", depth="rows.png")
    assert "sparse samples interpolated" in capsys.readouterr().err
    np.testing.assert_allclose(np.load("z.npy"), depth / 1000, rtol=1e-3)


def test_a_depth_pose_needs_its_intrinsics(capsys):
    error = refused(capsys, *render(*RIGHT, "-o", "out.png", "--depth-pose", pose("at.txt")))
    assert "--depth-pose belongs to --depth-intrinsics" in error


def test_depth_of_its_own_camera_is_not_brought_through_a_lens(capsys):
    eye = ["--lens", "20,20,16,12,-0.1,0,0,0", "--depth-scale", "1000", "--move", "0.1,0,0"]
    words = ["render", "color.png", "depth.png", *eye, "--depth-intrinsics", "20,20,16,12"]
    assert "a picture without a lens" in refused(capsys, *words, "-o", "out.png")


# Models of COLMAP


def colmap() -> None:
    """A dense workspace: two pictures 0.2 apart, the second's camera of an unknown model, depth."""
    one = struct.pack("<IiQQ4d", 1, 1, 32, 24, 20, 20, 16, 12)  # PINHOLE
    two = struct.pack("<IiQQ5d", 2, 7, 32, 24, 20, 20, 16, 12, 0.5)  # FOV
    Path("cameras.bin").write_bytes(struct.pack("<Q", 2) + one + two)
    rows = [(1, 0.0, b"color.png"), (2, -0.2, b"right.png")]
    pictures = [
        struct.pack("<I7dI", n, 1, 0, 0, 0, x, 0, 0, n) + name + bytes(9) for n, x, name in rows
    ]
    Path("images.bin").write_bytes(struct.pack("<Q", 2) + b"".join(pictures))
    depth = cv2.imread("depth.png", cv2.IMREAD_UNCHANGED).astype("<f4") / 1000
    Path("color.png.geometric.bin").write_bytes(b"32&24&1&" + depth.tobytes())


@pytest.mark.sweep
def test_a_model_of_colmap_brings_cameras_and_depth():
    colmap()
    words = ["--source-pose", "images.bin:color.png", "--pose", "images.bin:right.png", *FAST]
    arguments = ["render", "color.png", "color.png.geometric.bin", *words, "-o", "model.exr"]
    assert ended(*arguments) == 0
    assert np.array_equal(read_image("model.exr"), moved(*RIGHT, *FAST))


@pytest.mark.sweep
def test_a_camera_of_an_unknown_model_needs_intrinsics(capsys):
    colmap()
    words = [
        *("render", "color.png", "color.png.geometric.bin", "--source-pose", "images.bin:right"),
        *("--move", "0,0,0", *FAST, "-o", "out.png"),
    ]
    line = refused(capsys, *words)
    assert "cameras.bin: camera 2: COLMAP's model 'FOV' is not known" in line
    assert ended(*words, *EYE) == 0


def test_a_film_along_a_file_says_which_poses_it_leaves_out(capsys):
    lines = [f"{n} {0.1 * n} 0 0 0 0 0 1" for n in range(3)]
    Path("way.txt").write_text("\n".join([*lines, "3 0 0 0 0 0 0 0"]))
    words = ["--path", "way.txt", "-o", "film", *FAST]
    assert ended("animate", "color.png", "depth.png", "--depth-scale", "1000", *EYE, *words) == 0
    assert len(list(Path("film").glob("*.png"))) == 3
    assert "1 of 4 cameras are left out: way.txt: line 4: the quaternion" in capsys.readouterr().err


# Intrinsics of files


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["open3d.json", "ros.yaml", "opencv.yml"])
def test_intrinsics_of_a_file_are_their_numbers(name):
    write_intrinsics()
    words = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, *FAST]
    expected = moved(*RIGHT, *FAST)
    assert ended(*words, "--intrinsics", name, "-o", "file.exr") == 0
    assert np.array_equal(read_image("file.exr"), expected)
    assert ended(*words, *EYE, "--target-intrinsics", name, "-o", "target.exr") == 0
    assert np.array_equal(read_image("target.exr"), expected)
    for own, output in (("20,20,16,12", "numbers.exr"), (name, "depth.exr")):
        assert ended(*words, *EYE, "--depth-intrinsics", own, "-o", output) == 0
    assert np.array_equal(read_image("depth.exr"), read_image("numbers.exr"))


@pytest.mark.sweep
def test_intrinsics_of_a_file_are_fitted_to_the_picture(capsys):
    write_intrinsics(64, 48)
    words = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, *FAST]
    half = ["--intrinsics", "10,10,8,6"]
    assert ended(*words, *half, "-o", "half.exr") == 0
    for option in ("--intrinsics", "--lens"):
        assert ended(*words, option, "open3d.json", "-o", "file.exr") == 0
        assert np.array_equal(read_image("file.exr"), read_image("half.exr"))
    write_intrinsics(64, 64)
    capsys.readouterr()  # what was said of the others
    line = refused(capsys, *words, "--intrinsics", "ros.yaml", "-o", "no.png")
    assert "64 x 64 pixels do not fit a picture of 32 x 24" in line


def test_a_lens_of_a_file_bends_as_its_numbers_do(capsys):
    write_intrinsics()
    bent = Path("ros.yaml").read_text().replace("D: [0, 0, 0, 0, 0]", "D: [0.2, 0, 0, 0, 0]")
    Path("ros.yaml").write_text(bent)
    words = ["render", "color.png", "depth.png", "--depth-scale", 1000, *RIGHT, *FAST]
    assert ended(*words, "--lens", "20,20,15.5,11.5,0.2,0,0,0", "-o", "numbers.exr") == 0
    for option in ("--intrinsics", "--lens"):
        assert ended(*words, option, "ros.yaml", "-o", "file.exr") == 0
        assert np.array_equal(read_image("file.exr"), read_image("numbers.exr"))
    capsys.readouterr()  # what was said of these
    line = refused(capsys, *words, *EYE, "--target-intrinsics", "ros.yaml", "-o", "no.png")
    assert "ros.yaml has a lens; give it as --target-lens" in line


@pytest.mark.some(1)
@pytest.mark.parametrize("option", ["--intrinsics", "--lens", "--target-intrinsics"])
def test_files_that_hold_no_intrinsics_are_one_line(option, capsys):
    Path("bad.yaml").write_text("K: [1, 2")
    eye = EYE if option == "--target-intrinsics" else []
    for name, complaint in (
        ("bad.yaml", "did not find expected ',' or ']'"),
        ("no.json", "there is no such"),
    ):
        words = [*eye, *RIGHT, option, name, "-o", "no.png"]
        line = refused(capsys, "render", "color.png", "depth.png", "--depth-scale", 1000, *words)
        assert f"{name}: " in line
        assert complaint in line
