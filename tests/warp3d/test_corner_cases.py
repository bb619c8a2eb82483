import math

import numpy as np
import pytest

from resample.measuring.quality import psnr
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.methods.hybrid import Hybrid
from resample_warp3d.sheet.filling import bridged
from resample_warp3d.types import DepthImage, Equation, Hole, Rendered
from resample_warp3d.views.multi_source import merge
from resample_warp3d.warping import nearness_of, render, warp
from tests.warp3d.naive_sheet import EMPTY, camera_at, depth_image, flat, pattern, plane, see

SHAPE = 64, 64
SOURCE = camera_at()
WALL = np.full(SHAPE, 4.0)


@pytest.mark.parametrize("z", [0.0, -2.0, -4.0, -12.0])
def test_labels_have_no_holes_where_they_shrink(z):
    labels = np.where(np.arange(64) < 32, 0.25, 0.75)[None, :, None] * np.ones((64, 1, 1))
    target = camera_at((0.5 * 4 / 64, 0.5 * 4 / 64, z))
    given = warp(labels, WALL, SOURCE, target, Hybrid(labels=True))
    side = 64 * 4 / (4 - z)
    assert given.coverage.sum() == pytest.approx(side**2, rel=0.1)


def test_a_label_is_the_one_that_covers_most():
    labels = np.ones((64, 64, 1))
    labels[::2, ::2] = 0.5  # a quarter of the samples
    given = warp(labels, WALL, SOURCE, camera_at((0, 0, -4.0)), Hybrid(labels=True))
    inside = given.image[20:44, 20:44]
    assert (inside == 1).all()


def test_bridging_takes_colors_of_partly_covered_sides_at_full():
    coverage = np.tile(np.float32([1, 1, 0.97, 0, 0.97, 1, 1]), (5, 1))
    image = 0.5 * coverage[..., None]
    given = bridged(
        Rendered(
            image, coverage, np.ones_like(coverage), np.ones_like(coverage), np.zeros((5, 7), bool)
        )
    )
    assert given.coverage[2, 3] == 1
    assert given.image[2, 3, 0] == pytest.approx(0.5)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_color_that_is_no_number_spoils_no_other(bad):
    color = np.full((*SHAPE, 3), 0.5, np.float32)
    color[30, 30, 0] = bad
    given = warp(color, WALL, SOURCE, camera_at((0.1, 0.05, 0.5)))
    assert np.isfinite(given.image).all()


def test_a_merged_pixel_is_covered_as_far_as_the_views_cover_it():
    def view(coverage, depth, level):
        c = np.full((2, 2), coverage, np.float32)
        return type(warp(np.ones((1, 1)), np.ones((1, 1)), SOURCE, SOURCE))(
            (level * c)[..., None],
            c,
            np.full((2, 2), depth, np.float32),
            np.zeros((2, 2), np.uint8),
            c.copy(),
            c.copy(),
        )

    merged = merge([view(0.6, 2.0, 1.0), view(1.0, 4.0, 0.0)])
    np.testing.assert_allclose(merged.coverage, 1.0)
    np.testing.assert_allclose(merged.image, 0.6, rtol=1e-5)


def test_all_around_a_wall_that_shrinks_is_outside():
    given = warp(np.ones(SHAPE), WALL, SOURCE, camera_at((0, 0, -4.0)))
    assert (given.holes[given.coverage == 0] == Hole.OUTSIDE).all()


def test_what_is_covered_has_a_depth():
    depth = WALL.copy()
    depth[20:44, 24:40] = 2.0
    given = warp(np.ones(SHAPE), depth, SOURCE, camera_at((0.5, 0, 0)), step=0.0)
    assert np.isfinite(given.depth[given.coverage > 0]).all()


@pytest.mark.parametrize("depth", [1e-45, 1e-300, 5e-324])
def test_tiny_depth_does_not_warn(depth):
    nearness_of([[depth, 1.0]])


