import gzip
import json
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from resample.command.session import libraries
from resample.files.images import read_channels, read_image
from resample_volume import classification as names
from resample_volume import cli
from resample_volume.classification import TISSUES
from resample_volume.classification.presets import PRESETS
from resample_volume.classification.value_statistics import POINTS
from resample_volume.files.source import open_volume
from tests import commands

BOX = "checker-box:size=16,block=4"
TREE = "vessel-tree:size=24"
SMALL = ["--size", "32"]
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)

NRRD = """NRRD0004
type: uint8
dimension: {dimension}
sizes: {sizes}
spacings: {spacings}
encoding: {encoding}
{more}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rendered(*words: object, volume: str = BOX) -> np.ndarray:
    """Premultiplied RGBA (32, 32, 4) that `render` writes."""
    assert ended("render", volume, "-o", "out.exr", *SMALL, *words) == 0
    return read_image("out.exr")


@cache
def usual(*words: str, volume: str = BOX) -> np.ndarray:
    """The same picture, that others are compared with, made once."""
    return rendered(*words, volume=volume)


def nrrd(data: bytes, **changes: str) -> None:
    """Write `bad.nrrd`, a volume of 4 × 4 × 4 voxels if its header is not changed."""
    header = {"dimension": "3", "sizes": "4 4 4", "spacings": "1 1 1", "encoding": "raw"}
    lines = NRRD.format(**{**header, "more": "", **changes}).strip()
    Path("bad.nrrd").write_bytes(lines.encode() + b"\n\n" + data)


# Pictures


@pytest.mark.sweep
def test_a_png_has_8_or_16_bits_and_no_transparency():
    for bits, kind in ((8, b"\x08\x02"), (16, b"\x10\x02")):  # IHDR: depth, color type RGB
        assert ended("render", BOX, "-o", "box.png", *SMALL, "--bits", bits) == 0
        assert Path("box.png").read_bytes()[24:26] == kind
    assert read_image("box.png").shape == (32, 32, 3)
    assert read_image("box.png").max() > 0.05


@pytest.mark.sweep
def test_width_comes_before_height():
    assert ended("render", BOX, "-o", "box.png", "--size", "40x24") == 0
    assert read_image("box.png").shape == (24, 40, 3)


@pytest.mark.sweep
def test_an_exr_holds_linear_color_depth_and_coverage():
    assert ended("render", BOX, "-o", "box.exr", *SMALL) == 0
    channels = read_channels("box.exr")
    assert {"R", "G", "B", "A", "Z", "coverage"} <= set(channels)
    seen = channels["A"] > 0.5
    assert seen.any()
    assert np.isfinite(channels["Z"][seen]).all()
    assert np.isinf(channels["Z"][0, 0])
    assert channels["A"][0, 0] == channels["coverage"][0, 0] == 0
    assert channels["coverage"].max() <= 1 + 1e-6


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("words", "corner"),
    [
        ([], [0, 0, 0]),
        (["--background", "white"], [1, 1, 1]),
        (["--background", "#ff0000"], [1, 0, 0]),
        (["--background", "none"], [0, 0, 0, 0]),
    ],
)
def test_the_background_is_behind_the_volume(words, corner):
    assert ended("render", BOX, "-o", "box.png", *SMALL, *words) == 0
    assert read_image("box.png")[0, 0].tolist() == corner


@pytest.mark.sweep
def test_suffixes_are_known_in_capitals():
    assert ended("render", BOX, "-o", "BOX.PNG", *SMALL) == 0
    assert read_image("BOX.PNG").shape == (32, 32, 3)


@pytest.mark.sweep
def test_names_may_hold_spaces_and_any_letter():
    Path("Bilder für Ωmega").mkdir()
    assert ended("generate", BOX, "-o", "Bilder für Ωmega/ein Würfel.nrrd") == 0
    picture = "Bilder für Ωmega/das Bild.png"
    assert ended("render", "Bilder für Ωmega/ein Würfel.nrrd", "-o", picture, *SMALL) == 0
    assert read_image(picture).max() > 0.05


@pytest.mark.sweep
def test_a_picture_is_replaced_whole():
    Path("box.png").write_text("what was there")
    assert ended("render", BOX, "-o", "box.png", *SMALL) == 0
    assert read_image("box.png").shape == (32, 32, 3)
    assert [path.name for path in Path().iterdir()] == ["box.png"]


# Statistics


@pytest.mark.sweep
def test_stats_count_every_sample_and_time_every_stage():
    words = (*SMALL, "--classify", "pre", "--stats", "s.json")
    assert ended("render", BOX, "-o", "box.png", *words) == 0
    stats = json.loads(Path("s.json").read_text())
    assert (stats["classify"], stats["samples"], stats["rays"]) == ("pre", 16**3, 0)
    assert stats["points"] + stats["splats"] == stats["samples"]
    assert stats["splat_fraction"] == pytest.approx(stats["splats"] / stats["samples"])
    assert 0 <= stats["hidden"] <= stats["samples"]
    assert {"read", "classify", "shade", "paint", "write"} == set(stats["seconds"])
    assert all(seconds >= 0 for seconds in stats["seconds"].values())


@pytest.mark.sweep
@pytest.mark.parametrize(("primitive", "fraction"), [("points", 0.0), ("splats", 1.0)])
def test_stats_tell_points_from_splats(primitive, fraction):
    words = ["-o", "box.png", *SMALL, "--stats", "s.json", "--method", primitive]
    assert ended("render", BOX, *words) == 0
    assert json.loads(Path("s.json").read_text())["splat_fraction"] == fraction


@pytest.mark.sweep
def test_stats_of_nothing_are_valid_json():
    Path("none.toml").write_text('points = [{ value = 0, color = "red", opacity = 0 }]')
    words = ["-o", "box.png", *SMALL, "--stats", "s.json", "--transfer", "none.toml"]
    assert ended("render", BOX, *words) == 0
    assert json.loads(Path("s.json").read_text())["splat_fraction"] == 0


# Choices and their effect


@pytest.mark.sweep
def test_splats_are_red_when_colored_by_primitive():
    red = rendered("--color-by", "primitive", "--method", "splats")
    seen = red[red[..., 3] > 0.5]
    assert np.all(seen[:, 0] > 10 * seen[:, 1])
    points = ["--method", "points"]
    assert np.array_equal(rendered("--color-by", "primitive", *points), rendered(*points))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "words",
    [
        ["--method", "points"],
        ["--method", "splats"],
        ["--method", "paper"],
        ["--threshold", "100"],
        ["--subpixels", "1"],
        ["--filter", "gaussian:sigma=0.7"],
        pytest.param(["--kernel", "bspline"], marks=pytest.mark.sweep),
        ["--kernel", "gaussian:sigma=0.9"],
        pytest.param(["--opacity", "linear"], marks=pytest.mark.sweep),
        ["--transfer", "gray:opacity=0.3"],
        ["--opacity-unit", "5"],
        ["--camera", "60/20/1"],
        ["--camera", "30/20/1.3"],
        ["--fov", "60"],
        ["--fov", "0"],
        ["--up", "y"],
        ["--no-shading"],
        ["--light", "1/0/0"],
        ["--gradient", "sobel"],
        ["--gradient-opacity", "0.1/0.5"],
        ["--spacing", "1x1x2"],
    ],
)
def test_every_choice_changes_the_picture(words):
    from_afar = () if "--camera" in words else ("--camera", "30/20/1")
    before, after = usual(*from_afar, volume=TREE), rendered(*from_afar, *words, volume=TREE)
    assert before.shape == after.shape
    assert np.abs(before - after).max() > 1e-3


@pytest.mark.sweep
@pytest.mark.parametrize("footprint", ["corrected", "projected", "affine"])
def test_footprints_differ_where_perspective_is_strong(footprint):
    near = ["--method", "splats", "--fov", "90", "--camera", "30/20/1.5"]
    assert np.abs(usual(*near) - rendered(*near, "--footprint", footprint)).max() > 1e-4


@pytest.mark.sweep
def test_exact_is_the_footprint_and_every_sample_the_order_if_none_is_chosen():
    chosen = rendered("--footprint", "exact", "--order", "every-sample", "--kernel", "gaussian")
    assert np.array_equal(rendered("--classify", "pre"), chosen)


@pytest.mark.sweep
def test_an_orders_parameter_is_used():
    points = ["--method", "points"]
    thick = rendered(*points, "--order", "every-sample:thickness=8")
    assert np.abs(rendered(*points) - thick).max() > 1e-3


@pytest.mark.sweep
@pytest.mark.parametrize("count", [1, 2, 99])
def test_the_number_of_threads_changes_no_pixel(count):
    assert np.array_equal(rendered(), rendered("--threads", count))


@pytest.mark.sweep
def test_a_camera_file_of_angles_is_the_camera_of_these_angles():
    Path("c.toml").write_text("azimuth = 50\nelevation = -10\nzoom = 0.8\nfov = 40\n")
    by_file = rendered("--camera", "c.toml")
    assert np.array_equal(by_file, rendered("--camera", "50/-10/0.8", "--fov", "40"))


@pytest.mark.sweep
def test_the_three_forms_of_a_camera_file_agree():
    # At 64 from the middle of the box, straight from the front; 32 px wide.
    focal = 16 / np.tan(np.radians(15))
    Path("look.toml").write_text("eye = [7.5, -56.5, 7.5]\ntarget = [7.5, 7.5, 7.5]\nfov = 30\n")
    Path("sized.toml").write_text(Path("look.toml").read_text() + "width = 32\nheight = 32\n")
    Path("fx.toml").write_text(
        f"fx = {focal}\nfy = {focal}\ncx = 16\ncy = 16\nworld_to_camera = "
        "[[1, 0, 0, -7.5], [0, 0, -1, 7.5], [0, 1, 0, 56.5]]\n"
    )
    look, sized, calibrated = (
        rendered("--camera", f"{name}.toml") for name in ("look", "sized", "fx")
    )
    assert look[..., 3].max() > 0.9
    assert np.array_equal(look, sized)
    assert np.abs(look - calibrated).max() < 1e-4  # float32 positions


# Defined pictures


@pytest.mark.sweep
@pytest.mark.parametrize("output", ["out.png", "out.exr"])
def test_an_invisible_volume_is_an_empty_picture_and_a_line(output, capsys):
    Path("none.toml").write_text('points = [{ value = 0, color = "red", opacity = 0 }]')
    assert ended("render", BOX, "-o", output, *SMALL, "--transfer", "none.toml") == 0
    assert not read_image(output).any()
    error = capsys.readouterr().err
    assert "nothing to see: all voxels are transparent, missing or cut away" in error
    assert error.count("\n") == 1


@pytest.mark.sweep
@pytest.mark.parametrize("primitive", ["hybrid", "points", "splats", "paper"])
def test_a_camera_inside_the_volume_sees_it_from_within(primitive):
    Path("in.toml").write_text("eye = [7.5, 7.5, 7.5]\ntarget = [7.5, 20, 7.5]\nfov = 60\n")
    picture = rendered("--camera", "in.toml", "--method", primitive)
    assert np.isfinite(picture).all()
    assert picture[..., 3].min() > 0.9


@pytest.mark.sweep
def test_a_camera_that_looks_away_sees_nothing():
    Path("away.toml").write_text("eye = [7.5, -60, 7.5]\ntarget = [7.5, -90, 7.5]\n")
    assert not rendered("--camera", "away.toml").any()


@pytest.mark.sweep
def test_values_that_are_not_finite_are_defined():
    values = np.full((8, 8, 8), np.nan, np.float32)
    np.save("nan.npy", values)
    assert not rendered(volume="nan.npy").any()
    values[2:6] = 1.0
    values[4, 4, 4] = np.inf
    values[5, 4, 4] = -np.inf
    np.save("some.npy", values)
    picture = rendered("--transfer", "gray", volume="some.npy")
    assert np.isfinite(picture).all()


@pytest.mark.sweep
def test_a_volume_of_one_value_is_seen():
    np.save("even.npy", np.full((8, 8, 8), 3, np.int16))
    assert rendered(volume="even.npy")[..., 3].max() > 0.5


# Bad input


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--method", "dots"], "'hybrid', 'points', 'splats', 'paper', 'inflate' or 'ewa'"),
        (["--footprint", "round"], "'affine', 'equation' or 'projected'"),
        (["--filter", "sinc"], "known filters: area, box, catmull-rom, gaussian,"),
        (["--kernel", "cone"], "known reconstructions: bspline, gaussian"),
        (["--order", "random"], "known orders: axis-sheets, every-sample, image-sheets"),
        (["--transfer", "cheese"], "known: bone, vessels, engine, lobster,"),
        (["--transfer", "none.toml"], "none.toml: No such file"),
        (["--transfer", "gray:opacity=2"], "opacity must be between 0 and 1"),
        (["--filter", "gaussian:sigma=-1"], "sigma is a positive number of pixels, not -1"),
        (["--filter", "gaussian:sigma=wide"], "sigma is a number, not 'wide'"),
        (["--filter", "gaussian:width=2"], "there is no parameter 'width'"),
        (["--order", "every-sample:thickness=0"], "must be above 0 voxels"),
        (["--kernel", "gaussian:radius=0"], "must be above 0"),
        (["--camera", "leftish"], "give azimuth,elevation,zoom"),
        (["--camera", "1/2/3/4"], "give azimuth,elevation,zoom"),
        (["--camera", "nan/0"], "must be finite"),
        (["--camera", "30/20/0"], "a zoom of 0; it must be above 0"),
        (["--camera", "30/20/-1"], "it must be above 0"),
        (["--camera", "30/20/inf"], "a zoom of inf"),
        (["--camera", "none.toml"], "none.toml: No such file"),
        (["--fov", "180"], "a field of view of 180.0 degrees; 0 to below 180"),
        (["--fov", "-1"], "0 to below 180"),
        (["--fov", "nan"], "0 to below 180"),
        (["--fov", "wide"], "wide"),
        (["--up", "w"], "'-x', '-y' or '-z'"),
        (["--threshold", "-1"], "greater than or equal to 0"),
        (["--threshold", "nan"], "greater than or equal to 0"),
        (["--subpixels", "33"], "less than or equal to 32"),
        (["--opacity-unit", "0"], "greater than"),
        (["--opacity-unit", "inf"], "finite"),
        (["--background", "nonsense"], "give none, #rrggbb or a color's name"),
        (["--bits", "12"], "8, 16 or 32"),
        (["--threads", "0"], "greater than or equal to 1"),
        (["--light", "0/0/0"], "must not be of length 0"),
        (["--light", "sun"], "light 'sun'; give 3 numbers as a,b,c"),
        (["--gradient-opacity", "0.5"], "give 2 numbers as a,b"),
        (["--gradient-opacity", "0.5/0.1"], "ascend from 0"),
        (["--reader", "foo"], "known readers: bioio, cube, dicom"),
        (["--spacing", "0x1x1"], "three positive numbers"),
        (["--spacing=-1x1x1"], "three positive numbers"),
        (["--spacing", "1x1"], "three positive numbers"),
        (["--colour-by", "primitive"], "--color-by"),
    ],
)
def test_a_bad_choice_is_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "render", BOX, "-o", "out.png", *SMALL, *words)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("size", "complaint"),
    [
        ("0", "a picture of 0 x 0 pixels; both sides must be at least 1"),
        ("0x40", "a picture of 0 x 40 pixels; both sides"),
        ("1000000", "there can be at most"),
        ("20000", "there can be at most"),
        ("x", "size 'x'; give 400 or 640x480"),
        ("40x", "give 400 or 640x480"),
        ("-4", "give 400 or 640x480"),
        ("1e2", "give 400 or 640x480"),
    ],
)
def test_a_size_that_is_none_is_refused_before_any_work(size, complaint, monkeypatch, capsys):
    monkeypatch.setattr("resample_volume.command.inputs.open_volume", None)
    assert complaint in refused(capsys, "render", BOX, "-o", "out.png", f"--size={size}")


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("azimuth = ", "c.toml: Invalid value"),
        ("azimut = 3", "azimut: Extra inputs are not permitted"),
        ('azimuth = "left"', "azimuth: Input should be a valid number"),
        ('up = "w"', "c.toml: up is 'w'"),
        ("fov = 180", "c.toml: a field of view of 180"),
        ("zoom = 0", "c.toml: a zoom of 0"),
        ("elevation = nan", "elevation: Input should be a finite number"),
        ("eye = [0, 0]\ntarget = [1, 1, 1]", "eye: List should have at least 3 items"),
        ("eye = [0, 0, 0]", "target: Field required"),
        ("eye = [1, 1, 1]\ntarget = [1, 1, 1]", "cannot look at"),
        ("eye = [0, 0, 0]\ntarget = [1, 1, 1]\nfov = 0", "not between 0 and 180"),
        ("eye = [0, 0, 0]\ntarget = [1, 1, 1]\nnear = -1", "must not lie behind the eye"),
        ("eye = [0, 0, 0]\ntarget = [1, 1, 1]\nwidth = 0", "width: Input should be greater than 0"),
        ("eye = [0, 0, 0]\ntarget = [1, 1, 1]\nwidth = 32", "give width and height, or neither"),
        ("fx = 1\nfy = 1\ncx = 0\ncy = 0", "world_to_camera: Field required"),
        (
            "fx = 1\nfy = 1\ncx = 0\ncy = 0\n"
            "world_to_camera = [[1, 0, 0, 0], [0, 1, 0], [0, 0, 1]]",
            "world_to_camera.1: List should have at least 4 items",
        ),
        (
            "fx = 1\nfy = 1\ncx = 0\ncy = 0\n"
            "world_to_camera = [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]",
            "rotation is not orthonormal",
        ),
        (
            "fx = 0\nfy = 1\ncx = 0\ncy = 0\n"
            "world_to_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]",
            "neither can be 0",
        ),
    ],
)
def test_a_bad_camera_file_is_one_line_that_names_it(content, complaint, capsys):
    Path("c.toml").write_text(content)
    error = refused(capsys, "render", BOX, "-o", "out.png", *SMALL, "--camera", "c.toml")
    assert "c.toml: " in error
    assert complaint in error


def test_a_camera_file_that_is_no_text_is_one_line(capsys):
    Path("c.toml").write_bytes(b"\xff\xfe\x00")
    assert "c.toml: " in refused(capsys, "render", BOX, "-o", "out.png", "--camera", "c.toml")


RAW = ["--shape", "4x4x4", "--dtype", "uint8"]


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("size", "words", "complaint"),
    [
        (63, RAW, "bad.raw"),
        (65, RAW, "bad.raw"),
        (0, RAW, "bad.raw"),
        (64, ["--shape", "4x4x4"], "give shape and dtype"),
        (64, ["--dtype", "uint8"], "give shape and dtype"),
        (64, [], "give shape and dtype"),
        (64, ["--shape", "4x16", "--dtype", "uint8"], "three positive numbers"),
        (64, ["--shape", "0x4x4", "--dtype", "uint8"], "three positive numbers"),
        (64, ["--shape", "4x4x4", "--dtype", "foo"], "not 'foo'"),
        (64, ["--shape", "1x8x8", "--dtype", "uint8"], "single slice"),
        (64, ["--shape", "9999999x9999999x9", "--dtype", "uint8"], "bytes"),
        (64, [*RAW, "--reader", "nrrd"], "shape and dtype are for raw files"),
    ],
)
def test_a_bad_raw_file_is_one_line(size, words, complaint, capsys):
    Path("bad.raw").write_bytes(bytes(size))
    assert complaint in refused(capsys, "render", "bad.raw", "-o", "out.png", *SMALL, *words)


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("data", "changes"),
    [
        (bytes(63), {}),  # truncated
        (bytes(64), {"sizes": "4 4 5"}),  # header and data do not fit
        (gzip.compress(bytes(64), mtime=0)[:-12], {"encoding": "gzip"}),
        (b"no gzip at all", {"encoding": "gzip"}),
        (bytes(16), {"dimension": "2", "sizes": "4 4", "spacings": "1 1"}),
        (bytes(16), {"sizes": "4 4 1"}),
        (b"", {"sizes": "4 4 0"}),
        (bytes(64), {"spacings": "1 0 1"}),
        (bytes(64), {"spacings": "1 -1 1"}),
        (
            bytes(64),
            {
                "spacings": "nan nan nan",
                "more": "space: left-posterior-superior\nspace directions: (1,0,0) (1,0,0) (0,0,1)",
            },
        ),
    ],
)
@pytest.mark.parametrize("command", [["render", "bad.nrrd", "-o", "out.png"], ["info", "bad.nrrd"]])
def test_a_damaged_file_is_one_line(data, changes, command, capsys):
    nrrd(data, **changes)
    assert "bad" in refused(capsys, *command)


@pytest.mark.sweep
def test_a_missing_unknown_or_empty_source_is_one_line(capsys):
    Path("folder").mkdir()
    Path("notes.txt").write_text("no volume")
    Path("empty.nrrd").write_bytes(b"")
    for name, complaint in (
        ("", "the volume has no name"),
        ("nonsense", "generated volumes are checker-box"),
        ("none.nrrd", "there is no such file"),
        ("notes.txt", "has no known suffix"),
        ("folder", "holds no slices"),
        ("empty.nrrd", "empty.nrrd is empty"),
        ("checker-box:size=1", "size is at least 2 voxels"),
        ("checker-box:color=1", "checker-box takes size=100, block=10"),
    ):
        assert complaint in refused(capsys, "render", name, "-o", "out.png", *SMALL)


def test_a_picture_larger_than_the_memory_is_refused_before_any_work(monkeypatch, capsys):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 30)
    monkeypatch.setattr("resample_volume.command.inputs.open_volume", None)
    error = refused(capsys, "render", BOX, "-o", "out.png", "--size", "4000")
    needed = f"{(libraries() + 80 * 4000**2) / (1 << 30):.2f}"
    assert f"needs about {needed} GiB of memory, 1.00 GiB are free; take a smaller size" in error


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "out.gif"], "pictures are written as .png, .exr, .jpg"),
        (["-o", "out"], "pictures are written as .png, .exr, .jpg"),
        (["-o", "none/out.png"], "cannot be written: No such file or directory"),
        (["-o", "folder.png"], "is not a regular file"),
        (["-o", "notes.txt/out.png"], "cannot be written"),
        (["-o", "out.png", "--stats", "none/s.json"], "cannot be written: No such file"),
        (["-o", "out.png", "--stats", "folder.png"], "is not a regular file"),
        (["-o", "out.png", "--stats", "./out.png"], "cannot be written twice"),
        ([], "needs --output"),
    ],
)
def test_an_output_that_cannot_be_written_is_found_before_any_work(
    words, complaint, monkeypatch, capsys
):
    Path("folder.png").mkdir()
    Path("notes.txt").write_text("keep me")
    monkeypatch.setattr("resample_volume.command.inputs.open_volume", None)
    assert complaint in refused(capsys, "render", BOX, *SMALL, *words)


def test_trying_an_output_does_not_touch_what_is_there(capsys):
    Path("out.png").write_text("keep me")
    refused(capsys, "render", "none.nrrd", "-o", "out.png")
    assert Path("out.png").read_text() == "keep me"


# The other commands


@pytest.mark.sweep
def test_compare_prints_a_row_for_each_primitive(capsys):
    words = ["--methods", "points, splats,hybrid", "--size", "24", "--rays", "2"]
    assert ended("compare", BOX, *words) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split()[:3] == ["picture", "psnr", "ssim"]
    assert [row.split()[0] for row in rows] == ["points", "splats", "hybrid"]
    assert all(float(row.split()[1]) > 20 for row in rows)


def test_compare_gives_json_and_a_sheet(capsys):
    words = ["--methods", "splats", "--footprints", "exact,affine", "--size", "24", "--rays", "2"]
    assert ended("compare", BOX, *words, "--json", "-o", "sheet.png") == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["picture"] for row in rows] == ["splats exact", "splats affine"]
    assert {"psnr", "ssim", "ms", "splats"} <= set(rows[0])
    assert read_image("sheet.png").shape[1] > 3 * 192


@pytest.mark.some(4)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--methods", "points,dots"], "method 'dots'; known: hybrid, points, splats, paper"),
        (["--methods", ""], "give a method to compare; known: hybrid"),
        (["--footprints", "round"], "footprint 'round'; known: affine, corrected"),
        (["--rays", "0"], "0 rays per side of a pixel; 1 to 32 are allowed"),
        (["--rays", "33"], "1 to 32 are allowed"),
        (["--size", "0"], "both sides must be at least 1"),
        (["-o", "sheet.jpg"], "contact sheets are written as .png"),
        (["-o", "none/sheet.png"], "cannot be written"),
    ],
)
def test_compare_refuses_before_any_work(words, complaint, monkeypatch, capsys):
    monkeypatch.setattr("resample_volume.command.inputs.open_volume", None)
    assert complaint in refused(capsys, "compare", BOX, *words)


def test_info_tells_shape_spacing_range_and_histogram(capsys):
    assert ended("info", BOX, "--bins", "2", "--spacing", "1x1x2.5") == 0
    lines = capsys.readouterr().out.splitlines()
    facts = dict(line.split(maxsplit=1) for line in lines[:9])
    assert facts["shape"] == "(16, 16, 16)"
    assert facts["spacing"] == "[1.0, 1.0, 2.5]"
    assert facts["range"] == "(64, 192)"
    bars = lines[lines.index("values from   voxels; logarithmic bars") + 1 :]
    assert [line.split()[0] for line in bars] == ["64", "128"]
    assert sum(int(line.split()[2]) for line in bars) == 16**3


def test_info_shows_structure_and_suggests_thresholds(rng, capsys):
    values = np.where(rng.random((20, 20, 20)) < 0.01, 900.0, 100.0)
    values += rng.normal(0, 5, values.shape)
    values[0] = -32768
    np.save("a.npy", values.astype(np.int16))
    assert ended("info", "a.npy") == 0
    text = capsys.readouterr().out
    facts = dict(line.split("  ", 1) for line in text.splitlines() if "  " in line)
    assert facts["padding"].strip() == "[-32768.0]"
    assert 150 < float(facts["2 classes"]) < 850
    assert "400 voxels of -32768 are taken for padding and left out" in text
    bars = [line for line in text.splitlines() if "#" in line]
    assert max(line.count("#") for line in bars) == 40  # of thousands of voxels
    assert 15 < bars[-1].count("#") < 40  # of tens, which bars of equal shares would hide
    assert sum("between 2" in line for line in text.splitlines()) == 1


@pytest.mark.sweep
def test_presets_are_named_by_the_help(capsys):
    assert ended("render", "--help") == 0
    text = "".join(word for word in capsys.readouterr().out.split() if word != "│")
    for name in (*PRESETS, *TISSUES):
        assert name in text


def test_names_for_the_help_are_those_that_are_there():
    assert tuple(PRESETS) == names.PRESETS
    assert tuple(POINTS) == names.TISSUES


@pytest.mark.sweep
def test_classification_shows_that_it_goes_on(monkeypatch):
    shown = []

    @contextmanager
    def watched(what):
        shown.append(what)
        yield

    monkeypatch.setattr("resample.command.session.progress_bar", watched)
    assert ended("render", BOX, "-o", "box.png", *SMALL) == 0
    assert shown == ["classifying", "shading"]


def test_info_gives_json(capsys):
    np.save("a.npy", np.full((3, 4, 5), np.nan, np.float32))
    assert ended("info", "a.npy", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["shape"] == [5, 4, 3]
    assert (facts["range"], facts["nan"]) == (None, 60)


def test_info_refuses_in_one_line(capsys):
    assert "at least 1 bin" in refused(capsys, "info", BOX, "--bins", "0")


def test_generate_writes_what_is_read_back(capsys):
    assert ended("generate", BOX, "-o", "box.nii.gz") == 0
    assert np.array_equal(open_volume("box.nii.gz").values, open_volume(BOX).values)
    assert [path.name for path in Path().iterdir()] == ["box.nii.gz"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "output", "complaint"),
    [
        (BOX, "box.foo", "volumes are written as .nrrd"),
        (BOX, "none/box.nrrd", "cannot be written"),
        ("box", "box.nrrd", "generated are checker-box"),
    ],
)
def test_generate_refuses_in_one_line(name, output, complaint, capsys):
    assert complaint in refused(capsys, "generate", name, "-o", output)


def test_fetch_without_a_name_lists_the_volumes(capsys):
    assert ended("fetch") == 0
    assert "\nengine  " in capsys.readouterr().out


def test_fetch_of_an_unknown_name_lists_the_known(capsys):
    assert "unknown volume 'motor'; known are aneurism," in refused(capsys, "fetch", "motor")


def test_the_demo_renders_volumes_and_says_where(folder, monkeypatch, capsys):
    monkeypatch.delitem(cli.DEMO, "vessel-tree.png")
    assert ended("demo", "-o", "deep/demo") == 0
    out, error = capsys.readouterr()
    assert out == f"The pictures are in {folder / 'deep/demo'}\n"
    assert "resample-volume render checker-box --camera" in error
    assert read_image(Path("deep/demo/checker-box.png")).shape == (400, 400, 3)
