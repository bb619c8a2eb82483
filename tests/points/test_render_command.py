"""`resample-points` renders clouds of files, and refuses in a line."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from resample.files.images import read_channels, read_image
from resample_points import cli
from tests import commands
from tests.intrinsics import write_intrinsics

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def scan() -> None:
    """Write scan.ply: a red patch of points at z 0."""
    place = np.stack([*np.mgrid[:20, :20], np.zeros((20, 20))], axis=2).reshape(-1, 3) / 10.0
    color = np.tile(np.uint8([255, 0, 0, 255]), (400, 1))
    trimesh.PointCloud(place, color).export("scan.ply")


def test_a_cloud_is_shown():
    scan()
    words = ["--camera", "0/90/1", "--size", "40x30", "-o", "scan.exr"]
    assert ended("render", "scan.ply", *words) == 0
    channels = read_channels("scan.exr")
    assert {"R", "G", "B", "A", "Z", "coverage"} <= set(channels)
    assert channels["A"][15, 20] == pytest.approx(1, abs=0.01)  # levels of coverage
    assert (channels["R"][15, 20], channels["G"][15, 20]) == pytest.approx((1, 0), abs=0.01)


def test_a_cloud_is_seen_from_a_pose():
    scan()
    matrix = np.eye(4)
    matrix[:3, 3] = (-1, -1, 3)
    np.savetxt("pose.txt", matrix)
    words = ["--pose", "pose.txt", "--intrinsics", "20,20,16,12", "--size", "32x24"]
    assert ended("render", "scan.ply", *words, "-o", "scan.exr") == 0
    channels = read_channels("scan.exr")
    assert channels["Z"][12, 16] == pytest.approx(3, abs=1e-3)  # float32 of the projection


@pytest.mark.some(2)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["-o", "o.gif"], "pictures are written as .png, .exr, .jpg"),
        (["-o", "o.png", "--camera", "leftish"], "give azimuth,elevation,zoom"),
        (["-o", "o.png", "--camera", "0/0/0"], "a zoom of 0"),
        (["-o", "o.png", "--pose", "p.txt"], "--pose and --intrinsics belong together"),
        (["-o", "o.png", "--size", "0"], "at least 1"),
        (["-o", "o.png", "--point-size", "0"], "a point size of 0"),
        (["-o", "none/o.png"], "cannot be written"),
    ],
)
def test_what_cannot_be_rendered_is_refused_in_one_line(words, complaint, capsys):
    scan()
    assert complaint in refused(capsys, "render", "scan.ply", *words)


@pytest.mark.sweep
def test_files_that_are_no_clouds_are_one_line(capsys):
    Path("text.ply").write_text("no cloud")
    for name in ("text.ply", "gone.ply", "picture.png"):
        assert name in refused(capsys, "render", name, "-o", "o.png")


@pytest.mark.sweep
def test_a_cloud_takes_a_filter_too():
    rng = np.random.default_rng(3)
    np.savez("scan.npz", position=rng.random((400, 3)), color=rng.random((400, 3)))
    words = ["render", "scan.npz", "--size", "32x24", "-o", "cloud.exr"]
    pictures = []
    for more in ([], ["--filter", "gaussian"]):
        assert ended(*words, *more) == 0
        pictures.append(read_image("cloud.exr"))
    assert np.abs(pictures[1] - pictures[0]).max() > 0.02


@pytest.mark.sweep
def test_a_cloud_is_seen_with_intrinsics_of_a_file():
    scan()
    write_intrinsics()
    np.savetxt("there.txt", np.eye(4))
    words = ["render", "scan.ply", "--pose", "there.txt", "--size"]
    assert ended(*words, "32x24", "--intrinsics", "20,20,16,12", "-o", "numbers.exr") == 0
    assert ended(*words, "32x24", "--intrinsics", "ros.yaml", "-o", "file.exr") == 0
    assert np.array_equal(read_image("file.exr"), read_image("numbers.exr"))
    assert ended(*words, "64x48", "--intrinsics", "40,40,32,24", "-o", "numbers.exr") == 0
    assert ended(*words, "64x48", "--intrinsics", "open3d.json", "-o", "file.exr") == 0
    assert np.array_equal(read_image("file.exr"), read_image("numbers.exr"))
