"""Measurements stay measurements: no pixel holds a number that nothing measured."""

import numpy as np
import pytest

from resample_chunks import warp_chunks
from resample_texture import Plan, resize, rotate, scale, warp

TURNED = np.array([[0.9, 0.25, 1.3], [-0.2, 0.95, 2.7], [0, 0, 1.0]])
WAYS = {
    "turned": TURNED,
    "shifted": np.array([[1, 0, 0.4], [0, 1, 0.7], [0, 0, 1.0]]),
    "moved": np.array([[1, 0, 2], [0, 1, 3], [0, 0, 1.0]]),
    "enlarged": np.diag([2.3, 1.7, 1.0]) + np.array([[0, 0, 0.7], [0, 0, 1.2], [0, 0, 0]]),
    "shrunk": np.diag([0.3, 0.4, 1.0]) + np.array([[0, 0, 3.7], [0, 0, 4.2], [0, 0, 0]]),
    "far": np.diag([0.04, 0.03, 1.0]) + np.array([[0, 0, 4.7], [0, 0, 5.2], [0, 0, 0]]),
}
FRAME = 24, 22


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
@pytest.mark.parametrize("channels", [None, 1, 3])
def test_a_field_of_five_is_five_or_unknown(channels, dtype, way):
    image = np.full((12, 13) if channels is None else (12, 13, channels), 5.0, dtype)
    found = warp(image, WAYS[way], FRAME)
    assert found.image.dtype == dtype
    np.testing.assert_array_equal(
        np.isnan(found.image.reshape(*FRAME, -1)[..., 0]), found.coverage == 0
    )
    known = found.image[np.isfinite(found.image)]
    assert known.size > 0
    np.testing.assert_allclose(known.astype(float), 5.0, rtol=2e-5 if dtype != "float16" else 1e-3)
    np.testing.assert_array_equal(found.mean, found.image)


@pytest.mark.parametrize("way", WAYS)
def test_a_masked_hundred_is_a_hundred_or_masked(way):
    image = np.ma.MaskedArray(np.full((12, 13), 100, np.int16), np.zeros((12, 13), np.bool_))
    image.mask[4:7, 5:8] = True
    found = warp(image, WAYS[way], FRAME).image
    assert set(found.compressed().tolist()) <= {100}
    assert found.mask.any()
    assert not found.mask.all()


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32"])
def test_a_value_for_nothing_is_never_mixed_and_comes_back(dtype):
    missing = -9999 if dtype in ("int16", "float32") else 0
    image = np.full((20, 20), 70, dtype)
    image[6:12, 5:11] = missing
    found = warp(image, TURNED, (26, 26), nodata=missing, linear_light=False).image
    assert found.dtype == dtype
    assert not isinstance(found, np.ma.MaskedArray)
    is_missing = found == missing
    np.testing.assert_allclose(found[~is_missing].astype(float), 70, rtol=1e-5)
    assert 20 < is_missing[6:16, 6:16].sum() < 64
    other = warp(image, TURNED, (26, 26), nodata=missing, fill=3, linear_light=False).image
    np.testing.assert_array_equal(other == 3, is_missing)


def test_not_a_number_may_be_named_for_nothing_too():
    image = np.full((9, 9), 4.0)
    image[3:5, 3:6] = np.nan
    np.testing.assert_array_equal(
        warp(image, TURNED, (9, 9), nodata=np.nan).image, warp(image, TURNED, (9, 9)).image
    )


@pytest.mark.parametrize("fill", [0.0, -1.0, 7])
def test_fill_stands_where_nothing_is_known(fill):
    image = np.full((12, 13), 5.0)
    plain, found = warp(image, TURNED, FRAME), warp(image, TURNED, FRAME, fill=fill)
    np.testing.assert_array_equal(found.image, np.where(plain.coverage > 0, plain.image, fill))
    np.testing.assert_array_equal(found.mean, plain.mean)


def test_fill_makes_means_of_whole_numbers_too():
    image = np.full((12, 13), 50, np.uint8)
    assert set(np.unique(warp(image, TURNED, FRAME, fill=9).image).tolist()) == {9, 50}


