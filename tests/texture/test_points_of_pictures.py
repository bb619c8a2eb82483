"""Points that go with a picture; maps and transforms as other libraries have them."""

import cv2
import numpy as np
import pytest

from resample_texture import BackwardMap, ForwardMap, Homography, warp, warp_points

TURN = np.array([[0.8, -0.2, 10], [0.2, 0.9, 3], [1e-3, 2e-3, 1]])
SHAPE = (48, 64)


class Projective:
    """A transform as `skimage.transform.ProjectiveTransform` is: pixel centers at integers."""

    def __init__(self, params):
        self.params = np.asarray(params)

    @property
    def inverse(self):
        return Projective(np.linalg.inv(self.params))

    def __call__(self, coords):
        return cv2.perspectiveTransform(np.asarray(coords, float)[None], self.params)[0]


class Bent:
    """A transform without a matrix, as `PiecewiseAffineTransform` is."""

    def __call__(self, coords):
        x, y = np.asarray(coords, float).T
        return np.stack([x + 3 * np.sin(y / 9), 1.1 * y + 2], axis=1)

    @property
    def inverse(self):
        def back(coords):
            x, y = np.asarray(coords, float).T
            y = (y - 2) / 1.1
            return np.stack([x - 3 * np.sin(y / 9), y], axis=1)

        return back


class OneWay:
    """A transform whose inverse is not known, as that of `PolynomialTransform`."""

    def __call__(self, coords):
        return np.asarray(coords) + 2.0

    @property
    def inverse(self):
        raise NotImplementedError


@pytest.fixture
def points():
    return np.random.default_rng(7).uniform(4, 40, (20, 2))


@pytest.mark.parametrize("convention", ["corner", "opencv"])
@pytest.mark.parametrize("inverse", [False, True])
def test_points_by_a_matrix_are_opencv_s(points, convention, inverse):
    found = warp_points(points, TURN, convention=convention, inverse=inverse)
    matrix = np.linalg.inv(TURN) if inverse else TURN
    np.testing.assert_allclose(found, cv2.perspectiveTransform(points[None], matrix)[0], rtol=1e-12)
    affine = warp_points(points, TURN[:2])
    np.testing.assert_allclose(affine, cv2.transform(points[None], TURN[:2])[0], rtol=1e-12)


def test_points_keep_their_shape():
    assert warp_points([3, 4], np.eye(3)).tolist() == [3.0, 4.0]
    assert warp_points(np.zeros((2, 5, 2)), np.eye(3)).shape == (2, 5, 2)
    assert warp_points(np.zeros((0, 2)), np.eye(3)).shape == (0, 2)


def test_points_behind_the_camera_are_nowhere():
    front = Homography([[1, 0, 0], [0, 1, 0], [-0.1, 0, 1]], is_signed=True)
    found = warp_points([[5, 5], [15, 5], [10, 5]], front)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [False, True, True])


def test_a_mark_goes_where_its_picture_goes():
    y, x = np.indices(SHAPE) + 0.5
    image = np.exp(-((x - 30.5) ** 2 + (y - 20.5) ** 2) / 18)
    warped = np.nan_to_num(warp(image, TURN[:2], SHAPE).image)
    middle = [(warped * x).sum(), (warped * y).sum()] / warped.sum()
    np.testing.assert_allclose(warp_points([30.5, 20.5], TURN[:2]), middle, atol=0.01)


def bent_maps():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    return x + 3 * np.sin(y / 9), 1.1 * y + 2


@pytest.mark.parametrize("kind", [BackwardMap, ForwardMap])
def test_points_by_a_map_go_along_it_and_back(points, kind):
    given = kind(*bent_maps())
    along = np.stack([points[:, 0] + 3 * np.sin(points[:, 1] / 9), 1.1 * points[:, 1] + 2], axis=1)
    is_backward = kind is BackwardMap
    np.testing.assert_allclose(warp_points(points, given, inverse=is_backward), along, atol=2e-3)
    back = warp_points(along, given, inverse=not is_backward)
    np.testing.assert_allclose(back, points, atol=2e-3)


def test_points_that_a_map_does_not_have_are_nowhere():
    given = BackwardMap(*bent_maps())
    assert np.isnan(warp_points([[300, 300], [np.nan, 1]], given)).all()
    assert np.isnan(warp_points([[-1, 5], [64.5, 5], [5, 49]], given, inverse=True)).all()
    empty = BackwardMap(np.full(SHAPE, np.nan), np.full(SHAPE, np.nan))
    assert np.isnan(warp_points([5, 5], empty)).all()
    assert np.isnan(warp_points([5, 5], empty, inverse=True)).all()


