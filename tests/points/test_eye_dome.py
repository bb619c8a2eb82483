"""Eye-dome lighting: what lies behind an edge is dark, slopes and fronts are not."""

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample_points import Cloud, CloudStyle, render_cloud
from resample_points.painting.rendering import eye_dome

CAMERA = Camera.from_fov(50, 48, 64)


def plane(slope):
    """Depth of the plane z = 2 + slope x."""
    x = ((np.arange(64) + 0.5) - 32) / CAMERA.fx
    return np.tile(2 / (1 - slope * x), (48, 1)).astype(np.float32)


@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0])
def test_a_slanted_plane_stays_bright(slope):
    assert eye_dome(plane(slope), 1.0).min() > 0.97


def test_what_lies_behind_an_edge_is_dark_and_the_front_is_not():
    depth = plane(0.0)
    depth[:, :30] = 1.0
    light = eye_dome(depth, 1.0)
    assert light[:, 30].max() < 0.01
    assert light[:, :30].min() == 1
    assert light[:, 33:].min() == 1


def test_nothing_is_bright_and_darkens_nothing():
    depth = plane(0.0)
    depth[:, :30] = np.inf
    np.testing.assert_array_equal(eye_dome(depth, 1.0), np.ones((48, 64)))
    np.testing.assert_array_equal(eye_dome(np.full_like(depth, np.inf), 1.0), np.ones((48, 64)))


def test_strength_is_an_exponent_of_the_darkening():
    depth = plane(0.0)
    depth[:, :30] = 1.998
    once, twice = eye_dome(depth, 0.5), eye_dome(depth, 1.0)
    assert 0.5 < once.min() < 0.999
    np.testing.assert_allclose(twice, once**2, rtol=1e-5)


def test_parallel_depths_are_compared_by_differences():
    depth = plane(0.0)
    depth[:, :30] = -3.0
    light = eye_dome(depth, 1.0, extent=10.0)
    assert light[:, 30].max() < 0.01
    assert light[:, :30].min() == 1


def test_a_picture_with_eye_dome_lighting_is_that_picture_times_its_light():
    x, y = np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80))
    back = np.stack([x, y, np.full_like(x, 3)], axis=2).reshape(-1, 3)
    place = np.concatenate([back, 0.3 * back])
    cloud = Cloud(place, np.empty((0, 3)), np.ones((len(place), 3)), np.empty(0))
    plain = render_cloud(cloud, CAMERA, size=(64, 48))
    lit = render_cloud(cloud, CAMERA, size=(64, 48), style=CloudStyle(edl=1))
    expected = plain.rgba[..., :3] * eye_dome(plain.depth, 1)[..., None]
    np.testing.assert_array_equal(lit.rgba[..., :3], expected)
    np.testing.assert_array_equal(lit.coverage, plain.coverage)
    with pytest.raises(ValueError, match="eye-dome lighting of strength -1"):
        CloudStyle(edl=-1)
