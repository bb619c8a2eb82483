"""What the paper's method keeps besides its formula, which `tests/paper` has against a twin."""

import numpy as np
import pytest

from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
from resample_texture.methods.paper import Paper
from resample_texture.types import Edge
from tests.bits import assert_threads_change_nothing

SHAPE = (30, 34)
HORIZON = Homography(np.array([[40.0, 16.0, -4000.0], [0.0, 16.0, 400.0], [0.0, 1.0, 0.2]]))
MIXED = Homography(np.array([[0.9, 0.1, 3.3], [-0.1, 0.9, 2.1], [0.001, 0.004, 1.0]]))


def noise(height, width, channels=1):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def scaled(scale, x=0.0, y=0.0):
    return Homography(np.array([[scale, 0, x], [0, scale, y], [0, 0, 1.0]]))


def test_threads_do_not_change_a_bit():
    source = noise(200, 190, 4)
    assert_threads_change_nothing(lambda: Paper()(source, MIXED, (120, 130), Edge.TRANSPARENT))


def test_rows_in_several_batches_give_the_same_bits(monkeypatch):
    source = noise(60, 50, 3)
    whole = Paper()(source, MIXED, (40, 40), Edge.MIRROR)
    monkeypatch.setattr("resample_texture.methods.paper.MOST_AT_ONCE", 500)
    parts = Paper()(source, MIXED, (40, 40), Edge.MIRROR)
    np.testing.assert_array_equal(parts.image, whole.image)
    np.testing.assert_array_equal(parts.coverage, whole.coverage)


def test_texels_that_a_frame_does_not_see_are_left_out_without_a_change():
    source, far = noise(200, 180), np.array([[1, 0, -90.0], [0, 1, -110.0], [0, 0, 1.0]])
    window = Homography(far @ MIXED.matrix, is_signed=True)
    part = Paper()(source, window, (20, 24), Edge.TRANSPARENT)
    whole = Paper()(source, MIXED, (130, 114), Edge.TRANSPARENT)
    np.testing.assert_allclose(part.image, whole.image[110:, 90:], atol=1e-4)  # places in float32


@pytest.mark.parametrize(
    ("edge", "mode"), [(Edge.CLAMP, "edge"), (Edge.WRAP, "wrap"), (Edge.MIRROR, "symmetric")]
)
def test_edges_continue_the_source(edge, mode):
    source = noise(9, 8, 3)
    geometry = Homography(np.array([[1.1, 0.3, 6.0], [-0.2, 0.9, 9.0], [0.002, 0.004, 1.0]]))
    image, coverage = Paper()(source, geometry, SHAPE, edge)
    padded = np.pad(source, ((40, 40), (40, 40), (0, 0)), mode=mode)
    shift = np.array([[1.0, 0.0, -40.0], [0.0, 1.0, -40.0], [0.0, 0.0, 1.0]])
    larger = Homography(geometry.matrix @ shift, is_signed=True)
    expected = Paper()(padded, larger, SHAPE, Edge.TRANSPARENT)
    np.testing.assert_array_equal(coverage, 1.0)
    np.testing.assert_allclose(image, expected.image, atol=1e-5)


def test_nothing_is_drawn_above_the_horizon():
    image, coverage = Paper()(noise(400, 200), HORIZON, (32, 32), Edge.TRANSPARENT)
    assert np.isfinite(image).all()
    assert coverage[:14].max() == 0.0  # the horizon is at row 16, points reach 1.2 px
    assert coverage[19:].min() == 1.0


def test_texels_behind_the_eye_are_left_out():
    behind = Homography(HORIZON.matrix * [1, -1, 1], is_signed=True)
    image, coverage = Paper()(noise(40, 40), behind, (32, 32), Edge.TRANSPARENT)
    assert coverage.max() == 0.0
    assert not image.any()


def test_texels_without_a_place_are_left_out_and_others_fill_their_pixels():
    v, u = np.mgrid[:30, :30] + 0.5
    u[:, 15:] = np.nan
    image, coverage = Paper()(noise(30, 30), ForwardMap(2 * u, 2 * v), (60, 60), Edge.TRANSPARENT)
    assert np.isfinite(image).all()
    assert coverage[2:-2, 2:26].min() == 1.0
    assert coverage[:, 34:].max() == 0.0


def test_a_continued_plane_up_to_the_horizon_is_refused():
    with pytest.raises(ValueError, match="one by one"):
        Paper()(noise(8, 8), HORIZON, (32, 32), Edge.WRAP)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        (BackwardMap(np.ones((4, 4)), np.ones((4, 4))), "backward map cannot be followed forward"),
        (ForwardMap(np.ones((4, 4)), np.ones((4, 4))), r"map of \(4, 4\) places no source of"),
    ],
)
def test_maps_that_do_not_lead_from_the_source_are_refused(geometry, message):
    with pytest.raises(ValueError, match=message):
        Paper()(noise(4, 5), geometry, (4, 4), Edge.CLAMP)


@pytest.mark.parametrize("name", ["sigma", "filter_sigma"])
@pytest.mark.parametrize("value", [0.001, 17.0])
def test_deviations_have_a_range(name, value):
    with pytest.raises(ValueError, match=f"{name} lies between 0.01 and 16, not at {value}"):
        Paper(**{name: value})


@pytest.mark.parametrize("sigma", [0.01, 0.2])
def test_under_a_narrow_filter_every_point_meets_a_pixel(sigma):
    source = noise(20, 20)
    narrow = Paper(filter_sigma=sigma, total=True)
    image = narrow(source, scaled(0.7, 3.0, 3.0), (20, 20), Edge.TRANSPARENT).image
    np.testing.assert_allclose(image.sum(), source.sum(), rtol=2e-4)  # 128 phases of a kink


@pytest.mark.sweep
def test_a_wide_filter_leaves_a_mean(record):
    source, wide = noise(100, 100), Paper(filter_sigma=4.0)
    image = wide(source, scaled(0.5), (50, 50), Edge.CLAMP).image
    record.error("mean", abs(image[25, 25, 0] - source.mean()))


def test_a_texel_larger_than_the_frame_fills_it():
    source = np.ones((3, 3, 1), np.float32)
    image = Paper()(source, scaled(1e5, -1.5e5, -1.5e5), (8, 8), Edge.CLAMP).image
    np.testing.assert_allclose(image, 1.0, atol=1e-6)
