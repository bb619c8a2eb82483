"""Clouds that memory does not hold: in files they give the bits of those it does."""

import shutil
from collections import namedtuple
from functools import partial

import numpy as np
import pytest

from resample.command.session import Session
from resample.command.settings import Sharing
from resample.command.workers import share_memory
from resample.files.images import read_image
from resample.memory import allowing
from resample.memory.mapped import array_in_file, is_in_file
from resample_points import cli
from resample_points.command.choices import CloudOptions
from resample_points.command.gaussians import GaussianOptions
from resample_points.command.rendering import frames_of, scene_in, scene_of
from resample_points.data import parts
from resample_points.data.cloud import Cloud
from resample_points.data.columns import colored
from resample_points.files.readers import read_cloud
from resample_points.geometry import framing, sorting, spacing
from resample_points.geometry.framing import ball_around, framed, framed_together
from resample_points.geometry.spacing import prepare_cloud
from resample_points.painting import windows
from resample_points.painting.rendering import CloudStyle, index_cloud, render_cloud
from tests import commands
from tests.bits import assert_same
from tests.points.spinning import street

SIZE = (70, 50)
PAGES = 40_000  # bytes, of pages in memory
NONE = np.zeros((0, 3), np.float32)
ended = partial(commands.ended, cli.app)


@pytest.fixture(autouse=True)
def few_at_a_time(tmp_path, monkeypatch):
    """A cache of its own, and parts of few points."""
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))
    for module in (parts, framing):
        monkeypatch.setattr(module, "STEP", 700)


def ball(count, seed=1):
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(count, 3))
    return place / np.linalg.norm(place, axis=1)[:, None] * (1 + 0.01 * rng.normal(size=(count, 1)))


def plain():
    place = ball(3000) + np.array([435_000.0, 5_120_000.0, 250.0])
    return Cloud(place, NONE, ball(3000, 2).astype(np.float32) ** 2, np.zeros(0, np.float32))


def twice():
    """Points of which many are in one place, with colors and normals that differ."""
    place = np.concatenate([ball(2000), ball(900), np.zeros((5, 3))]).astype(np.float32)
    color, normal = (ball(2905, seed).astype(np.float32) for seed in (3, 4))
    return Cloud(place, normal, color**2, np.zeros(0, np.float32))


def unknown():
    """Points of which some have no place, no color or no normal."""
    given = twice()
    for n, part in enumerate(given[:3]):
        part[n::17] = np.nan
    return given


def stray():
    """Points beside one that is so far away that all others share a few steps of the curve."""
    far = np.concatenate([ball(3000).astype(np.float32), np.full((1, 3), 1e6, np.float32)])
    return Cloud(far, NONE, NONE, np.zeros(0, np.float32))


def sized():
    radius = np.random.default_rng(5).uniform(0.01, 0.05, 2905).astype(np.float32)
    radius[::31] = 0.0
    return twice()._replace(radius=radius, normal=NONE)


def rings():
    """Points along the rings of a spinning scanner."""
    return Cloud(street(0.01, 32, 512).place, NONE, NONE, np.zeros(0, np.float32))


CLOUDS = {each.__name__: each for each in (plain, twice, unknown, stray, sized, rings)}


def filed(values, pages=PAGES):
    """The same array, in a file."""
    if not len(values):
        return values
    held = array_in_file(values.shape, values.dtype, pages, "a cloud")
    held[:] = values
    return held


def in_files(cloud, pages=PAGES):
    columns = {name: filed(column) for name, column in cloud.columns.items()}
    return Cloud(*(filed(part, pages) for part in cloud[:4]), columns=columns)


def assert_same_discs(found, expected):
    for name in ("origin", "position", "axes", "color"):
        one, two = getattr(found, name), getattr(expected, name)
        assert (one.dtype, one.shape) == (two.dtype, two.shape), name
        assert one.tobytes() == two.tobytes(), name
    assert found.is_oriented == expected.is_oriented


@pytest.mark.some(1)
@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("pages", [PAGES, 10 * sorting.SORTED])
def test_a_cloud_in_files_has_the_discs_of_one_in_memory(name, pages, monkeypatch):
    expected = prepare_cloud(CLOUDS[name](), threads=1)
    monkeypatch.setattr(parts, "STEP", 333)
    found = prepare_cloud(in_files(CLOUDS[name](), pages), threads=2)
    assert is_in_file(found.position)
    assert is_in_file(found.axes)
    assert_same_discs(found, expected)


