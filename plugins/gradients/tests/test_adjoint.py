import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from resample import registry
from resample.profiles.filters import Area, Box, Gaussian, Mitchell, Tent
from resample.profiles.interpolation import (
    InterpolatingCatmullRom,
    InterpolatingGaussian,
    Nearest,
    Spline,
)
from resample_gradients.adjoint import adjoint
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Homography
from resample_texture.texels.forward import CellGrid, blocks_of, project
from resample_texture.texels.kernels.blocks import LEVEL
from resample_texture.types import Edge
from tests.bits import assert_threads_change_nothing

MAGNIFIED = Homography([[2.3, 0.4, -1.0], [-0.3, 1.9, 2.0], [0.002, 0.003, 1.0]])
MINIFIED = Homography([[0.23, 0.04, 3.0], [-0.03, 0.19, 2.0], [0.002, 0.003, 1.0]])
JOINED = Homography([[0.02, 0.001, 3.0], [-0.001, 0.02, 2.0], [0.0002, 0.0003, 1.0]])
UNEVEN = Homography([[3.0, 0.0, 3.0], [0.3, 0.05, 8.0], [0.0002, 0.0003, 1.0]])
FRAME = (14, 16)
SOURCE = (10, 12)
ROUNDING = 1e-6  # of products of float32 pictures of some hundred numbers, by their lengths


def product(a, b):
    return float((a.astype(np.float64) * b).sum())


def check_transposed(geometry, edge, cells, source_shape=SOURCE, channels=2):
    """Check that <A x, g> is <x, A^T g>."""
    rng = np.random.default_rng(7)
    source = rng.standard_normal((*source_shape, channels)).astype(np.float32)
    gradient = rng.standard_normal((*FRAME, channels)).astype(np.float32)
    image = project(source, geometry, FRAME, edge, cells).image
    texels = adjoint(gradient, geometry, source_shape, edge, cells)
    assert texels.dtype == np.float32
    assert texels.shape == source.shape
    size = np.sqrt(product(image, image) * product(gradient, gradient))
    error = product(image, gradient) - product(source, texels)
    assert abs(error) <= ROUNDING * size, f"{error} of {size}"


@pytest.mark.each_value
@pytest.mark.parametrize("is_sum", [False, True])
@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize("geometry", [MAGNIFIED, MINIFIED, JOINED, UNEVEN])
@pytest.mark.parametrize("name", registry.names("interpolations"))
def test_the_adjoint_is_the_transpose(geometry, edge, name, is_sum):
    cells = CellGrid(interpolation=registry.build("interpolations", name), is_sum=is_sum)
    check_transposed(geometry, edge, cells)


number = st.floats(-3, 3, allow_subnormal=False)
tilt = st.floats(-0.3, 0.3, allow_subnormal=False)
cells_drawn = st.builds(
    CellGrid,
    pixel_filter=st.sampled_from([Area(), Box(), Tent(), Gaussian(), Mitchell()]),
    interpolation=st.sampled_from(
        [Nearest(), InterpolatingCatmullRom(), Spline(), InterpolatingGaussian()]
    ),
    quality=st.floats(1.0, 3.0),
    cut=st.booleans(),
    is_sum=st.booleans(),
)


@pytest.mark.sweep
@settings(max_examples=25, deadline=None)
@given(
    numbers=st.tuples(
        number, number, st.floats(-9, 9), number, number, st.floats(-9, 9), tilt, tilt
    ),
    scale=st.sampled_from([0.02, 0.2, 1.0]),
    edge=st.sampled_from(Edge),
    cells=cells_drawn,
)
def test_any_homography_has_its_transpose(numbers, scale, edge, cells):
    matrix = np.array([*numbers, 1.0]).reshape(3, 3)
    matrix[:, :2] *= scale
    assume(np.linalg.cond(matrix) < 1e5)
    check_transposed(Homography(matrix), edge, cells)


@pytest.mark.sweep
@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1000),
    scale=st.floats(0.2, 3.0),
    edge=st.sampled_from(Edge),
    cells=cells_drawn,
)
def test_any_map_has_its_transpose(seed, scale, edge, cells):
    v, u = np.mgrid[: SOURCE[0], : SOURCE[1]] + 0.5
    jitter = np.random.default_rng(seed).uniform(-0.4, 0.4, (2, *SOURCE))
    x = np.where(jitter[0] > 0.38, np.nan, scale * (u + jitter[0]))
    check_transposed(ForwardMap(x, scale * (v + jitter[1])), edge, cells)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (40, 3)])
