"""Films of folders and stacks, for two eyes, with a camera that moves, and without flicker."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from resample.files.images import read_image
from resample.samples.rooms import room
from resample_warp3d import cli
from resample_warp3d.command import films
from tests import commands
from tests.elsewhere import assert_same_film, frames, pickle_for_workers

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SHAPE, COUNT = (24, 32), 3
FAST = ["--intrinsics", "20,20,16,12", "--method", "mcmillan-zbuffer", "--refine", "none"]
DEPTH = ["--depth-scale", "1000"]
MOVED = ["--move", "0.2,0,0"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder: pictures/8.png to 10.png, film.gif, depth/, and stack.npz and .npy."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    palette = rng.integers(0, 256, (12, 3), np.uint8)
    pictures = [Image.fromarray(palette[rng.integers(0, 12, SHAPE)]) for _ in range(COUNT)]
    pictures[0].save("film.gif", save_all=True, append_images=pictures[1:], duration=80)
    for name in ("depth", "pictures"):
        Path(name).mkdir()
    maps = np.full((COUNT, *SHAPE), 2.0, np.float32)
    for n, z in enumerate(maps):
        z[8:16, 4 * n : 4 * n + 8] = 1.0
        cv2.imwrite(f"depth/{n + 8}.png", (z * 1000).astype(np.uint16))
        pictures[n].save(f"pictures/{n + 8}.png")
    Path("pictures/.hidden").write_text("", encoding="utf-8")
    Path("pictures/notes.txt").write_text("", encoding="utf-8")
    np.save("stack.npy", maps)
    np.savez("stack.npz", z=maps, other=np.zeros(3))
    return tmp_path


def levels(path):
    """Frames of an animation, or of a folder's pictures in order."""
    if Path(path).is_dir():
        files = [file for file in sorted(Path(path).iterdir()) if file.suffix != ".json"]
        return [np.array(Image.open(file).convert("RGBA")) for file in files]
    with Image.open(path) as file:
        made = []
        for n in range(file.n_frames):
            file.seek(n)
            made.append(np.array(file.convert("RGBA")))
        return made


def alone(n, *words):
    """The result for one of the pictures by itself."""
    given = [f"pictures/{n + 8}.png", f"depth/{n + 8}.png", *DEPTH, *FAST]
    assert ended(words[0], *given, *words[1:], "-o", "one.png") == 0
    return np.array(Image.open("one.png").convert("RGBA"))


# Folders, patterns, stacks


@pytest.mark.sweep
@pytest.mark.parametrize("color", ["pictures", "pictures/*.png", "film.gif"])
@pytest.mark.parametrize(
    "depth", [["depth", *DEPTH], ["depth/*.png", *DEPTH], ["stack.npy"], ["stack.npz:z"]], ids=str
)
def test_films_are_files_folders_patterns_and_stacks(color, depth):
    assert ended("render", color, *depth, *FAST, *MOVED, "--fill", "-o", "out.apng") == 0
    made = levels("out.apng")
    assert len(made) == COUNT
    np.testing.assert_array_equal(made[1], alone(1, "render", *MOVED, "--fill"))


@pytest.mark.sweep
@pytest.mark.parametrize("output", ["out", "out/*.tif", "out/seen-*.exr"])
def test_a_film_is_written_to_numbered_files(output):
    assert ended("render", "pictures", "depth", *DEPTH, *FAST, *MOVED, "-o", output) == 0
    files = sorted(Path("out").iterdir())
    assert len(files) == COUNT
    assert files[0].name in ("frame-0000.png", "0000.tif", "seen-0000.exr")
    alone(2, "render", *MOVED)
    np.testing.assert_allclose(read_image(files[2]), read_image("one.png"), atol=1 / 255)


