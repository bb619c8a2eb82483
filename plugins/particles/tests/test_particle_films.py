"""Films around particles, and particles in pages."""

import shlex
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import resample_particles
import resample_points
from resample.cameras.viewpoints import Orbit
from resample.progress import Cancel
from resample.view.views import exports_of
from resample_particles import column_density, read_particles
from resample_particles.particles import Particles
from resample_particles.pictures import FEW
from resample_particles.viewing import map_of
from resample_points import Cloud, animate, cli
from resample_points.command.choices import CloudStart
from resample_points.scenes import cameras_of
from resample_points.viewing import map_of as old_map_of
from resample_points.viewing import suits, view_of
from tests import commands, snapshots
from tests.elsewhere import assert_same_film, pickle_for_workers

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
SMALL = ("--size", "48x36")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    snapshots.swift("a.hdf5")
    return tmp_path


def pictures(name):
    return [np.asarray(Image.open(path)) for path in sorted(Path(name).glob("*.png"))]


@pytest.mark.sweep
def test_frames_of_a_film_are_the_maps_of_its_cameras():
    span = ("--range", "1,100", "--colormap", "gray")
    assert ended("density", "a.hdf5", "--frames", "4", *SMALL, *span, "-o", "film") == 0
    frames, gas = pictures("film"), read_particles("a.hdf5")
    nothing = np.empty((0, 3), np.float32)
    cloud = Cloud(gas.position, nothing, nothing, np.empty(0, np.float32))
    turn = [Orbit(azimuth=30 + 90 * n, elevation=20, fov=40, up="z") for n in range(4)]
    for frame, camera in zip(frames, cameras_of(cloud, turn, (36, 48)), strict=True):
        value = column_density(gas, camera, size=(48, 36)).value
        share = np.clip(np.log10(np.maximum(value, 1)) / 2, 0, 1)
        assert abs(frame[..., 0] / 255 - share).max() < 2.1 / 255


@pytest.mark.sweep
def test_colors_of_a_film_keep_their_range():
    assert (
        ended("density", "a.hdf5", "--frames", "8", "--size", "80x64", "--color-bar", "-o", "film")
        == 0
    )
    bars = {frame[:, 90:].tobytes() for frame in pictures("film")}
    assert len(bars) == 1


@pytest.mark.sweep
def test_quantities_and_types_are_filmed(capsys):
    words = ("--quantity", "temperature", "--frames", "2", *SMALL)
    assert ended("density", "a.hdf5", *words, "-o", "hot") == 0
    assert ended("density", "a.hdf5", "--type", "dark", "--frames", "2", *SMALL, "-o", "dark") == 0
    assert pictures("hot")[0].tobytes() != pictures("dark")[0].tobytes()
    message = refused(capsys, "density", "a.hdf5", "--type", "stars", *SMALL, "-o", "none")
    assert "no particles of type stars" in message
    assert not Path("none").exists()


def test_columns_are_filmed_as_points_or_as_particles():
    rng = np.random.default_rng(1)
    table = np.column_stack([rng.normal(size=(40, 3)), rng.uniform(1, 2, 40), np.full(40, 0.3)])
    np.savetxt("a.csv", table, delimiter=",", header="x,y,z,mass,h", comments="")
    for name, command in {"cloud": "animate", "gas": "density"}.items():
        assert ended(command, "a.csv", "--frames", "2", *SMALL, "-o", name) == 0
    assert pictures("cloud")[0].tobytes() != pictures("gas")[0].tobytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("animate", "a.hdf5", "-o", "a"), "holds particles, which `resample-points density`"),
        (("info", "a.hdf5"), "holds particles, which `resample-points density`"),
        (("density", "a.hdf5", "--crop", "90:99,:,:", "-o", "a"), "no particle is in the box"),
        (("density", "a.hdf5", "--colormap", "no", "-o", "a"), "colormap 'no'"),
        (("density", "a.hdf5", "--axis", "x", "-o", "a"), "--axis is for one map"),
        (("density", "a.hdf5", "--bits", "16", "-o", "a.gif"), "films have 8 bits"),
        (("density", "a.hdf5", "--slice", "50%", "-o", "a.gif"), "a slice at"),
        (("density", "a.hdf5", "--frames", "2", "-o", "a.png"), "a.png is one map; give a film"),
        (("density", "a.hdf5", "a.hdf5", "-o", "a.npy"), "leave out further files"),
        (("render", "a.hdf5", "-o", "a.png"), "holds particles, which `resample-points density`"),
    ],
)
def test_what_does_not_go_with_particles_is_refused(words, message, capsys):
    assert message in refused(capsys, *words)


