import math

import numpy as np
import pytest

from resample import registry
from resample.engine.jit import threads
from resample_comparisons.texture.oiio import OIIO_FILTERS, Warp
from resample_comparisons.texture.opencv import (
    Cubic,
    InterArea,
    InterLinear,
    Lanczos4,
    Supersampled,
)
from resample_meshes.shapes import pyramid
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Homography,
    source_coordinates,
)
from resample_texture.scenes import shrunk
from resample_texture.types import Edge

POINTWISE = [InterLinear(), Cubic(), Lanczos4(), InterArea()]
GATHERING = [*POINTWISE, Supersampled(3)]
EVERY = [*GATHERING, Warp("mitchell")]
PERSPECTIVE = np.array([[1.1, 0.2, -4.3], [-0.1, 1.2, -2.1], [0.003, 0.005, 1.0]])
SHAPE = (22, 26)


def named(method):
    return type(method).__name__


def noise(height, width, channels):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def settled(index, size, edge):
    """Texel to read in place of one, None for nothing."""
    if 0 <= index < size:
        return index
    if edge is Edge.TRANSPARENT:
        return None
    if edge is Edge.CLAMP:
        return min(max(index, 0), size - 1)
    index %= size if edge is Edge.WRAP else 2 * size
    return min(index, 2 * size - 1 - index) if edge is Edge.MIRROR else index


def bilinear(picture, x, y, edge):
    """Picture and ones read at continuous coordinates, by definition."""
    height, width, channels = picture.shape
    read = np.zeros(channels + 1)
    left, top = math.floor(x - 0.5), math.floor(y - 0.5)
    for row in (top, top + 1):
        for column in (left, left + 1):
            weight = (1 - abs(y - 0.5 - row)) * (1 - abs(x - 0.5 - column))
            r, c = settled(row, height, edge), settled(column, width, edge)
            if r is not None and c is not None:
                read += weight * np.append(picture[r, c], 1.0)
    return read


def naive_bilinear(source, x, y, edge):
    """Bilinear warp by the obvious loop; NaN shows nothing."""
    result = np.zeros((*x.shape, source.shape[2] + 1))
    for place in np.ndindex(x.shape):
        if np.isfinite(x[place]):
            result[place] = bilinear(source, x[place], y[place], edge)
    return result


def together(warped):
    return np.dstack([warped.image, warped.coverage])


@pytest.mark.parametrize("edge", Edge)
def test_bilinear_is_the_naive_loop_through_a_matrix(edge):
    source = noise(17, 19, 3)
    expected = naive_bilinear(source, *source_coordinates(Homography(PERSPECTIVE), SHAPE), edge)
    found = InterLinear()(source, Homography(PERSPECTIVE), SHAPE, edge)
    np.testing.assert_allclose(together(found), expected, atol=2e-5)  # float32 coordinates


@pytest.mark.parametrize("edge", Edge)
def test_bilinear_is_the_naive_loop_through_a_map(edge):
    source = noise(17, 19, 1)
    x, y = np.random.default_rng(5).uniform(-60, 80, (2, *SHAPE))
    x[3, 4] = y[3, 4] = np.nan
    expected = naive_bilinear(source, x, y, edge)
    found = InterLinear()(source, BackwardMap(x, y), SHAPE, edge)
    np.testing.assert_allclose(together(found), expected, atol=3e-5)  # float32 coordinates


def test_a_map_of_a_matrix_gives_what_the_matrix_gives():
    source, geometry = noise(17, 19, 2), Homography(PERSPECTIVE)
    by_map = BackwardMap(*source_coordinates(geometry, SHAPE))
    for method in POINTWISE:
        one, other = (method(source, way, SHAPE, Edge.CLAMP) for way in (geometry, by_map))
        # Lanczos rounds places to 1/32 texel, so a place between two steps may go either way.
        far = 0.05 if isinstance(method, Lanczos4) else 1e-4
        np.testing.assert_allclose(one.image, other.image, atol=far, err_msg=named(method))


@pytest.mark.parametrize("method", [Cubic(), Lanczos4()], ids=named)
@pytest.mark.parametrize(("edge", "period"), [(Edge.WRAP, 19), (Edge.MIRROR, 38)])
def test_many_periods_away_a_repeated_source_looks_the_same(method, edge, period):
    source = noise(19, 19, 1)
    here, away = (
        Homography(np.array([[1, 0, -0.25 - shift], [0, 1, 3.5], [0, 0, 1]]))
        for shift in (0, 50 * period)
    )
    one, other = (method(source, way, SHAPE, edge).image for way in (here, away))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("n", [2, 5])
def test_supersampling_is_the_mean_of_a_finer_warp(n):
    source = noise(40, 37, 3)
    finer = Homography(np.diag([n, n, 1.0]) @ PERSPECTIVE)
    fine = Cubic()(source, finer, (SHAPE[0] * n, SHAPE[1] * n), Edge.CLAMP).image
    mean = fine.reshape(SHAPE[0], n, SHAPE[1], n, 3).mean(axis=(1, 3))
    found = Supersampled(n)(source, Homography(PERSPECTIVE), SHAPE, Edge.CLAMP).image
    np.testing.assert_allclose(found, mean, atol=1e-5)  # sums in float32


