"""Complex pictures, and sums of pictures in chunks."""

import dask.array
import numpy as np
import pytest
from scipy import ndimage

from resample_chunks import warp_chunks
from resample_dropins import ndimage as like_ndimage
from resample_texture import BackwardMap, Plan, resize, warp

TURNED = [[0.9, -0.2, 5.0], [0.3, 0.8, 1.0], [1e-3, 0.0, 1.0]]
BENT = BackwardMap.from_function(lambda x, y: (1.1 * x + np.sin(y / 5), 1.2 * y), (30, 40))
SHAPE = (30, 40)
WAYS = {"matrix": TURNED, "map": BENT, "shift": [[1, 0, 2], [0, 1, 3]], "along": [2.0, 0.7]}


def way_of(name):
    way = WAYS[name]
    return np.diag([*way, 1.0]) if name == "along" else way


def phases(shape=(33, 35), dtype="complex64"):
    rng = np.random.default_rng(5)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(dtype)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("dtype", ["complex64", "complex128", ">c16"])
@pytest.mark.parametrize("channels", [(), (1,), (2,), (3,), (4,)])
def test_both_parts_of_a_complex_picture_are_warped(way, dtype, channels):
    image = phases((33, 35, *channels), dtype)
    found = warp(image, way_of(way), SHAPE)
    real, imaginary = (
        warp(np.ascontiguousarray(part), way_of(way), SHAPE, alpha="none")
        for part in (image.real, image.imag)
    )
    assert found.image.dtype == np.dtype(dtype).newbyteorder("=")
    assert found.image.shape == (*SHAPE, *channels)
    np.testing.assert_allclose(found.image.real, real.image, rtol=0, atol=2e-5)
    np.testing.assert_allclose(found.image.imag, imaginary.image, rtol=0, atol=2e-5)
    np.testing.assert_array_equal(found.coverage, real.coverage)


@pytest.mark.parametrize("way", WAYS)
def test_a_complex_value_without_one_part_is_missing(way):
    image = phases()
    image[10:15, 12:20] += np.nan * 1j
    whole = np.where(np.isnan(image), complex(np.nan, np.nan), image)
    found, truth = (warp(one, way_of(way), SHAPE).image for one in (image, whole))
    np.testing.assert_array_equal(found, truth)
    assert 0 < np.isnan(found).sum() < found.size
    np.testing.assert_array_equal(np.isnan(found.real), np.isnan(found.imag))


@pytest.mark.parametrize("way", WAYS)
def test_masked_complex_pictures_stay_masked(way):
    image = np.ma.MaskedArray(phases(), np.zeros((33, 35), np.bool_))
    image.mask[10:15, 12:20] = True
    found = warp(image, way_of(way), SHAPE).image
    plain = warp(image.filled(np.nan), way_of(way), SHAPE).image
    np.testing.assert_array_equal(found.mask, np.isnan(plain))
    np.testing.assert_array_equal(found.compressed(), plain[~found.mask])


@pytest.mark.parametrize("fill", [0.0, 3.0, 2 - 1j])
def test_a_complex_fill_stands_where_nothing_is(fill):
    plain, found = (warp(phases(), TURNED, SHAPE, fill=one) for one in (None, fill))
    np.testing.assert_array_equal(found.image, np.where(plain.coverage > 0, plain.image, fill))


def test_a_complex_value_may_stand_for_nothing():
    image = phases()
    image[3:6, 4:9] = 5 + 5j
    lost = np.where(image == 5 + 5j, complex(np.nan, np.nan), image)
    found, plain = warp(image, TURNED, SHAPE, nodata=5 + 5j).image, warp(lost, TURNED, SHAPE).image
    np.testing.assert_array_equal(found == 5 + 5j, np.isnan(plain))


def test_a_complex_fill_of_a_real_picture_is_refused():
    with pytest.raises(ValueError, match="give a real number"):
        warp(np.ones((4, 4)), TURNED, SHAPE, fill=1j)


def test_sums_of_complex_pictures_are_kept():
    image = phases((12, 12))
    found = warp(image, np.diag([0.37, 0.61, 1.0]), (12, 12), total=True).image
    np.testing.assert_allclose(found.sum(), image.sum(), rtol=0, atol=1e-4)


