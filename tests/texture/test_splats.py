import dataclasses
import math

import numpy as np
import pytest

from resample.engine.jit import threads
from resample.engine.surfaces import RIM
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Homography,
    source_coordinates,
)
from resample_texture.texels.splatting import Splatting, splat
from resample_texture.types import Edge

SHAPE = (30, 34)
# A floor of 15 × 13 texels: 4 px per texel in front, less than 1 at the back, and turned.
FLOOR = Homography(np.array([[2.2, 0.9, 3.3], [-0.4, 3.9, 2.1], [0.01, 0.09, 1.0]]))
HORIZON = Homography(np.array([[40.0, 16.0, -4000.0], [0.0, 16.0, 400.0], [0.0, 1.0, 0.2]]))
SPLATS = Splatting()
BOTH = Splatting(threshold=1.0)  # and points
SHARP = Splatting(0.577, 0.5, 0.5, interpolating=True)
ALL_SHARP = Splatting(0.577, 0.5, 0.0, interpolating=True)
EVERY = [SPLATS, BOTH, SHARP]


def noise(height, width, channels=1):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def smooth(height, width):
    v, u = np.mgrid[:height, :width] + 0.5
    waves = np.sin(0.9 * u + 0.4 * v) + np.sin(0.5 * u - 0.7 * v)
    return np.float32(0.5 + 0.2 * waves)[..., None]


def scaled(scale, x=0.0, y=0.0):
    return Homography(np.array([[scale, 0, x], [0, scale, y], [0, 0, 1.0]]))


def summed(splatting):
    return dataclasses.replace(splatting, is_sum=True)


def jacobian(matrix, u, v):
    """Place, derivative and area of a texel."""
    x, y, d = matrix @ [u, v, 1.0]
    place = np.array([x, y]) / d
    slope = (matrix[:2, :2] - np.outer(place, matrix[2, :2])) / d
    return place, slope, abs(np.linalg.det(matrix)) / d**3


def weights_of_point(place, splatting, shape):
    """Weights of a point in all pixels, by definition."""
    along = []
    for at, size in zip(place[::-1], shape, strict=True):
        taps = math.ceil(2 * splatting.filter_of_points.radius)
        first = math.floor(at - 0.5 * taps + 0.5)
        distance = np.abs(np.arange(first, first + taps) + 0.5 - at)
        weight = splatting.filter_of_points(np.minimum(distance, 0.5 * taps))
        line = np.zeros(size)
        for pixel, share in zip(range(first, first + taps), weight / weight.sum(), strict=True):
            if 0 <= pixel < size:
                line[pixel] = share
        along.append(line)
    return np.outer(*along)


def naive(source, matrix, shape, splatting):
    """Sums of values and of weights, texel by texel, by definition."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    sums, weight = np.zeros((*shape, source.shape[2])), np.zeros(shape)
    for row in range(source.shape[0]):
        for column in range(source.shape[1]):
            place, slope, mass = jacobian(matrix, column + 0.5, row + 0.5)
            if np.linalg.norm(slope, 2) <= splatting.threshold:
                share = mass * weights_of_point(place, splatting, shape)
            else:
                spread = splatting.sigma**2 * slope @ slope.T + splatting.filter_sigma**2 * np.eye(
                    2
                )
                offset = np.stack([x - place[0], y - place[1]])
                q = np.einsum("iyx,ij,jyx->yx", offset, np.linalg.inv(spread), offset)
                peak = 2 * math.pi * math.sqrt(np.linalg.det(spread)) * (1 - math.exp(-RIM / 2))
                share = np.where(q <= RIM, mass * np.exp(-0.5 * q) / peak, 0.0)
            weight += share
            sums += share[..., None] * source[row, column]
    return sums, weight


def inset(geometry, source_shape, shape):
    """Distance of each pixel's source place from the nearest edge, texels."""
    u, v = source_coordinates(geometry, shape, source_shape)
    return np.minimum.reduce([u, source_shape[1] - u, v, source_shape[0] - v])


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_splats_are_what_the_obvious_loop_says(channels):
    source = noise(13, 15, channels)
    image, coverage = splat(source, FLOOR, SHAPE, Edge.TRANSPARENT, SPLATS)
    sums, weight = naive(source, FLOOR.matrix, SHAPE, SPLATS)
    is_seen = weight > 0.02
    expected = (sums[is_seen].T / weight[is_seen]).T
    np.testing.assert_allclose(  # float32, summed
        (image[is_seen].T / coverage[is_seen]).T, expected, atol=2e-5
    )