@pytest.mark.sweep
def test_a_film_that_breaks_off_leaves_nothing():
    Path("depth/10.png").write_bytes(b"damaged")
    Path("out").mkdir()
    Path("out/frame-0000.png").write_bytes(b"earlier")
    assert ended("render", "pictures", "depth", *DEPTH, *FAST, *MOVED, "-o", "out") == 2
    assert [file.name for file in Path("out").iterdir()] == ["frame-0000.png"]
    assert Path("out/frame-0000.png").read_bytes() == b"earlier"


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["pictures", "depth", "-o", "pictures"], "the film is read from this folder"),
        (["pictures", "depth", "-o", "depth/*.png"], "the film is read from this folder"),
        (["depth/*.jpg", "depth", "-o", "out"], "depth/*.jpg has no pictures"),
        (["pictures", "depth/8.png", "-o", "out"], "nor a stack (N, H, W) in .npy or .npz"),
        (["pictures", "depth/[89].png", "-o", "out"], "pictures has 3 pictures, depth/[89].png"),
        (["pictures", "depth", "-o", "out.jpg"], "the 3 pictures of pictures are written as"),
        (["pictures", "depth", "--fps", "0", "-o", "out"], "0 frames per second"),
        (["pictures", "depth", "--coverage", "c.png", "-o", "out"], "is for pictures, not for"),
    ],
)
def test_what_is_no_film_is_refused_in_one_line(capsys, words, complaint):
    assert complaint in refused(capsys, "render", *words, *DEPTH, *FAST, *MOVED)
    if "--coverage" not in words:
        assert complaint in refused(capsys, "stereo", *words, "--depth-kind", "z", *DEPTH, *FAST)


@pytest.mark.parametrize(
    "words",
    [
        ["animate", "pictures", "depth", "-o", "pictures"],
        ["animate", "pictures", "depth", "-o", "out", "--depth-output", "depth"],
        ["render", "film.gif", "depth", *MOVED, "-o", "out", "--depth-output", "depth/*.png"],
    ],
)
def test_a_film_is_not_written_over_itself(capsys, words):
    assert "the film is read from this folder" in refused(capsys, *words, *DEPTH, *FAST)


def test_pictures_of_two_sizes_are_refused(capsys):
    Image.new("RGB", (16, 12)).save("pictures/9.png")
    assert ended("render", "pictures", "depth", *DEPTH, *FAST, *MOVED, "-o", "out") == 2
    assert "pictures/9.png has 16 x 12 pixels" in capsys.readouterr().err
    assert not Path("out").exists()


@pytest.mark.some(1)
@pytest.mark.parametrize("color", ["pictures", "film.gif"])
def test_labels_of_films_stay_labels(color):
    words = ["render", color, "depth", *DEPTH, *FAST[:-4], *MOVED, "--unmixed", "-o", "out"]
    assert ended(*words) == 0
    known = {tuple(color) for n in (8, 9, 10) for color in read_levels(f"pictures/{n}.png")}
    for made in levels("out"):
        assert {tuple(color) for color in made[..., :3].reshape(-1, 3)} <= {*known, (0, 0, 0)}


def read_levels(path):
    return np.array(Image.open(path).convert("RGB")).reshape(-1, 3)


def test_a_folder_has_the_frames_per_second_it_is_given():
    words = ["render", "pictures", "depth", *DEPTH, *FAST, *MOVED]
    assert ended(*words, "--fps", "5", "-o", "out.webp") == 0
    with Image.open("out.webp") as file:
        file.seek(1)
        file.load()
        assert file.info["duration"] == 200


# Two eyes


@pytest.mark.some(1)
@pytest.mark.parametrize("layout", ["one", "side-by-side", "half-top-bottom", "anaglyph", "vr180"])
def test_films_are_made_for_two_eyes(layout):
    fast = FAST if layout != "vr180" else [*FAST[:2], *FAST[-2:]]
    eyes = ["--depth-kind", "z", *DEPTH, *fast, "--layout", layout, "--fill"]
    eyes += ["--eye-distance", "0.2", "--eyes", "right" if layout == "one" else "both"]
    eyes += ["--size", "32"] if layout == "vr180" else ["--zero-plane", "2"]
    assert ended("stereo", "pictures", "depth", *eyes, "-o", "out.apng") == 0
    given = ["pictures/9.png", "depth/9.png", *eyes]
    assert ended("stereo", *given, "-o", "one.png") == 0
    made, one = levels("out.apng"), np.array(Image.open("one.png").convert("RGBA"))
    assert len(made) == COUNT
    np.testing.assert_array_equal(made[1], one)


def test_films_of_rectified_pairs_take_their_disparity():
    np.save("disparity.npy", 4 / np.load("stack.npy"))
    words = ["--method", "mcmillan-zbuffer", "--refine", "none", "--fill"]
    assert ended("stereo", "film.gif", "disparity.npy", *words, "-o", "out.apng") == 0
    np.save("one.npy", 4 / np.load("stack.npy")[2])
    assert ended("stereo", "pictures/10.png", "one.npy", *words, "-o", "one.png") == 0
    np.testing.assert_array_equal(
        levels("out.apng")[2][..., :3], np.array(Image.open("one.png").convert("RGB"))
    )


