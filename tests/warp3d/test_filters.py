"""Pixel filters in 3D warping: composited on parts of pixels first, filtered after."""

import math
from functools import cache

import numpy as np
import pytest

from resample import registry
from resample.cameras.models import Camera
from resample.engine.jit import threads
from resample.measuring.quality import psnr
from resample_warp3d.clouds.files import Cloud
from resample_warp3d.clouds.rendering import CloudStyle, render_cloud
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid
from resample_warp3d.types import LEFT, RIGHT, Equation, Hole
from resample_warp3d.warping import render, warp, warp_disparity
from tests.bits import assert_threads_change_nothing
from tests.warp3d.naive_sheet import camera_at, depth_image, pattern, plane

SHAPE = 32, 40
FINE = 16  # sub-pixels of the truth, per side of a pixel
SOURCE = camera_at()
VIEWS = {
    "side": camera_at((0.15, -0.05, 0.05), 0.02),
    "back": camera_at((0.1, 0.2, -5.0)),
    "in": camera_at((0.05, 0.05, 1.4)),
}
FILTERS = [name for name in registry.names("filters") if name not in ("area", "box")]
METHODS = "hybrid", "paper", "splat", "point", "preview"
RIVALS = "mesh", "subsample"  # of kernels that nothing else needs
WHOLE = "mcmillan", "mcmillan-zbuffer", "ldi", "opencv"


def of_methods(*methods):
    """A test of methods and of rivals; of these it is a sweep, which the methods keep."""

    def made(test):
        mark = pytest.mark.sweep(kept_by=test.__name__)
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


def window(pixel_filter, n=FINE):
    """Weights of a filter at n parts of a pixel, and the px around it."""
    margin = math.ceil(pixel_filter.radius - 0.5)
    distance = np.abs((np.arange((2 * margin + 1) * n) + 0.5) / n - margin - 0.5)
    within = np.minimum(distance, pixel_filter.radius)
    weight = np.where(distance <= pixel_filter.radius, pixel_filter(within), 0.0)
    return weight / weight.sum(), margin


def plain_filtered(fine, weight, n=FINE):
    """Sub-pixels ((H + 2 m) n, (W + 2 m) n, C) under a filter, by plain sums in float64."""
    height, width = SHAPE[0] * n, SHAPE[1] * n
    down = sum(share * fine[k : k + height : n] for k, share in enumerate(weight))
    return sum(share * down[:, k : k + width : n] for k, share in enumerate(weight))


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
    made = plain_filtered(both, weight)
    return made[..., :-1], made[..., -1]


# dB against the truth where the source shows all that the filter reads, less 5.
LEAST = {"side": 61.0, "back": 63.0, "in": 69.0}


@pytest.mark.each_value
@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("view", VIEWS)
def test_the_hybrid_under_every_filter_is_the_truth_filtered(view, name):
    image, coverage = truth(view, name)
    given = seen(view, pixel_filter=name)
    whole = (np.abs(coverage - 1.0) < 1e-3) & (np.abs(given.coverage - 1.0) < 1e-3)
    assert whole.mean() > 0.1
    assert psnr(given.image, image.astype(np.float32), mask=whole) > LEAST[view]


@pytest.mark.parametrize("name", FILTERS)
def test_a_rim_is_covered_as_the_truth_is(name):
    coverage = np.clip(truth("side", name)[1], 0.0, 1.0)
    given = seen("side", pixel_filter=name)
    apart = np.abs(given.coverage - coverage)
    apart[given.holes == Hole.CRACK] = 0.0
    # Gaps of up to two pixels are closed, which the truth leaves open.
    assert np.quantile(apart, 0.9) < 2e-3


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
    "method",
    [
        "hybrid",
        pytest.param(
            "mesh:samples=4",
            marks=pytest.mark.sweep(
                kept_by="test_depth_and_magnification_are_those_of_a_pixel_s_own_square"
            ),
        ),
    ],
)
def test_depth_and_magnification_are_those_of_a_pixel_s_own_square(method):
    usual, given = seen("in", method), seen("in", method, "mitchell")
    both = (usual.coverage > 0.99) & (given.coverage > 0.99)
    near = np.abs(given.depth / usual.depth - 1.0)[both]
    assert np.mean(near < 2e-3) > 0.97  # silhouettes: pixels that both surfaces halve
    large = np.abs(given.magnification / usual.magnification - 1.0)[both]
    assert np.mean(large < 0.02) > 0.94


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


