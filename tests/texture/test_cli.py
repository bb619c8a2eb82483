import json
import zlib
from functools import partial
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO
import pytest
from PIL import Image

from resample.command.session import libraries
from resample.files.images import read_channels, read_image
from resample_texture import cli
from resample_texture.command import rendering
from resample_texture.command.choices import PictureWarping
from tests import commands
from tests.commands import store

HALF = ["--matrix", "0.5,0,0,0,0.5,0"]
SAME = ["--matrix", "1,0,0,0,1,0"]
LENS = "20,20,12,8,0.1,0.01,0,0"
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


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


def warped(*words: object, image: str = "photo.png") -> np.ndarray:
    """What `warp` makes of a picture, in linear light, premultiplied."""
    assert ended("warp", image, "-o", "out.exr", *words) == 0
    picture = read_image("out.exr")
    return picture if picture.shape[2] == 4 else np.dstack([picture, np.ones_like(picture[..., 0])])


# Pictures in and out


def test_the_identity_keeps_every_level_of_8_bits(photo):
    assert ended("warp", "photo.png", "-o", "out.png", *SAME) == 0
    kept = cv2.imread("out.png", cv2.IMREAD_UNCHANGED)
    assert np.array_equal(kept[..., ::-1], photo)


@pytest.mark.parametrize("words", [[], ["--no-linear"]])
def test_the_identity_keeps_every_level_of_16_bits(words, rng):
    levels = rng.integers(0, 65536, (16, 24), np.uint16)
    cv2.imwrite("deep.png", levels)
    assert ended("warp", "deep.png", "-o", "out.png", *SAME, "--edge", "clamp", *words) == 0
    assert np.array_equal(cv2.imread("out.png", cv2.IMREAD_UNCHANGED), levels)


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", ["exr", "tif"])
@pytest.mark.parametrize("words", [[], ["--no-linear"]])
def test_floats_go_through_no_curve(suffix, words, rng):
    values = rng.normal(0.5, 3.0, (8, 10, 3)).astype(np.float32)
    store(f"in.{suffix}", values)
    assert ended("warp", f"in.{suffix}", "-o", f"out.{suffix}", *SAME, *words) == 0
    stored = np.stack([read_channels(f"out.{suffix}")[name] for name in "RGB"], axis=2)
    assert np.array_equal(stored, values)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("names", "written"),
    [(("Y",), "YA"), (("R", "G", "B"), "RGBA"), (("R", "G", "B", "A"), "RGBA"), (("Y", "A"), "YA")],
)
def test_transparency_is_added_once(names, written, rng):
    store("in.exr", rng.random((8, 10, len(names))), names)
    assert ended("warp", "in.exr", "-o", "out.exr", *HALF) == 0
    assert sorted(read_channels("out.exr")) == sorted(written)


def test_beyond_the_source_a_picture_is_transparent():
    picture = warped(*HALF)
    assert picture.shape == (16, 24, 4)
    assert picture[:8, :12, 3].min() > 1 - 1e-4
    assert np.abs(picture[8:]).max() < 1e-4  # float32 sums of float32 places


def test_any_number_of_channels_stays_that_number(rng):
    store("in.exr", rng.random((8, 10, 6)), tuple("uvwxyz"))
    assert ended("warp", "in.exr", "-o", "out.exr", *SAME, "--edge", "clamp") == 0
    before, after = read_channels("in.exr"), read_channels("out.exr")
    assert sorted(after) == sorted("uvwxyz")
    assert all(np.array_equal(before[name], after[name]) for name in after)


def test_gray_stays_gray_unless_the_background_has_a_color(rng):
    cv2.imwrite("gray.png", rng.integers(0, 256, (8, 8), np.uint8))
    for color, channels in (("white", 1), ("#808080", 1), ("red", 3)):
        assert ended("warp", "gray.png", "-o", "out.png", *HALF, "--background", color) == 0
        assert read_image("out.png").shape == (8, 8, channels)


def test_the_background_is_behind_the_picture():
    assert ended("warp", "photo.png", "-o", "out.png", *HALF, "--background", "#ff0000") == 0
    assert read_image("out.png")[-1, -1].tolist() == [1, 0, 0]