@pytest.mark.parametrize("edge", Edge)
def test_sources_of_any_shape_have_their_transpose(shape, edge):
    check_transposed(MAGNIFIED, edge, CellGrid(interpolation=Spline()), shape)


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_any_number_of_channels_has_its_transpose(channels):
    check_transposed(MAGNIFIED, Edge.CLAMP, CellGrid(), channels=channels)


@pytest.mark.parametrize("edge", [Edge.CLAMP, Edge.WRAP, Edge.MIRROR])
def test_cells_of_more_texels_than_the_source_has_give_back(edge):
    axes = blocks_of(JOINED, SOURCE, FRAME, edge, CellGrid()).axes
    assert (1 << axes[:, 0, LEVEL].max()) > SOURCE[1]
    check_transposed(JOINED, edge, CellGrid())


@pytest.mark.sweep
@pytest.mark.parametrize(
    "cells", [CellGrid(), CellGrid(Mitchell(), Spline(), is_sum=True)], ids=str
)
def test_each_texel_gets_what_it_gives_to_each_pixel(cells):
    shape, frame = (3, 4), (4, 5)
    geometry = Homography([[1.2, 0.1, 0.2], [-0.1, 0.9, 0.5], [0.01, 0.02, 1.0]])
    forward = np.array([
        project(texel.reshape(*shape, 1), geometry, frame, Edge.CLAMP, cells).image.ravel()
        for texel in np.eye(12, dtype=np.float32)
    ])  # fmt: skip
    backward = np.array([
        adjoint(pixel.reshape(*frame, 1), geometry, shape, Edge.CLAMP, cells).ravel()
        for pixel in np.eye(20, dtype=np.float32)
    ])  # fmt: skip
    np.testing.assert_allclose(backward.T, forward, atol=1e-6)


def test_the_gradient_of_a_loss_is_that_of_finite_differences():
    rng, shape = np.random.default_rng(7), (3, 4)
    source, wanted = rng.random((*shape, 1), np.float32), rng.random((4, 5, 1), np.float32)

    def image(texels):
        return project(texels, MAGNIFIED, (4, 5), Edge.TRANSPARENT, CellGrid()).image

    def loss(texels):
        return 0.5 * product(image(texels) - wanted, image(texels) - wanted)

    gradient = adjoint(image(source) - wanted, MAGNIFIED, shape, Edge.TRANSPARENT, CellGrid())
    for index in np.ndindex(source.shape):
        step = np.zeros_like(source)
        step[index] = 0.05  # the loss is a parabola: differences across are exact for any step
        slope = (loss(source + step) - loss(source - step)) / 0.1
        assert slope == pytest.approx(gradient[index], abs=1e-5)


def test_threads_change_no_bit():
    gradient = np.random.default_rng(7).standard_normal((60, 70, 3)).astype(np.float32)
    cells = CellGrid(Gaussian(), Spline())
    assert_threads_change_nothing(
        lambda: [adjoint(gradient, MAGNIFIED, (90, 80), Edge.MIRROR, cells)]
    )


def test_a_source_out_of_sight_has_no_gradient():
    away = Homography([[1, 0, 1000], [0, 1, 0], [0, 0, 1]])
    gradient = np.ones((*FRAME, 1), np.float32)
    assert (adjoint(gradient, away, SOURCE, Edge.TRANSPARENT, CellGrid()) == 0).all()


def test_a_gradient_without_channels_is_refused():
    with pytest.raises(ValueError, match=r"height, width, C"):
        adjoint(np.ones(FRAME, np.float32), MAGNIFIED, SOURCE, Edge.CLAMP, CellGrid())


def test_a_backward_map_is_refused():
    geometry = BackwardMap(np.zeros(FRAME), np.zeros(FRAME))
    with pytest.raises(ValueError, match="backward"):
        adjoint(np.ones((*FRAME, 1), np.float32), geometry, SOURCE, Edge.CLAMP, CellGrid())
