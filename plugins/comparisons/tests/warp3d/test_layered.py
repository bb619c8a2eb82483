import numpy as np
import pytest

from resample_comparisons.warp3d.layered import LayeredDepthImage, build, patches, splat
from resample_comparisons.warp3d.mcmillan import McMillan
from resample_warp3d.depth.equation import inverse
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Equation
from tests.bits import assert_threads_change_nothing
from tests.warp3d.naive_warp import EMPTY, EQUATIONS, IDENTITY, blocks, moved, random_source

# A rival, whose kernels are compiled for it alone.
pytestmark = pytest.mark.sweep

SHAPE = 96, 96


def box_and_wall(x):
    """A white box before a gray wall, seen from a place to the right of the origin by x."""
    nearness, color = np.full((16, 32), 0.2), np.full((16, 32, 1), 0.5, np.float32)
    left = 12 - round(10 * x)
    nearness[4:12, left : left + 8], color[4:12, left : left + 8] = 1.0, 1.0
    return prepare(DepthImage(color, nearness, EMPTY), step=0.0)


def test_identity_is_exact_in_any_number_of_channels():
    source = random_source(channels=7)
    picture = LayeredDepthImage()(source, IDENTITY, (20, 24))
    is_known = source.nearness > 0
    np.testing.assert_array_equal(picture.image, np.where(is_known[..., None], source.color, 0))
    np.testing.assert_array_equal(picture.nearness, source.nearness)


def test_splats_of_one_pixel_are_mcmillans_warp():
    source, equation = blocks(), moved(0.1, -0.1, -0.8)
    given, expected = (
        LayeredDepthImage(sizes=1)(source, equation, SHAPE),
        McMillan()(source, equation, SHAPE),
    )
    np.testing.assert_array_equal(given.image, expected.image)
    np.testing.assert_allclose(given.nearness, expected.nearness, rtol=1e-6)


def test_a_view_of_the_same_samples_adds_no_layer():
    source = blocks()
    layers = build([(source, IDENTITY), (source, IDENTITY)], SHAPE)
    np.testing.assert_array_equal(np.diff(layers.start), 1)
    np.testing.assert_array_equal(layers.color.reshape(source.color.shape), source.color)


def test_a_second_view_fills_what_the_first_does_not_see():
    to_right = Equation(np.eye(3), np.array([-10.0, 0.0, 0.0]))  # 10 px for the box, 2 for the wall
    first, second = box_and_wall(0), box_and_wall(1)
    one = build([(first, IDENTITY)], (16, 32))
    two = build([(first, IDENTITY), (second, inverse(to_right))], (16, 32))
    row = slice(4, 12), slice(0, 30)  # beyond, the first view's frame ends
    assert np.mean(splat(one, to_right, (16, 32)).coverage[row] == 0) > 0.2
    picture = splat(two, to_right, (16, 32))
    np.testing.assert_array_equal(picture.image[row], second.color[row])


def test_layers_of_a_pixel_come_back_to_front():
    near, far = np.full((4, 4), 2.0), np.full((4, 4), 1.0)
    sources = [
        (prepare(DepthImage(np.full((4, 4, 1), value, np.float32), value * depth, EMPTY)), IDENTITY)
        for value, depth in ((1.0, near), (1.0, far))
    ]
    layers = build(sources, (4, 4))
    np.testing.assert_array_equal(layers.nearness.reshape(16, 2), [[1.0, 2.0]] * 16)


def test_the_order_of_sources_does_not_matter():
    sources = [(random_source(), equation) for equation in (IDENTITY, *EQUATIONS.values())]
    for one, two in zip(build(sources, SHAPE), build(sources[::-1], SHAPE), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-6)  # sums of equally near samples


def test_nearness_is_that_of_the_surface_at_pixel_centers():
    y, x = np.mgrid[:16, :20] + 0.5
    source = prepare(
        DepthImage(np.ones((16, 20, 1), np.float32), 0.2 + 0.01 * x + 0.005 * y, EMPTY)
    )
    equation = EQUATIONS["larger"]
    layers = build([(source, equation)], (40, 50))
    pixel = np.repeat(np.arange(2000), np.diff(layers.start))
    normal = np.array([0.01, 0.005, 0.2])
    place = np.stack([pixel % 50 + 0.5, pixel // 50 + 0.5, np.ones(len(pixel))], axis=1)
    back = np.linalg.inv(equation.matrix + np.outer(equation.epipole, normal))
    # On the plane δ = n · x₁; with x₁ ~ H⁻¹ x₂ that is n H⁻¹ x₂ times w, and divided by w here.
    np.testing.assert_allclose(layers.nearness, place @ (normal @ back), rtol=1e-5)
    np.testing.assert_allclose(layers.slope, [(normal @ back)[:2]] * len(pixel), atol=1e-6)


@pytest.mark.parametrize("scale", [1.5, 2.0, 3.0, 4.0])
def test_splats_leave_no_gaps_up_to_as_many_px_as_there_are_sizes(scale):
    source = prepare(DepthImage(np.ones((12, 12, 1), np.float32), np.ones((12, 12)), EMPTY))
    equation = Equation(np.diag([scale, scale, 1.0]), np.zeros(3))
    shape = int(12 * scale), int(12 * scale)
    assert LayeredDepthImage()(source, equation, shape).coverage.min() > 0


def test_opacities_are_whole_halves_and_quarters():
    tables = patches(4)
    for size in range(4):
        side = 2 * size + 1
        assert set(np.unique(tables[size, :side, :side])) <= {0.25, 0.5, 1.0}
        assert tables[size, size, size] == 1.0


def test_bits_do_not_depend_on_threads():
    source = random_source()
    assert_threads_change_nothing(
        lambda: LayeredDepthImage()(source, EQUATIONS["larger"], (40, 30))
    )


def test_sources_of_different_channels_are_refused():
    sources = [(random_source(channels=n), IDENTITY) for n in (3, 4)]
    with pytest.raises(ValueError, match=r"same number of channels.*3, 4"):
        build(sources, (20, 24))


def test_no_source_is_refused():
    with pytest.raises(ValueError, match="1 or more; given: none"):
        build([], (20, 24))


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"sizes": 0}, "sizes is a whole number"),
        ({"tolerance": -0.1}, "tolerance is a number from 0"),
        ({"tolerance": 1.0}, "less than 1"),
    ],
)
def test_choices_out_of_their_range_are_refused(choices, message):
    with pytest.raises(ValueError, match=message):
        LayeredDepthImage(**choices)
