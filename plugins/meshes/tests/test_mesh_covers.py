"""What lies beyond a texture's edges on a mesh, and what its alpha does."""

import numpy as np
import pytest

from resample import registry
from resample.colors import from_srgb
from resample.engine.jit import threads
from resample_meshes.rendering import Mesh, MeshStyle, render_mesh
from resample_meshes.shapes import Cover
from tests.texture.mesh_shapes import (
    CUBE,
    FACES,
    FALLING,
    SQUARE,
    decibels,
    even,
    from_above,
    interpolated,
    naive_mesh,
    noise,
    oblique,
    picture,
)


def covered(texture, cover, uv=SQUARE[:, :2], corners=SQUARE):
    return Mesh(corners, FALLING, uv, (texture,), covers=(cover,))


def see_through(size=64, seed=5):
    """Noise with an alpha of smooth blobs."""
    alpha = noise(size, seed)[..., :1]
    for axis in (0, 1):
        alpha = sum(np.roll(alpha, shift, axis) for shift in range(-4, 5)) / 9
    return np.concatenate([noise(size), alpha], axis=2).astype(np.float32)


@pytest.mark.sweep
@pytest.mark.parametrize("along_u", ["wrap", "mirror", "clamp"])
@pytest.mark.parametrize("along_v", ["wrap", "mirror", "clamp"])
@pytest.mark.parametrize("repeats", [2.3, 12.0])
def test_beyond_its_edges_a_texture_goes_on_as_its_cover_says(along_u, along_v, repeats, record):
    # 0.6 and 3.2 texels per px
    mesh = covered(noise(32), Cover(along_u, along_v), repeats * (SQUARE[:, :2] - 0.4))
    camera = from_above(120.0, 40, 0.3)
    frame = picture(mesh, camera, 40)
    record.quality("picture", decibels(frame.rgba, naive_mesh(mesh, camera, 40, rays=12)))


@pytest.mark.parametrize("edge", ["mirror", "clamp"])
def test_a_place_that_is_looked_up_knows_the_edges_too(edge):
    texture, uv = noise(16), np.array([1.7, -0.4])
    mesh = covered(texture, Cover(edge, edge), np.tile(uv, (4, 1)))  # nothing to project
    found = picture(mesh, from_above(8.0, 8), 8).rgba[4, 4, :3]
    catmull_rom = registry.build("interpolations", "catmull-rom")
    truth = interpolated(texture, uv[:1], 1 - uv[1:], catmull_rom, edge, edge)[0]
    np.testing.assert_allclose(found, truth, atol=1e-3)  # 1/4096 texel


@pytest.mark.some(1)
@pytest.mark.parametrize("distance", [0.4, 2.0, 6.0])
def test_a_mask_is_what_rays_see(distance, record):
    mesh = covered(see_through(), Cover(alpha="mask", cutoff=0.5))
    camera = oblique(distance, 40)
    frame = picture(mesh, camera, 40)
    truth = naive_mesh(mesh, camera, 40)
    whole = picture(covered(noise(8), Cover()), camera, 40).coverage.sum()
    assert 0.2 < truth[..., 3].sum() / whole < 0.8
    record.quality("picture", decibels(frame.rgba, truth))


def test_a_mask_s_cutoff_is_the_least_alpha_that_is_seen():
    texture = np.concatenate([even(1, 1, 1), np.full((4, 4, 1), 0.25, np.float32)], axis=2)
    camera = from_above(16.0, 16)
    for cutoff, seen in ((0.2, 256), (0.25, 256), (0.3, 0)):
        frame = picture(covered(texture, Cover(alpha="mask", cutoff=cutoff)), camera, 16)
        assert frame.coverage.sum() == pytest.approx(seen)


@pytest.mark.sweep
@pytest.mark.parametrize("distance", [0.4, 2.0, 6.0])
def test_what_one_can_see_through_is_what_rays_see(distance, record):
    mesh = covered(see_through(), Cover(alpha="blend"))
    camera = oblique(distance, 40)
    frame = picture(mesh, camera, 40)
    record.quality("picture", decibels(frame.rgba, naive_mesh(mesh, camera, 40)))


def test_an_opaque_texture_s_alpha_does_nothing():
    camera = oblique(1.0, 32)
    found = picture(covered(see_through(), Cover()), camera, 32).rgba
    np.testing.assert_array_equal(found, picture(covered(noise(64), Cover()), camera, 32).rgba)


def pane(red, green, blue, alpha):
    return np.full((2, 2, 4), (red, green, blue, alpha), np.float32)


