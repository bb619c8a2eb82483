"""Slabs of a thickness at a place: what they show, and that it is said if they hold nothing."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.command.settings import Resampling
from resample.files.images import read_channels
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume import Appearance, Scene, Volume, XRay, cli, render
from resample_volume.appearance import Classification
from resample_volume.command.choices import AppearanceChoices
from resample_volume.inputs import as_volume
from resample_volume.meshes import Section
from tests import commands

LAYERS = np.array([0, 10, 20, 30, 40, 50, 60, 70], np.float32)  # along y, the view from the front
FRONT = Orbit(0, 0, 1, 0)  # parallel rays along y
SIZE = (16, 16)
MIDDLE = SIZE[1] // 2, SIZE[0] // 2
SMALL = ["--size", "16", "--camera", "front", "--fov", 0]
ended = partial(commands.ended, cli.app)


def layers(spacing: float = 2.0) -> Volume:
    """Values that rise along y, 8 voxels of 2 units."""
    values = np.broadcast_to(LAYERS[:, None], (8, 8, 8)).copy()
    return as_volume(values)._replace(spacing=np.full(3, spacing), units="none")


def along(projection: Projection) -> Resampler:
    return Resampler(order=Rays(), projection=projection)


def middle_of(slab: str | None, projection: Projection, camera: object = FRONT) -> float:
    look = Appearance(slab=slab)
    frame = render(layers(), look, camera, size=SIZE, resampler=along(projection))
    return float(frame.value[MIDDLE])


# A slab of 4 units, 2 voxels, 2 units behind the middle: from 0 to 4, so values from 35 to 55.
@pytest.mark.parametrize("slab", ["2/4", "2/4/0/1/0", "2/4/0/0.5/0", "-2/4/0/-1/0"])
@pytest.mark.parametrize(
    ("projection", "value"),
    [
        (Projection.MAXIMUM, 55.0),
        (Projection.MINIMUM, 35.0),
        (Projection.AVERAGE, 45.0),
        (Projection.ADDITIVE, 180.0),
    ],
)
def test_a_slab_shows_what_lies_between_its_planes(slab, projection, value):
    assert middle_of(slab, projection) == pytest.approx(value, rel=0.01)


def test_a_slab_across_the_view_turns_with_it():
    back = Orbit(180, 0, 1, 0)
    assert middle_of("2/4", Projection.MAXIMUM, back) == pytest.approx(35, rel=0.01)
    assert middle_of("2/4/0/1/0", Projection.MAXIMUM, back) == pytest.approx(55, rel=0.01)


def test_in_perspective_a_slab_is_as_thick():
    near = Orbit(0, 0, 1, 30)
    assert middle_of("2/4", Projection.AVERAGE, near) == pytest.approx(45, rel=0.01)


def test_an_x_ray_of_a_slab_is_as_long():
    water = as_volume(np.zeros((8, 8, 8), np.float32))._replace(spacing=np.full(3, 2.0), units="hu")
    look = Appearance(xray=XRay(0.02), slab="2/5")
    frame = render(water, look, FRONT, size=SIZE)
    assert frame.value[MIDDLE] == pytest.approx(0.02 * 5, rel=0.01)


@pytest.mark.parametrize("classification", ["pre", "post"])
@pytest.mark.parametrize("slab", ["2/4", "2/4/0/1/0"])
def test_a_composite_of_a_slab_is_that_of_two_planes(classification, slab):
    cut = Appearance("0/white/0,100/white/0.5", classification=Classification(classification))
    clip = ("0/1/0/0", "0/-1/0/-4")
    one, other = (
        render(layers(), replace(cut, **by), FRONT, size=SIZE).rgba
        for by in ({"slab": slab}, {"clip": clip})
    )
    if slab == "2/4":  # the camera stands around the whole
        assert one[MIDDLE] == pytest.approx(other[MIDDLE], abs=0.02)
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("slab", ["2/4", "2/4/0/1/0"])
def test_a_scene_shows_slabs_in_previews_too(slab):
    scene, by = Scene(layers()), along(Projection.AVERAGE)
    for quality in ("final", "preview"):
        frame = scene.render(
            Appearance(slab=slab), FRONT, size=(32, 32), resampler=by, quality=quality
        )
        assert frame.value[16, 16] == pytest.approx(45, rel=0.03)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("20", "give its center"),
        ("20/10/1", "give its center"),
        ("a/b", "give its center"),
        ("nan/10", "give its center"),
        ("20/0", "its thickness must be above 0"),
        ("20/-1", "its thickness must be above 0"),
        ("20/10/0/0/0", "the normal must not be 0,0,0"),
    ],
)
def test_what_is_no_slab_is_refused_without_a_volume(text, complaint):
    for given in (Section.of, lambda one: Appearance(slab=one)):
        with pytest.raises(ValueError, match=f"slab .*{complaint}"):
            given(text)
    with pytest.raises(ValueError, match=complaint):
        AppearanceChoices(slab=text).renderer(Resampling())


# The command line


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)
    np.save("layers.npy", layers().values)


@pytest.mark.sweep
@pytest.mark.parametrize("slab", ["50/4", "-50/4/0/1/0"])
@pytest.mark.parametrize("projection", ["maximum", "composite"])
def test_a_slab_that_holds_nothing_is_said_once(capsys, slab, projection):
    words = ("--slab", slab, "--projection", projection, "-o", "out.exr", *SMALL)
    assert ended("render", "layers.npy", *words) == 0
    said = capsys.readouterr().err
    assert f"the slab {slab} holds nothing of layers" in said
    assert said.count("nothing") == 1
    assert read_channels("out.exr")["A"].max() == 0


@pytest.mark.sweep
@pytest.mark.parametrize("slab", ["50/4", "-50/4/0/1/0"])
def test_a_film_of_a_slab_that_holds_nothing_says_so(capsys, slab):
    words = ("--slab", slab, "--path", "still", "--frames", 1, "-o", "film", *SMALL)
    assert ended("animate", "layers.npy", *words) == 0
    assert f"the slab {slab} holds nothing of layers" in capsys.readouterr().err


@pytest.mark.some(1)
@pytest.mark.parametrize("slab", ["50/4", "-50/4/0/1/0"])
def test_a_film_of_times_says_it_too(capsys, slab):
    np.broadcast_to(layers().values, (2, 8, 8, 8)).tofile("beat.raw")
    read = ("--shape", "8x8x8x2", "--dtype", "float32", "--projection", "maximum")
    words = (*read, "--slab", slab, "--path", "still", "-o", "film", *SMALL)
    assert ended("animate", "beat.raw", *words) == 0
    said = capsys.readouterr().err
    assert said.count(f"the slab {slab} holds nothing of beat") == 1


@pytest.mark.sweep
def test_a_picture_that_no_ray_meets_says_so(capsys, tmp_path):
    camera = tmp_path / "aside.toml"
    camera.write_text("eye = [0, -50, 0]\ntarget = [90, -40, 0]\nfov = 20\n")
    words = ("--projection", "maximum", "--camera", camera, "-o", "out.png", "--size", "16")
    assert ended("render", "layers.npy", *words) == 0
    assert "the picture is empty: nothing visible lies in it" in capsys.readouterr().err
