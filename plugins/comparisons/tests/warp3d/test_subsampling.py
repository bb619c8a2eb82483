import numpy as np
import pytest

from resample_comparisons.warp3d.subsampling import Subsample
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Equation
from tests.bits import assert_threads_change_nothing
from tests.warp3d import naive_warp
from tests.warp3d.naive_warp import EMPTY, EQUATIONS, IDENTITY, random_source

# A rival, whose kernels are compiled for it alone.
pytestmark = pytest.mark.sweep

SHAPE = 22, 26


def flat(height=16, width=16):
    """A surface of one depth that is 1 everywhere."""
    color = np.ones((height, width, 1), np.float32)
    return prepare(DepthImage(color, np.ones((height, width)), EMPTY))


@pytest.mark.parametrize("is_placed", [False, True])
@pytest.mark.parametrize("name", EQUATIONS)
def test_subsamples_are_those_of_the_obvious_loop(name, is_placed):
    source, equation = random_source(is_placed=is_placed), EQUATIONS[name]
    given = Subsample(most=4)(source, equation, SHAPE)
    naive_warp.assert_same(given, naive_warp.subsamples(source, equation, SHAPE, 2, 4))


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.785, 1.2])
@pytest.mark.parametrize("scale", [0.3, 1.0, 2.7, 6.1])
def test_no_sub_pixel_is_missed_inside_a_surface(angle, scale):
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = turn, 20 - turn @ [8, 8]
    picture = Subsample()(flat(), Equation(matrix, np.zeros(3)), (40, 40))
    y, x = np.mgrid[:40, :40] + 0.5
    place = np.stack([x - 20, y - 20], axis=2) @ np.linalg.inv(turn).T
    inside = (abs(place) < 7.5 - 1 / scale).all(axis=2)
    assert np.all(picture.coverage[inside] == 1.0)


def test_fewer_subsamples_than_needed_leave_gaps():
    matrix = np.diag([9.0, 9.0, 1.0])
    coverage = Subsample(most=4)(flat(), Equation(matrix, np.zeros(3)), (100, 100)).coverage
    assert 0 < coverage[20:80, 20:80].mean() < 0.5


def test_a_sample_without_neighbours_is_drawn_alone():
    nearness = np.zeros((5, 5))
    nearness[2, 3] = 0.5
    source = prepare(DepthImage(np.ones((5, 5, 1), np.float32), nearness, EMPTY))
    picture = Subsample()(source, IDENTITY, (5, 5))
    assert np.argwhere(picture.coverage).tolist() == [[2, 3]]
    assert picture.coverage[2, 3] == 0.25
    assert picture.nearness[2, 3] == 0.5


def test_a_linear_picture_stays_as_it_is():
    y, x = np.mgrid[:12, :14] + 0.5
    source = prepare(DepthImage(np.stack([x, y], axis=2), np.ones((12, 14)), EMPTY))
    picture = Subsample()(source, IDENTITY, (12, 14))
    inner = slice(1, -1), slice(1, -1)
    np.testing.assert_allclose(picture.image[inner], source.color[inner], atol=1e-5)


def test_bits_do_not_depend_on_threads():
    source = random_source()
    assert_threads_change_nothing(
        lambda: Subsample(samples=3)(source, EQUATIONS["larger"], (90, 30))
    )


@pytest.mark.parametrize("choices", [{"samples": 0}, {"most": 0}, {"most": 65}, {"samples": 1.5}])
def test_choices_out_of_their_range_are_refused(choices):
    with pytest.raises(ValueError, match="is a whole number from 1 to"):
        Subsample(**choices)
