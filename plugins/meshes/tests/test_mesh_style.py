"""Interpolations and pixel filters of meshes."""

from types import SimpleNamespace

import numpy as np
import pytest

from resample import registry
from resample.profiles.filters import Box, Gaussian, Lanczos, Mitchell, Tent
from resample.profiles.interpolation import Bilinear, InterpolatingGaussian
from resample_meshes.rendering import Mesh, pixel_profile
from tests.texture.mesh_shapes import (
    FALLING,
    SQUARE,
    decibels,
    even,
    from_above,
    interpolated,
    naive,
    naive_rays,
    noise,
    oblique,
    picture,
    square,
    weight,
)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", registry.names("interpolations"))
def test_every_interpolation_is_what_rays_see(name, record):
    interpolation = registry.build("interpolations", name)
    texture, camera = noise(32), oblique(0.4, 32)  # 3 px per texel
    frame = picture(square(texture), camera, 32, interpolation=interpolation)
    truth = naive(texture, camera, 32, interpolation=interpolation)
    record.quality("picture", decibels(frame.rgba, truth))


@pytest.mark.sweep
def test_a_wide_interpolation_is_what_rays_see(record):
    wide = InterpolatingGaussian(0.9)  # over 3 texels
    texture, camera = noise(32), from_above(60.0, 32, 0.3)
    frame = picture(square(texture), camera, 32, interpolation=wide)
    record.quality("picture", decibels(frame.rgba, naive(texture, camera, 32, interpolation=wide)))


@pytest.mark.parametrize("name", registry.names("interpolations"))
@pytest.mark.parametrize("scale", [5.3, 40.7])
def test_white_stays_white_under_every_interpolation(name, scale):
    interpolation = registry.build("interpolations", name)
    frame = picture(
        square(even(1, 1, 1)), from_above(scale, 48, 0.3), 48, interpolation=interpolation
    )
    np.testing.assert_allclose(frame.rgba[..., 0], frame.coverage, atol=2e-6)  # float32 sums


def test_a_sub_pixel_that_no_point_reaches_has_the_interpolated_color():
    texture, uv = noise(16), np.array([0.3, 0.6])
    mesh = Mesh(SQUARE, FALLING, np.tile(uv, (4, 1)), (texture,))  # nothing to project
    spline = registry.build("interpolations", "spline")
    found = picture(mesh, from_above(8.0, 8), 8, interpolation=spline).rgba[4, 4, :3]
    truth = interpolated(texture, uv[:1], 1 - uv[1:], spline)[0]
    np.testing.assert_allclose(found, truth, atol=1e-3)  # 1/4096 texel


def test_linear_interpolation_stays_within_the_texture_s_range():
    frame = picture(square(noise(16)), from_above(60.0, 64), 64, interpolation=Bilinear())
    assert frame.rgba.min() >= 0
    assert frame.rgba.max() <= 1 + 1e-6


@pytest.mark.parametrize("name", registry.names("filters"))
def test_every_pixel_filter_leaves_white_white(name):
    # 90 px: three tiles, whose seams would show
    chosen = registry.build("filters", name)
    frame = picture(square(even(1, 1, 1)), from_above(80.0, 90, 0.2), 90, pixel_filter=chosen)
    np.testing.assert_allclose(frame.rgba[35:55, 25:65], 1, atol=1e-6)  # float32 sums


@pytest.mark.sweep
@pytest.mark.parametrize("chosen", [Tent(), Gaussian(0.5), Mitchell(), Lanczos(2)])
def test_a_pixel_filter_weighs_what_rays_see(chosen, record):
    rays, size = 12, 40
    texture, camera = noise(32), from_above(30.0, size, 0.4)
    image = naive_rays(texture, camera, size, rays, Bilinear())
    place = (np.arange(size * rays) + 0.5) / rays
    profile = weight(chosen, place - np.arange(size)[:, None] - 0.5)
    profile /= profile.sum(axis=1, keepdims=True)
    truth = np.einsum("js,isc->ijc", profile, np.einsum("ir,rsc->isc", profile, image))
    frame = picture(
        square(texture), camera, size, interpolation=Bilinear(), pixel_filter=chosen, samples=8
    )
    record.quality("picture", decibels(frame.rgba, np.clip(truth, [-1, -1, -1, 0], [2, 2, 2, 1])))


def test_depth_is_that_of_the_pixel_s_own_square():
    mesh, camera = square(even(1, 1, 1)), from_above(8.0, 16)
    wide = picture(mesh, camera, 16, pixel_filter=Gaussian(1.0))
    assert wide.coverage[8, 3] > 0
    np.testing.assert_array_equal(wide.depth, picture(mesh, camera, 16).depth)


def test_a_wider_filter_covers_no_more_sub_pixels():
    mesh, camera = square(even(1, 1, 1)), from_above(30.0, 40)
    box = picture(mesh, camera, 40).statistics
    wide = picture(mesh, camera, 40, pixel_filter=Lanczos(3)).statistics
    assert wide.covered == box.covered == 16 * 30**2


@pytest.mark.parametrize("samples", [1, 3, 4])
def test_a_box_of_a_pixel_weighs_its_own_sub_pixels_alike(samples):
    np.testing.assert_array_equal(pixel_profile(Box(), samples), np.full(samples, 1 / samples))


def test_the_time_that_a_mesh_takes_is_told(monkeypatch):
    ticks = iter([5.0, 7.5])
    clock = SimpleNamespace(perf_counter=lambda: next(ticks))
    monkeypatch.setattr("resample_meshes.rendering.time", clock)
    assert picture(square(even(1, 1, 1)), from_above(8.0, 16), 16).statistics.seconds == 2.5