@pytest.mark.sweep
@pytest.mark.parametrize("layout", ["half-side-by-side", "half-top-bottom"])
def test_halves_are_means_of_two_pixels_and_together_as_large_as_one(layout):
    words = ["stereo", "pictures/8.png", "depth/8.png", "--depth-kind", "z", *DEPTH, *FAST]
    words += ["--eyes", "0.2", "--fill", "--layout"]
    assert ended(*words, layout.removeprefix("half-"), "-o", "whole.exr") == 0
    assert ended(*words, layout, "-o", "half.exr") == 0
    whole, half = read_image("whole.exr"), read_image("half.exr")
    assert half.shape == (*SHAPE, 3)
    if layout == "half-side-by-side":
        means = 0.5 * (whole[:, ::2] + whole[:, 1::2])
    else:
        means = 0.5 * (whole[::2] + whole[1::2])
    np.testing.assert_allclose(half, means, atol=1e-6)


# A camera that moves


FLIGHT = ["animate", "pictures", "depth", *DEPTH, *FAST, "--amount", "0.3"]


@pytest.mark.sweep
def test_a_film_has_one_pose_for_each_of_its_pictures():
    assert ended(*FLIGHT, "-o", "out") == 0
    made = levels("out")
    np.savetxt("one.txt", np.eye(4))
    assert len(made) == COUNT
    still = alone(0, "render", "--pose", "one.txt", "--fill")
    covered = alone(0, "render", "--pose", "one.txt")[..., 3] == 255
    np.testing.assert_array_equal(made[0][covered], still[covered])  # a sway begins at the source


@pytest.mark.sweep
def test_poses_of_a_file_are_those_of_a_films_pictures():
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, 0, 3] = [0.0, -0.2, 0.1]
    Path("poses.txt").write_text("\n\n".join("\n".join(" ".join(map(str, row)) for row in pose)
                                 for pose in poses), encoding="utf-8")  # fmt: skip
    words = [*FLIGHT[:-2], "--path", "poses.txt"]
    assert ended(*words, "-o", "out") == 0
    made = levels("out")
    moved = alone(1, "render", "--move", "0.2,0,0")
    covered = moved[..., 3] == 255
    assert covered.mean() > 0.8
    np.testing.assert_array_equal(made[1][covered], moved[covered])


@pytest.mark.sweep
def test_a_longer_flight_shows_the_film_again():
    words = [*FLIGHT, "--frames", "5", "--path", "still.txt"]
    words.remove("--amount"), words.remove("0.3")
    np.savetxt("still.txt", np.eye(4))
    assert ended(*words, "-o", "out") == 0
    made = levels("out")
    assert len(made) == 5
    np.testing.assert_array_equal(made[3], made[0])
    np.testing.assert_array_equal(made[4], made[1])


def test_a_flight_goes_on_where_it_ended(capsys):
    assert ended(*FLIGHT, "-o", "out") == 0
    whole = frames("out")
    Path("out/frame-0001.png").unlink()
    assert ended(*FLIGHT, "-o", "out", "--resume") == 0
    assert frames("out") == whole
    np.save("stack.npy", np.full((COUNT, *SHAPE), 3.0, np.float32))
    words = ["animate", "pictures", "stack.npy", *FAST, "--amount", "0.3"]
    assert ended(*words, "-o", "out", "--resume") == 2
    assert "holds frames of another animation" in capsys.readouterr().err


def test_a_flight_through_a_film_is_the_same_elsewhere(monkeypatch):
    pickle_for_workers(monkeypatch)
    assert_same_film(cli.app, [*FLIGHT, "--size", "20x15"])


@pytest.mark.sweep
def test_a_flight_lasts_as_long_as_its_film():
    assert ended("animate", "film.gif", "depth", *DEPTH, *FAST, "-o", "out.webp") == 0
    with Image.open("out.webp") as file:
        file.seek(1)
        file.load()
        assert file.info["duration"] == 80


def test_a_flight_writes_the_depth_of_its_frames():
    assert ended(*FLIGHT, "-o", "out.apng", "--depth-output", "z/*.npy") == 0
    assert len(list(Path("z").iterdir())) == COUNT
    first = np.load("z/0000.npy")
    known = np.isfinite(first)
    np.testing.assert_allclose(first[known], np.load("stack.npy")[0][known], atol=1e-3)