@pytest.mark.sweep
def test_files_that_are_a_frame_each_have_the_colors_of_the_first():
    words = ("--size", "48x64", "--path", "still", "--color-bar")
    snapshots.swift("b.hdf5", a=0.25)
    assert ended("density", "a.hdf5", "b.hdf5", *words, "-o", "both") == 0
    assert ended("density", "a.hdf5", "--frames", "1", *words, "-o", "one") == 0
    first, second = pictures("both")
    np.testing.assert_array_equal(first, pictures("one")[0])
    np.testing.assert_array_equal(first[:, 48:], second[:, 48:])  # one bar
    assert (first[:, :48] != second[:, :48]).any()


def test_python_films_snapshots_as_the_command_does():
    animate("a.hdf5", "python", frames=2, size="48x36", kind="dark")
    assert ended("density", "a.hdf5", "--type", "dark", "--frames", "2", *SMALL, "-o", "said") == 0
    for one, other in zip(pictures("python"), pictures("said"), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.sweep
def test_workers_make_the_same_films(monkeypatch):
    pickle_for_workers(monkeypatch)
    assert_same_film(cli.app, ["density", "a.hdf5", "--frames", "3", *SMALL])


def test_names_of_the_application_are_those_of_this_package():
    for name in ("DensityMap", "Particles", "column_density", "read_particles"):
        assert getattr(resample_points, name) is getattr(resample_particles, name)
    assert old_map_of is map_of


def test_pages_show_particles_as_the_command_does():
    assert suits(["a.hdf5"])
    page = view_of(Path("a.hdf5"))
    assert page.about["subtitle"] == "60 particles"
    settings = {**page.about["settings"], "color-bar": True, "range": "1,300"}
    texts = exports_of(page.about, settings, (80, 64))
    assert ended(*shlex.split(texts["command"])[1:]) == 0
    told = np.asarray(Image.open("picture.png"))
    painter = page.painter()
    whole, quick = (
        painter.paint(settings, (80, 64), quick=quick, cancel=Cancel()) for quick in (False, True)
    )
    np.testing.assert_array_equal(whole.levels, told)
    assert quick.levels.shape[0] == 64
    np.testing.assert_array_equal(np.asarray(map_of("a.hdf5", {**settings, "size": "80x64"})), told)
    found = painter.pick(settings, (80, 64), 40, 32)
    assert set(found) <= {"column density"}
    with pytest.raises(ValueError, match="no option 'point-size'"):
        page.refuse({"point-size": 2})


def test_pages_of_particles_fill_the_view_and_measure_across_it():
    page = view_of(Path("a.hdf5"))
    assert page.about["fills"]
    assert page.about["measures"]
    given = view_of(Path("a.hdf5"), (CloudStart(camera="front"),))
    assert not given.about["fills"]
    painter, size = page.painter(), (80, 64)
    settings = {**page.about["settings"], "fov": 0.0, "camera": "front"}
    assert painter.paint(settings, size, quick=True, cancel=Cancel()).about["view"]["size"] == size
    places = [
        np.array(painter.pick(settings, size, x, 32)["position"].split(","), float)
        for x in (36.5, 44.5)
    ]
    _, scene, camera = painter._placed(settings, size)
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(8 / camera.sx, rel=1e-4)
    depth = [(camera.world_to_camera[2] @ [*place, 1]) for place in [*places, scene.middle]]
    np.testing.assert_allclose(depth, depth[2], rtol=1e-4)


def test_pages_begin_with_a_type_that_is_there():
    gas = Path("a.hdf5")
    import h5py

    with h5py.File(gas, "a") as file:
        del file["PartType0"]
    page = view_of(gas)
    assert page.about["settings"]["type"] == "dark"


@pytest.mark.sweep
def test_a_page_s_film_is_that_of_the_command():
    page = view_of(Path("a.hdf5"))
    cameras, settings = ["350/20/1", "10/30/1.5"], {"background": "white", "size": "48x36"}
    painter = page.painter()
    keyframes = painter.keyframes(cameras, settings)
    Path("keyframes.toml").write_text(keyframes)
    painter.film(settings, (48, 36), keyframes, Path("page.gif"), lambda _: None)
    texts = exports_of(page.about, settings, (48, 36), cameras, keyframes)
    words = [*shlex.split(texts["film"])[1:-1], "command.gif"]
    assert ended(*words) == 0
    assert Path("page.gif").read_bytes() == Path("command.gif").read_bytes()


def test_previews_keep_the_mass():
    from resample_particles.choices import DensityOptions
    from resample_particles.pictures import ParticlePictures

    place = np.random.default_rng(1).normal(size=(2 * FEW + 5, 3))
    whole = ParticlePictures(Particles(place, 1.0, 0.1), DensityOptions())
    few = whole.fewer.particles
    assert len(few) <= FEW
    np.testing.assert_allclose(few.mass.sum(), len(place), rtol=1e-4)
    assert (
        ParticlePictures(read_particles("a.hdf5"), DensityOptions()).fewer.particles.box is not None
    )
