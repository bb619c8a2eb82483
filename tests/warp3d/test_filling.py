import numpy as np
import pytest

from resample_warp3d.sheet.filling import fill, hole_outline
from resample_warp3d.types import Hole, Warped

BACK, FRONT = (0.1, 0.4, 0.2), (9.0, 0.0, 0.0)


def warped(image: np.ndarray, depth: np.ndarray) -> Warped:
    """A picture without holes yet."""
    whole = np.ones(depth.shape, np.float32)
    holes = np.zeros(depth.shape, np.uint8)
    return Warped(image.copy(), whole.copy(), depth.copy(), holes, whole.copy(), whole.copy())


def punch(given: Warped, where: tuple[slice, slice], kind: Hole) -> None:
    """Make a hole."""
    given.image[where] = given.coverage[where] = given.magnification[where] = 0
    given.confidence[where] = 0
    given.depth[where] = np.inf
    given.holes[where] = kind


def scene() -> Warped:
    """A bright box at 2 before a wall at 8; what it uncovered, left of it, is a hole."""
    image = np.full((48, 64, 3), BACK, np.float32)
    depth = np.full((48, 64), 8, np.float32)
    image[12:36, 24:44], depth[12:36, 24:44] = FRONT, 2
    given = warped(image, depth)
    punch(given, np.s_[12:36, 16:24], Hole.DISOCCLUDED)
    return given


def test_what_was_uncovered_is_filled_from_the_far_side_alone():
    filled = fill(scene())
    assert np.allclose(filled.image[12:36, 16:24], BACK, atol=1e-4)  # OpenCV's float32 sums
    assert np.allclose(filled.depth[12:36, 16:24], 8, rtol=1e-4)


def test_what_was_known_stays():
    given, filled = scene(), fill(scene())
    known = given.coverage == 1
    assert np.array_equal(filled.image[known], given.image[known])
    assert np.array_equal(filled.depth[known], given.depth[known])
    assert (filled.coverage == 1).all()


def test_how_it_came_about_stays_on_record():
    given, filled = scene(), fill(scene())
    assert np.array_equal(filled.holes, given.holes)
    assert np.array_equal(filled.confidence, given.confidence)
    assert np.array_equal(filled.magnification, given.magnification)


def test_a_pixel_that_is_covered_in_part_gets_the_background_behind_it():
    given = scene()
    given.image[12:36, 24] *= 0.25
    given.coverage[12:36, 24] = 0.25
    filled = fill(given)
    assert np.allclose(filled.image[20, 24], np.multiply(FRONT, 0.25) + np.multiply(BACK, 0.75))
    assert filled.depth[20, 24] == 2


def test_what_is_nearly_covered_keeps_its_own_color():
    given = scene()
    given.image[40, 40] *= 0.97
    given.coverage[40, 40] = 0.97
    assert np.allclose(fill(given).image[40, 40], BACK)


@pytest.mark.parametrize("kind", [Hole.OUTSIDE, Hole.NO_DEPTH])
def test_other_holes_are_filled_from_all_sides(kind):
    given = scene()
    given.holes[given.holes == Hole.DISOCCLUDED] = kind
    assert fill(given).image[24, 23, 0] > 1


def test_beyond_the_sources_frame_its_rim_goes_on():
    given = warped(np.full((8, 9, 1), 0.5, np.float32), np.full((8, 9), 3, np.float32))
    punch(given, np.s_[:, 6:], Hole.OUTSIDE)
    filled = fill(given)
    assert np.allclose(filled.image, 0.5, atol=1e-4)
    assert np.allclose(filled.depth, 3, rtol=1e-4)


def test_values_of_any_range_stay_within_those_around(rng):
    given = scene()
    given.image[:] = rng.normal(0, 1e-3, given.image.shape) * (given.coverage[..., None] > 0)
    filled = fill(given)
    assert filled.image.min() >= given.image.min()
    assert filled.image.max() <= given.image.max()


def test_a_sloping_floor_has_no_near_side():
    depth = np.repeat(np.linspace(8, 4, 48, dtype=np.float32)[:, None], 64, axis=1)
    given = warped(np.ones((48, 64, 3), np.float32), depth)
    punch(given, np.s_[24, 20:40], Hole.DISOCCLUDED)
    _, hidden = hole_outline(given.coverage, 1 / given.depth, given.holes)
    assert not hidden.any()


def test_nothing_is_done_without_holes_or_without_anything_else():
    whole, empty = scene(), scene()
    whole = whole._replace(coverage=np.ones_like(whole.coverage))
    assert fill(whole) is whole
    punch(empty, np.s_[:, :], Hole.OUTSIDE)
    assert fill(empty) is empty
