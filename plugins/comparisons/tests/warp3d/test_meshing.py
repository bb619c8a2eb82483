import math

import numpy as np
import pytest

from resample_comparisons.warp3d.meshing import DepthMesh
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Equation
from tests.bits import assert_threads_change_nothing
from tests.warp3d import naive_warp
from tests.warp3d.naive_warp import EMPTY, EQUATIONS, IDENTITY, random_source

# A rival, whose kernels are compiled for it alone.
pytestmark = pytest.mark.sweep

SHAPE = 22, 26
CUTS = {"links": None, "0.3": 0.3, "none": math.inf}


def plane(height=16, width=20):
    """A slanted plane whose color is its place in the source."""
    y, x = np.mgrid[:height, :width] + 0.5
    nearness = 0.2 + 0.01 * x + 0.005 * y
    return prepare(DepthImage(np.stack([x, y], axis=2), nearness, EMPTY))


@pytest.mark.each_value
@pytest.mark.parametrize("is_placed", [False, True])
@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("name", EQUATIONS)
def test_triangles_are_those_of_the_obvious_loop(name, cut, is_placed):
    source, equation = random_source(is_placed=is_placed), EQUATIONS[name]
    given = DepthMesh(cut=cut, samples=2)(source, equation, SHAPE)
    naive_warp.assert_same(given, naive_warp.triangles(source, equation, SHAPE, 2, CUTS[cut]))


def test_identity_is_exact_within_the_outermost_samples():
    source = plane()
    picture = DepthMesh()(source, IDENTITY, (16, 20))
    np.testing.assert_array_equal(picture.image, source.color)


def test_color_follows_the_perspective_of_planes():
    source, equation = plane(), EQUATIONS["larger"]
    picture = DepthMesh()(source, equation, (40, 50))
    y, x = np.mgrid[:40, :50] + 0.5
    normal = np.array([0.01, 0.005, 0.2])
    back = np.linalg.inv(equation.matrix + np.outer(equation.epipole, normal))
    place = np.stack([x, y, np.ones_like(x)], axis=2) @ back.T
    seen = picture.coverage > 0
    expected = (place[..., :2] / place[..., 2:])[seen]
    # Corners are stored to 4e-6 px, one px of the target is half a px of the source.
    np.testing.assert_allclose(picture.image[seen], expected, atol=2e-5)
    assert seen.mean() > 0.3


def test_a_rubber_sheet_fills_cuts_and_says_so():
    source = random_source()
    cut, whole = (
        DepthMesh(cut=cut)(source, EQUATIONS["larger"], SHAPE) for cut in ("links", "none")
    )
    assert not cut.bridged.any()
    assert np.all(whole.bridged[(cut.coverage == 0) & (whole.coverage > 0)])


@pytest.mark.parametrize(("sideways", "is_seen"), [(50.0, True), (-50.0, True), (-200.0, False)])
def test_the_back_of_a_surface_is_not_drawn(sideways, is_seen):
    normal, epipole = np.array([0.01, 0.005, 0.2]), np.array([sideways, 0.0, 0.0])
    matrix = np.array([[1.0, 0, 100], [0, 1, 10], [0, 0, 1]])
    assert (1 + normal @ epipole > 0) == is_seen  # on which side of the plane the eye is
    picture = DepthMesh()(plane(), Equation(matrix, epipole), (40, 200))
    assert picture.coverage.any() == is_seen


def test_a_mirrored_view_shows_the_front():
    source = plane()
    flip = Equation(np.array([[-1.0, 0, 20], [0, 1, 0], [0, 0, 1]]), np.zeros(3))
    np.testing.assert_array_equal(DepthMesh()(source, flip, (16, 20)).image, source.color[:, ::-1])


def test_coverage_is_the_share_of_sub_pixels():
    source = plane()
    half = Equation(np.array([[1.0, 0, 0.25], [0, 1, 0], [0, 0, 1]]), np.zeros(3))
    picture = DepthMesh(samples=4)(source, half, (16, 20))
    # The mesh begins at x = 0.75 px, so the last of four sub-pixels, at 0.875, is covered.
    np.testing.assert_array_equal(picture.coverage[1:-1, 0], 0.25)
    assert np.all(picture.coverage[1:-1, 1:-1] == 1.0)


def test_triangles_with_a_corner_behind_the_eye_are_dropped():
    source = plane()
    w = 1.0 - source.nearness / 0.35
    picture = DepthMesh()(source, Equation(np.eye(3), np.array([0, 0, -1 / 0.35])), (200, 200))
    assert (w < 0).any()
    assert np.isfinite(picture.image).all()
    assert picture.nearness.max() <= np.max((source.nearness / w)[w > 0])


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_less_than_two_rows_or_columns_make_no_triangles(shape):
    source = prepare(DepthImage(np.ones((*shape, 1), np.float32), np.ones(shape), EMPTY))
    assert not DepthMesh()(source, IDENTITY, (4, 4)).coverage.any()


def test_bits_do_not_depend_on_threads():
    source = random_source()
    assert_threads_change_nothing(
        lambda: DepthMesh(samples=3)(source, EQUATIONS["larger"], (90, 30))
    )


@pytest.mark.parametrize("cut", ["soft", -0.1, math.nan])
def test_an_unknown_cut_is_refused(cut):
    with pytest.raises(ValueError, match="links, none or a number from 0"):
        DepthMesh(cut=cut)


@pytest.mark.parametrize("samples", [0, 17, 2.5, True])
def test_a_wrong_number_of_sub_pixels_is_refused(samples):
    with pytest.raises(ValueError, match="samples is a whole number from 1 to 16"):
        DepthMesh(samples=samples)