def test_a_jpeg_is_black_or_as_the_background_where_nothing_is(capsys):
    assert ended("warp", "photo.png", "-o", "out.jpg", *HALF) == 0
    assert capsys.readouterr().err == ""
    assert read_image("out.jpg")[-1, -1] == pytest.approx([0, 0, 0], abs=0.02)  # JPEG's loss
    assert ended("warp", "photo.png", "-o", "out.jpg", *HALF, "--background", "white") == 0
    assert read_image("out.jpg")[-1, -1] == pytest.approx([1, 1, 1], abs=0.02)  # JPEG's loss


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("suffix", "bits", "kind"),
    [("png", 8, "uint8"), ("png", 16, "uint16"), ("tif", 16, "uint16"), ("tif", 32, "float")],
)
def test_a_picture_has_as_many_bits_as_asked_for(suffix, bits, kind):
    assert ended("warp", "photo.png", "-o", f"out.{suffix}", *HALF, "--bits", bits) == 0
    assert str(OpenImageIO.ImageInput.open(f"out.{suffix}").spec().format) == kind


@pytest.mark.sweep
def test_coverage_is_a_picture_of_shares_and_no_light():
    quarter = ["--matrix", "0.5,0,0,0,0.5,0", "--size", "13x9"]
    shifted = ["--matrix", "0.5,0,0.25,0,0.5,0.25", *quarter[2:]]
    for name in ("c.png", "c.exr"):
        assert ended("warp", "photo.png", "-o", "o.png", *shifted, "--coverage", name) == 0
        share = next(iter(read_channels(name).values()))
        assert share[0, 5] == pytest.approx(0.75, abs=0.005)  # 8 bits hold it to 0.002
        assert share[4, 5] == pytest.approx(1, abs=1e-6)


@pytest.mark.sweep
def test_color_does_not_bleed_out_of_what_is_transparent():
    levels = np.zeros((8, 8, 4), np.uint8)
    levels[:, :4] = (0, 0, 255, 255)  # red; the rest is transparent green
    levels[:, 4:] = (0, 255, 0, 0)
    cv2.imwrite("half.png", levels)
    for words in ([], ["--no-linear"]):
        picture = warped("--matrix", "2.3,0,0,0,2.3,0", *words, image="half.png")
        assert picture[..., 0].max() > 0.99
        assert not picture[..., 1].any()


@pytest.mark.sweep
def test_not_linear_means_the_mean_of_the_encoded_values():
    cv2.imwrite("lines.png", np.tile(np.uint8([[0], [255]]), (8, 16)))
    for words, level in (([], 188), (["--no-linear"], 128)):
        command = ["warp", "lines.png", "-o", "out.png", *HALF, "--edge", "clamp", *words]
        assert ended(*command) == 0
        assert abs(int(cv2.imread("out.png", 0)[4, 4]) - level) <= 1  # 127.5 rounds either way