@pytest.mark.parametrize("convention", ["corner", "opencv"])
def test_points_by_a_pair_of_maps_or_a_transform_count_as_they_are_told(points, convention):
    shift = 0.5 if convention == "corner" else 0.0
    x, y = (each - 0.5 for each in bent_maps())
    back = warp_points(points, (x, y), convention=convention, inverse=True)
    own = warp_points(points + 0.5 - shift, BackwardMap.from_opencv(x, y), inverse=True)
    np.testing.assert_allclose(back, own - 0.5 + shift, atol=1e-9)
    for transform in (Projective(TURN), Bent()):
        expected = transform(points - shift) + shift
        given = {"convention": convention}
        np.testing.assert_allclose(warp_points(points, transform, **given), expected, atol=1e-9)
        again = warp_points(expected, transform, inverse=True, **given)
        np.testing.assert_allclose(again, points, atol=1e-9)


def test_a_function_leads_back():
    np.testing.assert_array_equal(
        warp_points([3, 4], lambda x, y: (y, 2 * x), inverse=True), [4, 6]
    )
    with pytest.raises(ValueError, match="give inverse=True"):
        warp_points([3, 4], lambda x, y: (y, x))


@pytest.mark.parametrize("given", [5, [1, 2, 3], [["a", "b"]], np.zeros((2, 3))])
def test_points_are_pairs(given):
    with pytest.raises((ValueError, TypeError), match="points"):
        warp_points(given, np.eye(3))


@pytest.fixture
def picture():
    noise = np.random.default_rng(7).random((12, 16)).astype(np.float32)
    return cv2.resize(noise, SHAPE[::-1], interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("fixed", [False, True])
def test_maps_are_taken_as_remap_takes_them(picture, fixed):
    y, x = np.indices((40, 50), np.float32)
    maps = x * 0.9 + 3.25, y * 0.8 + 2.5
    given = cv2.convertMaps(*maps, cv2.CV_16SC2) if fixed else maps
    expected = cv2.remap(picture, *maps, cv2.INTER_LINEAR)
    for pair in (given, (np.dstack(maps), None)):
        found = warp(picture, pair, (40, 50), interpolation="bilinear")
        np.testing.assert_allclose(found.image, expected, atol=0.03)  # the mean over a pixel
    same = warp(picture, BackwardMap.from_opencv(*given), (40, 50))
    np.testing.assert_array_equal(warp(picture, given, (40, 50)).image, same.image)


def test_maps_lead_back_and_fit_the_target(picture):
    maps = tuple(np.zeros((2, 8, 9)))
    with pytest.raises(ValueError, match="always maps target to source"):
        warp(picture, maps, (8, 9), inverse=True)
    with pytest.raises(ValueError, match="does not fit a target"):
        warp(picture, maps, (8, 8))
    assert warp(picture, tuple(np.zeros((2, 2, 3))), (2, 3)).image.shape == (2, 3)
    assert warp(picture, (np.eye(3), np.eye(3)), SHAPE).image.shape == (2, *SHAPE)
    assert warp(picture, ((1, 0, 0), (0, 1, 0)), SHAPE).image.shape == SHAPE


@pytest.mark.parametrize("inverse", [False, True])
def test_transforms_of_scikit_image_are_from_source_to_target(picture, inverse):
    transform = Projective(TURN)
    given = transform.inverse if inverse else transform
    found = warp(picture, given, SHAPE, inverse=inverse).image
    expected = warp(picture, TURN, SHAPE, convention="opencv").image
    np.testing.assert_allclose(found, expected, atol=1e-6, equal_nan=True)


def test_transforms_without_a_matrix_are_maps(picture):
    y, x = np.indices(SHAPE, np.float64)
    places = Bent().inverse(np.stack([x.ravel(), y.ravel()], axis=1))
    expected = warp(picture, tuple(places.T.reshape(2, *SHAPE)), SHAPE)
    np.testing.assert_array_equal(warp(picture, Bent(), SHAPE).image, expected.image)
    forth = warp(picture, Bent(), SHAPE, inverse=True)
    pairs = Bent()(np.stack([x.ravel(), y.ravel()], axis=1)).T.reshape(2, *SHAPE)
    np.testing.assert_array_equal(forth.image, warp(picture, tuple(pairs), SHAPE).image)


def test_a_transform_without_an_inverse_is_told_of(picture):
    with pytest.raises(ValueError, match="OneWay knows no inverse; estimate it from target to"):
        warp(picture, OneWay(), SHAPE)
    moved = warp(picture, OneWay(), SHAPE, inverse=True)
    np.testing.assert_array_equal(moved.image[:-2, :-2], picture[2:, 2:])
