"""Depth that was taken at fewer samples and enlarged to the size of its picture."""

import cv2
import numpy as np
import pytest

from resample_warp3d.depth.refining.conditioning import refine
from resample_warp3d.depth.refining.enlargement import parted, small_map
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
        for given in (blocks, np.ascontiguousarray(blocks.T)):
            assert small_map(given, 0.0, is_soft=True).side == pytest.approx(side, rel=1e-3)
    assert small_map(cv2.GaussianBlur(steep, (0, 0), 1.0), 0.0, is_soft=True) is None


def picked(values, few):
    """A map of `few` samples a side, each the value amid its part of the frame."""
    at = ((np.arange(few) + 0.5) * len(values) / few).astype(int)
    return values[at][:, at]


def as_jpeg(values):
    levels = np.rint(255 * (values - values.min()) / np.ptp(values)).astype(np.uint8)
    stored = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
    found = cv2.imdecode(stored, cv2.IMREAD_GRAYSCALE) / np.float32(255)
    return (found * np.ptp(values) + values.min()).astype(np.float32)


WAYS = {"nearest": cv2.INTER_NEAREST, "bilinear": cv2.INTER_LINEAR, "bicubic": cv2.INTER_CUBIC}


@pytest.mark.parametrize("few", [92, 64, 43, 37])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("cut", [0, 9])
def test_any_ratio_and_phase_is_measured(few, way, cut):
    """Also that of a part of an enlarged map; samples lie where their values are seen."""
    small = picked(TRUTH, few)
    given = cv2.resize(small, TRUTH.shape, interpolation=WAYS[way])
    given = np.ascontiguousarray(given[cut : len(given) - 2 * cut, 2 * cut :])
    found = small_map(given, 0.0, is_soft=True)
    rows, columns = found.rows.places(given.shape[0]), found.columns.places(given.shape[1])
    offset = (0.25 if way == "nearest" else 0.5) * few / 160 - 0.5  # blocks begin at whole px
    place = np.arange(160) * few / 160 + offset
    for shown, true in ((rows, place[cut : 160 - 2 * cut]), (columns, place[2 * cut :])):
        apart = shown - true
        np.testing.assert_allclose(apart, np.rint(apart[0]), atol=0.2)
    row, column = np.rint(rows).astype(int)[20], np.rint(columns).astype(int)[20]
    there = np.rint(place[20 + cut]).astype(int), np.rint(place[20 + 2 * cut]).astype(int)
    assert found.values[row, column] == pytest.approx(small[there], rel=1e-3)


def test_maps_whose_corners_were_aligned_are_told_and_their_stretch_is_undone():
    small = picked(TRUTH, 43)
    at = np.linspace(0, 42, 160, dtype=np.float32)
    given = cv2.remap(
        small, np.tile(at, (160, 1)), np.tile(at[:, None], (1, 160)), cv2.INTER_LINEAR
    )
    found = small_map(given, 0.0, is_soft=True)
    assert found.values.shape == (43, 43)
    assert found.rows == pytest.approx((43 / 160, 21.5 / 160 - 0.5))
    np.testing.assert_allclose(found.values, small, atol=5e-3)


def test_blocks_are_found_under_the_noise_of_a_jpeg_file():
    near = cv2.resize(picked(TRUTH, 43), TRUTH.shape, interpolation=cv2.INTER_NEAREST)
    found = small_map(as_jpeg(near), 0.0, is_soft=True)
    assert found.is_repeated
    assert found.side == pytest.approx(160 / 43, rel=5e-3)


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
    found = small_map(1 / given if is_depth else given, 0.0, is_soft=True)
    assert found.side == pytest.approx(side, rel=1e-4)
    assert found.is_depth == is_depth
    np.testing.assert_allclose(found.values, small, rtol=1e-4)


def test_a_map_that_was_not_enlarged_has_no_small_one(rng):
    noisy = TRUTH * (1 + 0.002 * rng.standard_normal(TRUTH.shape))
    for given in (TRUTH, cv2.GaussianBlur(TRUTH, (0, 0), 1.5), noisy, as_jpeg(TRUTH)):
        assert small_map(np.asarray(given, np.float32), 0.0, is_soft=True) is None


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


@pytest.mark.parametrize("shape", [(8, 8), (32, 33), (39, 64), (41, 300)])
def test_small_maps_are_looked_at_too(shape, rng):
    row, column = np.mgrid[: shape[0], : shape[1]]
    for given in (np.ones(shape), 1 + rng.random(shape), 1 + (row // 3 + column // 3) % 7):
        found = small_map(np.asarray(given, np.float32), 0.0, is_soft=True)
        assert found is None or found.side == pytest.approx(3, rel=0.02)