def test_points_and_splats_are_what_the_obvious_loop_says():
    source = noise(13, 15)
    hybrid = Splatting(threshold=1.4)
    image, coverage = splat(source, FLOOR, SHAPE, Edge.TRANSPARENT, hybrid)
    sums, weight = naive(source, FLOOR.matrix, SHAPE, hybrid)
    is_seen = weight > 0.1
    expected = sums[is_seen, 0] / weight[is_seen]
    # The points' filter is read from a table of 2048 phases.
    np.testing.assert_allclose(image[is_seen, 0] / coverage[is_seen], expected, atol=1e-3)


def test_long_thin_slanted_splats_are_what_the_obvious_loop_says():
    source = noise(5, 6)
    slanted = Homography(np.array([[40.0, 0.3, -90.0], [31.0, 0.9, -70.0], [0.0, 0.0, 1.0]]))
    image, coverage = splat(source, slanted, (70, 80), Edge.TRANSPARENT, SPLATS)
    sums, weight = naive(source, slanted.matrix, (70, 80), SPLATS)
    is_seen = weight > 0.02
    expected = sums[is_seen, 0] / weight[is_seen]
    np.testing.assert_allclose(image[is_seen, 0] / coverage[is_seen], expected, atol=5e-5)


def test_coverage_at_the_edges_is_the_weight():
    source = noise(13, 15)
    coverage = splat(source, FLOOR, SHAPE, Edge.TRANSPARENT, SPLATS).coverage
    _, weight = naive(source, FLOOR.matrix, SHAPE, SPLATS)
    is_edge = ~(inset(FLOOR, (13, 15), SHAPE) > SPLATS.radius)
    np.testing.assert_allclose(coverage[is_edge], np.minimum(weight[is_edge], 1.0), atol=2e-5)


def test_splats_of_texels_outside_the_frame_reach_into_it():
    source = np.ones((4, 4, 1), np.float32)
    geometry = scaled(10.0, x=-41.0)  # the source ends 1 px left of the frame
    coverage = splat(source, geometry, (40, 20), Edge.TRANSPARENT, SPLATS).coverage
    _, weight = naive(source, geometry.matrix, (40, 20), SPLATS)
    np.testing.assert_allclose(coverage[:, 0], weight[:, 0], atol=1e-5)


@pytest.mark.parametrize("scale", [0.2, 0.45, 0.9, 1.3, 5.0])
@pytest.mark.parametrize("splatting", EVERY)
def test_weights_are_one_inside(scale, splatting):
    source = np.ones((60, 60, 1), np.float32)
    image = splat(source, scaled(scale), (12, 12), Edge.CLAMP, summed(splatting)).image
    # A sum of Gaussians ripples by 4 exp(−2 π² σ²) = 0.029, σ being half their distance.
    np.testing.assert_allclose(image * scale**2, 1.0, atol=0.03)


@pytest.mark.parametrize("splatting", EVERY)
def test_a_white_source_stays_white_and_is_covered_inside(splatting):
    source = np.ones((13, 15, 3), np.float32)
    image, coverage = splat(source, FLOOR, SHAPE, Edge.TRANSPARENT, splatting)
    is_inside = inset(FLOOR, (13, 15), SHAPE) > 3.0
    np.testing.assert_array_equal(coverage[is_inside], 1.0)
    np.testing.assert_allclose(image[is_inside], 1.0, atol=1e-6)


@pytest.mark.parametrize("splatting", EVERY)
def test_sums_are_conserved(splatting):
    source = noise(20, 20)
    turned = Homography(np.array([[0.8, -0.5, 17.0], [0.6, 1.1, 9.0], [0.001, 0.002, 1.0]]))
    image = splat(source, turned, (60, 60), Edge.TRANSPARENT, summed(splatting)).image
    # A Gaussian of half a pixel, sampled at pixels, has 1 ± 0.014 of its mass by where it falls.
    assert image.sum() == pytest.approx(source.sum(), rel=1e-3)


