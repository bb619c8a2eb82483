"""Pixel filters in 3D warping: composited on parts of pixels first, filtered after."""

from functools import cache

import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera
from resample.measuring.quality import psnr
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid
from resample_warp3d.types import LEFT, RIGHT, Equation, Hole
from resample_warp3d.warping import render, warp, warp_disparity
from tests.bits import assert_threads_change_nothing
from tests.filtered import FILTERS, FINE, plain_filtered, window
from tests.warp3d.naive_sheet import camera_at, depth_image, pattern, plane

SHAPE = 32, 40
SOURCE = camera_at()
VIEWS = {
    "side": camera_at((0.15, -0.05, 0.05), 0.02),
    "back": camera_at((0.1, 0.2, -5.0)),
    "in": camera_at((0.05, 0.05, 1.4)),
}
METHODS = "hybrid", "paper", "splat", "point", "preview"
RIVALS = "mesh", "subsample"  # of kernels that nothing else needs
WHOLE = "mcmillan", "mcmillan-zbuffer", "ldi", "opencv"


def of_methods(*methods):
    """A test of methods and of rivals; of these it is a sweep, which the methods keep."""

    def made(test):
        mark = pytest.mark.sweep
        rivals = [pytest.param(name, marks=mark) for name in RIVALS]
        return pytest.mark.parametrize("method", [*methods, *rivals])(test)

    return made


def is_on_card(point):
    return (abs(point[..., 0]) < 0.5) & (abs(point[..., 1] - 0.1) < 0.4)


@cache
def source():
    """A card before a wall, both with waves on them."""
    card = plane((0.0, 0.0, 1.0), 2.5, pattern(3.0), is_on_card)
    wall = plane((0.2, 0.1, 1.0), 4.0, pattern(2.0))
    return prepare(depth_image([card, wall], SOURCE, (64, 64)))


@cache
def white():
    """The same, all of one color."""
    given = source()
    return given._replace(color=np.full_like(given.color, 0.7))


def seen(view="side", method="hybrid", pixel_filter=None, of=source):
    made = registry.build("warps", method)
    return render(of(), between(SOURCE, VIEWS[view]), SHAPE, made, filter=pixel_filter)


@cache
def truth(view, name):
    """Image and coverage on 16 × 16 sub-pixels, gaps open, then filtered."""
    pixel_filter = registry.build("filters", name)
    weight, margin = window(pixel_filter)
    moved = between(SOURCE, VIEWS[view])
    step = np.array([[FINE, 0, FINE * margin], [0, FINE, FINE * margin], [0, 0, 1.0]])
    shape = (SHAPE[0] + 2 * margin) * FINE, (SHAPE[1] + 2 * margin) * FINE
    fine = Hybrid().layers(source(), Equation(step @ moved.matrix, step @ moved.epipole), shape)
    both = np.dstack([fine.image, fine.coverage]).astype(np.float64)
    made = plain_filtered(both, weight, SHAPE)
    return made[..., :-1], made[..., -1]


@pytest.mark.sweep
@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("view", VIEWS)
def test_the_hybrid_under_every_filter_is_the_truth_filtered(view, name, record):
    image, coverage = truth(view, name)
    given = seen(view, pixel_filter=name)
    whole = (np.abs(coverage - 1.0) < 1e-3) & (np.abs(given.coverage - 1.0) < 1e-3)
    assert whole.mean() > 0.1
    record.quality("picture", psnr(given.image, image.astype(np.float32), mask=whole))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", FILTERS)
def test_a_rim_is_covered_as_the_truth_is(name, record):
    coverage = np.clip(truth("side", name)[1], 0.0, 1.0)
    given = seen("side", pixel_filter=name)
    apart = np.abs(given.coverage - coverage)
    apart[given.holes == Hole.CRACK] = 0.0
    # Gaps of up to two pixels are closed, which the truth leaves open.
    record.error("coverage", np.quantile(apart, 0.9))


@pytest.mark.some(5)
@pytest.mark.parametrize("name", FILTERS)
@of_methods(*METHODS)
def test_what_has_one_color_keeps_it_wherever_it_is(method, name):
    given = seen("side", method, name, of=white)
    there = given.coverage > 1e-3
    color = given.image[there] / given.coverage[there][:, None]
    np.testing.assert_allclose(color, 0.7, rtol=2e-3)  # sums of float32 with both signs


@pytest.mark.parametrize("name", FILTERS)
@of_methods(*METHODS)
def test_inside_a_surface_all_is_covered(method, name):
    given = seen("back" if method == "point" else "in", method, name)
    inner = slice(16, 20), slice(19, 25)
    np.testing.assert_allclose(given.coverage[inner], 1.0, atol=2e-6)  # sums of float32