def test_supersampling_through_a_linear_map_is_that_through_its_matrix():
    source = noise(40, 37, 1)
    geometry = Homography(np.array([[0.4, 0.1, 2], [-0.2, 0.5, 9], [0, 0, 1]]))
    by_map = BackwardMap(*source_coordinates(geometry, SHAPE))
    one, other = (Supersampled(4)(source, g, SHAPE, Edge.TRANSPARENT) for g in (geometry, by_map))
    np.testing.assert_allclose(together(one), together(other), atol=1e-4)  # float32 coordinates


def test_a_hole_in_a_map_takes_nothing_from_its_neighbours():
    y, x = np.mgrid[0:8, 0:8] + 0.5
    x[4, 4] = np.nan
    coverage = Supersampled(4)(noise(8, 8, 1), BackwardMap(x, y), (8, 8), Edge.CLAMP).coverage
    np.testing.assert_array_equal(coverage == 1.0, np.isfinite(x))


@pytest.mark.parametrize("method", [Supersampled(2)], ids=named)
def test_any_number_of_threads_gives_the_same_bits(method):
    source, geometry = noise(64, 64, 3), Homography(np.diag([0.3, 0.2, 1.0]) @ PERSPECTIVE)
    pictures = []
    for count in (1, None):
        with threads(count):
            pictures.append(together(method(source, geometry, SHAPE, Edge.TRANSPARENT)))
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize("method", EVERY, ids=named)
def test_a_constant_source_is_its_color_times_coverage(method, edge):
    source = np.full((20, 30, 2), 0.5, np.float32)
    found = method(source, Homography(PERSPECTIVE), SHAPE, edge)
    expected = np.repeat(0.5 * found.coverage[..., None], 2, axis=2)
    np.testing.assert_allclose(found.image, expected, atol=2e-6)  # weights in float32


@pytest.mark.parametrize("method", EVERY, ids=named)
def test_coverage_of_a_transparent_source_is_one_inside_and_zero_outside(method):
    geometry = Homography(np.array([[1, 0, 10.0], [0, 1, 10.0], [0, 0, 1]]))
    coverage = method(noise(20, 20, 1), geometry, (40, 40), Edge.TRANSPARENT).coverage
    np.testing.assert_allclose(coverage[14:26, 14:26], 1.0, atol=1e-6)  # weights in float32
    outside = coverage.copy()
    outside[6:34, 6:34] = 0.0
    np.testing.assert_array_equal(outside, 0.0)


@pytest.mark.parametrize("method", EVERY, ids=named)
def test_coverage_stays_within_zero_and_one(method):
    found = method(noise(9, 9, 1), Homography(2.7 * PERSPECTIVE), SHAPE, Edge.TRANSPARENT)
    assert 0.0 <= found.coverage.min() <= found.coverage.max() <= 1.0


@pytest.mark.parametrize("edge", [Edge.TRANSPARENT, Edge.CLAMP, Edge.MIRROR])
@pytest.mark.parametrize("method", GATHERING, ids=named)
def test_nothing_is_drawn_above_the_horizon(method, edge):
    horizon = 12  # a row's upper edge
    matrix = np.linalg.inv(np.array([[3, 0, 1], [0, 1, 40], [0, 1, -horizon]], float))
    found = method(noise(20, 20, 1), Homography(matrix), (24, 16), edge)
    np.testing.assert_array_equal(found.coverage[:horizon], 0.0)
    np.testing.assert_array_equal(found.image[:horizon], 0.0)
    assert np.isfinite(found.image).all()
    if edge is not Edge.TRANSPARENT:
        np.testing.assert_array_equal(found.coverage[horizon:], 1.0)


def test_oiio_draws_nothing_behind_the_eye():
    matrix = np.linalg.inv(np.array([[1, 0, 0], [0, 1, 0], [0, 0.5, -2.1]]))
    found = Warp("triangle")(noise(8, 8, 1), Homography(matrix), (8, 8), Edge.CLAMP)
    np.testing.assert_array_equal(found.coverage[:, 0], [0, 0, 0, 0, 1, 1, 1, 1])


@pytest.mark.parametrize("channels", range(1, 7))
@pytest.mark.parametrize("method", EVERY, ids=named)
def test_channels_do_not_see_each_other(method, channels):
    source, geometry = noise(12, 14, channels), Homography(PERSPECTIVE)
    found = method(source, geometry, SHAPE, Edge.TRANSPARENT).image
    for c in range(channels):
        alone = method(source[..., c : c + 1].copy(), geometry, SHAPE, Edge.TRANSPARENT).image
        np.testing.assert_allclose(found[..., c : c + 1], alone, atol=1e-5)  # order of sums


