"""Photographs for two eyes: layouts, folders of photos, networks in ONNX, strength in words."""

import io
import re
import shlex
import struct
from functools import partial
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from resample.files.images import read_image
from resample_warp3d import cli, stereo
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
PLAIN = ["--method", "mcmillan-zbuffer", "--refine", "none"]
GIVEN = ["stereo", "color.png", "rel.npy", "--depth-kind", "relative", "--divergence", "10", *PLAIN]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder: a picture of a wall with a box in front, and relative depth of it."""
    monkeypatch.chdir(tmp_path)
    color = np.random.default_rng(7).integers(0, 256, (12, 20, 3), np.uint8)
    color = color.repeat(4, 0).repeat(4, 1)
    cv2.imwrite("color.png", color)
    rel = np.full((48, 80), 1.0, np.float32)
    rel[16:32, 32:48] = 3.0
    np.save("rel.npy", rel)


def made(*words):
    """Picture that a command makes."""
    assert ended(*GIVEN, *words, "-o", "out.png") == 0
    return read_image("out.png")


# Layouts


def test_both_eyes_share_the_parallax():
    """Half of 8 px each way from the source's place, about the middle of the range."""
    both = made("--eyes", "both", "--convergence", "50", "--layout", "sbs")
    source, left, right = read_image("color.png"), both[:, :80], both[:, 80:]
    np.testing.assert_allclose(left[18:30, 34:50], source[18:30, 32:48], atol=1e-6)
    np.testing.assert_allclose(right[18:30, 30:46], source[18:30, 32:48], atol=1e-6)
    np.testing.assert_allclose(left[:12, :78], source[:12, 2:], atol=1e-6)
    np.testing.assert_allclose(right[:12, 2:], source[:12, :78], atol=1e-6)


def test_depth_stands_beside_its_picture():
    both, half = made("--layout", "rgbd"), made("--layout", "half-rgbd")
    np.testing.assert_allclose(both[:, :80], read_image("color.png"), atol=1e-6)
    assert np.unique(both[:, 80:]).tolist() == [0, 1]
    assert both[18:30, 114:126].min() == 1
    np.testing.assert_allclose(half, 0.5 * (both[:, ::2] + both[:, 1::2]), atol=3e-3)


def test_a_quilt_goes_from_the_lower_left_view_to_the_upper_right_one():
    quilt = made("--layout", "quilt", "--quilt", "3x2", "--convergence", "0")
    assert quilt.shape == (96, 240, 3)
    source, places = read_image("color.png"), []
    for n in range(6):
        row, column = divmod(n, 3)
        view = quilt[48 * (1 - row) : 48 * (2 - row), 80 * column : 80 * column + 80]
        errors = [
            np.abs(view[18:30, 32 - at : 48 - at] - source[18:30, 32:48]).mean()
            for at in range(-8, 9)
        ]
        places.append(int(np.argmin(errors)) - 8)
    assert places == sorted(places)
    assert (places[0], places[-1]) == (-4, 4)
    small = made("--layout", "quilt", "--quilt", "3x2", "--size", "40x24")
    assert small.shape == (48, 120, 3)


def test_stills_for_two_eyes_hold_both_pictures():
    both = made("--layout", "sbs")
    for name in ("out.mpo", "out.jps"):
        assert ended(*GIVEN, "-o", name) == 0
    with Image.open("out.mpo") as file:
        assert (file.format, file.n_frames) == ("MPO", 2)
        kinds = [entry["Attribute"] for entry in file.mpinfo[0xB002]]
        assert [kind["MPType"] for kind in kinds] == ["Multi-Frame Image: (Disparity)"] * 2
        assert [kind["RepresentativeImageFlag"] for kind in kinds] == [True, False]
        for n, eye in enumerate((both[:, :80], both[:, 80:])):
            file.seek(n)
            stored = np.asarray(file.convert("RGB"), np.float32) / 255
            levels = np.where(eye <= 0.0031308, 12.92 * eye, 1.055 * eye ** (1 / 2.4) - 0.055)
            assert np.abs(stored - levels).mean() < 0.02
    data = Path("out.jps").read_bytes()
    place = data.index(b"_JPSJPS_")
    assert struct.unpack_from(">2sH", data, place - 4) == (b"\xff\xe3", 18)
    assert struct.unpack_from(">HI", data, place + 8) == (4, 0x201)
    with Image.open(io.BytesIO(data)) as image:
        crossed = np.asarray(image, np.float32)
    assert crossed.shape == (48, 160, 3)
    assert np.abs(crossed[:, 80:] - cv2.imread("color.png")[..., ::-1]).mean() < 5