def test_a_total_keeps_its_sum(rng):
    values = rng.random((8, 10, 1))
    store("flux.exr", values, ("Y",))
    assert ended("warp", "flux.exr", "-o", "out.exr", *HALF, "--total") == 0
    assert read_channels("out.exr")["Y"].sum() == pytest.approx(values.sum(), rel=1e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", ["palette", "palette with alpha", "bits", "gray and alpha"])
def test_every_kind_of_png_is_read(kind, rng):
    levels = rng.integers(0, 256, (8, 10, 4), np.uint8)
    pictures = {
        "palette": Image.fromarray(levels[..., :3]).quantize(8),
        "palette with alpha": Image.fromarray(levels).quantize(8),
        "bits": Image.fromarray(levels[..., 0]).convert("1"),
        "gray and alpha": Image.fromarray(np.ascontiguousarray(levels[..., :2])),
    }
    pictures[kind].save("in.png")
    assert ended("warp", "in.png", "-o", "out.png", *SAME) == 0
    before = np.array(pictures[kind].convert("RGBA")).astype(int)
    with Image.open("out.png") as written:
        after = np.array(written.convert("RGBA")).astype(int)
    opaque = before[..., 3] > 0
    assert np.abs(before - after)[opaque].max() <= 1  # alpha near 0 leaves color few digits


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_cmyk_becomes_rgb(suffix, rng):
    levels = rng.integers(0, 256, (8, 10, 4), np.uint8)
    Image.frombytes("CMYK", (10, 8), levels.tobytes()).save(f"in.{suffix}")
    assert ended("warp", f"in.{suffix}", "-o", "out.png", *SAME) == 0
    assert read_image("out.png").shape == (8, 10, 3)


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", ["exr", "tif"])
@pytest.mark.parametrize("edge", ["transparent", "clamp"])
def test_missing_values_stay_missing(suffix, edge):
    values = np.ones((8, 10, 3), np.float32)
    values[2, 3] = np.nan
    store("gap.exr", values)
    assert ended("warp", "gap.exr", "-o", f"out.{suffix}", *SAME, "--edge", edge) == 0
    kept = read_channels(f"out.{suffix}")
    assert sorted(kept) == sorted("RGB")
    for plane in kept.values():
        assert np.isnan(plane[2, 3])
        there = np.isfinite(plane)
        assert there.sum() >= 75  # neighbours that the gap reaches into
        assert np.allclose(plane[there], 1, atol=1e-5)


def test_of_formats_without_gaps_alpha_tells_what_is_missing():
    values = np.ones((8, 10, 3), np.float32)
    values[2, 3] = np.nan
    store("gap.exr", values)
    assert ended("warp", "gap.exr", "-o", "out.png", *SAME) == 0
    alpha = read_channels("out.png")["A"]
    assert alpha[2, 3] < 0.5
    assert alpha[5, 5] == 1


@pytest.mark.some(1)
@pytest.mark.parametrize("shape", [(16, 24), (16, 24, 3)])
@pytest.mark.parametrize("suffix", ["png", "tif", "jpg"])
def test_where_coverage_is_whole_no_alpha_is_invented(shape, suffix, rng):
    cv2.imwrite("in.png", rng.integers(0, 256, shape, np.uint8))
    inside = ["--matrix", "2,0.1,-9,0,2.1,-8", "--size", "24x16"]
    assert ended("warp", "in.png", "-o", f"out.{suffix}", *inside) == 0
    kept = cv2.imread(f"out.{suffix}", cv2.IMREAD_UNCHANGED)
    assert kept.shape == shape
    assert kept.min() < kept.max()


def test_names_may_hold_spaces_and_any_letter_and_capitals():
    Path("Bilder für Ωmega").mkdir()
    assert ended("warp", "photo.png", "-o", "Bilder für Ωmega/das Bild.PNG", *HALF) == 0
    assert read_image("Bilder für Ωmega/das Bild.PNG").max() > 0.05


def test_a_picture_is_replaced_whole():
    Path("out.png").write_text("what was there")
    assert ended("warp", "photo.png", "-o", "out.png", *HALF) == 0
    assert sorted(path.name for path in Path().iterdir()) == ["out.png", "photo.png"]


def test_stats_tell_sizes_and_times():
    words = [*HALF, "--stats", "s.json", "--size", "12x8"]
    assert ended("warp", "photo.png", "-o", "out.png", *words) == 0
    stats = json.loads(Path("s.json").read_text())
    assert (stats["source"], stats["size"]) == ([24, 16], [12, 8])
    assert {"read", "warp", "write"} == set(stats["seconds"])


# Where pixels go


@pytest.mark.sweep
def test_the_matrix_may_come_from_a_file_and_the_other_way_round():
    Path("m.txt").write_text("# half\n0.5 0 0\n0 0.5 0\n0 0 1\n")
    assert np.array_equal(warped(*HALF), warped("--matrix", "m.txt"))
    assert np.array_equal(warped(*HALF), warped("--matrix", "2,0,0,0,2,0", "--inverse"))


@pytest.mark.sweep
def test_opencvs_convention_counts_from_pixel_centers():
    moved = warped("--matrix", "0.5,0,-0.25,0,0.5,-0.25", "--convention", "opencv")
    assert np.array_equal(warped(*HALF), moved)


@pytest.mark.sweep
def test_corners_say_where_the_pictures_corners_go():
    picture = warped("--corners", "0,0 12,0 12,8 0,8")
    assert picture.shape == (8, 12, 4)
    assert np.allclose(picture, warped(*HALF)[:8, :12], atol=1e-6)  # float32 sums


@pytest.mark.sweep
def test_corners_may_lead_from_points_of_the_source():
    points = "2,2 22,2 22,14 2,14 -> 0,0 20,0 20,12 0,12"
    picture = warped("--corners", points)
    assert np.array_equal(picture, warped("--matrix", "1,0,-2,0,1,-2", "--size", "20x12"))


@pytest.mark.sweep
def test_a_map_says_where_pixels_come_from():
    x, y = np.meshgrid(np.arange(12) * 2 + 1.0, np.arange(8) * 2 + 1.0)
    np.savez("map.npz", x=x, y=y)
    picture = warped("--map", "map.npz")
    assert picture.shape == (8, 12, 4)
    inside = np.s_[1:-1, 1:-1]  # a map says nothing about where its last pixels end
    assert np.allclose(picture[inside], warped(*HALF)[:8, :12][inside], atol=1e-4)


@pytest.mark.sweep
def test_a_flow_moves_pixels():
    np.save("flow.npy", np.full((16, 24, 2), (10 / 3, 7 / 3)))
    # Pixels that texels go to have no limits, and average light at any scale.
    linear = "--interpolation", "area-spline:limit=none", "--no-linear"
    moved = warped("--flow", "flow.npy", *linear)
    shifted = warped("--matrix", "1,0,3.33333333333,0,1,2.33333333333", *linear)
    assert np.allclose(moved[4:, 5:], shifted[4:, 5:], atol=1e-4)


@pytest.mark.sweep
@pytest.mark.parametrize("form", ["numbers", "toml", "json", "yml"])
def test_a_lens_is_numbers_or_a_file(form):
    matrix, bends = [[20.0, 0, 12], [0, 20, 8], [0, 0, 1]], [0.1, 0.01, 0.0, 0.0]
    facts = {"camera_matrix": matrix, "distortion_coefficients": bends}
    Path("l.json").write_text(json.dumps(facts))
    Path("l.toml").write_text("\n".join(f"{name} = {value}" for name, value in facts.items()))
    storage = cv2.FileStorage("l.yml", cv2.FILE_STORAGE_WRITE)
    for name, value in facts.items():
        storage.write(name, np.array(value))
    storage.release()
    given = LENS if form == "numbers" else f"l.{form}"
    assert np.array_equal(warped("--lens", given), warped("--lens", LENS))


@pytest.mark.sweep
def test_a_lens_can_be_put_in_and_taken_out():
    assert not np.array_equal(warped("--lens", LENS), warped("--lens", LENS, "--inverse"))


@pytest.mark.sweep
def test_a_region_is_that_part_of_the_whole():
    part = warped(*HALF, "--roi", "3,2,6,5")
    assert np.allclose(part, warped(*HALF)[2:7, 3:9], atol=1e-6)  # float32 sums


@pytest.mark.sweep
def test_the_number_of_threads_changes_no_pixel():
    assert np.array_equal(warped(*HALF), warped(*HALF, "--threads", 1))


@pytest.mark.sweep
@pytest.mark.parametrize(
    "words",
    [
        ["--method", "bilinear"],
        ["--method", "opencv-supersample:n=2"],
        ["--filter", "gaussian:sigma=0.7"],
        ["--interpolation", "nearest"],
        ["--quality", "4"],
        ["--edge", "wrap"],
    ],
)
def test_every_choice_changes_the_picture(words):
    tilt = ["--corners", "1,2 40,0 36,30 3,17"]
    assert np.abs(warped(*tilt)[..., :3] - warped(*tilt, *words)[..., :3]).max() > 1e-3


# Bad input


@pytest.mark.sweep
@pytest.mark.parametrize("command", ["warp", "rectify", "compare", "animate"])
def test_what_is_no_picture_is_one_line(command, capsys):
    data = Path("photo.png").read_bytes()
    Path("cut.png").write_bytes(data[: len(data) // 2])
    flipped = bytearray(Path("photo.png").read_bytes())
    flipped[60] ^= 255
    Path("corrupt.png").write_bytes(flipped)
    Path("text.png").write_text("no picture")
    Path("notes.txt").write_text("no picture")
    Path("empty.png").write_bytes(b"")
    Path("folder").mkdir()
    words = {
        "warp": [*HALF, "-o", "out.png"],
        "rectify": ["--corners", "1,1 9,1 9,9 1,9", "-o", "out.png"],
        "compare": ["--methods", "bilinear", "-o", "out.png"],
        "animate": ["-o", "out.gif"],
    }[command]
    for name in ("cut.png", "corrupt.png", "text.png", "notes.txt", "empty.png", "folder", "no"):
        assert name in refused(capsys, command, name, *words)


@pytest.mark.sweep
def test_a_picture_larger_than_the_memory_is_refused_before_it_is_read(monkeypatch, capsys):
    cv2.imwrite("large.png", np.zeros((4000, 4000), np.uint8))
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 28)
    monkeypatch.setattr("resample.files.images.PictureFile.strips", None)
    error = refused(capsys, "warp", "large.png", "-o", "out.png", *HALF)
    needed = f"{(libraries() + 60 * 4000**2) / (1 << 30):.2f}"
    assert f"a picture of 4000 x 4000 pixels needs about {needed} GiB of memory, 0.25 GiB" in error


@pytest.mark.parametrize(
    ("method", "libraries_of"), [("lanczos4", lambda: rendering.OTHERS), ("hybrid", libraries)]
)
def test_a_baseline_needs_no_memory_for_kernels(method, libraries_of, monkeypatch):
    needed = {}
    monkeypatch.setattr(rendering, "require", lambda *given: needed.update(given[1]))
    rendering.check_memory((8, 8, 3), (8, 8), PictureWarping(method=method), Path("a.png"))
    assert needed["libraries"] == libraries_of()


def test_a_header_that_claims_too_much_is_one_line(capsys):
    header = bytearray(Path("photo.png").read_bytes())
    header[16:24] = (100_000).to_bytes(4, "big") * 2
    header[29:33] = zlib.crc32(header[12:29]).to_bytes(4, "big")
    Path("bomb.png").write_bytes(header)
    assert "bomb.png" in refused(capsys, "warp", "bomb.png", "-o", "out.png", *HALF)


def test_a_target_larger_than_the_memory_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 30)
    rival = ["--method", "lanczos4"]  # which is not drawn in strips
    words = ["warp", "photo.png", "-o", "out.png", *HALF, "--size", "6000"]
    error = refused(capsys, *words, *rival)
    assert "a picture of 6000 x 6000 pixels needs" in error


@pytest.mark.some(14)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "give one of --matrix, --corners, --map, --flow, --lens, not none"),
        ([*HALF, "--lens", LENS], "not --matrix and --lens"),
        (["--matrix", "1,2,3"], "a matrix has three lines of three"),
        (["--matrix", "0,0,0,0,0,0,0,0,1"], "has no inverse"),
        (["--matrix", "nan,0,0,0,1,0"], "must be finite"),
        (["--matrix", "none.txt"], "neither nine or six numbers nor a file"),
        (["--corners", "1,2,3"], "is not four points"),
        (["--corners", "0,0 1,1 2,2 3,3"], "lie on a line"),
        (["--corners", "0,0 9,0 9,9 0,9 -> 0,0 9,9 9,0 0,9"], "no camera sees"),
        (["--corners", "0,0 9,0 9,9 0,9", "--inverse"], "not to a corners"),
        (["--map", "none.npz"], "none.npz: No such file"),
        (["--map", "small.npy", "--size", "9"], "leave out the size"),
        (["--flow", "small.npy"], "is a flow of 3 x 2 pixels, the picture has 24 x 16"),
        (["--lens", "1,2,3"], "give fx,fy,cx,cy,k1,k2,p1,p2"),
        (["--lens", "none.yml"], "none.yml: there is no such file"),
        (["--lens", "bad.yml"], "bad.yml: line 2: did not find expected ',' or ']'"),
        (["--lens", "bad.json"], "bad.json: "),
        (["--lens", "bare.toml"], "it has none of camera_matrix"),
        ([*HALF, "--size", "0"], "both sides must be at least 1"),
        ([*HALF, "--size", "x"], "give 400 or 640x480"),
        ([*HALF, "--method", "magic"], "unknown method 'magic'"),
        ([*HALF, "--method", "opencv-supersample:n=0"], "opencv-supersample:n=0: "),
        (
            [*HALF, "--method", "oiio", "--filter", "area"],
            "unknown filter 'area'; known are box, triangle",
        ),
        ([*HALF, "--filter", "sinc"], "known filters: area, box,"),
        ([*HALF, "--interpolation", "sinc"], "known interpolations: area-spline, bilinear,"),
        ([*HALF, "--quality", "0.1"], "quality lies between 1 and 16"),
        ([*HALF, "--edge", "fade"], "'transparent', 'clamp', 'wrap' or 'mirror'"),
        ([*HALF, "--roi", "1,2,3"], "give left,top,width,height"),
        ([*HALF, "--roi", "20,0,9,9"], "does not lie within"),
        ([*HALF, "--bits", "7"], "8, 16 or 32"),
        ([*HALF, "--bits", "32"], ".png has 8 or 16 bits per channel, not 32"),
        ([*HALF, "--background", "mud"], "give none, #rrggbb or a color's name"),
        ([*HALF, "--threads", "0"], "greater than or equal to 1"),
        ([*HALF, "--convention", "metric"], "'corner' or 'opencv'"),
    ],
)
def test_a_bad_choice_is_one_line(words, complaint, capsys):
    np.save("small.npy", np.zeros((2, 3, 2)))
    Path("bad.yml").write_text("camera_matrix: [1, 2")
    Path("bad.json").write_text("{")
    Path("bare.toml").write_text("width = 3")
    assert complaint in refused(capsys, "warp", "photo.png", "-o", "out.png", *words)


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "out.gif"], "pictures are written as .png, .exr, .jpg"),
        (["-o", "out"], "pictures are written as"),
        (["-o", "out.jpg", "--background", "none"], "JPEG has no transparency"),
        (["-o", "none/out.png"], "cannot be written: No such file or directory"),
        (["-o", "folder.png"], "is not a regular file"),
        (["-o", "out.png", "--stats", "none/s.json"], "cannot be written: No such file"),
        (["-o", "out.png", "--coverage", "./out.png"], "cannot be written twice"),
        (["-o", "out.png", "--coverage", "c.gif"], "pictures are written as"),
        ([], "give the output after photo.png"),
    ],
)
def test_an_output_that_cannot_be_written_is_found_before_any_work(
    words, complaint, monkeypatch, capsys
):
    Path("folder.png").mkdir()
    monkeypatch.setattr("resample_texture.command.jobs.Job.opened", None)
    assert complaint in refused(capsys, "warp", "photo.png", *HALF, *words)


