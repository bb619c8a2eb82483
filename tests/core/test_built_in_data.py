"""Built-in data: made by name, the same everywhere, and taken by every command."""

from pathlib import Path

import numpy as np
import pytest

import resample
from resample import registry
from resample.samples import finding
from resample.samples.finding import expanded, kept
from tests.commands import ended, refused

SMALL = {  # of each sample: parameters that make it small
    "bricks": "size=64",
    "checker-box": "size=16,block=4",
    "halo": "count=500",
    "knot": "along=60,around=8",
    "knot-gaussians": "count=500",
    "knot-points": "count=2000",
    "marschner-lobb": "size=12",
    "page": "",
    "room": "size=48",
    "test-card": "size=64",
    "vessel-tree": "size=24",
    "zone-plate": "size=64",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder; samples are kept beside it."""
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(tmp_path / "kept"))
    finding._passing.cache_clear()
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    yield tmp_path
    finding._passing.cache_clear()


def spec(name: str) -> str:
    return f"sample:{name}:{SMALL[name]}".removesuffix(":")


def app_of(application: str):
    return registry.load("apps", application)


def test_every_sample_is_tried_here():
    assert sorted(SMALL) == registry.names("samples")


@pytest.mark.some(3)
@pytest.mark.parametrize("name", SMALL)
def test_samples_are_the_same_whenever_they_are_made(name, tmp_path, monkeypatch):
    first = kept(spec(name))
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(tmp_path / "again"))
    finding._passing.cache_clear()
    second = kept(spec(name))
    files = [sorted(each.folder.iterdir()) for each in (first, second)]
    assert [file.name for file in files[0]] == [file.name for file in files[1]]
    assert first.folder != second.folder
    for one, other in zip(*files, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_files_of_a_sample_are_written_once(monkeypatch):
    first = kept(spec("bricks"))
    monkeypatch.setattr(finding, "_make", None)
    assert kept(spec("bricks")) == first
    assert [path.name for path in first.folder.parent.iterdir()] == [first.folder.name]


def test_a_sample_whose_generator_has_changed_is_made_anew(tmp_path):
    source = tmp_path / "maker.py"
    source.write_text("first")
    before = finding._digest("bricks", str(source))
    source.write_text("second")
    assert finding._digest("bricks", str(source)) != before


def test_nothing_is_left_of_a_sample_that_could_not_be_made(folder):
    with pytest.raises(ValueError, match="16 to 4096 px, not 4"):
        kept("sample:bricks:size=4")
    assert list((folder / "kept" / "samples").iterdir()) == []


def test_samples_are_made_where_none_can_be_kept(folder, monkeypatch):
    (folder / "file").write_text("")
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(folder / "file"))
    finding._passing.cache_clear()
    assert resample.sample_path(spec("bricks")).is_file()


def test_pictures_of_samples_are_stored_as_they_are():
    import cv2

    picture = resample.sample("bricks:size=64")
    stored = cv2.imread(str(resample.sample_path("bricks:size=64")))
    assert np.array_equal(stored[..., ::-1], picture)


def test_the_depth_of_the_room_is_exact_on_its_back_wall():
    room = resample.sample("room:size=48")
    assert room.depth.max() == np.float32(5.6)
    assert room.depth[20, 2] < 5.6


@pytest.mark.sweep
def test_the_room_seen_from_elsewhere_is_the_room_warped():
    from resample_warp3d import Camera, warp

    room = resample.sample("room:size=96")
    truth = resample.sample("room:size=96,x=0.2")
    camera = Camera.from_fov(room.fov, *room.depth.shape)
    moved = np.eye(4)
    moved[0, 3] = -0.2
    seen = warp(room.color, room.depth, camera, camera.moved(moved))
    known = seen.coverage > 0.99
    apart = np.abs(seen.to_uint8()[..., :3] / 255 - truth.color / 255)[known]
    assert known.mean() > 0.85
    assert np.median(apart) < 0.01  # pixels of checks and outlines differ


def test_volumes_come_back_from_their_files_as_they_are():
    from resample_volume import open_volume

    made = resample.sample(spec("marschner-lobb"))
    stored = open_volume(resample.sample_path(spec("marschner-lobb")))
    assert np.array_equal(made.values, stored.values)
    assert np.array_equal(made.spacing, stored.spacing)
    assert np.array_equal(made.origin, stored.origin)
    assert made.name == stored.name


@pytest.mark.sweep
def test_meshes_and_clouds_of_samples_are_read_as_they_were_made():
    from resample_meshes.rendering import load_mesh
    from resample_points import read_cloud

    mesh = resample.sample(spec("knot"))
    assert len(load_mesh(resample.sample_path(spec("knot"))).triangle) == len(mesh.triangle)
    cloud = resample.sample(spec("knot-points"))
    stored = read_cloud(resample.sample_path(spec("knot-points")))
    assert np.allclose(cloud.position, stored.position, atol=1e-6)
    assert np.allclose(cloud.normal, stored.normal, atol=1e-6)


@pytest.mark.sweep
def test_normals_of_the_knot_point_out_of_it():
    cloud = resample.sample("knot-points:count=4000")
    gap = np.linalg.norm(cloud.position[:, None] - cloud.position[None, :400], axis=2)
    inward = cloud.position[:400] - 0.3 * cloud.normal[:400]
    nearest = np.linalg.norm(cloud.position[:, None] - inward[None], axis=2).min(axis=0)
    assert gap.shape == (4000, 400)
    assert nearest.min() > 0.15  # the tube is 0.52 thick: nothing is near 0.3 below its surface


COMMANDS = {
    "texture warp": ["warp", "bricks", "--corners", "0,0 60,9 60,40 0,50"],
    "texture rectify": ["rectify", "page"],
    "texture mesh": ["mesh", "knot", "--size", "32"],
    "warp3d render": ["render", "room"],
    "warp3d stereo": ["stereo", "room"],
    "points render": ["render", "knot-points", "--size", "32"],
    "points render of Gaussians": ["render", "knot-gaussians", "--size", "32"],
    "points density": ["density", "halo", "--size", "32"],
    "volume render": ["render", "vessel-tree", "--size", "32"],
}


@pytest.mark.some(1)
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_take_samples_and_need_no_more(name):
    command, given, *words = COMMANDS[name]
    application = app_of(name.split()[0])
    assert ended(application, command, spec(given), *words, "--output", "out.png") == 0
    assert Path("out.png").is_file()


def test_what_a_sample_brings_yields_to_what_is_said():
    words = expanded(["render", spec("room"), "-o", "out.png", "--fov", "40", "--move=1,0,0"])
    assert not any(word.startswith("--source-pose") for word in words)
    assert [word for word in words if word.startswith("--move")] == ["--move=1,0,0"]


@pytest.mark.sweep
def test_a_room_compared_brings_what_is_really_seen():
    words = expanded(["compare", spec("room")])
    added = dict(word.split("=", 1) for word in words if word.startswith("--"))
    assert Path(added["--truth"]).name == "room.png"
    assert added["--move"] == "0.35,-0.05,0.1"


def test_options_for_pictures_take_samples():
    words = expanded(["mesh", spec("knot"), "--texture", spec("bricks"), f"--truth={spec('room')}"])
    assert words[3].endswith("bricks.png")
    assert words[4].endswith("room.png")
    assert len(words) == 5


def test_views_take_samples(capsys):
    np.savetxt("pose.txt", np.eye(4))
    view = f"{spec('room')},x=0.4,pose.txt"
    color, depth, pose = expanded(["render", "--view", view])[2].split(",")
    assert [Path(color).name, Path(depth).suffix, pose] == ["room.png", ".npy", "pose.txt"]
    assert expanded(["render", f"--view={view}"])[1].startswith("--view=")
    words = ["render", spec("room"), "--view", view, "-o", "out.png"]
    assert ended(app_of("warp3d"), *words, "--move", "0.4,0,0", "--fov", "60") == 0
    capsys.readouterr()
    for wrong in (spec("room"), "sample:bricks,pose.txt"):
        error = refused(app_of("warp3d"), capsys, "render", spec("room"), "--view", wrong)
        assert "give sample:NAME,POSE" in error


def test_an_unknown_sample_names_those_that_there_are(capsys):
    error = refused(app_of("texture"), capsys, "warp", "sample:brick", "-o", "out.png")
    assert "unknown sample 'brick', did you mean 'bricks'?" in error
    assert "vessel-tree" in error


def test_an_unknown_parameter_names_those_that_there_are(capsys):
    error = refused(app_of("texture"), capsys, "warp", "sample:bricks:rows=4", "-o", "out.png")
    assert "size=512" in error
