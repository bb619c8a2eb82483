"""Parts of pixels: their weights are the filter's, and as few are taken as stand for it."""

import math

import numpy as np
import pytest

from resample import registry
from resample.engine.jit import kernel
from resample.engine.surfaces import middle_of_rows, nearest_of_rows, resolve_rows, resolve_tile
from resample.painting import paper, splats
from resample.profiles.filters import Area, Box, Gaussian, Tent
from resample.profiles.subpixels import Subpixels, subpixels_of
from resample.resampler import Resampler

EVERY = registry.names("filters")


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("count", [None, 1, 3, 7])
def test_weights_are_the_filter_s_mass_in_each_part(name, count):
    pixel_filter = registry.build("filters", name)
    parts = subpixels_of(pixel_filter, count)
    n = parts.count
    places = (np.arange((2 * parts.margin + 1) * n * 1000) + 0.5) / (1000 * n) - parts.margin - 0.5
    distance = np.abs(places)
    inside = distance <= pixel_filter.radius
    density = np.where(inside, pixel_filter(np.minimum(distance, pixel_filter.radius)), 0.0)
    mass = (density / density.sum()).reshape(-1, 1000).sum(axis=1)
    # 16 places in a part instead of 1000, whose weight errs by h² / 24 times a slope of 4 / px.
    np.testing.assert_allclose(parts.weight, mass, atol=6e-4)
    assert parts.weight.sum() == pytest.approx(1.0, abs=1e-6)  # float32


@pytest.mark.parametrize("name", EVERY)
def test_a_filter_lies_within_its_margin(name):
    pixel_filter = registry.build("filters", name)
    parts = subpixels_of(pixel_filter)
    assert parts.margin >= pixel_filter.radius - 0.5
    assert parts.weight.size == (2 * parts.margin + 1) * parts.count


@pytest.mark.parametrize(
    ("pixel_filter", "count", "margin"),
    [(Area(), 1, 0), (Box(), 1, 0), (Box(1.5), 1, 1), (Box(1.0), 2, 1), (Box(0.75), 4, 1),
     (Tent(), 4, 1), (Gaussian(), 4, 2)],
)  # fmt: skip
def test_as_few_parts_are_taken_as_stand_for_a_filter(pixel_filter, count, margin):
    parts = subpixels_of(pixel_filter)
    assert (parts.count, parts.margin) == (count, margin)


def test_a_plugin_that_has_no_sum_is_refused():
    class Nothing:
        radius = 0.8

        def __call__(self, distance):
            return 0.0 * distance

    with pytest.raises(ValueError, match="cannot be scaled to 1"):
        subpixels_of(Nothing())


@pytest.mark.parametrize("most", [1, 700, 1 << 21])
def test_strips_are_all_rows_once_and_say_where_they_lie(most, monkeypatch):
    monkeypatch.setattr("resample.profiles.subpixels.LARGEST_STRIP", most)
    parts, rows = Subpixels(3, 2, np.full(15, 1 / 15, np.float32)), []
    for strip in parts.strips((11, 7)):
        rows += range(strip.first, strip.last)
        assert strip.shape == ((strip.last - strip.first + 4) * 3, (7 + 4) * 3)
        # The corner of the strip's first pixel lies behind the margin.
        corner = strip.matrix @ [0.0, strip.first, 1.0]
        np.testing.assert_allclose(corner, [6.0, 6.0, 1.0])
    assert rows == list(range(11))


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_pixels_are_what_a_loop_over_their_window_sums(channels, rng):
    parts = subpixels_of(Gaussian(0.6))
    n, side = parts.count, parts.weight.size
    shape = (5 + 2 * parts.margin) * n, (7 + 2 * parts.margin) * n, channels
    fine = rng.random(shape, np.float32)
    picture = np.empty((5, 7, channels), np.float32)
    resolve_rows(fine.reshape(shape[0], -1), parts.weight, n, picture)
    share = np.outer(parts.weight, parts.weight).astype(np.float64)
    for row in range(5):
        for column in range(7):
            window = fine[row * n : row * n + side, column * n : column * n + side]
            wanted = (share[..., None] * window).sum(axis=(0, 1))
            np.testing.assert_allclose(picture[row, column], wanted, rtol=1e-5)  # float32


@kernel
def tile_resolved(fine, weight, count, pixels):
    """Resolve a tile."""
    resolve_tile(fine, weight, count, pixels)


def test_a_tile_is_resolved_in_the_precision_of_its_weights(rng):
    weight = rng.random(9)
    fine = rng.random((5 * 3, 6 * 3, 4), np.float32)
    pixels = np.empty((3, 4, 4))
    tile_resolved(fine, weight, 3, pixels)
    for row in range(3):
        for column in range(4):
            window = fine[3 * row : 3 * row + 9, 3 * column : 3 * column + 9]
            wanted = np.einsum("r,c,rck->k", weight, weight, window)
            np.testing.assert_allclose(pixels[row, column], wanted, rtol=1e-13)


def test_the_middle_is_the_middle_of_what_is_there(rng):
    nearness = rng.random((6, 9), np.float32)
    nearness[rng.random((6, 9)) < 0.5] = 0.0
    middle, beside = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    middle_of_rows(nearness, 2.0 * nearness, 3, middle, beside)
    for row in range(2):
        for column in range(3):
            square = nearness[3 * row : 3 * row + 3, 3 * column : 3 * column + 3]
            known = np.sort(square[square > 0])
            assert middle[row, column] == (known[known.size // 2] if known.size else 0.0)
    np.testing.assert_array_equal(beside, 2.0 * middle)


def test_the_nearest_is_that_of_the_pixel_s_own_square(rng):
    depth = rng.random((8, 10), np.float32)
    nearest = np.empty((2, 3), np.float32)
    nearest_of_rows(depth, 2, 1, nearest)
    inner = depth[2:-2, 2:-2].reshape(2, 2, 3, 2)
    np.testing.assert_array_equal(nearest, inner.min(axis=(1, 3)))
    assert math.isfinite(nearest.max())


def test_the_docstring_tells_the_finest_grids():
    told = " ".join(str(Resampler.__doc__).split())
    assert f"hybrid and points choose, up to {splats.FINEST} and {paper.FINEST}" in told
