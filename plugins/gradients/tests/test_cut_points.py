"""Points of pixels that the edges of a transparent source cut, as plain Python."""

import numpy as np
import pytest

from resample_gradients.kernels.points import cut_at_edges, sides, slopes_of_cut
from resample_texture.texels.kernels.splats import _clip

SIZE = 5.0
cut, slopes = cut_at_edges.__wrapped__, slopes_of_cut.__wrapped__


@pytest.mark.parametrize(
    ("place", "before", "after", "expected"),
    [
        (2.0, 0.5, 1.0, (2.0, 1.0)),  # inside
        (0.25, 1.0, 0.75, (4.0 / 7.0, 4.0 / 7.0)),  # left from 0 to 1
        (4.5, 0.5, 1.5, (4.25, 0.5)),  # left from 4 to 5, of which the point is at a quarter
        (-1.0, 0.5, 1.0, (0.0, 0.0)),  # its box ends at the edge
        (6.0, 1.0, 0.5, (SIZE, 0.0)),  # its box begins at the edge
        (2.0, 9.0, 9.0, (2.5, 5.0 / 18.0)),  # all of the source
        (0.0, 0.0, 0.0, (0.0, 1.0)),  # no box: on the edge is inside
        (SIZE, 0.0, 0.0, (SIZE, 1.0)),
        (-1e-3, 0.0, 0.0, (-1e-3, 0.0)),
    ],
)
def test_a_box_is_clipped_and_the_point_divides_what_is_left_alike(place, before, after, expected):
    assert cut(place, before, after, SIZE) == pytest.approx(expected)


@pytest.mark.parametrize("place", [0.3, 2.0, 4.6, -0.4, 5.2])
def test_slopes_of_a_cut_are_its_differences(rng, place):
    before, after = rng.uniform(0.6, 1.5, 2)
    at, step = np.array([place, before, after]), 1e-6
    found = np.array(slopes(*at, SIZE)).reshape(2, 3)
    for n in range(3):
        low, high = (np.array(cut(*(at + d * np.eye(3)[n]), SIZE)) for d in (-step, step))
        np.testing.assert_allclose(found[:, n], (high - low) / (2 * step), atol=1e-6)


@pytest.mark.parametrize(("place", "before", "after"), [(-1.0, 0.5, 1.0), (6.0, 1.0, 0.5)])
def test_a_box_that_touches_the_source_from_outside_does_not_change(place, before, after):
    assert slopes(place, before, after, SIZE) == (0.0,) * 6


def test_a_point_without_a_box_moves_as_its_place_does():
    assert slopes(2.0, 0.0, 0.0, SIZE) == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_side_that_grows_with_a_step_depends_on_the_step_s_direction(sign):
    class Node:
        left, right, above, below = 1.0, 2.0, 3.0, 4.0

    wide, narrow = (2.0, -1.0) if sign > 0 else (-1.0, 2.0)
    assert sides.__wrapped__(0.5, 0.0, Node, sign)[0] == sign * wide
    assert sides.__wrapped__(-0.5, 0.0, Node, sign)[0] == sign * narrow
    assert sides.__wrapped__(0.0, -0.5, Node, sign)[1] == sign * (-3.0 if sign > 0 else 4.0)


@pytest.mark.parametrize(
    ("box", "bounds"),
    [
        ((2.3, 3.7, 4.2, 5.1), (2, 3, 5, 6)), ((-9.0, -0.5, 99.0, 3.0), (-2, -1, 12, 3)),
        ((2.0, 3.0, 2.0, 5.0), None), ((2.0, 3.0, 5.0, 3.0), None), ((13.0, 0.0, 15.0, 3.0), None),
        ((2.0, 3.0, 2.1, 3.1), (2, 3, 3, 4)),
    ],
)  # fmt: skip
def test_a_splat_touches_whole_pixels_of_the_frame_and_its_margin(box, bounds):
    found = np.zeros(4, np.int64)
    assert _clip.__wrapped__(np.array(box), (8, 10), 2, found) is (bounds is not None)
    if bounds is not None:
        assert tuple(found) == bounds