@pytest.mark.parametrize(
    "method",
    [
        "hybrid",
        pytest.param("mesh", marks=pytest.mark.sweep(kept_by="test_strips_leave_no_seam")),
    ],
)
def test_strips_leave_no_seam(method, monkeypatch):
    whole = seen("in", method, "gaussian")
    monkeypatch.setattr("resample.profiles.subpixels.LARGEST_STRIP", 8000)
    given = seen("in", method, "gaussian")
    apart = np.abs(given.image - whole.image).max(axis=2)
    assert np.mean(apart < 1e-4) > 0.99  # places in float32 are rounded otherwise
    assert apart.max() < 0.05


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


# Clouds


@cache
def ball():
    n = np.arange(4000) + 0.5
    z, angle = 1 - 2 * n / 4000, math.pi * (1 + math.sqrt(5)) * n
    around = np.sqrt(1 - z * z)
    place = np.stack([around * np.cos(angle), around * np.sin(angle), z - 4.0], axis=1)
    color = (0.5 + 0.5 * np.sin(4.0 * place)).astype(np.float32)
    normal = place - [0, 0, -4.0]
    return Cloud(-place, -normal.astype(np.float32), color, np.zeros(0, np.float32))


def cloud_seen(pixel_filter=None, n=1, margin=0, **style):
    """The ball on n sub-pixels per side of a pixel, and px around it."""
    matrix = np.array(
        [[45.0 * n, 0, (20 + margin) * n], [0, 45.0 * n, (16 + margin) * n], [0, 0, 1]]
    )
    size = (SHAPE[1] + 2 * margin) * n, (SHAPE[0] + 2 * margin) * n
    camera = Camera(matrix, np.eye(4))
    return render_cloud(ball(), camera, size=size, style=CloudStyle(**style), filter=pixel_filter)


@pytest.mark.parametrize("name", FILTERS)
def test_a_cloud_under_every_filter_is_the_truth_filtered(name):
    weight, margin = window(registry.build("filters", name))
    fine = cloud_seen(n=FINE, margin=margin, subpixels=1)
    wanted = plain_filtered(fine.rgba.astype(np.float64), weight)
    rgba = np.where(wanted[..., 3:] > 0, wanted, 0.0)
    rgba /= np.maximum(rgba[..., 3:], 1.0)
    # Rims are known to a sixteenth of a pixel only, on 4 × 4 sub-pixels.
    assert psnr(cloud_seen(name).rgba, rgba.astype(np.float32)) > 34.0
    whole = np.abs(wanted[..., 3] - 1.0) < 1e-6
    given = cloud_seen(name).rgba
    assert psnr(given, rgba.astype(np.float32), mask=whole) > 38.0


@pytest.mark.parametrize("name", FILTERS)
def test_a_cloud_of_one_color_keeps_it(name):
    one = ball()._replace(color=np.full((4000, 3), 0.6, np.float32))
    camera = Camera(np.array([[45.0, 0, 20], [0, 45, 16], [0, 0, 1.0]]), np.eye(4))
    frame = render_cloud(one, camera, size=SHAPE[::-1], filter=name)
    there = frame.coverage > 1e-3
    color = frame.rgba[there][:, :3] / frame.coverage[there][:, None]
    np.testing.assert_allclose(color, 0.6, rtol=1e-3)  # sums of float32 with both signs
    assert 0.0 <= frame.coverage.min() <= frame.coverage.max() <= 1.0


@pytest.mark.parametrize("name", ["area", "box"])
def test_a_cloud_under_the_mean_of_a_pixel_keeps_its_bits(name):
    given, usual = cloud_seen(name), cloud_seen()
    np.testing.assert_array_equal(given.rgba, usual.rgba)
    np.testing.assert_array_equal(given.depth, usual.depth)


def test_a_filtered_cloud_is_the_same_for_any_threads_and_order():
    pictures = []
    for count, order in ((1, slice(None)), (2, slice(None, None, -1))):
        cloud = Cloud(*(part[order] for part in ball()[:4]))
        camera = Camera(np.array([[45.0, 0, 20], [0, 45, 16], [0, 0, 1.0]]), np.eye(4))
        with threads(count):
            pictures.append(render_cloud(cloud, camera, size=SHAPE[::-1], filter="mitchell"))
    np.testing.assert_array_equal(pictures[0].rgba, pictures[1].rgba)
    np.testing.assert_array_equal(pictures[0].depth, pictures[1].depth)


def test_a_filtered_cloud_knows_its_discs_and_its_nearest_depth():
    usual, given = cloud_seen(), cloud_seen("tent")
    assert given.statistics[:3] == usual.statistics[:3]
    both = np.isfinite(usual.first_depth) & np.isfinite(given.first_depth)
    near = np.abs(given.first_depth[both] / usual.first_depth[both] - 1.0)
    assert np.mean(near < 0.02) > 0.97  # rims are seen at other places of a pixel
