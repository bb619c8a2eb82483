"""Section 3 of the paper: texture mapping by points, by splats and by both (Figure 5)."""

import cv2
import numpy as np
import pytest

from resample_comparisons.texture.opencv import InterLinear
from resample_texture import Edge, Homography
from resample_texture.methods.forward import Hybrid, Points, Splats, Supersample
from resample_texture.methods.paper import Paper

SOURCE = 160  # texels per side
SHAPE = (60, 120)  # px
# A floor seen from above: row 0 of the source is nearest to the eye, the last one farthest. Texels
# are 4 × 13 px in front and 0.3 × 0.08 px at the back.
STEP, WIDTH, RISE, SKY = 0.2, 4.0, 65.0, 2.5
FLOOR = Homography(
    [
        [WIDTH, 60.0 * STEP, 60.0 - WIDTH * SOURCE / 2],
        [0.0, -SKY * STEP, RISE - SKY],
        [0.0, STEP, 1.0],
    ]
)
FAR = np.s_[2:9, 52:68]  # px whose texels are shorter than one px
NEAR = np.s_[36:46, 30:90]  # px whose texels are longer than the 4 px that a point reaches across


def checkerboard(cell):
    side = np.arange(SOURCE) // cell
    return ((side[:, None] + side) % 2).astype(np.float32)[..., None]


def white():
    return np.ones((SOURCE, SOURCE, 1), np.float32)


def drawn(method, source):
    return method(source, FLOOR, SHAPE, Edge.TRANSPARENT)


def lengths(part):
    """Longest diagonal axis of the texels at pixels of a part of the frame."""
    y, x = (index[part] + 0.5 for index in np.indices(SHAPE))
    u, v, d = np.tensordot(FLOOR.inverse(), np.stack([x, y, np.ones_like(x)]), 1)
    matrix = FLOOR.matrix
    w = matrix[2, 0] * u / d + matrix[2, 1] * v / d + matrix[2, 2]
    columns = [
        [(matrix[k, n] - place * matrix[2, n]) / w for n in (0, 1)] for k, place in ((0, x), (1, y))
    ]
    jacobian = np.moveaxis(np.array(columns), (0, 1), (-2, -1))
    return np.linalg.norm(jacobian, 2, axis=(-2, -1))


def test_the_floor_shrinks_far_away_and_grows_nearby():
    assert lengths(FAR).max() < 1.0
    assert lengths(NEAR).min() > 4.0


def test_figure_5a_points_leave_holes_where_the_texture_grows():
    holes = drawn(Points(), white()).coverage[NEAR] == 0.0
    assert 0.05 < holes.mean() < 0.5


def test_figure_5a_points_leave_no_holes_where_the_texture_shrinks():
    warped = drawn(Points(), white())
    assert (warped.coverage[FAR] == 1.0).all()
    np.testing.assert_allclose(warped.image[FAR], 1.0, atol=1e-5)


@pytest.mark.parametrize("method", [Paper(), Splats(), Supersample(), Hybrid()], ids=repr)
def test_figure_5c_splats_or_parts_close_the_holes(method):
    warped = drawn(method, white())
    for part in (FAR, NEAR):
        assert (warped.coverage[part] == 1.0).all()
        np.testing.assert_allclose(warped.image[part], 1.0, atol=1e-5)


def test_the_hybrid_is_points_up_to_its_threshold():
    source = checkerboard(2)
    paper, points = (drawn(Paper(threshold), source).image for threshold in (1.0, 1e3))
    np.testing.assert_array_equal(paper[FAR], points[FAR])
    assert (paper[NEAR] != points[NEAR]).any()


def test_the_hybrid_is_splats_above_its_threshold():
    source = checkerboard(2)
    paper, splats = (drawn(Paper(threshold), source).image for threshold in (1.0, 1e-3))
    np.testing.assert_array_equal(paper[NEAR], splats[NEAR])
    assert (paper[FAR] != splats[FAR]).any()


@pytest.mark.some(1)
@pytest.mark.parametrize("cell", [3, 4, 5])
def test_bilinear_lookup_aliases_where_the_hybrid_does_not(cell):
    source = checkerboard(cell)
    # Means over pixels of 32 × 32 readings of the nearest texel
    fine = 32
    zoomed = np.diag([fine, fine, 1.0]) @ FLOOR.matrix
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    matrix = np.linalg.inv(half) @ zoomed @ half  # OpenCV counts from pixel centers
    size = SHAPE[1] * fine, SHAPE[0] * fine
    picture = cv2.warpPerspective(source[..., 0], matrix, size, flags=cv2.INTER_NEAREST)
    expected = picture.reshape(SHAPE[0], fine, SHAPE[1], fine).mean(axis=(1, 3))[FAR]
    errors = [
        np.sqrt(np.mean((drawn(method, source).image[..., 0][FAR] - expected) ** 2))
        for method in (InterLinear(), Paper(), Hybrid())
    ]
    assert errors[0] > 2 * errors[1]  # whose Gaussian is wider than the truth's box
    assert errors[0] > 8 * errors[2]


def test_splats_of_texels_are_blurred_where_they_grow():
    # Why they are not the default's: a white texel of 3 × 6 px is gray.
    source = np.zeros((SOURCE, SOURCE, 1), np.float32)
    source[2, 80] = 1.0
    peak = [drawn(method, source).image.max() for method in (Paper(), Hybrid())]
    assert peak[0] < 0.75  # a Gaussian of 0.45 texels holds 0.79 of its mass per texel² at most
    assert peak[1] > 0.9
