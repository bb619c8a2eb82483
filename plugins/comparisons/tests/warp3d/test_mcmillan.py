import numpy as np
import pytest

from resample_comparisons.warp3d.kernels.mcmillan import copy_rows, place_samples
from resample_comparisons.warp3d.mcmillan import (
    McMillan,
    McMillanZBuffer,
    blank,
    eye_in_source,
    walks_of,
)
from resample_warp3d.depth.equation import of_rectified
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.types import DepthImage, Equation
from tests.bits import assert_threads_change_nothing
from tests.warp3d import naive_warp
from tests.warp3d.naive_warp import EMPTY, EQUATIONS, IDENTITY, blocks, moved, random_source

METHODS = [McMillan(), McMillanZBuffer()]
EYES = {
    "right": (0.4, 0, 0),
    "left": (-0.4, 0, 0),
    "above": (0, -0.4, 0),
    "below": (0, 0.4, 0),
    "diagonal": (0.3, 0.3, 0),
    "ahead, seen": (0.1, 0.05, 0.6),
    "far ahead, seen": (0, 0, 1.2),
    "behind, seen": (0.1, -0.1, -0.8),
    "far behind, seen": (0, 0.2, -3),
    "ahead, beyond the frame": (-0.5, 0.1, 0.3),
    "behind, beyond the frame": (0.5, 0.2, -0.3),
}


@pytest.mark.some(3)
@pytest.mark.parametrize("is_placed", [False, True])
@pytest.mark.parametrize("name", EQUATIONS)
def test_z_buffer_is_that_of_the_obvious_loop(name, is_placed):
    source, shape = random_source(is_placed=is_placed), (22, 26)
    given = McMillanZBuffer()(source, EQUATIONS[name], shape)
    naive_warp.assert_same(given, naive_warp.nearest_pixels(source, EQUATIONS[name], shape))


@pytest.mark.parametrize("eye", EYES.values(), ids=EYES)
def test_order_shows_the_surfaces_that_a_z_buffer_shows(eye):
    source, equation = blocks(), moved(*eye)
    by_order, by_depth = (method(source, equation, (96, 96)) for method in METHODS)
    np.testing.assert_array_equal(by_order.coverage, by_depth.coverage)
    # Samples of one block that share a pixel are equally near but for the turn of the camera.
    np.testing.assert_allclose(by_order.nearness, by_depth.nearness, rtol=1e-3)


@pytest.mark.parametrize("eye", EYES.values(), ids=EYES)
def test_the_same_order_backward_shows_what_is_hidden(eye):
    source, equation = blocks(), moved(*eye)
    walks = walks_of(equation, (96, 96), EMPTY)
    first, end, step = np.moveaxis(walks, 2, 0)
    backward = np.stack([end - step, first - step, -step], axis=2)
    owner, picture = np.full((96, 96), -1, np.int32), blank(source, (96, 96))
    place_samples(source, equation, backward, owner, np.zeros((0, 0), np.float32))
    copy_rows(source, equation, owner, picture)
    expected = McMillanZBuffer()(source, equation, (96, 96)).nearness
    assert np.mean(picture.nearness < 0.99 * expected) > 0.01


@pytest.mark.parametrize("method", METHODS)
def test_order_of_a_rectified_pair_shows_nearer_samples(method):
    nearness = np.array([[1, 1, 3, 1, 1, 1, 4, 1, 1, 1]], np.float32)
    color = np.arange(10, dtype=np.float32).reshape(1, 10, 1)
    source = prepare(DepthImage(color, nearness, EMPTY))
    to_right = method(source, of_rectified(1.0), (1, 10))
    to_left = method(source, of_rectified(-1.0), (1, 10))
    assert to_right.nearness.tolist() == [[1, 0, 4, 1, 1, 0, 1, 1, 1, 0]]
    assert to_left.nearness.tolist() == [[0, 1, 1, 0, 1, 3, 1, 0, 1, 1]]
    assert to_right.image[0, 2, 0] == 6


@pytest.mark.parametrize("method", METHODS)
def test_identity_is_exact_in_any_number_of_channels(method):
    source = random_source(channels=7)
    picture = method(source, IDENTITY, (20, 24))
    is_known = source.nearness > 0
    np.testing.assert_array_equal(picture.image, np.where(is_known[..., None], source.color, 0))
    np.testing.assert_array_equal(picture.coverage, is_known)
    np.testing.assert_array_equal(picture.nearness, source.nearness)


@pytest.mark.parametrize("method", METHODS)
def test_a_turn_of_the_camera_does_not_ask_for_depth(method):
    source = random_source()
    turn = Equation(EQUATIONS["larger"].matrix, np.zeros(3))
    flat = source._replace(nearness=(source.nearness > 0).astype(np.float32))
    given, expected = method(source, turn, (20, 24)).image, method(flat, turn, (20, 24)).image
    np.testing.assert_array_equal(given, expected)


@pytest.mark.parametrize("equation", [*EQUATIONS.values(), IDENTITY, of_rectified(1.0)])
def test_sheets_hold_every_sample_once(equation):
    rows, columns = walks_of(equation, (20, 24), EMPTY)
    assert sorted(n for walk in rows for n in range(*walk)) == list(range(20))
    assert sorted(n for walk in columns for n in range(*walk)) == list(range(24))


def test_sheets_meet_at_the_eye_even_in_a_distorted_source():
    source = random_source(is_placed=True)
    equation = Equation(np.eye(3), np.array([-7.3, -11.6, -1.0]))  # the eye is at (7.3, 11.6)
    rows, columns = walks_of(equation, (20, 24), source.place)
    row, column = rows[0, 1], columns[0, 1]
    assert source.place[row - 1, 12, 1] < 11.6 < source.place[row, 12, 1]
    assert source.place[row, column - 1, 0] < 7.3 < source.place[row, column, 0]


def test_the_eye_is_behind_the_source_where_its_scale_is_negative():
    assert eye_in_source(moved(0, 0, -1))[2] < 0 < eye_in_source(moved(0, 0, 1))[2]


@pytest.mark.parametrize("method", METHODS)
def test_magnification_is_that_of_areas(method):
    source = random_source()
    source = source._replace(slope=np.zeros_like(source.slope))
    picture = method(source, Equation(np.diag([2, 1.5, 1]), np.zeros(3)), (30, 48))
    seen = picture.coverage > 0
    np.testing.assert_allclose(picture.magnification[seen], 3.0, rtol=1e-6)
    assert not picture.magnification[~seen].any()


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_seen_of_what_is_behind_the_eye(method):
    source = random_source()
    picture = method(source, Equation(np.eye(3), np.array([0, 0, -20.0])), (20, 24))
    assert not picture.coverage.any()
    assert not picture.image.any()


@pytest.mark.parametrize("method", METHODS)
def test_a_single_sample_may_lie_anywhere(method):
    source = prepare(DepthImage(np.ones((1, 1, 2), np.float32), np.ones((1, 1)), EMPTY))
    picture = method(source, Equation(np.eye(3), np.array([2.0, 1.0, 0.0])), (2, 3))
    assert np.argwhere(picture.coverage).tolist() == [[1, 2]]


@pytest.mark.parametrize("method", METHODS)
def test_bits_do_not_depend_on_threads(method):
    source = random_source()
    assert_threads_change_nothing(lambda: method(source, EQUATIONS["bent"], (40, 30)))
