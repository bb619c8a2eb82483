"""X-rays of computed tomography against formulas, and what is said where there are none."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from resample.cameras.files import viewpoint
from resample.cameras.models import Camera, Orthographic
from resample.colors import from_srgb, to_srgb
from resample.command.settings import Resampling
from resample.files.images import read_channels, read_image
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume import Appearance, Scene, Volume, XRay, cli, render
from resample_volume.command import rendering
from resample_volume.command.choices import AppearanceChoices
from resample_volume.inputs import as_volume
from resample_volume.rendering import Subject
from resample_volume.series import Series
from resample_volume.types import Recording
from resample_volume.viewing import picture
from tests import commands

AIR, WATER, BONE = -1000.0, 0.0, 1000.0
RADIUS, MU = 12.0, 0.02
SIDE = 33
LEAST, PER_UNIT = 4, 5  # places along a voxel's side, whose mean it holds
EVEN, FLAT = (1.0, 1.0, 1.0), (0.5, 0.5, 3.0)
PLAIN = XRay(MU)
RAYS = Resampler(order=Rays(), projection=Projection.XRAY)
BY_XRAY = ["--projection", "xray", "--units", "hu"]
SMALL = ["--size", "24"]
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)


def in_hu(values: np.ndarray, spacing: tuple[float, ...] = EVEN, units: str = "hu") -> Volume:
    made = as_volume(np.asarray(values, np.float32))
    return made._replace(spacing=np.array(spacing), units=units)


def ball(spacing: tuple[float, float, float] = EVEN, inside: float = WATER) -> Volume:
    """Ball in air, around the origin; voxels hold means over themselves."""
    count = [2 * int(np.ceil((RADIUS + 3) / step)) + 1 for step in spacing]
    fine = [LEAST if step <= 1 else int(PER_UNIT * step) for step in spacing]
    x, y, z = (
        (np.arange(n * per) - (n * per - 1) / 2) * step / per
        for n, step, per in zip(count, spacing, fine, strict=True)
    )
    is_in = x**2 + y[:, None] ** 2 + z[:, None, None] ** 2 <= RADIUS**2
    sizes = [part for pair in zip(count[::-1], fine[::-1], strict=True) for part in pair]
    share = is_in.reshape(sizes).mean(axis=(1, 3, 5), dtype=np.float32)
    volume = in_hu(AIR + (inside - AIR) * share, spacing)
    return volume._replace(origin=-(np.array(count) - 1) / 2 * np.array(spacing))


WATERS = ball().values


def parallel() -> Orthographic:
    pose = np.eye(4)
    pose[2, 3] = 100
    return Orthographic(1, 1, SIDE / 2, SIDE / 2, pose)


def source() -> Camera:
    """60 from the ball's middle, with a pixel for each unit there."""
    pose = np.eye(4)
    pose[2, 3] = 60
    return Camera([[60, 0, SIDE / 2], [0, 60, SIDE / 2], [0, 0, 1]], pose)


def taken(volume: Volume, camera: object, xray: XRay = PLAIN) -> Frame:
    return render(volume, Appearance(xray=xray), camera, size=(SIDE, SIDE))


def distance() -> np.ndarray:
    """Of pixels from the middle."""
    row, column = np.indices((SIDE, SIDE)) - (SIDE - 1) / 2
    return np.hypot(row, column)


def chord(away: np.ndarray) -> np.ndarray:
    """Length of lines through the ball."""
    return 2 * np.sqrt(np.maximum(RADIUS**2 - away**2, 0))


@pytest.mark.some(1)
@pytest.mark.parametrize("spacing", [EVEN, FLAT])
def test_a_ball_of_water_attenuates_by_its_chords(spacing, record):
    value = taken(ball(spacing), parallel()).value
    near = distance() < RADIUS - 3
    np.testing.assert_allclose(value[near], MU * chord(distance()[near]), rtol=0.01)
    record.error("beside the ball", np.abs(value[distance() > RADIUS + 3]).max())


def test_a_point_source_sees_a_ball_by_its_chords():
    value = taken(ball(), source()).value
    away = distance() / np.hypot(distance(), 60) * 60  # of rays from the ball's middle
    near = away < RADIUS - 3
    np.testing.assert_allclose(value[near], MU * chord(away[near]), rtol=0.01)


@pytest.mark.sweep
def test_bone_attenuates_twice_as_much_as_water():
    water, bone = (taken(ball(inside=hu), parallel()).value[16, 16] for hu in (WATER, BONE))
    assert bone == pytest.approx(2 * water, rel=1e-4)


@pytest.mark.sweep
def test_attenuation_goes_with_that_of_water():
    one, two = (taken(ball(), parallel(), XRay(mu)).value for mu in (0.02, 0.04))
    np.testing.assert_allclose(two, 2 * one, rtol=1e-6)


def test_what_is_thinner_than_air_does_not_shine():
    volume = in_hu(np.full((8, 8, 8), -3000))
    assert (taken(volume, "front").value == 0).all()