@pytest.mark.some(5)
@pytest.mark.parametrize("name", CLOUDS)
def test_a_cloud_in_files_knows_its_rows(name, monkeypatch):
    monkeypatch.setattr(parts, "STEP", 333)
    given = CLOUDS[name]()
    found = prepare_cloud(in_files(given, 10 * sorting.SORTED))
    assert is_in_file(found.source)
    assert len(np.unique(found.source)) == len(found.position)
    place = given.position[found.source] - found.origin
    np.testing.assert_array_equal(place.astype(np.float32), found.position)


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["plain", "unknown"])
def test_pixels_show_the_same_points_of_a_cloud_in_files(name):
    given = CLOUDS[name]()
    held, filed_ = prepare_cloud(given), prepare_cloud(in_files(given))
    camera = framed(held, size=SIZE, azimuth=30, elevation=20)
    found, expected = (index_cloud(each, camera, size=SIZE) for each in (filed_, held))
    assert (expected >= 0).mean() > 0.2
    np.testing.assert_array_equal(found, expected)


@pytest.mark.some(1)
@pytest.mark.parametrize("choices", [{"radius": 0.03}, {"largest": np.inf}, {"largest": 0.8}])
def test_choices_of_discs_hold_in_files(choices):
    expected = prepare_cloud(twice(), **choices)
    assert_same_discs(prepare_cloud(in_files(twice()), **choices), expected)


def discs(pages=PAGES):
    """Discs in memory and in files."""
    given = prepare_cloud(plain())
    axes, color = filed(given.axes, pages), filed(given.color, pages)
    return given, given._replace(position=filed(given.position, pages), axes=axes, color=color)


CAMERAS = {
    "whole": partial(framed, size=SIZE, azimuth=30, elevation=20),
    "inside": partial(framed, size=SIZE, azimuth=30, elevation=20, distance=0.9),
    "far": partial(framed, size=SIZE, distance=60.0),
}
STYLES = {
    "plain": {},
    "gray": {"style": CloudStyle(light="headlight", point_size=1.4, subpixels=3)},
    "filtered": {"filter": "gaussian:sigma=0.6"},
}


@pytest.mark.sweep
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("style", STYLES)
def test_a_cloud_in_files_has_the_picture_of_one_in_memory(camera, style):
    held, in_file = discs()
    seen = CAMERAS[camera](held)
    found, expected = (
        render_cloud(each, seen, size=SIZE, threads=count, **STYLES[style])
        for each, count in ((in_file, 2), (held, 1))
    )
    assert expected.coverage.any()
    assert_same(found, expected)
    for name in ("samples", "points", "splats", "hidden", "subpixels"):
        assert getattr(found.statistics, name) == getattr(expected.statistics, name), name


@pytest.mark.sweep
@pytest.mark.parametrize("pages", [1, 3000, 200_000, 10_000_000])
def test_pictures_do_not_depend_on_how_many_discs_are_painted_at_a_time(pages, monkeypatch):
    held, in_file = discs(pages)
    camera = framed(held, size=SIZE, azimuth=70)
    spans = []
    paint = windows.CloudInFiles.paint

    def counting(cloud, span):
        spans.append(span)
        paint(cloud, span)

    monkeypatch.setattr(windows.CloudInFiles, "paint", counting)
    assert_same(render_cloud(in_file, camera, size=SIZE), render_cloud(held, camera, size=SIZE))
    assert (len(spans) == 1) == (pages == 10_000_000)
    if pages == 1:
        assert all(last == first + 1 for first, last in spans)  # tile by tile


@pytest.mark.sweep
def test_cameras_of_a_cloud_in_files_are_those_of_one_in_memory():
    held, in_file = discs()
    angles = [(10.0 * n, 20.0) for n in range(9)]
    for one, two in zip(
        *(framed_together(each, size=SIZE, angles=angles) for each in (held, in_file)), strict=True
    ):
        assert one.world_to_camera.tobytes() == two.world_to_camera.tobytes()
    one, two = ball_around(held), ball_around(in_file)
    assert one[0].tobytes() == two[0].tobytes()
    assert one[1] == two[1]