@pytest.mark.parametrize("method", EVERY, ids=named)
def test_pictures_are_float32_in_one_piece(method):
    found = method(noise(5, 6, 3), Homography(np.eye(3)), SHAPE, Edge.TRANSPARENT)
    assert found.image.dtype == found.coverage.dtype == np.float32
    assert found.image.shape == (*SHAPE, 3)
    assert found.coverage.shape == SHAPE
    assert found.image.flags.c_contiguous
    assert found.coverage.flags.c_contiguous


@pytest.mark.parametrize("edge", Edge)
def test_oiio_repeats_the_source_as_the_others_do(edge):
    source = noise(16, 16, 1)
    geometry = Homography(np.array([[1, 0, 20.0], [0, 1, 5.0], [0, 0, 1]]))
    found = Warp("triangle")(source, geometry, (26, 40), edge)
    expected = InterLinear()(source, geometry, (26, 40), edge)
    np.testing.assert_allclose(together(found), together(expected), atol=1e-6)


@pytest.mark.parametrize("method", EVERY, ids=named)
def test_the_matrix_may_have_any_sign_and_scale(method):
    source = noise(12, 14, 1)
    one, other = (
        method(source, Homography(scale * PERSPECTIVE), SHAPE, Edge.CLAMP).image
        for scale in (1.0, -3.0)
    )
    np.testing.assert_allclose(one, other, atol=1e-4)


def test_a_wide_target_is_made_of_tiles():
    source = noise(3, 40000, 1)[:, :, :1]
    found = InterLinear()(source, Homography(np.eye(3)), (3, 40000), Edge.CLAMP)
    np.testing.assert_allclose(found.image, source, atol=1e-3)  # 1/256 texel in float32


@pytest.mark.parametrize("shape", [(1, 1), (5, 3), (17, 23), (1, 9)])
def test_levels_are_box_means(shape):
    source = noise(*shape, 5)
    levels = pyramid(source).levels
    assert levels[-1].tolist()[1:] == [1, 1]
    for _, height, width in levels:
        np.testing.assert_allclose(
            shrunk(source, height, width), box_means(source, height, width), atol=1e-5
        )


def box_means(picture, height, width):
    """Means over equal boxes, texels at their rims counted in part."""
    for axis, size in ((0, height), (1, width)):
        length = picture.shape[axis]
        border = np.arange(size + 1) * length / size
        index = np.arange(length)
        end = np.minimum(border[1:, None], index + 1)
        share = (end - np.maximum(border[:-1, None], index)).clip(0) * size / length
        picture = np.moveaxis(np.tensordot(share, picture, (1, axis)), 0, axis)
    return picture


@pytest.mark.parametrize("method", GATHERING, ids=named)
def test_forward_maps_are_refused(method):
    with pytest.raises(ValueError, match="takes a matrix or a backward map; for forward maps use"):
        method(noise(4, 4, 1), ForwardMap(*np.ones((2, 4, 4))), SHAPE, Edge.CLAMP)


def test_oiio_refuses_maps():
    with pytest.raises(ValueError, match="oiio takes a matrix; for maps use bilinear or hybrid"):
        Warp()(noise(4, 4, 1), BackwardMap(*np.ones((2, 4, 4))), (4, 4), Edge.CLAMP)


@pytest.mark.parametrize("way", ["lanczos4", "map"])
def test_a_source_beyond_the_limit_of_opencv_is_refused(way):
    method = Lanczos4() if way == "lanczos4" else InterLinear()
    geometry = Homography(np.eye(3)) if way == "lanczos4" else BackwardMap(*np.ones((2, 4, 4)))
    with pytest.raises(ValueError, match=r"40000 × 2 texels .* 32750 a side"):
        method(np.ones((2, 40000, 1), np.float32), geometry, (4, 4), Edge.CLAMP)


@pytest.mark.parametrize("n", [0, 17, 2.5, True])
def test_supersampling_refuses_a_bad_number(n):
    with pytest.raises(ValueError, match="n is a whole number from 1 to 16, not"):
        Supersampled(n)


def test_an_unknown_kernel_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="unknown kernel 'box'; known are cubic, linear, lanczos4"):
        Supersampled(kernel="box")


def test_an_unknown_filter_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="unknown filter 'hann'; known are box, triangle, gauss"):
        Warp("hann")


@pytest.mark.parametrize("name", OIIO_FILTERS)
def test_openimageio_knows_every_filter(name):
    picture = Warp(name)(noise(6, 6, 1), Homography(np.eye(3)), (6, 6), Edge.CLAMP).image
    assert np.isfinite(picture).all()


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("bilinear", InterLinear()),
        ("cubic", Cubic()),
        ("lanczos4", Lanczos4()),
        ("area", InterArea()),
        ("opencv-supersample:n=8,kernel=linear", Supersampled(8, "linear")),
        ("oiio:filter=mitchell", Warp("mitchell")),
    ],
)
def test_methods_go_by_name(spec, expected):
    assert registry.build("methods", spec) == expected