def test_missing_voxels_do_not_attenuate():
    values = np.zeros((16, 16, 16), np.float32)
    values[:8] = np.nan
    thick = taken(in_hu(values), "top").value.max()
    assert thick == pytest.approx(MU * 8, rel=0.1)


@pytest.mark.sweep
def test_stored_units_are_those_without_what_is_added():
    volume = ball()
    stored = volume._replace(values=volume.values + 1024, units="hu+1024")
    one, other = (taken(shown, parallel()).value for shown in (volume, stored))
    np.testing.assert_allclose(other, one, atol=1e-5)


def test_gray_levels_are_even_in_the_line_integral_over_the_window():
    frame = taken(ball(), parallel(), XRay(MU, (0.1, 0.4)))
    share = np.clip((frame.value - 0.1) / 0.3, 0, 1)
    np.testing.assert_allclose(to_srgb(frame.rgba[..., 0]), share, atol=1e-4)
    assert (frame.rgba[..., 3] == 1).all()


@pytest.mark.sweep
def test_bones_are_white_and_inverted_black():
    look = Appearance(xray=XRay(MU, (0.0, 0.5)))
    white, black = (
        render(ball(), replace(look, invert=inverted), parallel(), size=(SIDE, SIDE)).rgba
        for inverted in (False, True)
    )
    assert white[16, 16, 0] > 0.8
    np.testing.assert_allclose(to_srgb(black[..., :3]), 1 - to_srgb(white[..., :3]), atol=2e-4)


def test_without_a_window_white_is_about_the_most_along_the_volumes_axes():
    frame = taken(ball(), parallel())
    assert frame.rgba[16, 16, 0] > 0.9
    assert frame.rgba[0, 0, 0] == 0


@pytest.mark.sweep
def test_the_renderer_alone_asks_for_an_x_ray():
    size = (SIDE, SIDE)
    alone = render(ball(), "auto", parallel(), size=size, resampler=RAYS)
    np.testing.assert_array_equal(alone.value, taken(ball(), parallel()).value)


def test_a_scene_and_its_previews_show_x_rays():
    scene, look = Scene(ball()), Appearance(xray=XRay(MU))
    for quality in ("final", "preview"):
        frame = scene.render(look, parallel(), size=(32, 32), quality=quality)
        assert frame.value.max() == pytest.approx(MU * 2 * RADIUS, rel=0.03)


def test_all_times_share_a_window():
    values = np.stack([ball(inside=hu).values for hu in (WATER, BONE)])[:, None]
    recording = Recording(values, np.ones(3), np.zeros(3), np.eye(3), "times", "hu")
    series = Series.of(recording)
    look = series.appearance(Appearance(), Projection.XRAY)
    assert look.xray.added == 0
    assert look.xray.window[1] == pytest.approx(2 * MU * 2 * RADIUS, rel=0.02)


@pytest.mark.parametrize(
    "text",
    [
        "eye = [0, -750, 0]\ntarget = [0, 0, 0]\nfov = 22.62\n",
        "fx = 1250\nfy = 1250\ncx = 250\ncy = 250\nworld_to_camera = "
        "[[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 750], [0, 0, 0, 1]]\n",
    ],
)
def test_a_device_is_a_camera_with_the_source_for_an_eye(text, tmp_path):
    """1000 to a detector of 500 x 500 pixels of 0.8, 750 to the middle: see the how-to."""
    (tmp_path / "device.toml").write_text(text)
    camera = Subject.of(ball(), Appearance(xray=PLAIN), RAYS).camera(
        viewpoint(str(tmp_path / "device.toml"), 30.0, "z"), 500, 500
    )
    view = camera.view()
    np.testing.assert_allclose(view.focal, 1000 / 0.8, rtol=1e-4)
    corner = view.rotation @ [10.0, 0.0, 20.0] + view.translation
    seen = view.principal + view.focal * corner[:2] / corner[2]
    on_detector = np.array([10.0, -20.0]) * 1000 / 750 / 0.8
    np.testing.assert_allclose(seen, 250 + on_detector, rtol=1e-4)


def test_a_page_shows_x_rays():
    looks = ({}, {"invert": True})
    given = {"projection": "xray", "units": "hu", "size": "24", "camera": "front"}
    white, black = (picture("water.npy", {**given, **look}) for look in looks)
    assert white.value.max() == pytest.approx(MU * 2 * RADIUS, rel=0.05)
    assert white.rgba[12, 12, 0] > 0.8
    assert black.rgba[12, 12, 0] < 0.1


# What is refused


@pytest.mark.parametrize(
    ("units", "why"),
    [
        ("", "neither its file nor its values show that they are Hounsfield units; give its units"),
        ("none", "its units are none; give its units, hu or hu.1024, or take the projection addit"),
    ],
)
def test_values_that_are_no_hounsfield_units_are_refused(units, why):
    volume = in_hu(np.arange(64).reshape(4, 4, 4), units=units)
    with pytest.raises(ValueError, match=f"holds 0 to 63, and {why}"):
        taken(volume, "front")