def test_coverage_sums_to_the_projected_area():
    source = np.ones((20, 20, 1), np.float32)
    turned = np.array([[1.8, -0.5, 17.0], [0.6, 2.1, 9.0], [0.0, 0.0, 1.0]])
    coverage = splat(source, Homography(turned), (80, 80), Edge.TRANSPARENT, SPLATS).coverage
    # What ripples above 1 is clipped.
    assert coverage.sum() == pytest.approx(400 * np.linalg.det(turned), rel=5e-3)


def test_interpolating_splats_pass_through_the_texels():
    source = noise(16, 16)
    image = splat(source, scaled(21.0), (336, 336), Edge.TRANSPARENT, SHARP).image
    at_centers = image[10::21, 10::21]
    # Splats end at 1.91 texels and have the pixel filter on top.
    np.testing.assert_allclose(at_centers[2:-2, 2:-2], source[2:-2, 2:-2], atol=0.01)


def test_plain_splats_blur():
    source = noise(16, 16)
    image = splat(source, scaled(21.0), (336, 336), Edge.TRANSPARENT, SPLATS).image
    assert np.abs(image[10::21, 10::21] - source)[2:-2, 2:-2].max() > 0.1


def test_no_pop_in_a_zoom_where_interpolating_splats_become_points():
    source, shape = smooth(64, 64), (32, 32)
    points = splat(source, scaled(0.499), shape, Edge.MIRROR, SHARP).image
    splats = splat(source, scaled(0.499), shape, Edge.MIRROR, ALL_SHARP).image
    assert 0 < np.abs(points - splats).max() < 0.005 * np.ptp(source)


def test_rows_where_points_meet_splats_show_a_small_seam_only():
    source = smooth(96, 48)
    tilted = Homography(np.array([[0.62, 0.0, 0.0], [0.0, 0.62, 0.0], [0.0, 0.01, 1.0]]))
    hybrid = splat(source, tilted, (28, 14), Edge.MIRROR, SHARP).image
    splats = splat(source, tilted, (28, 14), Edge.MIRROR, ALL_SHARP).image
    by_row = np.sqrt(np.mean((hybrid - splats) ** 2, axis=(1, 2)))
    # Coefficients of waves 7 texels long are 1.17 times the texels; the sums meet within 2 px.
    assert 0 < by_row.max() < 0.03 * source.std()


@pytest.mark.parametrize("splatting", EVERY)
def test_threads_do_not_change_a_bit(splatting):
    source = noise(200, 190, 4)
    geometry = Homography(np.array([[0.9, 0.1, 3.3], [-0.1, 0.9, 2.1], [0.001, 0.004, 1.0]]))
    with threads(1):
        one = splat(source, geometry, (120, 130), Edge.TRANSPARENT, splatting)
    many = splat(source, geometry, (120, 130), Edge.TRANSPARENT, splatting)
    np.testing.assert_array_equal(one.image, many.image)


# Of maps, what finds a block's texels is compiled once more.
OF_MAPS = pytest.mark.sweep
OF_HOLES = pytest.mark.sweep


@OF_MAPS
@pytest.mark.parametrize("splatting", EVERY)
def test_a_map_of_an_affine_homography_gives_the_same_picture(splatting):
    source = noise(40, 37, 3)
    matrix = np.array([[0.9, 0.3, 3.3], [-0.2, 1.2, 9.1], [0.0, 0.0, 1.0]])
    v, u = np.mgrid[:40, :37] + 0.5
    x, y = np.einsum("ij,jyx->iyx", matrix[:2, :2], np.stack([u, v])) + matrix[:2, 2, None, None]
    by_map = splat(source, ForwardMap(x, y), (60, 50), Edge.TRANSPARENT, splatting)
    by_matrix = splat(source, Homography(matrix), (60, 50), Edge.TRANSPARENT, splatting)
    is_seen = by_matrix.coverage > 0.1  # where their images are full differs: by lines, by weight
    mean, expected = (w.image[is_seen] / w.coverage[is_seen, None] for w in (by_map, by_matrix))
    np.testing.assert_allclose(mean, expected, atol=1e-3)  # phases of a table differ by one


@OF_HOLES
def test_texels_without_a_place_are_left_out():
    source = noise(30, 30)
    v, u = np.mgrid[:30, :30] + 0.5
    u[:, 15:] = np.nan
    image, coverage = splat(source, ForwardMap(2 * u, 2 * v), (60, 60), Edge.TRANSPARENT, BOTH)
    assert np.isfinite(image).all()
    assert coverage[30, 26] == 1.0
    assert coverage[:, 36:].max() == 0.0


