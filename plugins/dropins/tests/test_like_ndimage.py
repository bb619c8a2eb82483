import numpy as np
import pytest
import scipy.ndimage as scipy_ndimage

from resample_dropins import ndimage

MATRIX = np.array([[0.3317, -0.0213], [0.0319, 0.3127]])  # no center lies between two texels
OFFSET = (-1.3719, -2.1331)
SHAPE = (40, 50)
MODES = ["nearest", "reflect", "mirror", "grid-wrap", "grid-mirror"]
SAME = {0: 1e-6, 1: 0.01, 3: 0.01}  # means over a third of a texel, not values at centers


def smooth(dtype="float64", height=16, width=18):
    v, u = np.mgrid[:height, :width] * (2 * np.pi / np.array([height, width])[:, None, None])
    share = 0.5 + 0.2 * np.sin(u) + 0.1 * np.cos(v)
    return share.astype(dtype) if np.dtype(dtype).kind == "f" else (200 * share - 90).astype(dtype)


@pytest.mark.parametrize("order", SAME)
@pytest.mark.parametrize("mode", MODES)
def test_an_affine_matrix_is_scipy_s(mode, order):
    image = smooth()
    choices = {"offset": OFFSET, "output_shape": SHAPE, "order": order, "mode": mode}
    ours = ndimage.affine_transform(image, MATRIX, **choices)
    theirs = scipy_ndimage.affine_transform(image, MATRIX, **choices)
    assert ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours, theirs, atol=SAME[order])


@pytest.mark.parametrize("order", SAME)
@pytest.mark.parametrize("mode", MODES)
def test_coordinates_are_scipy_s(mode, order):
    image = smooth()
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    places = np.stack([rows * 0.331 - 1.373 + 0.013 * columns, columns * 0.317 - 2.131])
    ours = ndimage.map_coordinates(image, places, order=order, mode=mode)
    theirs = scipy_ndimage.map_coordinates(image, places, order=order, mode=mode)
    np.testing.assert_allclose(ours, theirs, atol=SAME[order])


@pytest.mark.parametrize("order", [0, 1])
def test_beyond_a_constant_edge_there_is_its_value(order):
    image = smooth()
    choices = {"offset": OFFSET, "output_shape": SHAPE, "order": order, "cval": 7.0}
    ours = ndimage.affine_transform(image, MATRIX, mode="constant", **choices)
    theirs = scipy_ndimage.affine_transform(image, MATRIX, mode="grid-constant", **choices)
    ones = scipy_ndimage.affine_transform(
        np.pad(np.ones((12, 14)), 2), MATRIX, OFFSET, SHAPE, order=1
    )
    np.testing.assert_allclose(ours[ones == 1], theirs[ones == 1], atol=SAME[order])
    away = theirs == 7.0
    assert (ours[away] == 7.0).mean() > 0.95


@pytest.mark.parametrize(
    "matrix", [[0.5, 0.25], np.diag([0.5, 0.25]), [[0.5, 0, 3], [0, 0.25, 2]], np.eye(3)]
)
@pytest.mark.parametrize("dtype", ["int16", "int64", "float32"])
def test_all_forms_of_a_matrix_are_taken(matrix, dtype):
    image = smooth(dtype)
    ours = ndimage.affine_transform(image, matrix, output_shape=(20, 30), order=1, mode="nearest")
    theirs = scipy_ndimage.affine_transform(
        image, matrix, output_shape=(20, 30), order=1, mode="nearest"
    )
    assert ours.dtype == theirs.dtype
    scale = 1.0 if dtype == "float32" else 200.0
    np.testing.assert_allclose(ours, theirs, atol=0.02 * scale)


def test_the_result_s_type_or_array_may_be_given():
    image = smooth("int16")
    floats = ndimage.affine_transform(image, [0.5, 0.5], output=np.float64)
    assert floats.dtype == np.float64
    assert (floats != np.rint(floats)).any()
    out = np.zeros((20, 30), np.int32)
    assert ndimage.affine_transform(image, [0.5, 0.5], output=out, mode="nearest") is out
    whole = ndimage.affine_transform(
        image, [0.5, 0.5], output=np.float64, output_shape=(20, 30), mode="nearest"
    )
    np.testing.assert_allclose(out, whole, atol=0.5001)


def test_labels_and_gaps_are_kept():
    labels = np.arange(20, dtype=np.int64).reshape(4, 5) + 2**60
    ours = ndimage.affine_transform(labels, [0.5, 0.5], output_shape=(8, 10), order=0)
    assert np.isin(ours[ours > 0], labels).all()
    image = np.ones((8, 8))
    image[2:4, 2:4] = np.nan
    ours = ndimage.affine_transform(image, [0.25, 0.25], output_shape=(32, 32), mode="nearest")
    assert np.isnan(ours).any()
    np.testing.assert_allclose(ours[np.isfinite(ours)], 1.0, rtol=1e-5)


MASKED = {"input": np.ma.MaskedArray(smooth())}  # what SciPy does not take


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"order": 6}, "order 6; known: 0 to 5"),
        ({"mode": "around"}, "mode 'around'; known: constant"),
        ({"prefilter": False, **MASKED}, "give values instead"),
        ({"matrix": np.ones(3)}, r"a matrix is \(2,\), \(2, 2\)"),
        ({"matrix": [[1, 0, 0], [0, 1, 0], [0, 1, 1]]}, "ends with 0, 0, 1"),
        ({"matrix": np.zeros((2, 2)), **MASKED}, "no inverse"),
        (
            {"input": np.ma.zeros(3), "output_shape": (2, 3)},
            r"a picture has the shape \(height, width\) here",
        ),
        ({"output": np.zeros((3, 4, 5)), **MASKED}, "is not height and width"),
    ],
)
def test_what_cannot_be_done_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        ndimage.affine_transform(**{"input": smooth(), "matrix": MATRIX, **given})


def test_places_of_more_than_two_numbers_are_refused():
    with pytest.raises(ValueError, match=r"coordinates have the shape \(2, height, width\)"):
        ndimage.map_coordinates(smooth(), np.zeros((3, 7)))