@pytest.mark.parametrize("name", FILTERS)
@of_methods(*METHODS)
def test_coverage_stays_within_its_bounds_and_all_that_is_seen_has_a_depth(method, name):
    given = seen("side", method, name)
    assert 0.0 <= given.coverage.min() <= given.coverage.max() <= 1.0
    assert np.isfinite(given.image).all()
    assert np.isfinite(given.depth[given.coverage > 0]).all()
    assert (given.magnification[given.coverage > 0] > 0).all()
    assert not given.image[given.coverage == 0].any()


@pytest.mark.parametrize("name", ["area", "box", "box:radius=0.5"])
@of_methods(*METHODS, "mcmillan")
def test_the_mean_over_a_pixel_is_what_a_method_does_anyway(method, name):
    for given, usual in zip(seen("side", method, name), seen("side", method), strict=True):
        np.testing.assert_array_equal(given, usual)


@pytest.mark.parametrize(
    "method", ["hybrid", pytest.param("mesh:samples=4", marks=pytest.mark.sweep)]
)
def test_depth_and_magnification_are_those_of_a_pixel_s_own_square(method, record):
    usual, given = seen("in", method), seen("in", method, "mitchell")
    both = (usual.coverage > 0.99) & (given.coverage > 0.99)
    near = np.abs(given.depth / usual.depth - 1.0)[both]
    record.error("wrong depths", ~(near < 2e-3))  # silhouettes: pixels that both surfaces halve
    large = np.abs(given.magnification / usual.magnification - 1.0)[both]
    record.error("wrong magnifications", ~(large < 0.02))


def test_narrow_gaps_are_closed_under_a_filter_too():
    cut = source()
    cut = cut._replace(links=cut.links.copy(), nearness=cut.nearness.copy())
    cut.links[:, 31] &= ~np.uint8(RIGHT)
    cut.links[:, 32] &= ~np.uint8(LEFT)
    cut.nearness[:, 32:] *= 1.03
    apart = Equation(np.eye(3), np.array([80.0, 0.0, 0.0]))
    usual, given = (
        render(cut, apart, (64, 110), Hybrid(), filter=name) for name in (None, "gaussian")
    )
    closed = usual.holes == Hole.CRACK
    assert closed.sum() > 30
    assert np.median(given.coverage[closed]) > 0.95
    assert given.coverage[closed].min() > 0.5  # beside what stays a hole
    assert (given.holes[closed] == Hole.CRACK).all()


def test_what_is_far_from_everything_is_a_hole():
    far = render(source(), between(SOURCE, camera_at((30.0, 0, 0))), SHAPE, Hybrid(), filter="tent")
    assert not far.coverage.any()
    assert np.isinf(far.depth).all()
    assert (far.holes != Hole.NONE).all()


@pytest.mark.parametrize("method", ["hybrid", "paper", "preview"])
def test_the_count_of_threads_does_not_change_a_bit(method):
    assert_threads_change_nothing(lambda: seen("side", method, "lanczos"))


@pytest.mark.parametrize("method", ["hybrid", pytest.param("mesh", marks=pytest.mark.sweep)])
def test_strips_leave_no_seam(method, monkeypatch, record):
    whole = seen("in", method, "gaussian")
    monkeypatch.setattr("resample.profiles.subpixels.LARGEST_STRIP", 8000)
    given = seen("in", method, "gaussian")
    apart = np.abs(given.image - whole.image).max(axis=2)
    assert np.mean(apart < 1e-4) > 0.99  # places in float32 are rounded otherwise
    record.error("largest", apart.max())


@pytest.mark.parametrize("method", WHOLE)
def test_methods_that_copy_samples_to_whole_pixels_take_no_filter(method):
    with pytest.raises(ValueError, match="copies samples to whole pixels; leave out the pixel"):
        seen("side", method, "gaussian")


def test_labels_are_not_filtered():
    with pytest.raises(ValueError, match="labels are not mixed; leave out the pixel filter"):
        seen("side", "hybrid:labels=true", "gaussian")


def test_an_unknown_filter_lists_the_known_ones():
    with pytest.raises(LookupError, match="mitchell"):
        seen("side", pixel_filter="gausian")


def test_all_calls_of_the_library_take_a_filter(rng):
    color, depth = rng.random((20, 24, 3), np.float32), np.full((20, 24), 2.0)
    eye = Camera.from_intrinsics(20, 20, 12, 10)
    moved = warp(color, depth, eye, eye, filter="tent")
    assert np.abs(moved.image - color).max() > 0.1
    paired = warp_disparity(color, np.full((20, 24), 1.0), filter="tent")
    assert paired.image.shape == color.shape
