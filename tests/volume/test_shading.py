"""Light on voxels: what is lit, from where, and what never goes dark."""

import subprocess
import sys

import numpy as np
import pytest

from resample.cameras.models import AnyCamera, Camera, Orthographic
from resample.cameras.poses import look_at
from resample.cameras.viewpoints import Sphere
from resample.engine.jit import kernel
from resample.types import Doubles, Floats
from resample_volume.kernels.voxels import power
from resample_volume.voxels.framing import Shifted
from resample_volume.voxels.shading import DepthCue, Light, cue_range, cued, shade
from resample_volume.voxels.visible import Voxels

EYE = (0.0, 0.0, -10.0)
VIEW = (0.0, 0.0, 1.0)
MATT = Light(specular=0.0)


def with_gradients(gradient: object, color: object = (0.5, 0.25, 0.125)) -> Voxels:
    """Voxels at the origin."""
    slope = np.atleast_2d(np.asarray(gradient, np.float32))
    colors = np.tile(np.float32(color), (len(slope), 1))
    return Voxels(np.zeros_like(slope), colors, np.ones(len(slope), np.float32), slope, np.eye(3))


def scattered(rng: np.random.Generator, count: int = 50) -> Voxels:
    position, gradient = rng.normal(size=(2, count, 3)).astype(np.float32)
    color = rng.random((count, 3)).astype(np.float32)
    return Voxels(position, color, rng.random(count).astype(np.float32), gradient, np.eye(3))


def unit(vector: Doubles) -> Doubles:
    return vector / np.linalg.norm(vector)


def lit(gradient: object, light: Light = MATT) -> Floats:
    return shade(with_gradients(gradient), light, EYE).color


@kernel
def powers(bases: Doubles, exponent: float, found: Doubles) -> None:
    """Powers of numbers, one by one."""
    for n in range(bases.size):
        found[n] = power(bases[n], exponent)


@pytest.mark.parametrize("exponent", [0.05, 0.5, 1.0, 16.0, 250.0, 1e4])
def test_powers_are_those_of_the_library(exponent: float) -> None:
    bases = np.concatenate([[0.0, 1e-300, 1e-20, 1 - 1e-12, 1.0], np.linspace(0.001, 1.0, 400)])
    found = np.empty_like(bases)
    powers(bases, exponent, found)
    np.testing.assert_allclose(found, bases**exponent, rtol=0, atol=1e-8)


@pytest.mark.parametrize("direction", [None, (1.0, 2.0, -3.0)])
def test_colors_agree_with_the_obvious_loop(
    direction: tuple[float, float, float] | None, rng: np.random.Generator
) -> None:
    voxels = scattered(rng)
    light = Light(direction, ambient=0.2, diffuse=0.5, specular=0.4, shininess=9.0)
    eye = np.array([4.0, -3.0, 9.0])
    found = shade(voxels, light, eye).color
    shaded = np.empty((len(voxels.position), 3))
    for n, position in enumerate(voxels.position.astype(float)):
        normal = unit(voxels.gradient[n].astype(float))
        viewer = unit(eye - position)
        toward = viewer if light.direction is None else unit(np.array(light.direction))
        halfway = unit(viewer + toward)
        own = light.ambient + light.diffuse * abs(normal @ toward)
        highlight = light.specular * abs(normal @ halfway) ** light.shininess
        shaded[n] = voxels.color[n] * own + highlight
    np.testing.assert_allclose(found, shaded, atol=1e-6)


def test_without_light_samples_keep_the_voxels_fields(rng: np.random.Generator) -> None:
    voxels = scattered(rng)._replace(gradient=np.empty((0, 3), np.float32))
    samples = shade(voxels, None)
    for name in set(samples._fields) & set(voxels._fields):
        assert getattr(samples, name) is getattr(voxels, name)


def test_light_changes_nothing_but_color(rng: np.random.Generator) -> None:
    voxels = scattered(rng)
    samples = shade(voxels, Light(), EYE)
    assert samples.position is voxels.position
    assert samples.extinction is voxels.extinction
    assert samples.color.dtype == np.float32


