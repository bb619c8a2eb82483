import numpy as np
import pytest

from resample_texture.geometry.regions import picks_of_move, whole_move
from resample_texture.types import Edge, Warped
from resample_texture.warping import warp

PADDINGS = {Edge.CLAMP: "edge", Edge.WRAP: "wrap", Edge.MIRROR: "symmetric"}


# Of a picture (4, 5): matrix, what NumPy does.
TURNS = {
    "a quarter": ([[0, 1, 0], [-1, 0, 5], [0, 0, 1]], lambda image: np.rot90(image, 1)),
    "a half": ([[-1, 0, 5], [0, -1, 4], [0, 0, 1]], lambda image: np.rot90(image, 2)),
    "three quarters": ([[0, -1, 4], [1, 0, 0], [0, 0, 1]], lambda image: np.rot90(image, 3)),
    "a flip": ([[-1, 0, 5], [0, 1, 0], [0, 0, 1]], np.fliplr),
    "upside down": ([[1, 0, 0], [0, -1, 4], [0, 0, 1]], np.flipud),
    "transposed": ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], lambda image: image.swapaxes(0, 1)),
}


def shift(x, y):
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def moved(image, move, shape, edge):
    picks = picks_of_move(move, image.shape[:2], shape, edge)
    return Warped(picks.of(image), picks.coverage)


def shifted(image, move, shape, edge):
    return moved(image, whole_move(shift(*move)), shape, edge)


@pytest.mark.parametrize("scale", [1.0, -1.0, 0.5, 1e-30])
def test_a_shift_is_found_whatever_the_matrix_s_scale(scale):
    assert whole_move(scale * shift(-3, 5)) == ((-3, 5), (1, 1), False)


@pytest.mark.parametrize(
    "matrix",
    [
        shift(0.5, 0),
        shift(0, 1e-9),
        shift(2.0**60, 0),
        np.diag([2.0, 1.0, 1.0]),
        np.diag([-1.0, 2.0, 1.0]),
        [[1, 1e-12, 0], [0, 1, 0], [0, 0, 1.0]],
        [[1, 0, 0], [0, 1, 0], [1e-12, 0, 1.0]],
        [[1, 0, 0], [0, 1, 0], [1, 0, 0.0]],
        [[0, 1, 0.5], [1, 0, 0], [0, 0, 1.0]],
        [[0, 1, 0], [2, 0, 0], [0, 0, 1.0]],
        [[0, 1, 0], [1, 1e-12, 0], [0, 0, 1.0]],
        [[0, 1, 0], [0, 0, 1], [1.0, 0, 0]],
    ],
)
def test_anything_else_is_no_move(matrix):
    assert whole_move(np.asarray(matrix)) is None


@pytest.mark.parametrize("move", [(2, -1), (-14, 3), (0, 0), (31, 29)])
@pytest.mark.parametrize("edge", PADDINGS)
def test_a_continued_source_is_numpy_s_padding(rng, edge, move):
    image = rng.random((4, 5, 3))
    whole = np.pad(image, ((40, 40), (40, 40), (0, 0)), mode=PADDINGS[edge])
    moved = shifted(image, move, (6, 7), edge)
    expected = whole[40 - move[1] :, 40 - move[0] :][:6, :7]
    np.testing.assert_array_equal(moved.image, expected)
    np.testing.assert_array_equal(moved.coverage, np.ones((6, 7)))


@pytest.mark.parametrize("move", [(2, -1), (-3, 3), (0, 0), (5, 0), (0, -4), (10**12, 0)])
def test_around_a_transparent_source_there_is_nothing(rng, move):
    image = rng.random((4, 5))
    expected, coverage = np.zeros((6, 7)), np.zeros((6, 7))
    for row, column in np.ndindex(6, 7):
        y, x = row - move[1], column - move[0]
        if 0 <= y < 4 and 0 <= x < 5:
            expected[row, column], coverage[row, column] = image[y, x], 1.0
    moved = shifted(image, move, (6, 7), Edge.TRANSPARENT)
    np.testing.assert_array_equal(moved.image, expected)
    np.testing.assert_array_equal(moved.coverage, coverage)


@pytest.mark.parametrize("edge", Edge)
def test_two_shifts_are_one(rng, edge):
    image = rng.random((6, 6))
    once = shifted(image, (5, 1), (6, 6), edge).image
    halfway = shifted(image, (2, 3), (6, 6), edge).image
    if edge is Edge.WRAP:
        np.testing.assert_array_equal(shifted(halfway, (3, -2), (6, 6), edge).image, once)
    else:  # what leaves the frame does not come back
        twice = shifted(halfway, (3, -2), (6, 6), edge).image
        np.testing.assert_array_equal(twice[1:4, 5:], once[1:4, 5:])


def test_the_result_is_a_copy(rng):
    image = rng.random((4, 5))
    before = image.copy()
    shifted(image, (0, 0), (4, 5), Edge.CLAMP).image[:] = -1.0
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("scale", [1.0, -3.0])
@pytest.mark.parametrize("name", TURNS)
def test_turns_and_flips_are_numpy_s(rng, name, scale):
    matrix, turned = TURNS[name]
    image = rng.random((4, 5, 3))
    expected = turned(image)
    found = moved(
        image, whole_move(scale * np.array(matrix, float)), expected.shape[:2], Edge.TRANSPARENT
    )
    np.testing.assert_array_equal(found.image, expected)
    np.testing.assert_array_equal(found.coverage, np.ones(expected.shape[:2]))


@pytest.mark.parametrize("edge", PADDINGS)
@pytest.mark.parametrize("name", TURNS)
def test_what_continues_a_source_is_turned_with_it(rng, name, edge):
    matrix, turned = TURNS[name]
    image = rng.random((4, 5, 3))
    whole = turned(np.pad(image, ((9, 9), (9, 9), (0, 0)), mode=PADDINGS[edge]))
    further = shift(9, 9) @ np.array(matrix, float)
    found = moved(image, whole_move(further), whole.shape[:2], edge)
    np.testing.assert_array_equal(found.image, whole)


@pytest.mark.parametrize("name", TURNS)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_warp_turns_value_for_value(rng, name, kind):
    matrix, turned = TURNS[name]
    image = (rng.random((4, 5, 4)) * 200).astype(kind)
    expected = turned(image)
    found = warp(image, matrix, expected.shape[:2])
    assert found.image.dtype == kind
    np.testing.assert_array_equal(found.image, expected)
