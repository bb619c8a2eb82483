import cv2
import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from resample_sky import control_points
from resample_texture import Homography
from resample_texture.geometry.mappings import source_coordinates

SHAPE = (60, 80)
TURNED = Homography([[0.9, -0.2, 12.0], [0.25, 1.1, -3.0], [4e-4, -2e-4, 1.0]])


def scattered(rng, count=12, shape=SHAPE):
    """Pixel centers, all different."""
    places = rng.choice(shape[0] * shape[1], count, replace=False)
    return np.stack([places % shape[1] + 0.5, places // shape[1] + 0.5], axis=1)


def at(bent, points):
    column, row = (points - 0.5).astype(int).T
    return np.stack([bent.x[row, column], bent.y[row, column]], axis=1)


def mapped(points, matrix=TURNED.matrix):
    places = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return places[:, :2] / places[:, 2:]


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_a_thin_plate_passes_through_its_points(rng):
    after = scattered(rng)
    before = after + rng.normal(0.0, 5.0, after.shape)
    bent = control_points(before, after, SHAPE)
    np.testing.assert_allclose(at(bent, after), before, rtol=0, atol=1e-9)


def test_a_thin_plate_is_that_of_scipy_to_a_hundredth_of_a_pixel(rng, record):
    after = rng.random((9, 2)) * SHAPE[::-1]
    before = after + rng.normal(0.0, 6.0, after.shape)
    bent = control_points(before, after, SHAPE)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    plate = RBFInterpolator(after, before, kernel="thin_plate_spline")
    truth = plate(np.column_stack([x.ravel(), y.ravel()])).T.reshape(2, *SHAPE)
    record.error("largest, px", np.hypot(bent.x - truth[0], bent.y - truth[1]).max())


def test_a_thin_plate_of_an_affine_map_is_that_map(rng):
    after = scattered(rng)
    bent = control_points(after @ [[0.9, 0.1], [-0.2, 1.2]] + [3, 4], after, SHAPE)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    np.testing.assert_allclose(bent.x, 0.9 * x - 0.2 * y + 3, rtol=0, atol=1e-8)


def test_a_smoothed_thin_plate_misses_points(rng):
    after = scattered(rng)
    before = after + rng.normal(0.0, 5.0, after.shape)
    bent = control_points(before, after, SHAPE, smoothing=1e4)
    assert np.abs(at(bent, after) - before).max() > 1.0


@pytest.mark.parametrize("count", [4, 20])
def test_a_projective_map_is_found_again(rng, count):
    before = scattered(rng, count)
    found = control_points(before, mapped(before), SHAPE, "projective")
    np.testing.assert_allclose(mapped(before, found.matrix), mapped(before), rtol=0, atol=1e-7)


def test_a_projective_map_of_many_points_is_opencvs(rng):
    before = scattered(rng, 20)
    after = mapped(before) + rng.normal(0.0, 0.5, before.shape)
    found = control_points(before, after, SHAPE, "projective").matrix
    theirs, _ = cv2.findHomography(before, after, 0)
    missed = [np.sum((mapped(before, m) - after) ** 2) for m in (found, theirs)]
    assert missed[0] <= missed[1] * (1 + 1e-6)


def test_an_affine_map_is_that_of_least_squares(rng):
    before = scattered(rng)
    after = before @ [[1.1, 0.3], [-0.2, 0.9]] + [5, -7] + rng.normal(0.0, 0.5, before.shape)
    truth = np.linalg.lstsq(np.column_stack([before, np.ones(12)]), after, rcond=None)[0].T
    found = control_points(before, after, SHAPE, "affine").matrix
    np.testing.assert_allclose(found[:2], truth, rtol=0, atol=1e-9)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_polynomial_is_found_again(rng, degree):
    def truth(x, y):
        return x + 2 + 1e-3 * (x * y) ** (degree / 2 if degree == 2 else 0), y - 1e-4 * x**degree

    after = scattered(rng, 20)
    before = np.stack(truth(*after.T), axis=1)
    bent = control_points(before, after, SHAPE, f"polynomial:degree={degree}")
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    np.testing.assert_allclose([bent.x, bent.y], truth(x, y), rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("thin", "known: thin-plate, affine"),
        ("polynomial:degree=0", "degree is 1 to 9, not '0'"),
        ("polynomial:degree=3", "needs 10 points or more, not 5"),
        ("affine:degree=2", "known"),
    ],
)
def test_kinds_that_are_none_are_refused(rng, kind, message):
    points = scattered(rng, 5)
    with pytest.raises(ValueError, match=message):
        control_points(points, points, SHAPE, kind)


@pytest.mark.parametrize("kind", ["thin-plate", "affine", "projective", "polynomial:degree=1"])
def test_points_on_a_line_are_refused(kind):
    line = np.arange(10.0)[:, None] * [1.0, 2.0]
    with pytest.raises(ValueError, match="line"):
        control_points(line, line, SHAPE, kind)


def test_points_that_coincide_need_smoothing():
    points = np.array([[0, 0], [9, 0], [0, 9], [9, 0]], float)
    with pytest.raises(ValueError, match="two target points coincide"):
        control_points(points, points, SHAPE)


def test_all_forms_show_the_same_affine_warp(rng):
    before = scattered(rng)
    after = before @ [[0.9, 0.3], [-0.2, 1.0]] + [5, 7]
    kinds = ("thin-plate", "affine", "projective", "polynomial:degree=1")
    places = [
        np.stack(source_coordinates(control_points(before, after, SHAPE, kind), SHAPE))
        for kind in kinds
    ]
    for one in places[1:]:
        np.testing.assert_allclose(one, places[0], rtol=0, atol=1e-6)
