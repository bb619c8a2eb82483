"""Calls of `skimage.transform` by its documentation; version 0.26 was compared by hand."""

import numpy as np
import pytest
import scipy.ndimage

from resample_dropins import scikit

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
        ({"inverse_map": lambda points: points[:5]}, r"the map of points returned \(5, 2\) for"),
        ({"output_shape": (5,)}, "is not height and width"),
    ],
)
def test_what_cannot_be_done_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        scikit.warp(**{"image": smooth(), "inverse_map": MATRIX, **given})


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("mode", ["edge", "symmetric", "reflect"])
def test_enlarging_is_scipy_s_zoom_of_areas(order, mode):
    image = smooth(height=12, width=14)
    ours = scikit.resize(image, (31, 35), order=order, mode=mode, clip=False)
    theirs = scipy.ndimage.zoom(
        image, (31 / 12, 35 / 14), order=order, mode=MODES[mode], grid_mode=True
    )
    np.testing.assert_allclose(ours, theirs, atol=2e-6)


def test_shrinking_is_the_mean_of_what_pixels_cover(record):
    image = np.random.default_rng(3).random((24, 36, 3))
    means = image.reshape(6, 4, 9, 4, 3).mean(axis=(1, 3))
    for ours in (scikit.resize(image, (6, 9, 3)), scikit.rescale(image, 0.25, channel_axis=-1)):
        np.testing.assert_allclose(ours, means, atol=0.12)
        record.error("mean", abs(ours.mean() - image.mean()))


def test_labels_are_copied_when_resized():
    labels = np.random.default_rng(4).integers(0, 9, (8, 10)).astype(np.uint8)
    ours = scikit.resize(labels, (16, 20), order=0, preserve_range=True, anti_aliasing=False)
    np.testing.assert_array_equal(ours, labels.repeat(2, 0).repeat(2, 1))
    assert ours.dtype == np.uint8
    np.testing.assert_array_equal(
        scikit.rescale(labels > 4, (2, 2)), (labels > 4).repeat(2, 0).repeat(2, 1)
    )


def test_quarters_of_a_turn_copy_texels_counterclockwise():
    image = np.random.default_rng(5).random((8, 11))
    for quarter in range(4):
        ours = scikit.rotate(image, 90 * quarter, resize=True)
        np.testing.assert_allclose(ours, np.rot90(image, quarter), atol=1e-9)
    about = scikit.rotate(image, 90, center=(3, 3))
    np.testing.assert_allclose(about[:7, :7], np.rot90(image[:7, :7]), atol=1e-9)
    assert scikit.rotate(image, 33).shape == (8, 11)


def test_turned_pictures_hold_all_corners():
    image = np.ones((9, 13), np.uint8)
    ours = scikit.rotate(image, 30, resize=True, preserve_range=True)
    turn = np.deg2rad(30)
    size = 8 * np.cos(turn) + 12 * np.sin(turn) + 1, 8 * np.sin(turn) + 12 * np.cos(turn) + 1
    assert ours.shape == tuple(np.around(size).astype(int))
    assert ours.sum() == pytest.approx(9 * 13, rel=0.02)


@pytest.mark.parametrize(
    ("call", "given", "message"),
    [
        (scikit.resize, {"output_shape": (4, 5, 6)}, "keep its channels"),
        (scikit.resize, {"output_shape": (0, 5)}, "a target of 5 × 0 px"),
        (scikit.resize, {"output_shape": (4, 5), "anti_aliasing": False}, "averaged over"),
        (scikit.resize, {"output_shape": (4, 5), "anti_aliasing_sigma": 2}, "averaged over"),
        (scikit.rescale, {"scale": 0.5}, "give channel_axis=-1"),
        (scikit.rescale, {"scale": 0.5, "channel_axis": 0}, "give channel_axis=-1"),
        (scikit.rotate, {"angle": 20, "mode": "mirror"}, "mode 'mirror'; known: constant"),
    ],
)
def test_resizing_and_turning_refuse_what_they_cannot_do(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(smooth(3), **given)