@pytest.mark.parametrize("mu", [0.0, -1.0, float("nan"), float("inf")])
def test_attenuation_is_above_0(mu):
    with pytest.raises(ValueError, match=r"it must be above 0, such as 0\.02 per mm"):
        XRay(mu)


def test_x_rays_are_of_their_projection():
    look, maximum = Appearance(xray=XRay()), replace(RAYS, projection=Projection.MAXIMUM)
    with pytest.raises(ValueError, match="need the projection xray, not maximum"):
        render(ball(), look, resampler=maximum)
    with pytest.raises(ValueError, match="need the projection xray, not composite"):
        AppearanceChoices(mu_water=0.03).renderer(Resampling())


def test_what_is_composited_has_no_negative():
    with pytest.raises(ValueError, match="invert swaps black and white of values"):
        render(ball(), Appearance(invert=True))


@pytest.mark.parametrize("projection", ["maximum", "minimum", "average", "additive"])
def test_a_negative_is_as_far_from_white_as_the_picture_from_black(projection):
    values = np.zeros((12, 12, 12), np.float32)
    values[3:9, 3:9, 3:9] = np.arange(6)
    by = Resampler(order=Rays(), projection=Projection(projection))
    looks = Appearance(), Appearance(invert=True)
    plain, other = (render(values, look, "front", size=(24, 24), resampler=by) for look in looks)
    wanted = 1 - to_srgb(np.clip(plain.rgba[..., :3], 0, 1))
    np.testing.assert_allclose(to_srgb(other.rgba[..., :3]), wanted, atol=2e-4)
    assert (other.rgba[..., 3] == 1).all()


# The command line


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, with a ball of water in it."""
    monkeypatch.chdir(tmp_path)
    np.save("water.npy", WATERS)


def drawn(*words: object) -> np.ndarray:
    assert ended("render", "water.npy", "-o", "out.exr", *SMALL, *words) == 0
    return read_channels("out.exr")["G"]


@pytest.mark.sweep
def test_a_command_makes_an_x_ray():
    by = ["--fov", 0, "--camera", "front", "--window", "0.24/0.48"]
    white = drawn(*BY_XRAY, *by)
    assert white[12, 12] == pytest.approx(1, abs=0.01)  # 0.48, of 24 mm
    assert white[0, 0] < 1e-6
    half = drawn(*BY_XRAY, *by, "--mu-water", 0.01)
    assert half[12, 12] == pytest.approx(from_srgb(np.float32(0.5)), abs=0.01)
    black = drawn(*BY_XRAY, *by, "--invert")
    assert (black[12, 12], black[0, 0]) == (pytest.approx(0, abs=0.01), pytest.approx(1))


def test_a_command_refuses_an_x_ray_of_other_values_in_one_line(capsys):
    words = ("--projection", "xray", "--units", "none", "-o", "out.png", *SMALL)
    said = refused(capsys, "render", "water.npy", *words)
    assert "X-rays are of Hounsfield units" in said


def test_a_bar_beside_an_x_ray_has_its_line_integrals():
    words = [*BY_XRAY, "--window", "0.24/0.48", "--color-bar", "--size", "64"]
    assert ended("render", "water.npy", "-o", "out.png", *words) == 0
    assert read_image("out.png").shape[1] > 64


@pytest.mark.sweep
def test_a_film_shows_x_rays():
    words = ["--path", "still", "--frames", 1, *SMALL, *BY_XRAY]
    assert ended("animate", "water.npy", "-o", "film", *words) == 0
    (frame,) = Path("film").glob("*.png")
    assert read_image(frame)[12, 12].min() > 0.9


def test_sums_below_0_are_said(capsys):
    words = ("--units", "hu", "--projection", "additive", *SMALL)
    assert ended("render", "water.npy", "-o", "out.png", *words) == 0
    said = capsys.readouterr().err
    assert "all sums are below 0; for Hounsfield units take the projection xray" in said


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((0.0, 0.0), "the picture is black: all sums are 0"),
        ((-1.0, 0.0), "the picture is black: all sums are below 0"),
        ((-1.0, 0.1), None),
        ((np.nan, 0.1), None),
    ],
)
def test_a_black_picture_of_sums_is_said_to_be_one(values, said):
    frame = SimpleNamespace(value=np.array(values, np.float32))
    volume = as_volume(np.zeros((4, 4, 4), np.float32))
    assert rendering._emptiness(frame, volume, Projection.ADDITIVE) == said
    if said is not None:
        said = "the picture is black: no ray meets an attenuating voxel"
    assert rendering._emptiness(frame, volume, Projection.XRAY) == said


@pytest.mark.sweep
def test_air_alone_is_said(capsys):
    np.save("water.npy", np.full((8, 8, 8), AIR, np.float32))
    assert ended("render", "water.npy", "-o", "out.png", *SMALL, *BY_XRAY) == 0
    assert "no ray meets an attenuating voxel" in capsys.readouterr().err


def test_methods_are_not_compared_by_x_rays(capsys):
    said = refused(capsys, "compare", "water.npy", *BY_XRAY)
    assert "take the projection additive" in said
