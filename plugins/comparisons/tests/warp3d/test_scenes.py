import math

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers
from resample_comparisons.warp3d.scenes import (
    VIEWPOINTS,
    Ball,
    ObjectScene,
    Panel,
    SceneViewpoint,
    SurfaceMaterial,
    _objects,
    generated,
    pose_of,
)
from resample_warp3d.depth.equation import between, places, warp_places
from resample_warp3d.types import DepthImage
from tests.bits import assert_threads_change_nothing

PLAIN = SurfaceMaterial("checker", 1.0, "#ffffff", "#ffffff")
SHAPE = (12, 16)
CAMERA = Camera.from_fov(60.0, *SHAPE)


def scene_of(*things):
    return ObjectScene(_objects(things), CAMERA, {}, SHAPE)


def wall(z, half=50.0):
    return Panel((-half, -half, z), (2 * half, 0.0, 0.0), (0.0, 2 * half, 0.0), PLAIN)


def rays(camera=CAMERA, shape=SHAPE):
    """Directions of the pixels' centers, z = 1."""
    place = np.dstack([pixel_centers(shape), np.ones(shape)])
    return place @ np.linalg.inv(camera.matrix).T


@pytest.fixture(scope="module")
def small():
    return generated(24)


def test_a_wall_has_one_depth():
    _, depth = scene_of(wall(3.0)).render(CAMERA, SHAPE, rays=1)
    np.testing.assert_allclose(depth, 3.0, rtol=1e-13)


def test_inverse_depth_is_linear_on_a_slanted_plane():
    slanted = Panel((-20.0, -20.0, 9.0), (40.0, 0.0, 8.0), (0.0, 40.0, 0.0), PLAIN)
    _, depth = scene_of(slanted).render(CAMERA, SHAPE, rays=1)
    np.testing.assert_allclose(np.diff(1 / depth, n=2, axis=1), 0.0, atol=1e-14)


def test_a_sphere_is_hit_where_the_quadratic_says():
    center, radius = np.array([0.2, -0.1, 4.0]), 1.1
    _, depth = scene_of(Ball(tuple(center), radius, PLAIN)).render(CAMERA, SHAPE, rays=1)
    ray = rays()
    square, half = (ray**2).sum(axis=2), ray @ center
    discriminant = half**2 - square * (center @ center - radius**2)
    with np.errstate(invalid="ignore"):
        expected = (half - np.sqrt(discriminant)) / square
    np.testing.assert_allclose(depth, np.where(discriminant > 0, expected, np.inf), rtol=1e-12)


def test_the_nearest_object_is_seen():
    _, depth = scene_of(wall(5.0), wall(2.0, half=0.2), wall(7.0)).render(CAMERA, SHAPE, rays=1)
    assert depth[6, 8] == pytest.approx(2.0)
    assert depth[0, 0] == pytest.approx(5.0)


def test_what_is_behind_the_eye_is_not_seen():
    _, depth = scene_of(wall(-3.0), Ball((0.0, 0.0, -4.0), 1.0, PLAIN)).render(CAMERA, SHAPE)
    assert np.isinf(depth).all()


def test_a_plane_that_reaches_behind_the_eye_is_seen_in_front_of_it():
    floor = Panel((-50.0, 1.0, 80.0), (100.0, 0.0, 0.0), (0.0, 0.0, -100.0), PLAIN)
    _, depth = scene_of(floor).render(CAMERA, SHAPE, rays=1)
    down = rays()[..., 1]
    hits = (down > 0) & (1 / down < 80)
    np.testing.assert_allclose(depth[hits], 1 / down[hits], rtol=1e-12)
    assert np.isinf(depth[~hits]).all()


def test_colors_are_means_over_pixels():
    half = Panel((-50.0, -50.0, 2.0), (50.0, 0.0, 0.0), (0.0, 100.0, 0.0), PLAIN)
    camera = Camera.from_intrinsics(10.0, 10.0, 8.25, 6.0)
    color, _ = scene_of(half).render(camera, SHAPE, rays=8)
    whole, part, nothing = color[6, 7:10, 1]
    assert nothing == 0
    assert part / whole == pytest.approx(0.25)


def test_a_pixel_behind_which_an_occluder_stands_is_seen_in_part():
    # From 1 beside, the strip at z 2 with 0 <= x <= 1 hides -1 <= x <= 1 of the wall at z 4.
    strip = Panel((0.0, -50.0, 2.0), (1.0, 0.0, 0.0), (0.0, 100.0, 0.0), PLAIN)
    other = Camera.from_fov(150.0, 64, 64).moved(pose_of(SceneViewpoint((1.0, 0.0, 0.0))))
    camera = Camera.from_intrinsics(8.0, 8.0, 8.5, 6.0)
    scene = scene_of(wall(4.0), strip)
    fraction, nearest, farthest = scene.visible(camera, SHAPE, other, (64, 64), rays=4)
    # Columns of 0.5 m on the wall, from x = -4.25: column 6 spans -1.25 to -0.75.
    assert fraction[6, 5:8].tolist() == [1.0, 0.5, 0.0]
    assert nearest[6, 6] == farthest[6, 6] == pytest.approx(4.0)


