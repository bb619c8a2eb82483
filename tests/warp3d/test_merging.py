import math
from itertools import permutations

import numpy as np
import pytest

from resample_warp3d.types import Hole, Warped
from resample_warp3d.views.multi_source import angle_share, merge
from resample_warp3d.warping import warp
from tests.warp3d.naive_sheet import camera_at, depth_image, flat, pattern, plane, see

SHAPE = 48, 48
ROUND = 1e-6  # of a mean in float32


def view(level, *, depth=2.0, confidence=1.0, coverage=1.0, hole=Hole.NONE, shape=(3, 4)):
    """View that is the same everywhere."""
    full = np.ones(shape, np.float32)
    coverage = np.float32(0 if hole not in (Hole.NONE, Hole.CRACK) else coverage) * full
    return Warped(
        (level * coverage)[..., None], coverage, np.where(coverage > 0, np.float32(depth), np.inf),
        np.full(shape, hole, np.uint8), coverage.copy(), confidence * coverage,
    )  # fmt: skip


def beside(left, right):
    """Left half of one view and right half of another."""
    both = (np.concatenate([a[:, :2], b[:, 2:]], 1) for a, b in zip(left, right, strict=True))
    return Warped(*both)


def assert_same_bits(given, expected):
    for one, other in zip(given, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def things():
    """A card before a wall."""

    def is_inside(point):
        return (abs(point[..., 0]) < 0.5) & (abs(point[..., 1]) < 0.4)

    return [plane((0, 0, 1), 2.0, pattern(3.0), is_inside), plane((0, 0, 1), 4.0, pattern(3.0))]


def warped(source_eye, target):
    source = camera_at(source_eye, focal=48.0, shape=SHAPE)
    image = depth_image(things(), source, SHAPE, rays=8)
    return warp(image.color, 1 / image.nearness, source, target)


@pytest.mark.sweep
def test_the_order_of_views_changes_no_bit():
    target = camera_at(focal=48.0, shape=SHAPE)
    views = [warped(eye, target) for eye in ((-0.4, 0, 0), (0.4, 0.05, 0), (0, -0.3, 0.5))]
    expected = merge(views)
    for order in permutations(views):
        assert_same_bits(merge(order), expected)


@pytest.mark.sweep
def test_holes_of_one_view_are_filled_by_the_other(record):
    target = camera_at(focal=48.0, shape=SHAPE)
    left, right = (warped((x, 0, 0), target) for x in (-0.5, 0.5))
    both = merge([left, right])
    inside = np.s_[4:-4, 4:-4]
    assert (left.coverage[inside] == 0).mean() > 0.02
    assert (right.coverage[inside] == 0).mean() > 0.02
    # A silhouette before a hole of its own view stays covered in part.
    assert both.coverage[inside].min() > 0.5
    truth = see(things(), target, SHAPE, rays=8).color
    error = np.abs(both.image - truth)[inside].max(axis=2)
    record.error("wrong pixels", ~(error < 0.05))  # the rest are those


@pytest.mark.parametrize("coverage", [0.5, 1.0])
def test_one_view_merged_is_that_view(coverage):
    given = view(0.7, depth=3.0, confidence=0.4, coverage=coverage)
    merged = merge([given])
    for one, other in zip(merged, given, strict=True):
        np.testing.assert_allclose(one, other, rtol=ROUND)


@pytest.mark.sweep
def test_a_view_of_a_scene_merged_is_that_view():
    given = warped((0.3, 0, 0), camera_at(focal=48.0, shape=SHAPE))
    merged = merge([given])
    np.testing.assert_allclose(merged.image, given.image, atol=ROUND)
    np.testing.assert_allclose(merged.coverage, given.coverage, atol=ROUND)
    np.testing.assert_allclose(merged.depth, given.depth, rtol=ROUND)
    np.testing.assert_array_equal(merged.holes, given.holes)


def test_the_nearer_surface_wins():
    near, far = view(0.9, depth=2.0, confidence=0.1), view(0.2, depth=3.0)
    merged = merge([far, near])
    np.testing.assert_allclose(merged.image, 0.9, rtol=ROUND)
    np.testing.assert_allclose(merged.depth, 2.0, rtol=ROUND)
    np.testing.assert_allclose(merged.confidence, 0.1, rtol=ROUND)


def test_what_covers_less_than_half_hides_nothing():
    thin, far = view(1.0, depth=1.0, coverage=0.3, confidence=0.3), view(0.2, depth=3.0)
    merged = merge([far, thin])
    assert merged.coverage.min() > 0.9
    np.testing.assert_allclose(merged.depth, 3.0, rtol=0.2)


@pytest.mark.parametrize("difference", [0.0, 0.01])
def test_views_of_one_surface_are_weighed_by_their_confidence(difference):
    sure, unsure = view(0.8, depth=2.0), view(0.2, depth=2 + 2 * difference, confidence=0.5)
    merged = merge([sure, unsure])
    # Squares of the confidences: 4 to 1.
    np.testing.assert_allclose(merged.image, 0.8 * 0.8 + 0.2 * 0.2, rtol=1e-5)
    np.testing.assert_array_equal(merged.confidence, 1)


def test_a_source_that_saw_a_surface_from_nearby_counts_more():
    target = camera_at((0, 0, 1.0), focal=48.0, shape=SHAPE)
    wall = [plane((0, 0, 1), 4.0, flat(0.5))]
    levels = []
    for z, level in ((0.0, 0.2), (1.0, 0.8)):
        source = camera_at((0, 0, z), focal=48.0, shape=SHAPE)
        depth = 1 / depth_image(wall, source, SHAPE, rays=1).nearness
        color = np.full((*SHAPE, 1), level, np.float32)
        levels.append(warp(color, depth, source, target))
    middle = merge(levels).image[24, 24, 0]
    # Magnified 16 : 9 in areas, so the weights are as 81 to 256.
    assert middle == pytest.approx((81 * 0.2 + 256 * 0.8) / 337, abs=0.01)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (Hole.OUTSIDE, Hole.OUTSIDE, Hole.OUTSIDE),
        (Hole.OUTSIDE, Hole.DISOCCLUDED, Hole.DISOCCLUDED),
        (Hole.NO_DEPTH, Hole.OUTSIDE, Hole.NO_DEPTH),
        (Hole.NO_DEPTH, Hole.DISOCCLUDED, Hole.DISOCCLUDED),
        (Hole.NONE, Hole.DISOCCLUDED, Hole.NONE),
        (Hole.NONE, Hole.CRACK, Hole.NONE),
        (Hole.CRACK, Hole.OUTSIDE, Hole.CRACK),
        (Hole.CRACK, Hole.CRACK, Hole.CRACK),
    ],
)
def test_of_two_reasons_the_one_nearest_to_a_remedy_stays(first, second, expected):
    views = [view(0.5, hole=first), view(0.5, hole=second)]
    for order in (views, views[::-1]):
        np.testing.assert_array_equal(merge(order).holes, expected)


