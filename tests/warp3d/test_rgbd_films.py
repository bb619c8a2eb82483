"""Films with depth, seen from another place."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from resample.files.images import read_image
from resample_warp3d import cli
from resample_warp3d.command.depths import DepthFrames
from resample_warp3d.depth.files import read_depth
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SEEN = ["--intrinsics", "20,20,16,12", "--move", "0.2,0,0", "--method", "mcmillan-zbuffer"]
COUNT = 3


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder: film.gif of few colors, and depth as a folder, a film and relative."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    palette = rng.integers(0, 256, (12, 3), np.uint8)
    pictures = [Image.fromarray(palette[rng.integers(0, 12, (24, 32))]) for _ in range(COUNT)]
    pictures[0].save("film.gif", save_all=True, append_images=pictures[1:], duration=80)
    for name in ("depth", "relative", "pictures", "empty"):
        Path(name).mkdir()
    levels = []
    for n in range(COUNT):
        z = np.full((24, 32), 2.0, np.float32)
        z[8:16, 4 * n : 4 * n + 8] = 1.0
        cv2.imwrite(f"depth/{n}.png", (z * 1000).astype(np.uint16))
        near = 1 / z if n else np.full_like(z, 0.5) + 0.1 * (z < 2)  # no box at first, but a step
        np.save(f"relative/{n}.npy", 3 * near + 7)
        levels.append(Image.fromarray((255 / (2 * z)).astype(np.uint8)))
        pictures[n].save(f"pictures/{n}.png")
    levels[0].save("depth.gif", save_all=True, append_images=levels[1:], duration=80)
    return tmp_path


def frames(path):
    """Frames of an animation, (H, W, 3 or 4)."""
    with Image.open(path) as file:
        made = []
        for n in range(file.n_frames):
            file.seek(n)
            made.append(np.array(file.convert("RGBA")))
        return made, file.info.get("duration")


@pytest.mark.sweep
@pytest.mark.parametrize("depth", ["depth", "depth/*.png"])
def test_every_picture_moves_by_its_own_depth(depth):
    words = ["render", "film.gif", depth, "--depth-scale", "1000", *SEEN, "--fill"]
    assert ended(*words, "-o", "out.apng") == 0
    made, duration = frames("out.apng")
    assert len(made) == COUNT
    assert duration == pytest.approx(80, abs=1)
    for n in range(COUNT):
        one = ["render", f"pictures/{n}.png", f"depth/{n}.png", "--depth-scale", "1000", *SEEN]
        assert ended(*one, "--fill", "--refine", "none", "-o", "one.png") == 0
        np.testing.assert_array_equal(made[n][..., :3], np.array(Image.open("one.png")))


def test_depth_may_be_a_film_of_gray_levels():
    words = ["render", "film.gif", "depth.gif", "--depth-kind", "inverse", "--depth-scale", "255"]
    assert ended(*words, *SEEN, "-o", "out.apng") == 0
    made, _ = frames("out.apng")
    source = np.array(Image.open("pictures/2.png"))  # a wall of nearness 1/4, that moves by a pixel
    np.testing.assert_array_equal(made[2][:8, :31, :3], source[:8, 1:])


def test_relative_depth_of_a_film_has_one_range():
    words = ["film.gif", "relative", "--depth-kind", "relative", "--near", "1", "--far", "2"]
    assert ended("render", *words, *SEEN, "--refine", "none", "-o", "out.apng") == 0
    made, _ = frames("out.apng")
    source = np.array(Image.open("pictures/0.png"))
    np.testing.assert_array_equal(made[0][:8, :30, :3], source[:8, 2:])  # the wall stays at 2
    assert read_image("pictures/0.png").shape == (24, 32, 3)


@pytest.mark.sweep
def test_a_doubtful_scale_is_said_once(capsys):
    words = ["render", "film.gif", "depth", "--depth-scale", "1e7", *SEEN, "-o", "out.gif"]
    assert ended(*words) == 0
    assert capsys.readouterr().err.count("check the depth's scale") == 1


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["film.gif", "depth/0.png", "-o", "out.gif"], "is neither a film, a folder nor a pattern"),
        (["film.gif", "depth/[01].png", "-o", "out.gif"], "film.gif has 3 pictures, depth/[01]"),
        (["film.gif", "depth", "-o", "out.jpg"], "the 3 pictures of film.gif are written as"),
        (["film.gif", "depth", "-o", "out.gif", "--holes", "h.png"], "--holes is for pictures"),
        (["film.gif", "depth", "-o", "out.gif", "--view", "a,b,c"], "--view is for pictures"),
        (["film.gif", "empty", "-o", "out.gif"], "empty is a folder without files"),
        (["pictures", "depth/1.png", "-o", "out.png"], "pictures: is a folder"),
        (["pictures/1.png", "depth", "-o", "out.png"], "depth: is a folder"),
    ],
)
def test_what_is_no_film_with_depth_is_refused_in_one_line(capsys, words, complaint):
    assert complaint in refused(capsys, "render", *words, "--depth-scale", "1000", *SEEN)


def test_a_complaint_about_one_file_of_a_folder_names_it(capsys):
    words = ["film.gif", "depth", *SEEN, "-o", "out.gif"]
    assert "depth/0.png: depth in whole numbers" in refused(capsys, "render", *words)


FLIGHT = ["animate", "pictures/1.png", "depth/1.png", "--depth-scale", "1000", "--refine", "none"]
FLIGHT += ["--intrinsics", "20,20,16,12", "--frames", "3", "--amount", "0.3"]
STILL = ["--intrinsics", "20,20,16,12", "--refine", "none", "--noise", "0"]
STILL += ["--move", "0,0,0"]


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("pattern", "scale", "atol"),
    [("z", ["--depth-scale", "1000"], 6e-4), ("z/d-*.exr", [], 1e-6), ("z/*.npy", [], 0)],
)
def test_a_film_is_read_with_the_depth_that_was_written_with_it(pattern, scale, atol):
    assert ended(*FLIGHT, "--depth-output", pattern, "-o", "film.apng") == 0
    made, _ = frames("film.apng")
    assert len(list(Path("z").iterdir())) == len(made) == COUNT
    words = ["render", "film.apng", pattern, *scale, *STILL]
    assert ended(*words, "-o", "again.apng", "--depth-output", "back/*.npy") == 0
    again, _ = frames("again.apng")
    for n, (one, other) in enumerate(zip(made, again, strict=True)):
        known = other[..., 3] == 255
        assert known.mean() > 0.8
        np.testing.assert_array_equal(one[known], other[known])
        (file,) = Path("z").glob(f"*{n:04d}*")
        given, back = read_depth(file), np.load(f"back/{n:04d}.npy")
        given = np.where(given == 0, np.inf, given) / (1000 if file.suffix == ".png" else 1)
        np.testing.assert_allclose(back, given, rtol=1e-6, atol=1e-9)
    exact = np.load("back/0000.npy")  # of the source's own place
    known = np.isfinite(exact)
    z = cv2.imread("depth/1.png", cv2.IMREAD_UNCHANGED) / 1000
    np.testing.assert_allclose(exact[known], z[known], atol=max(atol, 1e-6))


def test_a_film_that_breaks_off_leaves_no_depth_and_goes_on_from_there(monkeypatch):
    words = [*FLIGHT, "--depth-output", "z", "-o", "film.apng"]
    assert ended(*words) == 0
    whole = [np.array(Image.open(file)) for file in sorted(Path("z").iterdir())]
    film = Path("film.apng").read_bytes()
    for file in (*Path("z").iterdir(), Path("film.apng")):
        file.unlink()
    asked, write = [], DepthFrames.write

    def breaking(self, n, depth):
        asked.append(n)
        if len(asked) == 2:
            raise OSError("no room")
        write(self, n, depth)

    monkeypatch.setattr(DepthFrames, "write", breaking)
    assert ended(*words) == 2
    assert not [file for file in Path("z").iterdir() if file.is_file()]
    assert not Path("film.apng").exists()
    assert ended(*words, "--resume") == 0
    assert asked == [0, 1, 1, 2]
    found = [np.array(Image.open(file)) for file in sorted(Path("z").iterdir())]
    np.testing.assert_array_equal(found, whole)
    assert Path("film.apng").read_bytes() == film


@pytest.mark.sweep
def test_a_film_that_is_rendered_in_vain_leaves_no_depth():
    Path("depth/2.png").write_bytes(b"damaged")
    words = ["render", "film.gif", "depth", "--depth-scale", "1000", *STILL]
    assert ended(*words, "--depth-output", "z", "-o", "out.apng") == 2
    assert not Path("z").exists()
    assert not Path("out.apng").exists()


def test_depth_of_a_shorter_film_replaces_that_of_a_longer_one():
    words = [*FLIGHT, "--depth-output", "z/*.npy", "-o", "film.gif"]
    assert ended(*words) == 0
    Path("z/notes.npy").touch()
    words[words.index("--frames") + 1] = "2"
    assert ended(*words) == 0
    assert sorted(file.name for file in Path("z").iterdir()) == [
        "0000.npy",
        "0001.npy",
        "notes.npy",
    ]


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("pattern", "complaint"),
    [
        ("z.exr", "with one * for the number of the frame, such as depth/*.exr"),
        ("*/z.exr", "with one *"),
        ("z/*.jpg", "depth is written as .exr, .npy or .png"),
        ("none/z/*.png", "none"),
        ("film.gif/*.png", "film.gif is not a folder"),
        ("out", "out is the folder of the film's frames; give the depth another folder"),
    ],
)
def test_depth_that_cannot_be_written_is_refused_at_once(capsys, pattern, complaint):
    assert complaint in refused(capsys, *FLIGHT, "--depth-output", pattern, "-o", "out")