def test_a_surface_that_faces_the_light_shows_its_whole_color() -> None:
    np.testing.assert_allclose(lit([0, 0, -2]), [[0.5, 0.25, 0.125]], rtol=1e-6)


def test_a_surface_along_the_light_shows_its_ambient_share() -> None:
    np.testing.assert_allclose(lit([1, 0, 0]), [[0.15, 0.075, 0.0375]], rtol=1e-6)


def test_both_sides_of_a_surface_are_lit_alike(rng: np.random.Generator) -> None:
    voxels = scattered(rng)
    light = Light((1.0, 2.0, -3.0))
    turned = voxels._replace(gradient=-voxels.gradient)
    np.testing.assert_array_equal(shade(voxels, light, EYE).color, shade(turned, light, EYE).color)


def test_the_length_of_a_gradient_does_not_matter(rng: np.random.Generator) -> None:
    voxels = scattered(rng)
    steeper = voxels._replace(gradient=1024 * voxels.gradient)
    np.testing.assert_allclose(
        shade(voxels, Light(), EYE).color, shade(steeper, Light(), EYE).color, rtol=1e-6
    )


def test_the_scene_and_its_mirror_image_are_lit_alike(rng: np.random.Generator) -> None:
    voxels = scattered(rng)
    mirror = np.array([-1, 1, 1], np.float32)
    mirrored = voxels._replace(position=voxels.position * mirror, gradient=voxels.gradient * mirror)
    one = shade(voxels, Light((1.0, 2.0, 3.0)), (4, 5, 6)).color
    other = shade(mirrored, Light((-1.0, 2.0, 3.0)), (-4, 5, 6)).color
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("direction", [None, (1.0, 1.0, 0.0)])
def test_flat_regions_keep_their_color(direction: tuple[float, float, float] | None) -> None:
    found = lit([[0, 0, 0], [1e-9, 0, 0], [0, 0, 5]], Light(direction))
    np.testing.assert_allclose(found[:2], np.tile([0.5, 0.25, 0.125], (2, 1)), rtol=1e-6)


def test_a_volume_without_any_gradient_keeps_its_color() -> None:
    np.testing.assert_allclose(lit([[0, 0, 0]] * 2, Light()), [[0.5, 0.25, 0.125]] * 2, rtol=1e-6)


def test_highlights_are_white() -> None:
    shiny = lit([0, 0, 1], Light(specular=0.5)) - lit([0, 0, 1], Light(specular=0.0))
    np.testing.assert_allclose(shiny, [[0.5, 0.5, 0.5]], rtol=1e-6)


def test_a_highlight_narrows_with_the_shininess() -> None:
    wide, narrow = (lit([0.3, 0, 1], Light(shininess=power))[0, 0] for power in (4.0, 64.0))
    assert narrow < wide


def test_a_light_behind_the_voxel_seen_from_the_eye_has_no_highlight_to_halve() -> None:
    found = lit([0, 0, 1], Light((0.0, 0.0, 1.0)))  # eye and light are opposite: no half way
    assert np.isfinite(found).all()


def test_an_eye_within_a_voxel_gives_finite_colors() -> None:
    samples = shade(with_gradients([0, 0, 1]), Light(), (0, 0, 0))
    assert np.isfinite(samples.color).all()


def test_a_parallel_view_is_that_of_an_eye_far_away(rng: np.random.Generator) -> None:
    voxels = scattered(rng)
    light = Light((1.0, 2.0, -3.0))
    far = shade(voxels, light, (0, 0, -1e7)).color
    np.testing.assert_allclose(shade(voxels, light, view=VIEW).color, far, atol=1e-5)


def test_threads_do_not_change_colors(rng: np.random.Generator) -> None:
    from resample.engine.jit import threads

    voxels = scattered(rng, 9000)  # three chunks
    with threads(1):
        alone = shade(voxels, Light(), EYE).color
    np.testing.assert_array_equal(alone, shade(voxels, Light(), EYE).color)


def test_no_voxels_are_no_samples() -> None:
    assert shade(with_gradients(np.empty((0, 3))), Light(), EYE).color.shape == (0, 3)


def test_light_without_gradients_is_refused() -> None:
    voxels = with_gradients([0, 0, 1])._replace(gradient=np.empty((0, 3), np.float32))
    with pytest.raises(ValueError, match="classify with gradient='central' or 'sobel'"):
        shade(voxels, Light(), EYE)