def test_light_may_still_be_multiplied_by_the_coverage():
    image = np.full((12, 13, 3), 0.5, np.float32)
    found = warp(image, TURNED, FRAME, fill="premultiplied")
    np.testing.assert_allclose(found.image, 0.5 * np.dstack([found.coverage] * 3), atol=1e-6)
    plain = warp(image, TURNED, FRAME)
    np.testing.assert_allclose(
        plain.to_uint8(background="white"), found.to_uint8(background="white")
    )


def test_opacity_and_sums_say_themselves_where_nothing_is():
    assert not np.isnan(warp(np.ones((8, 8, 4)), TURNED, FRAME).image).any()
    assert not np.isnan(warp(np.ones((8, 8)), TURNED, FRAME, total=True).image).any()
    with pytest.raises(ValueError, match="pictures with opacity are transparent where nothing is"):
        warp(np.ones((8, 8, 4)), TURNED, FRAME, fill=0)
    with pytest.raises(ValueError, match="totals are 0 where nothing is; leave fill out"):
        warp(np.ones((8, 8)), TURNED, FRAME, total=True, fill=0)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"fill": "blue"}, "fill is a number, 'black', 'white' or 'premultiplied', not 'blue'"),
        ({"fill": 300}, "fill 300 does not fit uint8; give a value of that type"),
        ({"nodata": -1}, "nodata -1 does not fit uint8; give a value of that type"),
        ({"nodata": 0.5}, "nodata 0.5 does not fit uint8; give a value of that type"),
    ],
)
def test_values_that_a_type_does_not_hold_are_refused(choices, message):
    with pytest.raises(ValueError, match=message):
        warp(np.zeros((8, 8), np.uint8), TURNED, FRAME, **choices)
    with pytest.raises(ValueError, match="a masked array marks missing values; leave nodata"):
        warp(np.ma.MaskedArray(np.zeros((8, 8))), TURNED, FRAME, nodata=0)


def test_plans_chunks_and_shortcuts_do_the_same():
    image = np.full((30, 31, 2), 5.0, np.float32)
    image[8:12, 9:14] = np.nan
    expected = warp(image, TURNED, FRAME).image
    np.testing.assert_array_equal(Plan(TURNED, FRAME, (30, 31))(image).image, expected)
    made = np.zeros((*FRAME, 2), np.float32)
    warp_chunks(image, TURNED, FRAME, out=made, side=16)
    np.testing.assert_array_equal(made, expected)
    for found in (rotate(image, 20.0), scale(image, 0.4), resize(image, (9, 7))):
        known = found.image[np.isfinite(found.image)]
        np.testing.assert_allclose(known, 5.0, rtol=1e-5)
    whole = np.full((30, 31), 70, np.int16)
    whole[:4] = -1
    assert set(np.unique(rotate(whole, 20.0, nodata=-1).image).tolist()) == {-1, 70}


def test_sixteen_bits_are_linear_unless_said_otherwise():
    image = np.uint16([[10000, 30000]])
    assert resize(image, (1, 1)).image.tolist() == [[20000]]
    assert resize(image, (1, 1), linear_light=True).image.tolist() == [[22730]]
    assert resize(np.uint8([[40, 120]]), (1, 1)).image.tolist() == [[91]]


@pytest.mark.parametrize("shape", [(3, 40, 50), (1, 40, 50), (4, 40, 50), (5, 3, 40, 50)])
def test_channels_first_are_refused_in_words(shape):
    for call in (lambda image: warp(image, TURNED, FRAME), lambda image: resize(image, (9, 9))):
        with pytest.raises(
            ValueError, match=r"would be . rows of 40 pixels.*of channels first, numpy"
        ):
            call(np.zeros(shape, np.float32))


def test_pictures_of_few_rows_are_pictures():
    assert warp(np.zeros((3, 40, 3)), TURNED, FRAME).image.shape == (*FRAME, 3)
    assert warp(np.zeros((40, 50)), TURNED, FRAME).image.shape == FRAME


@pytest.mark.some(2)
@pytest.mark.parametrize("factor", [30, 190, 333, 1000])
def test_means_are_exact_at_any_factor(factor):
    image = np.zeros((2 * factor, 3 * factor))
    image[:, 5 : factor // 2] = 1.0
    found = resize(image, (2, 3)).image
    expected = image.reshape(2, factor, 3, factor).mean(axis=(1, 3))
    np.testing.assert_allclose(found, expected, atol=1e-6)