def test_channels_that_a_format_cannot_hold_are_one_line(rng, capsys):
    store("in.exr", rng.random((8, 10, 6)), tuple("uvwxyz"))
    words = ["warp", "in.exr", *SAME, "--edge", "clamp", "-o"]
    assert "6 channels do not fit into .png" in refused(capsys, *words, "out.png")


# The other commands


def test_rectify_takes_the_corners_in_any_order(photo):
    for corners in ("4,2 20,2 20,14 4,14", "20,14 4,2 4,14 20,2"):
        assert ended("rectify", "photo.png", "--corners", corners, "-o", "page.png") == 0
        assert np.array_equal(cv2.imread("page.png")[..., ::-1], photo[2:14, 4:20])


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--corners", "1,1 2,2 3,3 4,4"], "lie on a line"),
        (["--corners", "0,0 9,0 3,3 0,9"], "do not bound a convex shape"),
        (["--corners", "1,1"], "is not four points"),
        ([], "needs --corners"),
        (["--corners", "4,2 20,2 20,14 4,14", "--size", "0"], "at least 1"),
    ],
)
def test_rectify_refuses_in_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "rectify", "photo.png", "-o", "page.png", *words)


SQUARE = """mtllib {material}
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
{uv}
usemtl skin
f {first}
f {second}
"""
UV = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1"


