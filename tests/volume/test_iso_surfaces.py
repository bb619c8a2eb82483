"""Surfaces beside the volume: against formulas, and against the first hits of rays."""

import numpy as np
import pytest

from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume import meshes
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.inputs import as_volume
from resample_volume.meshes import IsoSurface
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.voxels.shading import Light
from tests.commands import ended, refused
from tests.volume.test_space_meshes import FOG, RED, ahead, fog

pytest.importorskip("vtkmodules.vtkFiltersCore", reason="pip install 'hybrid-resample[vtk]'")

MIDDLE = np.array([15.3, 14.8, 15.6])
PLACE = np.stack(np.indices((32, 32, 32))[::-1], axis=-1) - MIDDLE
BALL = as_volume((100 - 4 * np.linalg.norm(PLACE, axis=-1)).astype(np.float32))
TURN = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
NOTHING = "2000..3000"


def mesh_of(volume, *surfaces):
    """Corners in the volume's scene, normals and triangles."""
    subject = Subject.of(volume, Appearance(NOTHING, surfaces=surfaces))
    return subject.mesh.corner + subject.middle, subject.mesh.normal, subject.mesh.face


def test_corners_and_normals_of_a_ball_are_those_of_its_formula():
    corner, normal, face = mesh_of(BALL, "60")
    away = corner - MIDDLE
    assert len(face) > 1000
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 10, atol=2e-4)
    np.testing.assert_allclose(np.abs((normal * away).sum(axis=1)), 10, atol=1e-3)


def test_a_ball_of_uneven_voxels_that_are_turned_is_one_in_its_scene():
    steps = np.array([0.5, 0.7, 0.6])
    radius = np.linalg.norm(PLACE * steps, axis=-1)
    volume = as_volume((-radius).astype(np.float32))._replace(
        spacing=steps, direction=TURN, origin=np.array([3.0, 90.0, -7.0])
    )
    corner, normal, _ = mesh_of(volume, "-6")
    away = corner - (volume.origin + TURN @ (steps * MIDDLE))
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 6, atol=1e-3)
    np.testing.assert_allclose(np.abs((normal * away).sum(axis=1)), 6, atol=5e-3)


def test_a_surface_goes_on_to_the_faces_of_the_volume():
    volume = as_volume(np.indices((8, 9, 10))[0].astype(np.float32))
    corner, _, _ = mesh_of(volume, "3.25")
    np.testing.assert_allclose(corner[:, 2], 3.25, atol=1e-3)  # of a spline
    np.testing.assert_allclose(corner[:, :2].min(axis=0), -0.5, atol=1e-6)
    np.testing.assert_allclose(corner[:, :2].max(axis=0), [9.5, 8.5], atol=1e-6)


def test_there_is_no_surface_beside_missing_voxels():
    values = BALL.values.copy()
    values[:, :, :16] = np.nan
    values[20, 20, 25] = np.nan
    corner, _, face = mesh_of(BALL._replace(values=values), "60")
    used = corner[np.unique(face)]
    assert used[:, 0].min() >= 15.9
    assert len(face) > 500
    np.testing.assert_allclose(np.linalg.norm(used - MIDDLE, axis=1), 10, atol=0.3)  # gaps filled


@pytest.mark.sweep
@pytest.mark.parametrize("light", [None, Light((1, -1, 2))])
def test_a_surface_is_what_rays_hit_first(light):
    color = (0.9, 0.3, 0.1)
    camera, size = ahead(), (64, 64)
    look = Appearance(NOTHING, light, surfaces=(IsoSurface(60.0, color),))
    found = render(BALL, look, camera, size=size).rgba
    name = "#f49559"  # the same, displayed
    made = Resampler(order=Rays(), projection=Projection.FIRST_HIT, iso=60.0)
    wanted = render(
        BALL, Appearance(f"0/{name}/1,100/{name}/1", light), camera, size=size, resampler=made
    ).rgba
    y, x = (np.indices(size) + 0.5 - 32) / 2 + 15.5 - MIDDLE[[1, 0], None, None]
    inside = np.hypot(x, y) < 9.3
    np.testing.assert_allclose(found[inside], wanted[inside], atol=0.02)
    assert not found[np.hypot(x, y) > 10.4].any()
    assert found[..., 3].sum() == pytest.approx(np.pi * 20**2, rel=0.01)


@pytest.mark.sweep
def test_what_is_before_and_behind_a_surface_is_seen_as_its_opacity_says():
    volume = as_volume(np.indices((32, 32, 32))[0].astype(np.float32))
    surfaces = (IsoSurface(15.5, RED, 0.4), IsoSurface(25.5, RED))
    look = Appearance(fog(0.05), None, surfaces=surfaces)
    found = render(volume, look, ahead(), size=(64, 64)).rgba[32, 32, :3]
    half, back = np.exp(-0.05 * 16), np.exp(-0.05 * 26)
    of_fog = (1 - half) + 0.6 * (half - back)
    wanted = of_fog * np.array(FOG) + (0.4 * half + 0.6 * back) * np.array(RED)
    np.testing.assert_allclose(found, wanted, atol=2e-3)


@pytest.mark.sweep
def test_a_preview_has_the_surface_too():
    look = Appearance(NOTHING, surfaces=("60",))
    quick = Scene(BALL).render(look, ahead(), size=(64, 64), quality="preview").rgba
    whole = render(BALL, look, ahead(), size=(64, 64)).rgba
    assert abs(quick[..., 3].sum() / whole[..., 3].sum() - 1) < 0.05


@pytest.mark.sweep
def test_the_command_shows_a_surface_of_what_is_not_shown_else(tmp_path, monkeypatch):
    from PIL import Image

    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    np.save("ball.npy", BALL.values)
    words = ("ball.npy", "--size", "32", "--transfer", NOTHING, "-o", "out.png")
    assert ended(app, "render", *words, "--surface", "60:color=tomato", "--no-shading") == 0
    np.testing.assert_array_equal(np.asarray(Image.open("out.png"))[16, 16, :3], [255, 99, 71])


@pytest.mark.sweep
def test_a_volume_in_chunks_has_the_surface_of_an_array(tmp_path, monkeypatch):
    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    np.save("ball.npy", BALL.values)
    assert ended(app, "convert", "ball.npy", "ball.zarr", "--chunk", "16") == 0
    for name in ("ball.npy", "ball.zarr"):
        words = (name, "--size", "32", "--surface", "60", "-o", f"{name}.png")
        assert ended(app, "render", *words) == 0
    one, two = ((tmp_path / f"ball.{kind}.png").read_bytes() for kind in ("npy", "zarr"))
    assert one == two


@pytest.mark.some(3)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x", "give a value"),
        ("nan", "give a value"),
        ("60:size=1", "unknown size"),
        ("60:opacity=2", "give 0 to 1"),
        ("60:color=none", "give a color's name"),
        ("600", "there is no surface of the value 600"),
    ],
)
def test_what_is_no_surface_is_one_line(text, said, tmp_path, monkeypatch, capsys):
    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    words = ("checker-box:size=16", "-o", "out.png", "--size", "16x16", "--surface", text)
    assert said in refused(app, capsys, "render", *words)


def test_without_vtk_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setattr(meshes, "find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"hybrid-resample\[vtk\]"):
        IsoSurface.of("60")