@pytest.mark.parametrize(
    ("eye", "view", "match"),
    [
        (None, None, "the eye of a perspective or the view of a parallel camera"),
        (EYE, VIEW, "the eye of a perspective or the view of a parallel camera"),
        ((0, 0), None, "eye must be three finite numbers"),
        ((0, 0, np.nan), None, "eye must be three finite numbers"),
        (None, (0, 0, 0), "view must not be of length 0"),
    ],
)
def test_an_impossible_viewer_is_refused(eye: object, view: object, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        shade(with_gradients([0, 0, 1]), Light(), eye, view=view)


@pytest.mark.parametrize(
    ("choice", "match"),
    [
        ({"ambient": -0.1}, "ambient must be 0 or more"),
        ({"diffuse": np.nan}, "diffuse must be 0 or more"),
        ({"specular": np.inf}, "specular must be 0 or more"),
        ({"shininess": 0.0}, "shininess must be greater than 0"),
        ({"direction": (0.0, 0.0, 0.0)}, "light direction must not be of length 0"),
        ({"direction": (0.0, 1.0)}, "light direction must be three finite numbers"),
    ],
)
def test_an_impossible_light_is_refused(choice: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        Light(**choice)


POSE = look_at((1.0, 2.0, -10.0), (0.0, 0.5, 1.0), (0.0, -1.0, 0.0))
CAMERAS = {
    "perspective": Camera.from_intrinsics(100, 100, 50, 50, POSE),
    "parallel": Orthographic(10, 10, 50, 50, POSE),
    "shifted": Shifted(Camera.from_intrinsics(100, 100, 50, 50, POSE), np.array([3.0, -1.0, 2.0])),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_light_fades_with_depth_as_the_obvious_loop_has_it(
    name: str, rng: np.random.Generator
) -> None:
    camera = CAMERAS[name]
    samples = shade(scattered(rng), None)
    found = cued(samples, camera, DepthCue(0.7), 9.0, 12.0)
    view = camera.view()
    for n, place in enumerate(samples.position):
        depth = (view.rotation @ place + view.translation)[2]
        light = 1 - 0.7 * min(max((depth - 9.0) / 3.0, 0), 1)
        np.testing.assert_allclose(found.color[n], samples.color[n] * light, atol=1e-6)
    assert found.color.dtype == np.float32
    assert found.extinction is samples.extinction


@pytest.mark.parametrize(("share", "darkest"), [(0.0, 1.0), (1.0, 0.0)])
def test_a_depth_cue_takes_nothing_or_all(share: float, darkest: float) -> None:
    samples = shade(with_gradients([[0, 0, 1]]), None)
    found = cued(samples, Camera.from_intrinsics(9, 9, 5, 5), DepthCue(share), -2.0, -1.0)
    np.testing.assert_allclose(found.color, darkest * samples.color)


def test_cueing_reaches_over_what_is_visible() -> None:
    camera: AnyCamera = Camera.from_intrinsics(
        9, 9, 5, 5, look_at((0, 0, -10), (0, 0, 0), (0, -1, 0))
    )
    assert cue_range(camera, Sphere(np.array([4.0, 0, 1]), 3.0)) == pytest.approx((8, 14))


def test_cueing_begins_where_one_can_see() -> None:
    camera = Camera.from_intrinsics(9, 9, 5, 5, near=0.5)
    assert cue_range(camera, Sphere(np.array([0, 0, 1.0]), 3.0)) == pytest.approx((0.5, 4))
    assert cue_range(camera, Sphere(np.array([0, 0, -9.0]), 3.0)) == pytest.approx((0.5, 3.5))


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_an_impossible_depth_cue_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="takes a share from 0 to 1"):
        DepthCue(share)


@pytest.mark.sweep
def test_the_modules_load_without_numba_and_matplotlib() -> None:
    code = (
        "import sys, resample_volume.voxels.shading, resample_volume.classification.transfer;"
        "import resample_volume.voxels.visible;"
        "sys.exit(', '.join({'numba', 'matplotlib'} & set(sys.modules)) or 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