def test_small_maps_of_a_shot_are_enlarged_as_its_first_one(monkeypatch):
    decisions = iter([True])  # another question would fail
    monkeypatch.setattr(films, "is_sharpened", lambda _: next(decisions))
    np.save("small.npy", np.load("stack.npy")[:, ::2, ::2])
    words = ["render", "pictures", "small.npy", *FAST, *MOVED, "--depth-output", "z/*.npy"]
    assert ended(*words, "-o", "out") == 0
    for file in Path("z").iterdir():
        z = np.load(file)
        assert ((z > 1.2) & (z < 1.8)).any()


# Relative depth


def still_film(bits, noise=0.0):
    """A still film of a room; the scale of its relative depth varies by 15 %, and it has noise."""
    picture, near = room(48)[0], 1 / room(48)[1].astype(float)
    rng = np.random.default_rng(5)
    for name in ("still", "relative"):
        Path(name).mkdir()
    for n in range(4):
        cv2.imwrite(f"still/{n}.png", picture)
        smooth = cv2.GaussianBlur(rng.normal(0, 1, near.shape), (0, 0), 2)
        noisy = near + noise * near.max() * smooth / smooth.std()
        raw = np.exp(rng.normal(0, 0.15)) * noisy + rng.normal(0, 0.05) * near.max()
        if bits is None:
            np.save(f"relative/{n}.npy", raw)
            continue
        share = np.clip(raw / (2 * near.max()), 0, 1)
        cv2.imwrite(f"relative/{n}.png", np.rint(share * (2**bits - 1)).astype(f"uint{bits}"))
    return ["render", "still", "relative", "--depth-kind", "relative", "--move", "0.1,0,0"]


def flicker(path):
    """Largest change of a level from frame to frame."""
    made = np.array(levels(path)).astype(int)
    return np.abs(np.diff(made, axis=0)).max()


@pytest.mark.sweep
@pytest.mark.parametrize("bits", [None, 16, 8])
def test_a_still_film_does_not_flicker_where_its_depths_scale_varies(bits, capsys):
    words = [*still_film(bits), "--fill"]
    assert ended(*words, "--stats", "stats.json", "-o", "out") == 0
    assert flicker("out") <= 1
    assert "their shifts are aligned; --temporal none" in capsys.readouterr().err
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert stats["temporal"] == "aligned"
    assert len(stats["scale"]) == 4


def test_a_still_film_does_not_flicker_where_its_depth_is_noisy():
    words = [*still_film(None, noise=0.03), "--fill"]
    assert ended(*words, "-o", "out") == 0
    assert flicker("out") <= 4


def test_without_alignment_relative_depth_has_one_range():
    words = [*still_film(None), "--fill"]
    assert ended(*words, "--temporal", "none", "--stats", "stats.json", "-o", "out") == 0
    assert flicker("out") > 40
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert stats["temporal"] == "none"


def test_cuts_are_told(capsys):
    words = still_film(None)
    for n in (2, 3):
        Image.fromarray(255 - np.array(Image.open(f"still/{n}.png"))[::-1]).save(f"still/{n}.png")
    assert ended(*words, "-o", "out") == 0
    assert "each shot has its own range; cuts before picture 2;" in capsys.readouterr().err


@pytest.mark.sweep
def test_frames_of_aligned_depth_are_the_same_in_any_order():
    words = ["animate", *still_film(8)[1:5], "--path", "sway"]
    assert ended(*words, "-o", "out") == 0
    whole = frames("out")
    for n in (1, 3):
        Path(f"out/frame-{n:04d}.png").unlink()
    assert ended(*words, "-o", "out", "--resume") == 0
    assert frames("out") == whole


@pytest.mark.sweep
@pytest.mark.parametrize("command", ["render", "stereo"])
def test_films_of_panoramas_are_made_as_pictures_are(command, rng):
    Path("pano").mkdir()
    for n in range(2):
        cv2.imwrite(f"pano/{n}.png", rng.integers(0, 256, (16, 32, 3), np.uint8))
    np.save("length.npy", 2 + rng.random((2, 16, 32)))
    np.save("one.npy", np.load("length.npy")[1])
    words = ["--source-projection", "equirectangular", "--fill", "--refine", "none"]
    eyes = ["--depth-kind", "z", "--layout", "sbs", "--eyes", "0.1"]
    words += MOVED if command == "render" else eyes
    assert ended(command, "pano", "length.npy", *words, "-o", "out") == 0
    assert ended(command, "pano/1.png", "one.npy", *words, "-o", "one.png") == 0
    one = np.array(Image.open("one.png").convert("RGBA"))
    np.testing.assert_array_equal(levels("out")[1], one)
