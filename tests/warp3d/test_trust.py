"""How sure refined depth is goes into the confidence of pixels."""

import numpy as np
import pytest

from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
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
