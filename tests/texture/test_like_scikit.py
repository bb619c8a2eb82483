"""`skimage.transform.warp` by its documentation; it was compared with version 0.26 by hand."""

import numpy as np
import pytest
import scipy.ndimage

from resample_texture.like import scikit

MATRIX = np.array([[0.3127, 0.0319, -2.1331], [-0.0213, 0.3317, -1.3719], [4e-4, 3e-4, 1.0]])
SHAPE = (40, 50)
MODES = {"edge": "nearest", "symmetric": "reflect", "reflect": "mirror", "wrap": "grid-wrap"}
SAME = {0: 1e-6, 1: 0.01, 3: 0.01}  # means over a third of a texel, not values at centers


def smooth(channels=None, height=16, width=18):
    v, u = np.mgrid[:height, :width] * (2 * np.pi / np.array([height, width])[:, None, None])
    planes = [0.5 + 0.2 * np.sin(u + c) + 0.1 * np.cos(v) for c in range(channels or 1)]
    return np.stack(planes, axis=2) if channels else planes[0]


def places(shape=SHAPE):
    """Rows and columns (2, h, w) that the matrix leads to."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    u, v, w = np.tensordot(MATRIX, np.stack([x, y, np.ones_like(x)]), 1)
    return np.stack([v / w, u / w])


def turned(points, factor=1.0):
    """Places (M, 2), column and row, that the matrix leads to."""
    u, v, w = MATRIX @ np.column_stack([points, np.ones(len(points))]).T
    return factor * np.column_stack([u / w, v / w])


class Transform:
    """What scikit-image's transforms have."""

    params = MATRIX

    def __call__(self, points):
        return turned(points)


@pytest.mark.parametrize("order", SAME)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "inverse_map", [MATRIX, Transform(), turned, places()], ids=["matrix", "object", "f", "places"]
)
def test_all_forms_of_an_inverse_map_are_taken(inverse_map, mode, order):
    image = smooth()
    ours = scikit.warp(image, inverse_map, output_shape=SHAPE, order=order, mode=mode)
    theirs = scipy.ndimage.map_coordinates(image, places(), order=order, mode=MODES[mode])
    np.testing.assert_allclose(ours, theirs, atol=SAME[order])


def test_channels_are_warped_alike_and_arguments_are_handed_on():
    image = smooth(3)
    ours = scikit.warp(image, turned, {"factor": 0.5}, SHAPE, mode="edge")
    for c in range(3):
        theirs = scipy.ndimage.map_coordinates(
            image[..., c], 0.5 * places(), order=1, mode="nearest"
        )
        np.testing.assert_allclose(ours[..., c], theirs, atol=0.01)


@pytest.mark.parametrize(
    ("dtype", "largest"), [("uint8", 255), ("uint16", 65535), ("int16", 32767), ("bool", 1)]
)
def test_integers_become_floats_of_zero_to_one(dtype, largest):
    image = (smooth() * largest).astype(dtype)
    choices = {"output_shape": SHAPE, "mode": "edge"}
    shares = scikit.warp(image, MATRIX, order=1, **choices)
    expected = scikit.warp(image / largest, MATRIX, order=1, **choices)
    assert shares.dtype == np.float64
    np.testing.assert_allclose(shares, expected, atol=1e-6)
    values = scikit.warp(image, MATRIX, order=1, preserve_range=True, **choices)
    np.testing.assert_allclose(values, expected * largest, atol=1e-6 * largest)
    copied = scikit.warp(image, MATRIX, order=0, **choices)
    assert copied.dtype == image.dtype


def test_booleans_are_copied_by_default():
    image = smooth() > 0.5
    ours = scikit.warp(image, MATRIX, output_shape=SHAPE)
    assert ours.dtype == np.bool_


def test_the_default_is_of_the_image_s_size_and_black_around():
    image = smooth()
    ours = scikit.warp(image, np.array([[1, 0, 5], [0, 1, 0], [0, 0, 1.0]]), cval=0.25)
    np.testing.assert_allclose(ours[:, :-5], image[:, 5:])
    np.testing.assert_array_equal(ours[:, -5:], 0.25)


def test_values_are_clipped_unless_they_are_not():
    image = np.zeros((12, 12))
    image[:, 6:] = 1.0
    matrix = np.diag([0.3, 0.3, 1.0])
    choices = {"output_shape": (40, 40), "order": 3, "mode": "edge"}
    clipped = scikit.warp(image, matrix, **choices)
    assert clipped.min() >= 0.0
    assert clipped.max() <= 1.0
    assert scikit.warp(image, matrix, clip=False, **choices).max() > 1.01
    assert scikit.warp(image, matrix, **{**choices, "mode": "constant"}, cval=3.0).max() <= 3.0


def test_gaps_and_masks_are_kept():
    image = np.ones((8, 8))
    image[2:4, 2:4] = np.nan
    ours = scikit.warp(image, np.diag([0.25, 0.25, 1.0]), output_shape=(32, 32), order=3)
    assert np.isnan(ours).any()
    mask = np.ma.MaskedArray(np.ones((8, 8), np.uint8), np.isnan(image))
    ours = scikit.warp(mask, np.diag([0.25, 0.25, 1.0]), output_shape=(32, 32), order=1)
    assert isinstance(ours, np.ma.MaskedArray)
    assert ours.mask.any()
    np.testing.assert_allclose(ours[2:-4, 2:-4].compressed(), 1 / 255)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"order": 7}, "order 7; known: 0 to 5"),
        ({"mode": "mirror"}, "mode 'mirror'; known: constant, edge"),
        ({"inverse_map": np.eye(2)}, r"a \(3, 3\) matrix or places \(2, 16, 18\), not \(2, 2\)"),
        ({"inverse_map": lambda points: points[:5]}, r"the inverse map returned \(5, 2\) for"),
        ({"output_shape": (5,)}, "is no height and width"),
    ],
)
def test_what_cannot_be_done_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        scikit.warp(**{"image": smooth(), "inverse_map": MATRIX, **given})
