"""What cannot be drawn is refused; what is odd but can be, is drawn in a defined way."""

import numpy as np
import pytest

from resample.profiles.filters import Box, Gaussian, Lanczos
from resample_meshes.rendering import Mesh, MeshStyle, render_mesh
from tests.texture.mesh_shapes import (
    FALLING,
    SQUARE,
    even,
    fitted_camera,
    from_above,
    noise,
    oblique,
    picture,
    square,
)


def test_triangles_without_area_change_nothing():
    texture, camera = noise(32), oblique(1.0, 32)
    thin = [[0, 0, 0], [1, 1, 1], [0, 1, 0], [0, 2, 2]]  # three of them are points, one is a line
    corners = np.concatenate([SQUARE, [[0.5, 0.5, 0.0], [0.9, 0.9, 0.0]]])
    uv = np.concatenate([SQUARE[:, :2], np.zeros((2, 2))])
    triangle = np.concatenate([thin, FALLING, [[0, 4, 2], [4, 5, 0]]])
    found = picture(Mesh(corners, triangle, uv, (texture,)), camera, 32)
    np.testing.assert_array_equal(found.rgba, picture(square(texture), camera, 32).rgba)


@pytest.mark.parametrize("slope", [0.0, 1.0, -2.5])
def test_a_texture_along_a_line_gives_the_colors_of_that_line(slope):
    ramp = np.broadcast_to(np.linspace(0, 1, 64)[None, :, None], (64, 64, 3))
    uv = 0.25 + 0.5 * np.stack([SQUARE[:, 0], slope * SQUARE[:, 0]], axis=1)
    found = picture(Mesh(SQUARE, FALLING, uv, (ramp,)), from_above(32.0, 32), 32).rgba[..., 0]
    expected = (64 * (0.25 + 0.5 * (np.arange(32) + 0.5) / 32) - 0.5) / 63
    np.testing.assert_allclose(found, np.tile(expected, (32, 1)), atol=2e-4)  # 1/4096 texel


@pytest.mark.parametrize("shift", [900_000, -900_000])
def test_far_texture_coordinates_show_the_texture_again(shift):
    texture, camera = noise(32), oblique(1.0, 32)
    mesh = square(texture)
    moved = Mesh(mesh.position, mesh.triangle, mesh.uv + shift, mesh.textures)
    found = picture(moved, camera, 32).rgba
    np.testing.assert_allclose(found, picture(mesh, camera, 32).rgba, atol=1e-3)  # points at rims


@pytest.mark.sweep
def test_a_texture_that_repeats_a_million_times_is_its_mean():
    texture = noise(32)
    mesh = Mesh(SQUARE, FALLING, 1e6 * SQUARE[:, :2], (texture,))
    found = picture(mesh, from_above(32.0, 32), 32).rgba[16, 16, :3]
    np.testing.assert_allclose(found, texture.mean(axis=(0, 1)), rtol=1e-5)


@pytest.mark.sweep
def test_a_texture_drawn_out_to_a_thread_takes_few_points():
    thread = np.array([[0, 0], [1e5, 1e5], [1e5 + 1e-3, 1e5]])
    mesh = Mesh(SQUARE[:3], FALLING[:1], thread, (noise(32),))
    frame = picture(mesh, from_above(32.0, 32), 32)
    assert np.isfinite(frame.rgba).all()
    assert frame.statistics.points < 256 * frame.statistics.covered


@pytest.mark.parametrize("scale", [1e-200, 1e-90, 1e90])
def test_a_mesh_of_a_size_that_numbers_hardly_hold_is_seen_or_not(scale):
    frame = picture(square(even(1, 1, 1), scale * SQUARE), oblique(1.0, 8), 8)
    assert frame.rgba[4, 4].tolist() in ([0, 0, 0, 0], [1, 1, 1, 1])


@pytest.mark.parametrize("seed", range(8))
def test_a_crumpled_mesh_gives_a_picture_all_the_same(seed):
    rng = np.random.default_rng(seed)
    # Mesh with slivers, repeated vertices, huge coordinates and folded textures
    count = int(rng.integers(3, 20))
    position = rng.normal(size=(count, 3)) * 10.0 ** rng.integers(-3, 4)
    position[:, 1] *= rng.choice([0.0, 1e-9, 1.0])
    position[rng.integers(count)] *= 1e12
    position[rng.integers(count)] = position[0]
    uv = rng.normal(size=(count, 2)) * rng.choice([1e-12, 1.0, 1e5])
    uv[:, 1] += rng.choice([0.0, 1.0]) * (uv[:, 0] - uv[:, 1])
    triangle = rng.integers(0, count, (15, 3))
    mesh = Mesh(position, triangle, np.clip(uv, -1e6, 1e6), (noise(16),))
    zoom, fov = 10.0 ** rng.uniform(-2, 3), rng.choice([0.0, 30.0, 150.0])
    frame = picture(mesh, fitted_camera(mesh, 30, 20, zoom, fov, size=(16, 16)), 16)
    assert np.isfinite(frame.rgba).all()
    assert not np.isnan(frame.depth).any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"triangle": np.zeros((0, 3), int)}, "without triangles"),
        ({"triangle": np.array([[0, 1, 4]])}, "vertex 4 is named, but there are 4"),
        ({"position": SQUARE * np.nan}, "not finite"),
        ({"position": SQUARE[:, :2]}, "must be"),
        ({"uv": None}, "no texture coordinates"),
        ({"uv": np.full((4, 2), np.inf)}, "not finite"),
        ({"uv": np.full((4, 2), np.nan)}, "not finite"),
        ({"uv": np.full((4, 2), -3e38)}, r"coordinate of 3e\+38; 1e\+06 is the limit"),
        ({"textures": ()}, "neither a texture nor vertex colors"),
        ({"textures": (np.zeros((0, 4, 3), np.float32),)}, "no texels"),
        ({"texture": np.array([0, 1])}, "texture 1 is named"),
    ],
)
def test_what_is_no_mesh_is_refused(change, message):
    given = {
        "position": SQUARE,
        "triangle": FALLING,
        "uv": SQUARE[:, :2],
        "textures": (even(1, 1, 1),),
    }
    with pytest.raises(ValueError, match=message):
        Mesh(**(given | change))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"samples": 0}, "1 to 16"),
        ({"quality": 0.0}, "quality"),
        ({"quality": np.nan}, "quality"),
        ({"interpolation": Lanczos(9)}, "over 9.0 texels"),
        ({"interpolation": Box(2.0)}, "blurs too much"),
        ({"pixel_filter": Gaussian(radius=17.0)}, "radius 17.0 px"),
        ({"pixel_filter": Box(0.1)}, "meets none of the 4 samples"),
    ],
)
def test_a_bad_choice_is_refused(choice, message):
    with pytest.raises(ValueError, match=message):
        MeshStyle(**choice)


@pytest.mark.parametrize("size", [(0, 8), (8, 0), (8, -1), (1 << 20, 8)])
def test_a_picture_s_size_is_checked(size):
    with pytest.raises(ValueError, match=r"pixels; (1 to|both sides must be at least 1)"):
        render_mesh(square(even(1, 1, 1)), from_above(8.0, 8), size=size)


def test_a_camera_without_a_zoom_is_refused():
    with pytest.raises(ValueError, match="zoom"):
        fitted_camera(square(even(1, 1, 1)), zoom=0.0)