def square(*, has_uv: bool = True, texture: str = "photo.png") -> None:
    """Write `square.obj`, facing +z."""
    faces = ("1/1 2/2 3/3", "1/1 3/3 4/4") if has_uv else ("1 2 3", "1 3 4")
    text = SQUARE.format(material="s.mtl", uv=UV if has_uv else "", first=faces[0], second=faces[1])
    Path("square.obj").write_text(text)
    Path("s.mtl").write_text(f"newmtl skin\nmap_Kd {texture}\n")


def test_a_mesh_is_shown_with_its_texture():
    square()
    words = ["--camera", "60/20/1", "--size", "40x32", "-o", "mesh.exr"]
    assert ended("mesh", "square.obj", *words) == 0
    channels = read_channels("mesh.exr")
    assert {"R", "G", "B", "A", "Z", "coverage"} <= set(channels)
    assert channels["A"].shape == (32, 40)
    assert 0.05 < channels["A"].mean() < 0.95


@pytest.mark.sweep
@pytest.mark.parametrize(
    "words",
    [
        ["--camera", "60/10/1"],
        ["--fov", "0"],
        ["--up", "z"],
        ["--texture", "blue.png"],
        ["--interpolation", "nearest"],
        ["--filter", "gaussian:sigma=0.8"],
    ],
)
def test_every_choice_changes_the_meshs_picture(words):
    square()
    cv2.imwrite("blue.png", np.full((4, 4, 3), (255, 0, 0), np.uint8))
    pictures = []
    for more in ([], words):
        assert ended("mesh", "square.obj", "--size", "32", "-o", "mesh.exr", *more) == 0
        pictures.append(read_image("mesh.exr"))
    assert np.abs(pictures[0] - pictures[1]).max() > 1e-3


