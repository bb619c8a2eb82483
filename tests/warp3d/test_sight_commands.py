"""Panoramas, lenses and parallel rays on the command line."""

import json
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.cameras.pixels import Equirectangular
from resample.files.formats import WriteOptions
from resample.files.images import read_channels, read_image
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from resample.measuring.quality import psnr
from resample_warp3d import cli
from resample_warp3d.command.source import SourceCamera
from tests import commands
from tests.warp3d.naive_sights import traced
from tests.warp3d.test_sights import EYE, SHAPE, SOURCES, TARGETS, THINGS, pose

AROUND = "--source-projection", "equirectangular"
PARALLEL = "--source-projection", "orthographic", "--pixel-size", 1 / 60
HEIGHT = 64
PANORAMA = Equirectangular(pose(EYE))
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


def store(name, camera, shape):
    """Write a picture and depth; returns them."""
    color, depth = traced(THINGS, camera, shape)
    write_picture(name, Picture(color, Kind(("R", "G", "B"), 32, is_encoded=False)), WriteOptions())
    np.save(name.with_suffix(".npy"), depth)
    np.savetxt(name.with_suffix(".txt"), camera.world_to_camera)
    return color, depth


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A folder of pictures with depth."""
    made = tmp_path_factory.mktemp("stored")
    store(made / "around.exr", PANORAMA, (HEIGHT, 2 * HEIGHT))
    store(made / "parallel.exr", SOURCES["orthographic"], SHAPE)
    store(made / "flat.exr", SOURCES["pinhole"], SHAPE)
    np.savetxt(made / "target.txt", TARGETS["pinhole"].world_to_camera)
    return made


@pytest.fixture(autouse=True)
def folder(stored, tmp_path, monkeypatch):
    shutil.copytree(stored, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def made(name, *words):
    files = f"{name}.exr", f"{name}.npy"
    rest = "--source-pose", f"{name}.txt", "--refine", "none", "-o", "out.exr"
    assert ended("render", *files, *words, *rest) == 0
    return read_image("out.exr")


def near(record, what, picture, camera, shape):
    whole = picture[..., 3] > 0.97
    assert whole.sum() > 400
    record.quality(what, psnr(picture[..., :3], traced(THINGS, camera, shape)[0], mask=whole))


@pytest.mark.sweep
def test_a_panorama_is_seen_by_a_pinhole(record):
    words = *AROUND, "--pose", "target.txt", "--target-fov", 60, "--size", "128x96"
    near(record, "picture", made("around", *words), TARGETS["pinhole"], SHAPE)  # rims grow


@pytest.mark.sweep
def test_a_panorama_is_seen_as_one_by_default(record):
    picture = made("around", *AROUND, "--pose", "target.txt")
    near(record, "picture", picture, TARGETS["equirectangular"], (64, 128))


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["ray", pytest.param("z", marks=pytest.mark.sweep)])
def test_depth_of_a_panorama_is_along_its_rays(kind, record):
    written = made("around", *AROUND, "--depth-kind", kind, "--move", "0,0,0")
    near(record, "picture", written, PANORAMA, (HEIGHT, 2 * HEIGHT))


@pytest.mark.sweep
def test_parallel_rays_are_seen_by_a_pinhole_and_as_such(record):
    words = *PARALLEL, "--pose", "target.txt", "--target-fov", 60
    near(record, "pinhole", made("parallel", *words), TARGETS["pinhole"], SHAPE)
    parallel = made("parallel", *PARALLEL, "--move", "0,0,0")
    near(record, "parallel", parallel, SOURCES["orthographic"], SHAPE)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("lens", ["--target-lens", "90,90,63.5,47.5,-0.2,0.03,0.001,-0.002"]),
        ("orthographic", ["--target-projection", "orthographic", "--target-pixel-size", 0.02]),
        ("fisheye", ["--target-lens", "fisheye.json"]),
        ("equirectangular", ["--target-projection", "equirectangular", "--size", "192x96"]),
    ],
)
def test_a_picture_is_seen_by_other_cameras(target, words, record):
    matrix = [[60, 0, 63.5], [0, 60, 47.5], [0, 0, 1]]
    facts = {"K": matrix, "D": [0.02, -0.01, 0.003, 0], "lens_model": "fisheye"}
    with open("fisheye.json", "w") as file:
        json.dump(facts, file)
    shape = (96, 192) if target == "equirectangular" else SHAPE
    picture = made("flat", "--fov", 70, "--pose", "target.txt", *words)
    near(record, "picture", picture, TARGETS[target], shape)


@pytest.mark.sweep
def test_panoramas_have_stats_holes_and_depth():
    extra = "--stats", "s.json", "--holes", "h.png", "--depth-output", "d.npy"
    made("around", *AROUND, "--move", "0.1,0,0", *extra)
    assert len(json.loads(Path("s.json").read_text())["sources"]) == 6
    assert np.load("d.npy").shape == (HEIGHT, 2 * HEIGHT)
    assert read_channels("h.png")


@pytest.mark.sweep
def test_a_film_of_a_panorama_has_frames():
    words = *AROUND, "--target-fov", 60, "--size", "40x30", "--frames", 2, "-o", "film.gif"
    assert ended("animate", "around.exr", "around.npy", *words) == 0


@pytest.mark.some(9)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([*AROUND, "--fov", "60"], "--fov is for a pinhole"),
        ([*AROUND, "--pixel-size", "1"], "belong together"),
        (["--source-projection", "orthographic"], "belong together"),
        (["--fov", "60", "--pixel-size", "1"], "--pixel-size belongs to"),
        ([*AROUND, "--depth-kind", "disparity", "--baseline", "1"], "known: z, ray, inverse"),
        ([*AROUND, "--target-projection", "pinhole"], "needs --target-fov"),
        ([*AROUND, "--view", "a,b,c"], "--view needs pictures of a pinhole"),
        ([*AROUND, "--export", "a.ply"], "--export needs pictures of a pinhole"),
        ([*AROUND, "--target-fov", "60", "--target-lens", "1,1,1,1,1,0,0,0"], "not both"),
        (["--fov", "60", "--target-projection", "equirectangular"], "twice as wide as high"),
        (["--fov", "60", "--target-projection", "orthographic"], "belong together"),
        (
            ["--fov", "60", "--target-lens", "1,1,1,1,1,0,0,0", "--method", "mesh"],
            "use the method hybrid",
        ),
    ],
)
def test_what_does_not_go_together_is_said_in_a_line(words, complaint, capsys):
    name = "around" if AROUND[0] in words and "equirectangular" in words[:2] else "flat"
    files = f"{name}.exr", f"{name}.npy"
    said = refused(capsys, "render", *files, "--move", "0,0,0", *words, "-o", "o.png")
    assert complaint in said


def test_the_size_of_pixels_belongs_to_parallel_pictures():
    with pytest.raises(ValueError, match="--pixel-size belongs to --source-projection ortho"):
        SourceCamera(fov=60.0, pixel_size=1.0).check()
    SourceCamera(fov=60.0).check()