@OF_HOLES
def test_a_texel_without_neighbours_is_left_out():
    x = np.full((5, 5), np.nan)
    x[2, 2] = 3.0
    coverage = splat(noise(5, 5), ForwardMap(x, x), (6, 6), Edge.TRANSPARENT, BOTH).coverage
    assert coverage.max() == 0.0


@OF_HOLES
def test_a_map_of_nowhere_gives_nothing():
    nowhere = np.full((5, 5), np.nan)
    image = splat(noise(5, 5), ForwardMap(nowhere, nowhere), (6, 6), Edge.WRAP, BOTH).image
    assert not image.any()


@pytest.mark.parametrize(
    ("edge", "mode"), [(Edge.CLAMP, "edge"), (Edge.WRAP, "wrap"), (Edge.MIRROR, "symmetric")]
)
@pytest.mark.parametrize("splatting", EVERY)
def test_edges_continue_the_source(edge, mode, splatting):
    source = noise(9, 8, 3)
    geometry = Homography(np.array([[2.0, 0.3, 4.0], [-0.2, 1.7, 5.0], [0.002, 0.004, 1.0]]))
    image, coverage = splat(source, geometry, SHAPE, edge, splatting)
    padded = np.pad(source, ((40, 40), (40, 40), (0, 0)), mode=mode)
    shift = np.array([[1.0, 0.0, -40.0], [0.0, 1.0, -40.0], [0.0, 0.0, 1.0]])
    larger = Homography(geometry.matrix @ shift, is_signed=True)
    expected = splat(padded, larger, SHAPE, Edge.TRANSPARENT, splatting)
    np.testing.assert_array_equal(coverage, 1.0)
    np.testing.assert_allclose(image, expected.image, atol=2e-5)


def test_nothing_is_drawn_above_the_horizon():
    image, coverage = splat(noise(400, 200), HORIZON, (32, 32), Edge.TRANSPARENT, BOTH)
    assert np.isfinite(image).all()
    assert coverage[:14].max() == 0.0  # the horizon is at row 16, splats reach 1.7 px
    assert coverage[19:].min() == 1.0


def test_texels_behind_the_eye_are_left_out():
    behind = Homography(HORIZON.matrix * [1, -1, 1], is_signed=True)
    image, coverage = splat(noise(40, 40), behind, (32, 32), Edge.TRANSPARENT, BOTH)
    assert coverage.max() == 0.0
    assert not image.any()


def test_a_continued_plane_up_to_the_horizon_is_refused():
    with pytest.raises(ValueError, match="one by one"):
        splat(noise(8, 8), HORIZON, (32, 32), Edge.WRAP, BOTH)


def test_a_texel_larger_than_the_frame_fills_it():
    source = np.ones((3, 3, 1), np.float32)
    image = splat(source, scaled(1e5, -1.5e5, -1.5e5), (8, 8), Edge.CLAMP, BOTH).image
    np.testing.assert_allclose(image, 1.0, atol=1e-6)


@pytest.mark.parametrize(
    "bad",
    [
        {"sigma": 0.0},
        {"sigma": math.nan},
        {"sigma": 17.0},
        {"filter_sigma": -1.0},
        {"filter_sigma": 1e-3},
        {"filter_sigma": math.inf},
        {"threshold": math.nan},
        {"threshold": -0.1},
        {"threshold": math.inf},
        {"sigma": 0.2, "interpolating": True},
    ],
)
def test_bad_choices_are_refused(bad):
    with pytest.raises(ValueError, match=r"sigma|threshold"):
        Splatting(**bad)


def test_a_backward_map_is_refused():
    with pytest.raises(ValueError, match="backward map"):
        splat(noise(4, 4), BackwardMap(np.ones((4, 4)), np.ones((4, 4))), (4, 4), Edge.CLAMP, BOTH)


def test_a_map_of_another_source_is_refused():
    with pytest.raises(ValueError, match="places no source"):
        splat(noise(4, 5), ForwardMap(np.ones((4, 4)), np.ones((4, 4))), (4, 4), Edge.CLAMP, BOTH)