def test_a_camera_looks_at_the_farthest_points_of_all(monkeypatch):
    held, _ = discs()
    few = framed(held, size=SIZE, azimuth=12, elevation=5)
    monkeypatch.setattr(framing, "STEP", 100_000)  # all in one part
    monkeypatch.setattr(parts, "STEP", 100_000)
    whole = framed(held, size=SIZE, azimuth=12, elevation=5)
    assert few.world_to_camera.tobytes() == whole.world_to_camera.tobytes()


@pytest.mark.parametrize("span", [None, "0.2,0.7", "2%,97.3%"])
@pytest.mark.parametrize("kind", [np.float64, np.uint16])
def test_colors_by_a_column_in_a_file_are_those_of_one_in_memory(span, kind, monkeypatch):
    column = (np.random.default_rng(8).random(3000) * 900).astype(kind)
    if kind is np.float64:
        column[5::90] = np.nan
    given = plain()._replace(columns={"time": column})
    expected, scale = colored(given, "time", span=span)
    monkeypatch.setattr(parts, "STEP", 700)
    found, found_scale = colored(in_files(given), "time", span=span)
    assert found_scale == scale
    assert found.color.tobytes() == expected.color.tobytes()
    assert is_in_file(found.color)


@pytest.mark.some(1)
@pytest.mark.parametrize("few", [90, 10_000])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.977, 1.0])
def test_quantiles_are_those_of_all_values(share, few, monkeypatch):
    monkeypatch.setattr(parts, "STEP", few)
    rng = np.random.default_rng(4)
    for values in (rng.normal(size=1501), rng.integers(0, 4, 900), np.array([3.0]), np.ones(800)):
        assert parts.quantile_of(values, share) == np.quantile(values, share)
    wide = np.array([-1e308, -1e-300, 0.0, 1e-300, 1e308, np.inf, np.nan])
    assert parts.quantile_of(wide, share) == np.quantile(wide[:5], share)


def written(path, kind):
    """A cloud in a file of a kind."""
    laser = pytest.importorskip("tests.laser")
    rng = np.random.default_rng(6)
    steps = np.round(ball(3000) * 900)
    places = dict(zip("xyz", (steps * 0.001 + np.array(laser.CENTER)).T, strict=True))
    levels = dict(zip(("red", "green", "blue"), rng.integers(0, 60_000, (3, 3000)), strict=True))
    columns = places | levels | {"intensity": rng.integers(0, 999, 3000)}
    if kind in ("ply", "pcd"):
        names = [*"xyz", "intensity"]
        table = np.stack([columns[name] for name in names], axis=1).astype("<f4")
        table[::50, 1] = np.nan
        if kind == "ply":
            lines = [f"property float {name}" for name in names]
            head = ["ply", "format binary_little_endian 1.0", "element vertex 3000", *lines]
            head.append("end_header")
        else:
            words = [" ".join([word, *each]) for word, each in zip(
                ("FIELDS", "SIZE", "TYPE"), (names, "4444", "FFFF"), strict=True
            )]  # fmt: skip
            head = [*words, "POINTS 3000", "DATA binary"]
        path.write_bytes("\n".join([*head, ""]).encode() + table.tobytes())
    elif kind == "copc":
        some = [slice(0, 500), slice(500, 3000)]
        each = [{name: column[rows] for name, column in columns.items()} for rows in some]
        path.write_bytes(laser.copc_of(each))
    else:
        columns |= {"withheld": np.arange(3000) % 7 == 0}
        if kind == "gray":
            columns = {name: columns[name] for name in columns if name not in levels}
        path.write_bytes(
            laser.las_of(columns, packed=kind == "laz", point_format=1 if kind == "gray" else 3)
        )
    return path


SUFFIXES = {"ply": "ply", "pcd": "pcd", "las": "las", "laz": "laz", "copc": "laz", "gray": "las"}