def test_where_no_view_has_anything_there_is_nothing():
    merged = merge([view(0.5, hole=Hole.OUTSIDE), view(0.5, hole=Hole.DISOCCLUDED)])
    assert not merged.image.any()
    assert not merged.coverage.any()
    assert not merged.confidence.any()
    assert np.isinf(merged.depth).all()


def test_each_pixel_is_merged_for_itself():
    first = beside(view(0.9), view(0.9, hole=Hole.OUTSIDE))
    second = beside(view(0.1, hole=Hole.OUTSIDE), view(0.1))
    merged = merge([first, second])
    np.testing.assert_allclose(merged.image[:, :2], 0.9, rtol=ROUND)
    np.testing.assert_allclose(merged.image[:, 2:], 0.1, rtol=ROUND)


def test_views_are_not_changed():
    views = [view(0.9), view(0.1, hole=Hole.OUTSIDE)]
    before = [Warped(*(part.copy() for part in each)) for each in views]
    merge(views)
    for given, expected in zip(views, before, strict=True):
        assert_same_bits(given, expected)


def test_views_of_other_shapes_are_refused():
    with pytest.raises(ValueError, match=r"not of \[\(3, 4, 1\), \(4, 4, 1\)\]"):
        merge([view(0.5), view(0.5, shape=(4, 4))])


def test_no_view_is_refused():
    with pytest.raises(ValueError, match="can be merged, not of none"):
        merge([])


@pytest.mark.parametrize(("degrees", "share"), [(0.0, 1.0), (4.0, 0.5), (8.0, 0.2), (-4.0, 0.5)])
def test_a_view_from_four_degrees_aside_counts_half(degrees, share):
    depth = 2.0
    eye = depth * math.tan(math.radians(degrees)), 0.0, 0.0
    target, source = (camera_at(at, focal=48.0, shape=(5, 5)) for at in ((0.0, 0.0, 0.0), eye))
    shown = angle_share(view(0.5, depth=depth, shape=(5, 5)), source, target)
    assert shown[2, 2] == pytest.approx(share, abs=0.01)  # its ray is aslant by less than a pixel


def test_a_view_counts_by_the_angle_at_what_is_seen_and_not_by_the_way():
    target, source = (camera_at((x, 0, 0), focal=48.0, shape=(5, 5)) for x in (0.0, 0.1))
    near, far = (angle_share(view(0.5, depth=d, shape=(5, 5)), source, target) for d in (1, 10))
    assert near.max() < 0.5
    assert far.min() > 0.97
