"""Depth that was taken at fewer samples and enlarged to the size of its picture."""

import cv2
import numpy as np
import pytest

from resample_warp3d.depth.refining.conditioning import refine
from resample_warp3d.depth.refining.inspecting import block_of
from resample_warp3d.depth.refining.shrinking import parted, small_map
from resample_warp3d.types import DepthImage
from tests.warp3d.naive_sheet import EMPTY

NEAR, FAR = 0.5, 0.2
Y, X = np.mgrid[:160, :160] + 0.5
BALL = np.hypot(X - 75, Y - 83) < 41
TILT = 1 + 0.0005 * (X + Y)
TRUTH = (np.where(BALL, NEAR, FAR) * TILT).astype(np.float32)


def in_blocks(nearness, side):
    small = nearness[side // 2 :: side, side // 2 :: side]
    return np.ascontiguousarray(np.repeat(np.repeat(small, side, axis=0), side, axis=1))


def seen(nearness, rng):
    """The depth image of a ball before a wall, in noisy colors."""
    color = np.where(BALL[..., None], (0.8, 0.3, 0.1), (0.1, 0.4, 0.7))
    color = color + 0.05 * rng.standard_normal(color.shape)
    return DepthImage(color.astype(np.float32), np.asarray(nearness, np.float32), EMPTY)


def wrong(nearness):
    """Which samples are on another surface."""
    return np.abs(nearness / TRUTH - 1) > 0.1


@pytest.mark.some(1)
@pytest.mark.parametrize("side", [4, 8, 16])
def test_blocks_of_any_size_end_where_colors_do(side, rng, record):
    given = in_blocks(TRUTH, side)
    found = refine(seen(given, rng)).image.nearness
    assert wrong(given).mean() > 0.002 * side
    record.error("wrong samples", wrong(found))


def test_blocks_are_found_where_half_of_the_map_is_flat_along_an_axis():
    steep = np.where(Y > 96, TRUTH, np.float32(FAR) + 1e-3 * X.astype(np.float32))
    for side in (4, 8):
        blocks = in_blocks(steep, side)
        assert block_of(blocks) == side
        assert block_of(np.ascontiguousarray(blocks.T)) == side
    assert block_of(cv2.GaussianBlur(steep, (0, 0), 1.0)) == 1


def enlarged(values, side, kind):
    height, width = values.shape
    small = cv2.resize(values, (width // side, height // side), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (width, height), interpolation=kind), small


KINDS = {"bilinear": (cv2.INTER_LINEAR, 2), "bicubic": (cv2.INTER_CUBIC, 5)}


@pytest.mark.parametrize("is_depth", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_the_map_that_was_enlarged_is_found(kind, is_depth):
    way, side = KINDS[kind]
    given, small = enlarged(1 / TRUTH if is_depth else TRUTH, side, way)
    found = small_map(1 / given if is_depth else given)
    assert (found.side, found.is_depth) == (side, is_depth)
    np.testing.assert_allclose(found.values, small, rtol=1e-4)


def test_a_map_that_was_not_enlarged_has_no_small_one():
    for given in (TRUTH, cv2.GaussianBlur(TRUTH, (0, 0), 1.5), in_blocks(TRUTH, 4)):
        assert small_map(given) is None


@pytest.mark.some(2)
@pytest.mark.parametrize("side", [2, 4, 8])
def test_bicubic_maps_end_where_colors_do(side, rng, record):
    given, _ = enlarged(TRUTH, side, cv2.INTER_CUBIC)
    refined = refine(seen(given, rng))
    assert refined.chosen == "sharpen"
    assert wrong(given).mean() > 0.008 * side
    record.error("wrong samples", wrong(refined.image.nearness))


def test_means_of_two_surfaces_join_the_more_similar_one():
    values = np.full((5, 8), FAR, np.float32)
    values[:, 5:] = NEAR
    values[:, 4] = 0.7 * NEAR + 0.3 * FAR
    found, is_mean = parted(values)
    assert np.argwhere(is_mean)[:, 1].tolist() == [4] * 5
    np.testing.assert_array_equal(found[:, 4], np.float32(NEAR))
