"""How sure refined depth is goes into the confidence of pixels."""

import cv2
import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.pixels import Equirectangular
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.projection_models import mapping_between
from resample_warp3d.types import AS_GIVEN, DepthImage, Equation
from resample_warp3d.warping import render
from tests.warp3d.naive_sheet import EMPTY

SHAPE = (24, 32)
STAY = Equation(np.eye(3), np.zeros(3))


def source_of(trust, place=EMPTY):
    color = np.full((*SHAPE, 3), 0.5, np.float32)
    image = DepthImage(color, np.full(SHAPE, 2.0, np.float32), place)
    return prepare(image, refine="none")._replace(trust=trust)


def test_pixels_are_as_sure_as_the_depth_they_are_made_of(rng):
    trust = rng.random(SHAPE).astype(np.float32)
    moved = render(source_of(trust), of_rectified(1.0), SHAPE, "hybrid")
    given = render(source_of(AS_GIVEN), of_rectified(1.0), SHAPE, "hybrid")
    # A disparity of 2 px: the picture goes to the left.
    np.testing.assert_allclose(
        moved.confidence[:, :-3], (given.confidence * np.roll(trust, -2, axis=1))[:, :-3], atol=1e-6
    )
    np.testing.assert_array_equal(moved.image, given.image)


def test_behind_a_lens_samples_are_asked_where_they_are_seen(rng):
    trust = rng.random(SHAPE).astype(np.float32)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    place = np.stack([x + 3.0, y - 1.0], axis=2)
    moved = render(source_of(trust, place), STAY, SHAPE, "hybrid")
    expected = np.roll(trust, (-1, 3), axis=(0, 1))
    is_inside = np.s_[1:-3, 5:-1]
    np.testing.assert_allclose(
        moved.confidence[is_inside] / moved.coverage[is_inside], expected[is_inside], atol=1e-4
    )


def rays_of_lens(matrix, lens, shape):
    """Directions (H, W, 2), x / z and y / z, of the pixels of a camera with OpenCV's lens."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    pixels = np.stack([x, y], axis=2).reshape(-1, 1, 2)
    steps = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12
    found = cv2.undistortPoints(pixels, matrix, lens, criteria=steps)
    return found.reshape(*shape, 2)


def rays_of_panorama(shape):
    """As `rays_of_lens`, of all directions; NaN behind the eye."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    yaw, pitch = (x / shape[1] - 0.5) * 2 * np.pi, (0.5 - y / shape[0]) * np.pi
    ray = np.stack([np.tan(yaw), -np.tan(pitch) / np.cos(yaw)], axis=2)
    ray[np.cos(yaw) <= 0] = np.nan
    return ray


@pytest.mark.parametrize("name", ["lens", "panorama"])
def test_targets_that_bend_rays_ask_the_samples_that_their_pixels_see(name, rng):
    trust = rng.random(SHAPE).astype(np.float32)
    matrix = np.array([[20.0, 0, 16], [0, 20.0, 12], [0, 0, 1]])
    lens = np.array([-0.2, 0.05, 0.002, -0.001, 0.0])
    if name == "lens":
        shape = SHAPE
        target, ray = Camera(matrix, np.eye(4), lens), rays_of_lens(matrix, lens, shape)
    else:
        shape = 40, 80
        target, ray = Equirectangular(np.eye(4)), rays_of_panorama(shape)
    way = mapping_between(Camera(matrix), target, shape)
    moved = render(source_of(trust), way, shape, "hybrid")
    given = render(source_of(AS_GIVEN), way, shape, "hybrid")
    # The eye stays where it is, so pixels see along the same rays, whatever the depth.
    place = 20.0 * ray + (16.0, 12.0)
    is_inside = ((place > 0.5) & (place < np.array(SHAPE[::-1]) - 0.5)).all(axis=2)
    is_clear = is_inside & (np.abs(place - np.round(place)) > 1e-3).all(axis=2)
    assert is_clear.sum() > 120
    column, row = np.floor(place[is_clear]).astype(int).T
    np.testing.assert_allclose(
        moved.confidence[is_clear], given.confidence[is_clear] * trust[row, column], atol=1e-6
    )
    np.testing.assert_array_equal(moved.image, given.image)
    assert not moved.confidence[~(moved.coverage > 0)].any()


def test_depth_that_was_made_up_is_half_as_sure():
    color = np.full((*SHAPE, 3), 0.5, np.float32)
    nearness = np.full(SHAPE, 2.0, np.float32)
    nearness[10:13, 14:17] = 0.0
    source = prepare(DepthImage(color, nearness, EMPTY), refine="complete")
    confidence = render(source, STAY, SHAPE, "hybrid").confidence
    assert confidence[11, 15] == pytest.approx(0.5, abs=0.05)
    assert confidence[:8].min() == 1.0


def test_depth_as_it_was_given_takes_no_confidence():
    assert not source_of(AS_GIVEN).trust.size
    assert render(source_of(AS_GIVEN), STAY, SHAPE, "hybrid").confidence.min() == 1.0