# Strength


def test_relief_moves_to_the_foreground():
    """Depth halfway between wall and box is a quarter of the way with one step of the scale."""
    rel = np.load("rel.npy")
    rel[:12] = 2.0
    np.save("rel.npy", rel)
    scaled = ["--convergence", "0", "--foreground-scale", "1"]
    source, plain, moved = read_image("color.png"), made(*scaled[:2]), made(*scaled)
    np.testing.assert_allclose(plain[:11, 20:60], source[:11, 24:64], atol=1e-6)
    np.testing.assert_allclose(moved[:11, 20:60], source[:11, 22:62], atol=1e-6)
    np.testing.assert_allclose(moved[18:30, 24:40], source[18:30, 32:48], atol=1e-6)


def test_borders_are_kept_or_cut_off():
    source = read_image("color.png")
    words = ["--eyes", "both", "--layout", "sbs", "--convergence", "50"]
    both = made(*words, "--preserve-borders")
    for eye in (both[:, :80], both[:, 80:]):
        np.testing.assert_allclose(eye[:, [0, 79]], source[:, [0, 79]], atol=0.1)
    cut = made(*words, "--crop-borders")
    assert cut.shape == (48, 2 * (80 - 2 * 4), 3)


def test_comfort_is_said_in_px_and_degrees(capsys):
    made()
    said = capsys.readouterr().err
    assert re.search(r"from -?\S+ to \S+ px, \S+ to \S+ degrees where the picture is 60", said)
    assert "comfortable are 1.2 px, 1 degree; that tires eyes" in said


# Folders


def photos():
    """A folder of photos of two sizes, one of them in a folder below, and their depths."""
    for name, size in (("a.png", (80, 48)), ("b.jpg", (40, 60)), ("sub/c.png", (32, 32))):
        for kind in ("in", "z"):
            (Path(kind) / name).parent.mkdir(parents=True, exist_ok=True)
        color = cv2.resize(cv2.imread("color.png"), size, interpolation=cv2.INTER_NEAREST)
        cv2.imwrite(f"in/{name}", color)
        depth = np.zeros(size[::-1], np.uint8)
        depth[10:20, 10:20] = 200
        cv2.imwrite(str(Path("z", name).with_suffix(".png")), depth)
    return ["stereo", "in", "z", *PLAIN, "--layout", "sbs", "-o", "out"]


def test_photos_of_two_sizes_are_made_one_by_one(capsys):
    assert ended(*photos(), "--name-layout") == 0
    assert sorted(file.name for file in Path("out").iterdir()) == [
        "a_LRF_Full_SBS.png",
        "b_LRF_Full_SBS.jpg",
    ]
    assert read_image("out/b_LRF_Full_SBS.jpg").shape == (60, 80, 3)
    said = capsys.readouterr().err
    assert "pictures have several sizes and are made one by one (--batch)" in said
    assert said.endswith("resample: 2 written, 0 were there, 0 failed\n")