@pytest.mark.parametrize("kind", SUFFIXES)
def test_files_are_read_into_files_where_memory_does_not_hold_them(kind, tmp_path, monkeypatch):
    if kind not in ("ply", "pcd"):
        pytest.importorskip("laspy", reason="the extra las is not installed")
        pytest.importorskip("lazrs", reason="the extra las is not installed")
    path = written(tmp_path / f"a.{SUFFIXES[kind]}", kind)
    monkeypatch.setattr(parts, "STEP", 1 << 18)
    expected = read_cloud(path)
    assert not is_in_file(expected.position)
    for module in ("plain", "las"):
        monkeypatch.setattr(f"resample_points.files.{module}.STEP", 700)
    monkeypatch.setattr(parts, "STEP", 700)
    with allowing("400kB"):
        found = read_cloud(path, columns=["intensity"])
    assert is_in_file(found.position)
    for one, two in zip(found[:4], expected[:4], strict=True):
        assert (one.dtype, one.tobytes()) == (two.dtype, two.tobytes())
    assert list(found.columns) == ["intensity"]
    assert found.columns["intensity"].tobytes() == expected.columns["intensity"].tobytes()
    with pytest.raises(ValueError, match=r"no column 'time'; known: x, y, z, .*intensity"):
        read_cloud(path, columns=["time"])


@pytest.fixture
def scan(tmp_path, monkeypatch):
    """The working folder of commands, with scan.ply."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RESAMPLE_LOG", "info")
    monkeypatch.setattr(parts, "memory_in_use", lambda: 0)
    return written(tmp_path / "scan.ply", "ply")


@pytest.mark.sweep
@pytest.mark.usefixtures("scan")
def test_a_command_says_that_memory_does_not_hold_a_cloud_and_paints_it(
    tmp_path, monkeypatch, capsys
):
    words = ["--color-by", "intensity", "--range", "2%,98%", "--size", "64x48"]
    assert ended("render", "scan.ply", *words, "-o", "a.exr") == 0
    shown = ["--size", "64x48", "--index"]
    assert ended("render", "scan.ply", *shown, "a.npy", "-o", "a.png") == 0
    film = ["--size", "32x24", "--frames", "3"]
    assert ended("animate", "scan.ply", *film, "-o", "a") == 0
    assert "are in files" not in capsys.readouterr().err
    monkeypatch.setattr(parts, "PER_POINT", 10**6)
    little = ["--memory", "1GiB"]
    assert ended("render", "scan.ply", *words, *little, "-o", "b.exr") == 0
    told = capsys.readouterr().err
    assert "scan.ply has 3,000 points, which would take 2.79 GiB of memory, and 1.00 GiB" in told
    assert ended("animate", "scan.ply", *film, *little, "-o", "b") == 0
    assert "are in files of" in capsys.readouterr().err
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
    assert ended("render", "scan.ply", *shown, "b.npy", *little, "-o", "b.png") == 0
    assert np.array_equal(np.load("a.npy"), np.load("b.npy"))
    for n in range(3):
        name = f"frame-{n:04}.png"
        assert np.array_equal(read_image(f"a/{name}"), read_image(f"b/{name}"))
    assert list((tmp_path / "cache").glob("tmp*")) == []


def test_frames_that_are_made_elsewhere_keep_to_their_share_of_memory(scan, monkeypatch, caplog):
    scene = scene_of(Session(), scan, CloudOptions(no_cache=True))
    cameras = [framed(scene.scene.surfels, size=(32, 24), azimuth=angle) for angle in (0, 90)]
    film = scene.film(cameras, (24, 32), (0.0, 0.0, 0.0))
    monkeypatch.setattr(parts, "PER_POINT", 10**6)
    with allowing("3GiB"), caplog.at_level("INFO", "resample"):
        share_memory(Sharing(workers=2))
        read = partial(scene_in, [scan], scene.options, GaussianOptions())
        elsewhere = frames_of(read, cameras, (24, 32), (0.0, 0.0, 0.0), 1)
    assert "and 1.00 GiB may be used: they are in files" in caplog.text
    for n in range(2):
        assert np.array_equal(elsewhere(n), film.frame(n))


@pytest.mark.usefixtures("scan")
def test_a_disk_without_room_is_said_in_a_line(monkeypatch, capsys):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10, 10, 0))
    monkeypatch.setattr(parts, "PER_POINT", 10**6)
    assert ended("render", "scan.ply", "--memory", "1GiB", "-o", "a.png") == 2
    told = capsys.readouterr().err.splitlines()
    assert "error: scan.ply: scan.ply is" in told[-1]
    assert "cannot be kept in a file" in told[-1]


def test_a_stray_point_too_far_for_memory_is_said(monkeypatch):
    given = in_files(stray())
    monkeypatch.setattr(spacing, "memory_left", lambda: 1000)
    with pytest.raises(ValueError, match=r"are so far away .* drop those points, or allow more"):
        prepare_cloud(given)