def stack(colors, heights):
    """Squares above each other, the first one first among the triangles."""
    count = len(colors)
    position = np.concatenate([SQUARE + np.array([0, 0, height]) for height in heights])
    triangle = np.concatenate([FALLING + 4 * n for n in range(count)])
    return Mesh(
        position,
        triangle,
        np.tile(SQUARE[:, :2], (count, 1)),
        tuple(pane(*color) for color in colors),
        np.repeat(np.arange(count), 2),
        covers=(Cover(alpha="blend"),) * count,
    )


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_panes_lie_over_each_other_in_the_order_of_their_depth(order):
    colors = [(1.0, 0.0, 0.0, 0.5), (0.0, 1.0, 0.0, 0.25), (0.0, 0.0, 1.0, 0.75)]
    heights = [0.3, 0.2, 0.1]
    mesh = stack([colors[n] for n in order], [heights[n] for n in order])
    found = picture(mesh, from_above(16.0, 16), 16)
    below = 0.5 * 0.75
    expected = [0.5, 0.5 * 0.25, below * 0.75, 1 - below * 0.25]
    np.testing.assert_allclose(
        found.rgba[2:14, 2:14], np.broadcast_to(expected, (12, 12, 4)), rtol=1e-5
    )
    np.testing.assert_allclose(found.depth[2:14, 2:14], 4.7, rtol=1e-6)


@pytest.mark.sweep
def test_many_panes_dim_what_is_behind():
    count = 20
    mesh = stack([(0.0, 0.0, 0.0, 0.1)] * count, np.linspace(0, 1, count))
    found = picture(mesh, from_above(16.0, 16), 16).coverage[8, 8]
    assert found == pytest.approx(1 - 0.9**count, rel=1e-5)


def glass_cube(texture, alpha):
    corner = FACES.ravel()
    triangle = (4 * np.arange(6)[:, None, None] + FALLING[None]).reshape(-1, 3)
    uv = np.tile(SQUARE[:, :2], (6, 1))
    chosen = np.repeat([0, 1, 0, 1, 0, 1], 2)
    covers = (Cover("mirror", "clamp", alpha), Cover())
    return Mesh(CUBE[corner], triangle, uv, (texture, noise(32, 9)), chosen, covers=covers)


@pytest.mark.sweep
@pytest.mark.parametrize("alpha", ["blend", pytest.param("mask", marks=pytest.mark.sweep)])
def test_a_cube_with_openings_shows_its_inside(alpha, record):
    mesh, camera = glass_cube(see_through(32), alpha), oblique(3.5, 40)
    frame = picture(mesh, camera, 40)
    record.quality(
        "picture", decibels(frame.rgba, naive_mesh(mesh, camera, 40))
    )  # four samples along a px
    with threads(1):
        np.testing.assert_array_equal(picture(mesh, camera, 40).rgba, frame.rgba)


def test_a_fence_in_the_distance_lets_through_what_its_gaps_do():
    texture = np.concatenate([np.ones((64, 64, 3)), np.zeros((64, 64, 1))], axis=2)
    texture[:, ::4, 3] = 1  # a quarter
    mesh = covered(texture.astype(np.float32), Cover(alpha="mask"))
    found = picture(mesh, from_above(8.0, 16), 16)  # 8 texels per px
    np.testing.assert_allclose(found.rgba[5:11, 5:11], 0.25, atol=0.01)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"along_u": "transparent"}, "wrap, mirror or clamp"),
        ({"along_v": "repeat"}, "not a valid Edge"),
        ({"alpha": "glass"}, "not a valid Alpha"),
        ({"cutoff": float("nan")}, "cutoff of nan"),
    ],
)
def test_a_bad_cover_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Cover(**given)


def test_every_texture_has_a_cover_or_none_has():
    with pytest.raises(ValueError, match="2 covers for 1 textures"):
        Mesh(SQUARE, FALLING, SQUARE[:, :2], (even(1, 1, 1),), covers=(Cover(), Cover()))


@pytest.mark.parametrize("alpha", ["opaque", "mask", "blend"])
def test_levels_are_interpolated_and_light_is_averaged(alpha):
    """Black beside white, 16 times as large and half as large."""
    texture = np.ones((8, 8, 4), np.float32)
    texture[:, ::2, :3] = 0.0
    cover = Cover(alpha=alpha, is_encoded=True)
    mesh = Mesh(SQUARE, FALLING, uv=SQUARE[:, :2], textures=(texture,), covers=(cover,))
    style = MeshStyle(samples=1, interpolation="bilinear")
    # A pixel's middle, a quarter of a texel beside the border of two texels.
    large = render_mesh(mesh, from_above(128.0, 32), size=(32, 32), style=style).rgba[16]
    place = (np.arange(32) + 0.5 - 16) / 16 + 4 - 0.5
    part = place % 1.0
    level = np.where(np.floor(place) % 2 == 0, part, 1.0 - part)
    np.testing.assert_allclose(large[:, 1], from_srgb(level), atol=8e-3)
    small = render_mesh(mesh, from_above(4.0, 4), size=(4, 4)).rgba
    np.testing.assert_allclose(small[1:3, 1:3], [[[0.5, 0.5, 0.5, 1.0]] * 2] * 2, atol=0.02)