def test_a_folder_goes_on_after_errors_and_where_it_was(capsys):
    words = [*photos(), "--recursive"]
    Path("in/b.jpg").write_bytes(b"damaged")
    assert ended(*words) == 2
    capsys.readouterr()
    plain = [word for word in words if word not in ("--batch", "--recursive")]
    assert "; --batch --skip-errors leaves it out" in refused(capsys, *plain)
    assert ended(*words, "--skip-errors", "--resume") == 0
    said = capsys.readouterr().err
    assert "in/b.jpg is not a picture" in said
    assert said.endswith("resample: 1 written, 1 were there, 1 failed\n")
    assert Path("out/sub/c.png").is_file()
    Path("z/a.png").unlink()
    assert ended(*words[:-3], "--batch", "--skip-errors", "-o", "again") == 2
    assert "all of 2 pictures failed; the first: in/a.png: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "out.png"], "out.png: several pictures are written to a folder"),
        (["-o", "in"], "in/a.png would be replaced; give another folder"),
        (["-o", "x", "--holes", "h.png"], "--holes and --coverage are for one picture"),
    ],
)
def test_what_folders_cannot_do_is_refused(capsys, words, complaint):
    given = photos()[:-2]
    assert complaint in refused(capsys, *given, "--batch", *words)


# Networks


