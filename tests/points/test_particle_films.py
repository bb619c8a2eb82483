"""Films around particles, and particles in pages."""

import shlex
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample.cameras.viewpoints import Orbit
from resample.view.exports import exports_of
from resample.watching import Cancel
from resample_points import Cloud, cli, column_density, read_particles
from resample_points.command.choices import CloudStart
from resample_points.command.particles import FEW
from resample_points.data.particles import Particles
from resample_points.geometry.framing import ball_around
from resample_points.scenes import camera_of, cameras_of
from resample_points.viewing import map_of, suits, view_of
from tests import commands, snapshots

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
    assert ended("animate", "a.hdf5", "--frames", "4", *SMALL, *span, "-o", "film") == 0
    frames, gas = pictures("film"), read_particles("a.hdf5")
    nothing = np.empty((0, 3), np.float32)
    cloud = Cloud(gas.position, nothing, nothing, np.empty(0, np.float32))
    turn = [Orbit(azimuth=30 + 90 * n, elevation=20, fov=40, up="z") for n in range(4)]
    for frame, camera in zip(frames, cameras_of(cloud, turn, (36, 48)), strict=True):
        value = column_density(gas, camera, size=(48, 36)).value
        share = np.clip(np.log10(np.maximum(value, 1)) / 2, 0, 1)
        assert abs(frame[..., 0] / 255 - share).max() < 2.1 / 255


def test_frames_of_a_film_have_the_fields_of_view_and_zooms_of_their_orbits(rng):
    """At one distance, from which the first field of view shows the whole cloud."""
    place, nothing = rng.normal(size=(50, 3)), np.empty((0, 3), np.float32)
    cloud = Cloud(place, nothing, nothing, np.empty(0, np.float32))
    fields, zooms = (40.0, 40.0, 25.0, 70.0), (1.0, 2.0, 1.0, 0.7)
    turn = [
        Orbit(azimuth=90 * n, elevation=20, fov=fov, zoom=zoom, up="z")
        for n, (fov, zoom) in enumerate(zip(fields, zooms, strict=True))
    ]
    found = cameras_of(cloud, turn, (36, 48))
    focal = [
        zoom * 18.0 / np.tan(np.radians(fov) / 2) for fov, zoom in zip(fields, zooms, strict=True)
    ]
    np.testing.assert_allclose([camera.fx for camera in found], focal)
    np.testing.assert_allclose([camera.fy for camera in found], focal)
    middle = (place.min(axis=0) + place.max(axis=0)) / 2
    eyes = [-camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3] for camera in found]
    away = np.linalg.norm(np.array(eyes) - middle, axis=1)
    np.testing.assert_allclose(away, away[0], rtol=1e-6)


@pytest.mark.parametrize("fov", [0.0, 40.0])
@pytest.mark.parametrize("pan", [(0.1, 0.3), (-0.2, 0.0), (0.0, -0.4)])
def test_content_is_panned_right_and_up_by_shares_of_the_shorter_side(rng, fov, pan):
    nothing = np.empty((0, 3), np.float32)
    cloud = Cloud(rng.normal(size=(50, 3)), nothing, nothing, np.empty(0, np.float32))
    middle, seen = ball_around(cloud)[0], []
    for given in ((0.0, 0.0), pan):
        orbit = Orbit(azimuth=40, elevation=20, fov=fov, zoom=1.5, up="z", pan=given)
        view = camera_of(cloud, (36, 48), orbit).view()
        place = view.rotation @ middle + view.translation
        flat = place[:2] / place[2] if fov else place[:2]
        seen.append(view.focal * flat + view.principal)
    np.testing.assert_allclose(seen[1] - seen[0], [36 * pan[0], -36 * pan[1]], atol=1e-9)


@pytest.mark.sweep
def test_colors_of_a_film_keep_their_range():
    assert (
        ended("animate", "a.hdf5", "--frames", "8", "--size", "80x64", "--color-bar", "-o", "film")
        == 0
    )
    bars = {frame[:, 90:].tobytes() for frame in pictures("film")}
    assert len(bars) == 1


@pytest.mark.sweep
def test_quantities_and_types_are_filmed(capsys):
    words = ("--quantity", "temperature", "--frames", "2", *SMALL)
    assert ended("animate", "a.hdf5", *words, "-o", "hot") == 0
    assert ended("animate", "a.hdf5", "--type", "dark", "--frames", "2", *SMALL, "-o", "dark") == 0
    assert pictures("hot")[0].tobytes() != pictures("dark")[0].tobytes()
    message = refused(capsys, "animate", "a.hdf5", "--type", "stars", *SMALL, "-o", "none")
    assert "no particles of type stars" in message
    assert not Path("none").exists()


def test_columns_are_filmed_as_particles_where_an_option_of_theirs_is_given():
    rng = np.random.default_rng(1)
    table = np.column_stack([rng.normal(size=(40, 3)), rng.uniform(1, 2, 40), np.full(40, 0.3)])
    np.savetxt("a.csv", table, delimiter=",", header="x,y,z,mass,h", comments="")
    for name, words in {"cloud": (), "gas": ("--log",)}.items():
        assert ended("animate", "a.csv", *words, "--frames", "2", *SMALL, "-o", name) == 0
    assert pictures("cloud")[0].tobytes() != pictures("gas")[0].tobytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("animate", "a.hdf5", "--point-size", "2", "-o", "a"), "option of clouds of points"),
        (("animate", "a.hdf5", "--least-opacity", "0.5", "-o", "a"), "option of 3D Gaussians"),
        (("animate", "a.hdf5", "--crop", "90:99,:,:", "-o", "a"), "no particle is in the box"),
        (("animate", "a.hdf5", "--colormap", "no", "-o", "a"), "colormap 'no'"),
        (("render", "a.hdf5", "-o", "a.png"), "holds particles, which `resample-points density`"),
    ],
)
def test_what_does_not_go_with_particles_is_refused(words, message, capsys):
    assert message in refused(capsys, *words)


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
    from resample_points.command.density import DensityOptions
    from resample_points.command.particles import ParticlePictures

    place = np.random.default_rng(1).normal(size=(2 * FEW + 5, 3))
    whole = ParticlePictures(Particles(place, 1.0, 0.1), DensityOptions())
    few = whole.fewer.particles
    assert len(few) <= FEW
    np.testing.assert_allclose(few.mass.sum(), len(place), rtol=1e-4)
    assert (
        ParticlePictures(read_particles("a.hdf5"), DensityOptions()).fewer.particles.box is not None
    )