@pytest.mark.some(7)
@pytest.mark.parametrize(
    ("model", "words", "complaint"),
    [
        ("none.obj", [], "none.obj: there is no such file"),
        ("photo.png", [], "photo.png"),
        ("bare.obj", [], "texture"),
        ("square.obj", ["--camera", "leftish"], "give azimuth,elevation,zoom"),
        ("square.obj", ["--camera", "1/2/3/4"], "give azimuth,elevation,zoom"),
        ("square.obj", ["--camera", "0/0/0"], "a zoom of 0; it must be above 0"),
        ("square.obj", ["--fov", "180"], "view of 180.0 degrees; 0 to below 180"),
        ("square.obj", ["--texture", "none.png"], "none.png"),
        ("square.obj", ["--up", "w"], "'-x', '-y' or '-z'"),
        ("lost.obj", [], "gone.png"),
    ],
)
def test_mesh_refuses_in_one_line(model, words, complaint, capsys):
    square(has_uv=False)
    Path("square.obj").rename("bare.obj")
    Path("l.mtl").write_text("newmtl skin\nmap_Kd gone.png\n")
    square()
    Path("lost.obj").write_text(Path("square.obj").read_text().replace("s.mtl", "l.mtl"))
    assert complaint in refused(capsys, "mesh", model, "-o", "mesh.png", *words)


