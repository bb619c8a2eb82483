"""Ellipsoids seen all around, against rays by brute force and other cameras."""

import numpy as np
import pytest

from resample import Camera, registry
from resample.cameras.pixels import Equirectangular, rays_at
from resample.painting.all_around import RayDirections, paint_around, ray_directions
from resample.painting.ellipsoids import Ellipsoids, ShapedStyle, paint_ellipsoids
from tests.shaped import twin

SIZE = (32, 64)


def gaussians(count=80, seed=1):
    """All around the origin, in scales of all kinds."""
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(count, 3))
    place *= rng.uniform(1, 5, (count, 1)) / np.linalg.norm(place, axis=1, keepdims=True)
    scale = np.exp(rng.uniform(-4, -0.5, (count, 3)))
    opacity, color = rng.uniform(0.01, 1, count), rng.random((count, 3))
    parts = place, scale, rng.normal(size=(count, 4)), opacity, color
    return Ellipsoids(*(np.float32(part) for part in parts))


def truth(given, direction):
    """RGBA of rays (H, W, 3) from the origin, by distance."""
    position, scale, rotation, opacity, color = (np.asarray(a, float) for a in given[:5])
    axes, rgba = twin.rotations(rotation), np.zeros((*direction.shape[:2], 4))
    share = np.ones(direction.shape[:2])
    for n in np.argsort(np.linalg.norm(position, axis=1)):
        to_unit = axes[n].T / scale[n][:, None]
        o, d = to_unit @ -position[n], direction @ to_unit.T
        t = -(d @ o) / (d * d).sum(axis=2)
        square = np.square(o + t[..., None] * d).sum(axis=2)
        alpha = np.minimum(opacity[n] * np.exp(-0.5 * square), 0.99)
        alpha[(alpha < 1 / 255) | ~(t > 0)] = 0
        rgba[..., :3] += (share * alpha)[..., None] * color[n]
        rgba[..., 3] += share * alpha
        share *= 1 - alpha
    return rgba


def centers(size):
    return np.stack(np.meshgrid(np.arange(size[1]) + 0.5, np.arange(size[0]) + 0.5), axis=2)


def around(given, camera, size=SIZE, **style):
    if not isinstance(camera, RayDirections):
        camera = ray_directions(camera, size)
    return paint_around(given, camera, size, ShapedStyle("distance", **{"subpixels": 1, **style}))


def dome(fov, size):
    """A fisheye's circle, and nothing around it."""
    projection = registry.build("projections", f"fisheye:fov={fov}")

    def rays(place):
        shown = projection.shows(place, size)[..., None]
        return np.where(shown, projection.rays(place, size, 0), np.nan)

    return RayDirections(np.eye(4), rays)


def test_a_panorama_is_that_of_rays_without_a_seam():
    given = gaussians()
    ours = around(given, Equirectangular())
    np.testing.assert_allclose(ours.rgba, truth(given, rays_at(centers(SIZE), SIZE)), atol=1e-3)


@pytest.mark.parametrize("fov", [120, 180, 360])
def test_a_dome_is_that_of_rays(fov):
    given, size = gaussians(seed=2), (40, 48)
    ours = around(given, dome(fov, size), size)
    rays = dome(fov, size).rays(centers(size))
    expected = np.where(np.isfinite(rays[..., :1]), truth(given, np.nan_to_num(rays, nan=1)), 0)
    np.testing.assert_allclose(ours.rgba, expected, atol=1e-3)
    assert not ours.rgba[0, 0].any()


def test_what_is_turned_looks_the_same_across_edges_of_faces():
    """By 45 degrees, where what was in the middle of a face is between two of them."""
    given = gaussians(seed=3)
    one = around(given, Equirectangular(), dilation=0.3, is_compensated=True)
    turned = Equirectangular().turned(np.pi / 4)
    two = around(given, turned, dilation=0.3, is_compensated=True)
    assert twin.psnr(np.roll(one.rgba, -8, axis=1), two.rgba) > 100
    depth = np.roll(one.depth, -8, axis=1)
    seen = np.isfinite(depth)
    np.testing.assert_allclose(two.depth[seen], depth[seen], rtol=1e-3)


def test_a_pinhole_sees_what_its_own_painter_shows():
    given = gaussians(seed=4)
    camera, size = Camera.from_fov(70, 40, 48), (40, 48)
    own = paint_ellipsoids(given, camera, size, ShapedStyle("distance", 1))
    np.testing.assert_allclose(around(given, camera, size).rgba, own.rgba, atol=3e-4)


def test_a_lens_bends_what_is_seen():
    given = gaussians(seed=5)
    bent = Camera.from_intrinsics(40, 40, 24, 20).with_lens([-0.2, 0.03, 0, 0])
    ours = around(given, bent, (40, 48))
    from resample.cameras.pixels import directions, undistorted_places

    flat = directions(bent, undistorted_places(bent, centers((40, 48))))
    rays = np.concatenate([flat, np.ones((40, 48, 1))], axis=2)
    np.testing.assert_allclose(ours.rgba, truth(given, rays), atol=1e-3)


@pytest.mark.sweep
def test_sub_pixels_and_odd_sizes_are_averaged():
    given = gaussians(seed=6)
    fine = around(given, dome(200, (33, 37)), (33, 37), subpixels=3)
    size = (99, 111)
    rays = dome(200, size).rays(centers(size))
    expected = np.where(np.isfinite(rays[..., :1]), truth(given, np.nan_to_num(rays, nan=1)), 0)
    expected = expected.reshape(33, 3, 37, 3, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(fine.rgba, expected, atol=1e-3)


def test_orders_by_depth_are_refused():
    with pytest.raises(ValueError, match="take the order distance"):
        paint_around(
            gaussians(3), ray_directions(Equirectangular(), SIZE), SIZE, ShapedStyle("depth")
        )