def test_plans_batches_and_sizes_take_complex_pictures():
    batch = phases((2, 33, 35))[..., None]
    whole = warp(batch, TURNED, SHAPE).image
    plan = Plan(TURNED, SHAPE, (33, 35))
    for made, image in zip(whole, batch, strict=True):
        np.testing.assert_array_equal(plan(image).image, made)
    assert resize(batch[0, ..., 0], (8, 9)).image.dtype == np.complex64


@pytest.mark.parametrize("way", ["matrix", "map"])
def test_complex_pictures_in_chunks_are_those_in_memory(way):
    image = phases((80, 80))
    made = np.zeros(SHAPE, np.complex64)
    warp_chunks(image, way_of(way), SHAPE, out=made, side=32)
    np.testing.assert_allclose(made, warp(image, way_of(way), SHAPE).image, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("order", "mode"),
    [(0, "constant"), (1, "constant"), (1, "nearest"), (3, "reflect"), (3, "mirror")],
)
def test_a_complex_picture_at_coordinates_is_scipys(order, mode):
    image, places = phases((20, 24), "complex128"), np.mgrid[:10, :12] * 0.93 + 3.21
    options = {"order": order, "mode": mode, "cval": 2 - 3j}
    ours, theirs = (
        library.map_coordinates(image, places, **options) for library in (like_ndimage, ndimage)
    )
    assert ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-5)


def test_a_complex_cval_is_what_lies_beyond():
    made = like_ndimage.shift(phases((6, 6)), 3, cval=2 - 3j)
    np.testing.assert_array_equal(made[:3], np.complex64(2 - 3j))


def test_complex_pictures_fit_no_real_output():
    with pytest.raises(ValueError, match="fits no output of float32"):
        like_ndimage.shift(phases((6, 6)), 1, output=np.float32)
    with pytest.raises(ValueError, match="complex64 or complex128"):
        warp(phases((6, 6), "clongdouble"), TURNED, SHAPE)


def test_real_pictures_become_complex_ones_on_demand():
    image = phases((6, 6)).real
    made = like_ndimage.shift(image, 0.5, output=np.complex64, mode="mirror")
    expected = like_ndimage.shift(image, 0.5, mode="mirror")
    np.testing.assert_allclose(made, expected, rtol=0, atol=1e-6)


@pytest.mark.some(4)
@pytest.mark.parametrize("method", ["hybrid", "points", "supersample"])
@pytest.mark.parametrize("way", ["matrix", "map", "shift"])
def test_sums_in_chunks_are_those_of_the_whole(way, method):
    image = np.random.default_rng(2).random((33, 35), np.float32)
    made = np.zeros(SHAPE, np.float32)
    warp_chunks(image, way_of(way), SHAPE, method, out=made, side=16, total=True)
    truth = warp(image, way_of(way), SHAPE, method, total=True).image
    if method == "hybrid" or way != "map":
        np.testing.assert_array_equal(made, truth)
    np.testing.assert_allclose(made, truth, rtol=0, atol=2e-5)  # of points, added in other orders


def test_sums_are_conserved_over_chunks():
    image = np.random.default_rng(2).random((90, 70), np.float32)
    made = np.zeros((20, 20), np.float32)
    warp_chunks(image, np.diag([0.21, 0.19, 1.0]), (20, 20), out=made, side=8, total=True)
    assert made.sum(dtype=float) == pytest.approx(image.sum(dtype=float), rel=1e-5)


def test_lazy_sums_are_those_of_arrays():
    image = np.random.default_rng(2).random((33, 35), np.float32)
    lazy = warp_chunks(dask.array.from_array(image), TURNED, SHAPE, side=16, total=True)
    np.testing.assert_array_equal(lazy.compute(), warp(image, TURNED, SHAPE, total=True).image)


def test_sums_of_whole_numbers_in_chunks_are_refused():
    with pytest.raises(ValueError, match="sums do not fit uint8"):
        warp_chunks(np.ones((9, 9), np.uint8), TURNED, SHAPE, total=True)