@pytest.mark.sweep
def test_compare_prints_a_row_for_each_zone_and_method(monkeypatch, capsys):
    monkeypatch.setattr("resample_comparisons.texture.scenes.SMALLEST_SIDE", 96)
    assert ended("compare", "photo.png", "--methods", "bilinear, hybrid") == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split() == ["zone", "method", "psnr", "ssim", "flip", "ms"]
    assert [row.split()[:2] for row in rows[:2]] == [["whole", "bilinear"], ["whole", "hybrid"]]
    assert all(float(row.split()[2]) > 10 for row in rows)


@pytest.mark.parametrize("output", ["c.html", "c.png"])
def test_compare_gives_json_and_a_page_or_a_sheet(output, capsys):
    words = ["--scene", "2,0,0,0,2,0", "--methods", "bilinear,points", "--json", "-o", output]
    assert ended("compare", "photo.png", *words) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["zone"] for row in rows} == {"whole", "magnified"}
    assert Path(output).stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--methods", "bilinear,magic"], "unknown method 'magic'"),
        (["--methods", ""], "give methods to compare"),
        (["--scene", "sea"], "unknown scene 'sea'; known: floor,"),
        (["--scene", "1,2,3"], "a matrix has three lines"),
        (["--truth-filter", "disk"], 'Choose from: "box", "gaussian"'),
        (["--size", "0"], "at least 1"),
        (["-o", "sheet.jpg"], "comparisons are written as .png or .html"),
        (["-o", "none/sheet.png"], "cannot be written"),
    ],
)
def test_compare_refuses_before_any_work(words, complaint, monkeypatch, capsys):
    monkeypatch.setattr("resample.files.pictures.read_picture", None)
    assert complaint in refused(capsys, "compare", "photo.png", *words)