def test_a_rotation_by_half_the_field_of_view_does_not_warn():
    source = prepare(DepthImage(np.ones((4, 4, 1), np.float32), np.ones((4, 4)), EMPTY))
    matrix = np.array([[1, 0, 5], [0, 1, 0], [1e-3, 0, 0.0]])
    render(source, Equation(matrix, np.zeros(3)), (4, 4), Hybrid())


def test_an_equation_of_zeros_is_refused():
    source = prepare(DepthImage(np.ones((4, 4, 1), np.float32), np.ones((4, 4)), EMPTY))
    with pytest.raises(ValueError, match="singular"):
        render(source, Equation(np.zeros((3, 3)), np.zeros(3)), (4, 4), Hybrid())


@pytest.mark.parametrize("size", [(3.5, 4), (4,), "ab", (4, 5, 6)])
def test_a_size_that_is_none_is_refused(size):
    with pytest.raises(ValueError, match="size"):
        warp(np.ones(SHAPE), WALL, SOURCE, SOURCE, size=size[::-1])


@pytest.mark.parametrize(
    "given", [{"noise": -1.0}, {"noise": math.nan}, {"step": -1.0}, {"step": math.inf}]
)
def test_noise_and_step_out_of_range_are_refused(given):
    with pytest.raises(ValueError, match="give a number of 0 or more"):
        warp(np.ones(SHAPE), WALL, SOURCE, SOURCE, **given)


@pytest.mark.sweep
def test_shifts_by_parts_of_a_pixel_are_as_exact_as_a_little_magnification(record):
    wall = [plane((0, 0, 1), 4.0, pattern(14.0))]
    source = prepare(depth_image(wall, SOURCE, SHAPE))
    found = []
    for z in (0.0, 0.01):
        target = camera_at((0.5 * 4 / 64, 0, z))
        given = render(source, between(SOURCE, target), SHAPE, Hybrid()).image[3:-3, 3:-8]
        found.append(psnr(given, see(wall, target, SHAPE).color[3:-3, 3:-8].astype(np.float32)))
    assert found[0] > found[1] - 3
    record.quality("shift", found[0])


@pytest.mark.sweep
def test_silhouettes_are_not_biased(record):
    def inside(p):
        return 64 / 2.5 * p[..., 0] < 12.3125

    things = [plane((0, 0, 1), 2.5, flat(1.0), inside), plane((0, 0, 1), 5.0, flat(0.0))]
    given = render(
        prepare(depth_image(things, SOURCE, SHAPE)),
        between(SOURCE, camera_at((-0.02, 0, 0))),
        SHAPE,
        Hybrid(),
    ).image[32, :, 0]
    expected = np.clip(32 + 12.3125 + 0.02 * 64 / 2.5 - np.arange(64), 0, 1)
    record.error("silhouette", np.abs(given - expected)[5:-5].max())


def noisy_plane(noise):
    """A source whose plane has noise of that share of its nearness."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:64, :64]
    nearness = (0.5 + 0.001 * x - 0.002 * y) * (1 + noise * rng.normal(size=SHAPE))
    black = np.zeros((*SHAPE, 1), np.float32)
    return prepare(DepthImage(black, nearness.astype(np.float32), EMPTY))


@pytest.mark.parametrize("noise", [7e-4, 9e-4])
def test_little_noise_does_not_tear_surfaces(noise, record):
    source = noisy_plane(noise)
    record.error("torn links", source.links[1:-1, 1:-1] != 15)


@pytest.mark.parametrize("noise", [0.002, 0.005])
def test_strong_noise_is_measured(noise):
    source = noisy_plane(noise)
    assert source.noise == pytest.approx(noise, rel=0.2)


def test_rows_of_a_floor_are_no_quantum():
    nearness = np.broadcast_to(0.01 + 0.02 * np.arange(64)[:, None], SHAPE).astype(np.float32)
    source = prepare(
        DepthImage(np.zeros((*SHAPE, 1), np.float32), np.ascontiguousarray(nearness), EMPTY)
    )
    assert source.step == 0
