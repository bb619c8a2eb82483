"""Closed surfaces hide what is behind them, and their coverage is 1."""

import math

import cv2
import numpy as np
import pytest

from resample.cameras.models import Camera
from resample_comparisons.warp3d.scenes import SceneViewpoint, pose_of
from resample_warp3d import Hybrid
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage

SIDE = 400
SOURCE = Camera.from_fov(60.0, SIDE, SIDE)
RED, GREEN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
BALL, RADIUS = np.array([0.0, 0.0, 4.0]), 1.0
WALL = 7.0
GRAZING = 0.35  # cosine to the source's ray below which a sample may be a silhouette's
RIM = 4  # px from the outline of a ball or card


def rays_of(camera):
    """Directions (H, W, 3) of pixels' rays in the world, with z = 1 in the camera."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    pose = camera.world_to_camera
    flat = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.matrix).T
    return flat @ pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]


def hit_ball(camera):
    """Depth of the ball along each pixel's ray, inf where it is missed."""
    ray, eye = rays_of(camera)
    a, b = (ray**2).sum(-1), ray @ (eye - BALL)
    inside = b * b - a * ((eye - BALL) @ (eye - BALL) - RADIUS**2)
    depth = (-b - np.sqrt(np.maximum(inside, 0))) / a
    return np.where(inside > 0, depth, np.inf)


def hit_card(camera, distance, half, slope=0.0):
    """Depth of a card around the axis whose distance grows with x."""
    ray, eye = rays_of(camera)
    depth = (distance + slope * eye[0] - eye[2]) / (ray[..., 2] - slope * ray[..., 0])
    x, y = (eye[n] + depth * ray[..., n] for n in (0, 1))
    return np.where((abs(x) < half) & (abs(y) < half) & (depth > 0), depth, np.inf)


def inner(mask, reach):
    """The mask's pixels with all others farther away than `reach`."""
    for axis in (0, 1):
        for _ in range(reach):
            mask = mask & np.roll(mask, 1, axis) & np.roll(mask, -1, axis)
    return mask


def source_with(near, far):
    """Red before green."""
    depth = np.minimum(near, far)
    color = np.where((near < far)[..., None], RED, GREEN)
    return prepare(DepthImage(*(np.float32(each) for each in (color, 1 / depth))))


def around(degrees, distance=4.0):
    """A camera that has gone around the ball's center and looks at it."""
    angle = math.radians(degrees)
    eye = (distance * math.sin(angle), 0.0, 4.0 - distance * math.cos(angle))
    return SOURCE.moved(pose_of(SceneViewpoint(eye, -angle)))


def seen_of_ball(camera, reach, cosine):
    """Pixels `reach` px inside the ball whose angle to the source's rays has a larger cosine."""
    depth, (ray, eye) = hit_ball(camera), rays_of(camera)
    is_hit = np.isfinite(depth)
    point = eye + np.where(is_hit, depth, 0)[..., None] * ray
    normal = (point - BALL) / RADIUS
    found = -(normal * point).sum(-1) / np.linalg.norm(point, axis=-1)
    return inner(is_hit, reach) & (found > cosine)


@pytest.mark.sweep
@pytest.mark.parametrize("wall", ["level", "slanted"])
@pytest.mark.parametrize(("degrees", "distance"), [(20, 4.0), (30, 4.0), (36, 4.0), (30, 1.9)])
def test_no_wall_shows_through_a_ball(degrees, distance, wall):
    slope = 0.4 if wall == "slanted" else 0.0
    far = hit_card(SOURCE, WALL, 99.0, slope)
    source, camera = source_with(hit_ball(SOURCE), far), around(degrees, distance)
    warped = Hybrid()(source, between(SOURCE, camera), (SIDE, SIDE))
    inside = seen_of_ball(camera, RIM, GRAZING)
    assert inside.sum() > 10_000
    assert warped.image[inside, 1].max() == 0
    assert warped.coverage[inside].min() > 0.98  # 1 but in 4 of 115,584 pixels of the nearest view


def test_a_ball_hides_the_wall_up_to_where_the_source_sees_it_end():
    """There a sample of the source covers 10 px, of which only the outermost are its end."""
    source, camera = source_with(hit_ball(SOURCE), np.full((SIDE, SIDE), WALL)), around(45)
    warped = Hybrid()(source, between(SOURCE, camera), (SIDE, SIDE))
    seen = seen_of_ball(camera, 0, 0.0).astype(np.uint8)
    away = cv2.distanceTransform(seen, cv2.DIST_L2, 5)
    shows = warped.image[..., 1] > 0.01
    assert np.count_nonzero(shows & (away > 3)) <= 60
    assert not np.any(shows & (away > 10))


@pytest.mark.sweep
@pytest.mark.parametrize("roll", [8, 15, 30])
@pytest.mark.parametrize("distance", [1.0, 3.0, 3.6])
def test_no_wall_shows_through_a_card_that_is_rolled_and_large(roll, distance):
    card = hit_card(SOURCE, 4.0, 0.9)
    source = source_with(card, hit_card(SOURCE, WALL, 99.0))
    stand = SceneViewpoint((0.05, 0.02, distance), 0.0, 0.0, math.radians(roll))
    camera = SOURCE.moved(pose_of(stand))
    warped = Hybrid()(source, between(SOURCE, camera), (SIDE, SIDE))
    inside = inner(np.isfinite(hit_card(camera, 4.0, 0.9 - 0.04)), 1)
    assert inside.sum() > 10_000
    assert warped.image[inside, 1].max() == 0
    assert warped.coverage[inside].min() == 1


@pytest.mark.sweep
def test_a_thin_gap_between_cards_stays_open_to_what_is_behind():
    """A gap of 0.4 px before a green wall: not closed as if the cards were one surface."""
    wide = 0.02  # of the scene; seen from the source, several px
    x = (np.arange(SIDE) + 0.5 - SIDE / 2) / SOURCE.matrix[0, 0] * 4.0
    near = np.where(abs(x) > wide, 4.0, np.inf)[None].repeat(SIDE, 0)
    source = source_with(near, np.full((SIDE, SIDE), WALL))
    camera = SOURCE.moved(pose_of(SceneViewpoint((0.0, 0.0, -20.0))))
    warped = Hybrid()(source, between(SOURCE, camera), (SIDE, SIDE))
    pixel = SOURCE.matrix[0, 0] / 24.0  # px per scene unit at the cards
    row = warped.image[SIDE // 2, SIDE // 2 - 3 : SIDE // 2 + 3, 1]
    columns = np.count_nonzero(abs(x) <= wide) * 4.0 / SOURCE.matrix[0, 0]
    assert row.sum() == pytest.approx(columns * pixel, abs=0.25)