def field(number, value):
    """A field of a protobuf message: a number, bytes or text."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def varint(number):
    made = b""
    while number > 127:
        made, number = made + bytes([number & 127 | 128]), number >> 7
    return made + bytes([number])


def write_network(path, sides=("h", "w"), batch="n", facts=()):
    """A network in ONNX whose depth is the mean of what it takes of red, green and blue."""

    def tensor(name, *form):
        dims = b"".join(
            field(1, field(1, side) if isinstance(side, int) else field(2, side)) for side in form
        )
        return field(1, name) + field(2, field(1, field(1, 1) + field(2, dims)))

    axes = field(1, "axes") + field(8, 1) + field(20, 7)
    keep = field(1, "keepdims") + field(3, 0) + field(20, 2)
    node = field(1, "x") + field(2, "y") + field(4, "ReduceMean") + field(5, axes) + field(5, keep)
    graph = field(1, node) + field(2, "mean") + field(11, tensor("x", batch, 3, *sides))
    graph += field(12, tensor("y", batch, *sides))
    model = field(1, 8) + field(7, graph) + field(8, field(2, 13))
    for key, value in facts:
        model += field(14, field(1, key) + field(2, value))
    Path(path).write_bytes(model)


NETWORK = ["stereo", "color.png", "--depth-model", "mean.onnx", *PLAIN, "--layout", "rgbd"]


@pytest.mark.parametrize("sides", [("h", "w"), (28, 28)])
def test_a_network_in_a_file_estimates_the_depth(sides):
    color = np.zeros((56, 112, 3), np.uint8)
    color[:, 56:] = 255
    cv2.imwrite("color.png", color)
    write_network("mean.onnx", sides, facts=[("size", "28")])
    assert ended(*NETWORK, "-o", "out.png") == 0
    depth = read_image("out.png")[:, 112:]
    assert depth[:, :50].max() == 0
    assert depth[:, 62:].min() == 1


def test_a_network_takes_levels_as_its_file_or_options_say():
    from resample_warp3d.command import choices, footage

    levels = np.float32([[[0.1, 0.5, 0.9]]]).repeat(28, 0).repeat(28, 1)
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    picture = footage.Picture(light.astype(np.float32), None)
    usual = np.mean((levels[0, 0] - (0.485, 0.456, 0.406)) / (0.229, 0.224, 0.225))
    facts = [("mean", "0.5,0.5,0.5"), ("std", "0.5,0.5,0.5")]
    for known, options, value in (
        ([], {}, usual),
        (facts, {}, 0.0),
        (facts, {"model_mean": "0,0,0", "model_std": "1,1,0.5"}, np.mean([0.1, 0.5, 1.8])),
    ):
        write_network("mean.onnx", facts=known)
        choice = choices.Estimating(depth_model="mean.onnx", model_size=28, **options)
        (made,) = footage.opened(choice, 1).estimate([picture])
        assert made.shape == (28, 28)
        np.testing.assert_allclose(made, value, atol=1e-4)


@pytest.mark.parametrize("batch", ["n", 2])
def test_films_are_estimated_in_batches_and_made_as_with_depth_files(batch):
    Path("film").mkdir()
    rng = np.random.default_rng(3)
    for n in range(5):
        cv2.imwrite(f"film/{n}.png", rng.integers(0, 256, (7, 14, 3), np.uint8).repeat(8, 0))
    write_network("mean.onnx", batch=batch, facts=[("size", "28")])
    words = [*NETWORK[2:4], "--model-batch", "3", *PLAIN, "--layout", "half-tb"]
    assert ended("stereo", "film", *words, "-o", "out.apng") == 0
    with Image.open("out.apng") as file:
        assert file.n_frames == 5
    assert [file.name for file in Path().iterdir() if file.name.startswith(".")] == []


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["color.png"], "color.png: depth is missing; give its file, or a network that estimates "
         "it, --depth-model FILE.onnx"),
        (["color.png", "rel.npy", "--depth-model", "mean.onnx"], "give one of them"),
        (["color.png", "--depth-model", "color.png"], "color.png is not a network that runs"),
        (["color.png", "--depth-model", "no.onnx"], "No such file"),
        (["color.png", "rel.npy", "--model-size", "28"], "--model-size belongs to --depth-model"),
        (["color.png", "--depth-model", "mean.onnx", "--model-std", "0"], "are three numbers"),
    ],
)  # fmt: skip
def test_what_networks_cannot_do_is_refused(capsys, words, complaint):
    write_network("mean.onnx")
    assert complaint in commands.refused(cli.app, capsys, "stereo", *words, "-o", "out.png")


# The page


PAGE = Path(__file__).parents[2] / "docs/howto/headset.md"


def write_film(name, shade):
    """A film of a second, of 10 pictures of a box that moves before a wall."""
    with av.open(name, "w") as film:
        stream = film.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 112, 56, "yuv420p"
        for n in range(10):
            levels = shade.copy()
            levels[20:40, 20 + 2 * n : 50 + 2 * n] = 220
            picture = av.VideoFrame.from_ndarray(levels, format="rgb24")
            film.mux(stream.encode(picture.reformat(format="yuv420p")))
        film.mux(stream.encode(None))


def test_the_page_of_headsets_is_made_of_commands_that_run():
    ramp = np.linspace(20, 120, 112).astype(np.uint8)[None, :, None]
    write_film("film.mp4", np.ascontiguousarray(np.broadcast_to(ramp, (56, 112, 3))))
    write_film("depth.mp4", np.full((56, 112, 3), 60, np.uint8))
    write_network("depth.onnx", facts=[("size", "28")])
    for file in ("photo.jpg", "photos/a.png", "photos/below/b.jpg"):
        Path(file).parent.mkdir(exist_ok=True)
        cv2.imwrite(file, cv2.imread("color.png"))
    lines = re.findall(r"^\$ resample-warp3d (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(lines) == 10
    for line in lines:
        assert ended(*shlex.split(line)) == 0
    for name in (
        "trial_LRF_Full_SBS.mp4", "weaker_LRF_Full_SBS.mp4", "relief.mkv", "whole.mp4",
        "television_TB.mkv", "around_180x180_LR.mp4", "photos-3d/a_LRF_Full_SBS.png",
        "photos-3d/below/b_LRF_Full_SBS.jpg", "photo.mpo", "frame_qs5x3.png",
    ):  # fmt: skip
        assert Path(name).stat().st_size > 100


@pytest.mark.parametrize("choice", [{}, {"divergence": 2}])
def test_depth_of_one_plane_is_the_screen(choice):
    picture = np.tile(np.arange(64, dtype=np.uint8)[:, None] * 3, (48, 1, 3)).reshape(48, 64, 3)
    both = stereo(picture, np.full((48, 64), 4.0), depth_kind="z", layout="side-by-side", **choice)
    left, right = np.hsplit(both, 2)
    np.testing.assert_array_equal(left, right)