def test_depths_in_a_pixel_reach_from_the_occluder_to_what_is_behind():
    strip = Panel((0.0, -50.0, 2.0), (1.0, 0.0, 0.0), (0.0, 100.0, 0.0), PLAIN)
    camera = Camera.from_intrinsics(8.0, 8.0, 8.5, 6.0)
    _, nearest, farthest = scene_of(wall(4.0), strip).visible(camera, SHAPE, camera, SHAPE)
    assert (nearest[6, 8], farthest[6, 8]) == pytest.approx((2.0, 4.0))


def test_a_view_sees_all_of_itself(small):
    fraction, _, _ = small.visible(small.source, small.shape, small.source, small.shape, rays=2)
    assert fraction.min() == 1.0


def test_what_is_outside_the_other_frame_is_not_seen():
    camera = Camera.from_intrinsics(10.0, 10.0, 8.0, 6.0)
    shifted = Camera.from_intrinsics(10.0, 10.0, 12.0, 6.0)
    fraction, _, _ = scene_of(wall(3.0)).visible(camera, SHAPE, shifted, SHAPE)
    assert fraction[:, :12].min() == 1.0
    assert fraction[:, 12:].max() == 0.0


def test_depth_and_visibility_agree_with_the_warping_equation(small, record):
    image, camera = small.depth_image(rays=1), small.views["side"]
    nearness = image.nearness.astype(np.float64)
    place, there = warp_places(between(small.source, camera), places(image), nearness)
    _, depth = small.render(camera, (96, 96), rays=1)
    larger = camera.resized(small.shape, (96, 96))
    _, depth = small.render(larger, (96, 96), rays=1)
    column, row = np.floor(4 * place).astype(int).transpose(2, 0, 1)
    inside = (column >= 0) & (row >= 0) & (column < 96) & (row < 96)
    hidden = 1 / there[inside] > 1.1 * depth[row[inside], column[inside]]
    same = np.abs(there[inside] * depth[row[inside], column[inside]] - 1) < 0.02
    record.error(
        "wrong depths", ~(hidden | same)
    )  # the others are at edges, which 4 px per sample blur
    record.error("hidden or wrong", ~same)


@pytest.mark.parametrize("name", VIEWPOINTS)
def test_every_view_sees_something_that_the_source_sees(small, name):
    camera, shape = small.views[name], small.shape
    fraction, _, _ = small.visible(camera, shape, small.source, shape, rays=2)
    assert 0.05 < (fraction == 1).mean() < 0.95


def test_the_source_has_depth_everywhere(small):
    image = small.depth_image(rays=1)
    assert isinstance(image, DepthImage)
    assert (image.nearness > 0).all()


def test_pictures_are_the_same_each_time(small):
    first, second = (small.render(small.source, small.shape, rays=2)[0] for _ in range(2))
    assert np.array_equal(first, second)


def test_a_picture_does_not_depend_on_the_count_of_threads(small):
    assert_threads_change_nothing(lambda: [small.render(small.source, small.shape, rays=2)[0]])


def test_colors_are_light_between_none_and_white(small):
    color, _ = small.render(small.source, small.shape, rays=2)
    assert 0.0 <= color.min() < 0.1
    assert 0.5 < color.max() <= 1.35  # tints may exceed white


@pytest.mark.parametrize("pattern", ["photo", "checker", "stripes", "text", "cloth"])
def test_patterns_have_contrast(pattern):
    look = SurfaceMaterial(pattern, 4.0, "#101010", "#e0e0e0")
    page = Panel((-50.0, -50.0, 3.0), (100.0, 0.0, 0.0), (0.0, 100.0, 0.0), look)
    color, _ = scene_of(page).render(CAMERA, (48, 64), rays=1)
    assert color.std() > 0.05


def test_a_rolled_camera_sees_right_become_down():
    pose = pose_of(SceneViewpoint((0.0, 0.0, 0.0), roll=-math.pi / 2))
    np.testing.assert_allclose(pose[:3, :3] @ (1, 0, 0), (0, 1, 0), atol=1e-15)


def test_a_camera_that_looks_to_the_right_has_the_right_in_front():
    pose = pose_of(SceneViewpoint((0.0, 0.0, 0.0), yaw=math.pi / 2))
    np.testing.assert_allclose(pose[:3, :3] @ (1, 0, 0), (0, 0, 1), atol=1e-15)


def test_a_camera_that_looks_down_has_the_floor_in_front():
    pose = pose_of(SceneViewpoint((0.0, 0.0, 0.0), pitch=math.pi / 2))
    np.testing.assert_allclose(pose[:3, :3] @ (0, 1, 0), (0, 0, 1), atol=1e-15)


@pytest.mark.parametrize("size", [7, 4097])
def test_sizes_out_of_range_are_refused(size):
    with pytest.raises(ValueError, match="8 to 4096"):
        generated(size)


def test_lenses_are_refused(small):
    bent = Camera(small.source.matrix, distortion=np.array([0.1, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="without distortion"):
        small.render(bent, small.shape)