@pytest.mark.sweep
def test_animate_writes_gif_apng_or_a_folder():
    words = ["animate", "photo.png", "--frames", "3", "--size", "40x24", "-o"]
    for output in ("fly.gif", "fly.apng", "frames"):
        assert ended(*words, output) == 0
    for output in ("fly.gif", "fly.apng"):
        with Image.open(output) as animation:
            assert animation.n_frames == 3
    assert sorted(path.name for path in Path("frames").iterdir())[-1] == "frame-0002.png"
    assert {path.name for path in Path().iterdir()} == {
        *("photo.png", "fly.gif", "fly.apng", "frames")
    }


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "fly.avi"], "animations are written as .mp4, .webp, .gif, .apng or a folder"),
        (["-o", "none/fly.gif"], "cannot be written"),
        (["-o", "none/frames"], "none"),
        (["-o", "file"], "file is not a folder"),
        (["-o", "fly.gif", "--frames", "0"], "0 frames; 1 to 10000 are allowed"),
        (["-o", "fly.gif", "--fps", "0"], "0 frames per second"),
        (["-o", "fly.gif", "--size", "0"], "at least 1"),
        (["-o", "fly.gif", "--method", "magic"], "unknown method 'magic'"),
        (["-o", "fly.gif", "--path", "walk"], 'Choose from: "fly", "turn"'),
    ],
)
def test_animate_refuses_in_one_line(words, complaint, capsys):
    Path("file").write_text("a file")
    assert complaint in refused(capsys, "animate", "photo.png", *words)


def test_figures_write_a_sheet_the_pictures_and_the_table(monkeypatch, capsys):
    monkeypatch.setattr("resample_comparisons.texture.scenes.SMALLEST_SIDE", 64)
    for name in ("checker", "bricks"):
        fine = getattr(import_module("resample_comparisons.texture.scenes"), name)(128)
        monkeypatch.setattr(
            f"resample_comparisons.texture.scenes.{name}", lambda *_, fine=fine: fine
        )
    monkeypatch.setattr("resample_figures.figure_5.FIGURE", {"points": "a", "bilinear": "c"})
    assert ended("figures", "-o", "deep/figures") == 0
    written = {path.name for path in Path("deep/figures").iterdir()}
    assert {"figure5.png", "table.txt", "checker-points.png", "bricks-truth.png"} <= written
    assert Path("deep/figures/table.txt").read_text() == capsys.readouterr().out


@pytest.mark.sweep
def test_the_demo_says_where_its_pictures_are(folder, monkeypatch, capsys):
    monkeypatch.setitem(cli.DEMO, "flight.gif", cli.DEMO["flight.gif"].replace("24", "2"))
    assert ended("demo", "-o", "demo") == 0
    assert capsys.readouterr().out == f"The pictures are in {folder / 'demo'}\n"
    assert set(cli.DEMO) == {path.name for path in Path("demo").iterdir()}
