"""Nothing is damaged: values of all types, layouts, masks, batches, and arrays to write into."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample_texture import BackwardMap, Edge, Homography, warp
from resample_texture.geometry.mappings import source_coordinates
from resample_texture.texels.encoding import DTYPES, VALUES

VIEW = np.array([[1.3, 0.1, 2.0], [-0.05, 1.2, 1.0], [0.002, 0.004, 1.0]])
SHRUNK = np.array([[0.21, 0.02, 1.0], [-0.03, 0.24, 1.0], [0.0, 0.0, 1.0]])
SHAPE = (18, 22)
WIDER = 3e-5  # boxes are 1e-5 px wider than they should be, so that none is empty
SHARE = 2e-6  # of a range of values: float32, over the few additions that a pixel takes
LAYOUTS = {
    "c": np.ascontiguousarray,
    "fortran": np.asfortranarray,
    "chw": lambda a: np.ascontiguousarray(np.moveaxis(a, -1, 0)).transpose(*range(1, a.ndim), 0),
    "backward": lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
    "channels backward": lambda a: a[..., ::-1].copy()[..., ::-1],
    "strided": lambda a: np.repeat(np.repeat(a, 2, axis=0), 3, axis=1)[::2, ::3],
    "turned": lambda a: np.swapaxes(np.swapaxes(a, 0, 1).copy(), 0, 1),
}


def values(dtype, *shape, seed=7):
    """Values over most of a type's range, smooth enough not to ring beyond it."""
    kind = np.dtype(dtype).kind
    share = np.random.default_rng(seed).random(shape)
    if kind == "b":
        return share > 0.5
    if kind == "f":
        return (40.0 * share - 13.0).astype(dtype)
    low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
    return (low * 0.8 + share * (high * 0.8 - low * 0.8)).astype(dtype)


def span(image):
    return float(image.max()) - float(image.min())


@pytest.mark.each_value
@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_any_layout_of_any_type_gives_the_same_pixels(dtype, layout, channels):
    image = values(dtype, 15, 17, *([] if channels is None else [channels]))
    given = LAYOUTS[layout](image)
    np.testing.assert_array_equal(given, image)
    expected, warped = warp(image, VIEW, SHAPE), warp(given, VIEW, SHAPE)
    assert warped.image.dtype == image.dtype
    np.testing.assert_array_equal(warped.image, expected.image)
    np.testing.assert_array_equal(warped.coverage, expected.coverage)


@pytest.mark.parametrize("matrix", [VIEW, SHRUNK], ids=["grown", "shrunk"])
@pytest.mark.parametrize("dtype", sorted({*VALUES} - {"bool", "float16"}))
def test_values_are_neither_encoded_nor_squashed(dtype, matrix):
    image = values(dtype, 15, 17, 3)
    low = float(image.min())
    share = (image.astype(np.float64) - low) / span(image)
    expected = warp(share.astype(np.float32), matrix, SHAPE, linear_light=False)
    warped = warp(image, matrix, SHAPE)
    inner = warped.coverage == 1.0
    assert inner.any()
    found = (warped.image[inner].astype(np.float64) - low) / span(image)
    wanted, half = expected.image[inner], 0.0
    if np.dtype(dtype).kind != "f":  # rounded, and within the type's range
        limits, half = np.iinfo(dtype), 0.5 / span(image)
        wanted = np.clip(wanted, (limits.min - low) / span(image), (limits.max - low) / span(image))
    np.testing.assert_allclose(found, wanted, atol=SHARE + half)


@pytest.mark.parametrize("dtype", ["int8", "int16", "int32", "int64", "float32"])
def test_signed_values_keep_their_sign(dtype):
    image = np.full((8, 8), -100, dtype)
    warped = warp(image, SHRUNK, (4, 4))
    assert (warped.image[warped.coverage == 1.0] == -100).all()
    expected = np.where(warped.coverage > 0, -100.0, np.nan)
    if np.dtype(dtype).kind != "f":  # which has no value for nothing
        expected = warped.coverage * -100.0
    np.testing.assert_allclose(warped.image, expected, atol=0.51)


@pytest.mark.parametrize(
    ("dtype", "far"),
    [
        ("float64", 1e9),
        ("float64", -1e15),
        ("int32", 2_000_000_000),
        ("int32", -2_000_000_000),
        ("uint32", 4_000_000_000),
        ("int64", 2**62),
        ("int64", -(2**63)),
        ("uint64", 2**64 - 256),
    ],
)
def test_a_small_detail_of_large_values_is_kept(dtype, far):
    detail = np.random.default_rng(7).integers(0, 200, (15, 17))
    image = np.array([[far + int(d) for d in row] for row in detail], dtype)
    expected = warp(detail.astype(np.float32), VIEW, SHAPE)
    warped = warp(image, VIEW, SHAPE)
    inner = warped.coverage == 1.0
    found = np.array([float(value - far) for value in warped.image[inner].tolist()])
    wanted = expected.image[inner].astype(np.float64)
    if dtype != "float64":
        limits = np.iinfo(dtype)
        wanted = np.clip(wanted, limits.min - far, limits.max - far)
    rounding = 0.5 if dtype != "float64" else np.spacing(abs(far))
    np.testing.assert_allclose(found, wanted, atol=rounding + 200 * SHARE)


@pytest.mark.parametrize("scale", [1e300, 1e-300])
def test_huge_and_tiny_doubles_are_values_like_others(scale):
    image = np.random.default_rng(7).random((15, 17))
    expected = warp(image, VIEW, SHAPE).image
    np.testing.assert_allclose(warp(image * scale, VIEW, SHAPE).image / scale, expected, atol=SHARE)


def test_means_of_doubles_are_doubles():
    warped = warp(np.full((9, 9), 1e9 + 0.125), VIEW, SHAPE)
    there = warped.coverage > 0.5
    np.testing.assert_allclose(warped.mean[there], 1e9 + 0.125, rtol=2e-16)


def test_a_boolean_is_what_covers_the_half():
    image = np.zeros((8, 8), np.bool_)
    image[:, :4] = True
    warped = warp(image, np.diag([0.5, 0.5, 1.0]), (4, 4))
    np.testing.assert_array_equal(warped.image, [[True, True, False, False]] * 4)


def test_totals_of_large_doubles_are_kept():
    image = 1e9 + np.random.default_rng(7).random((12, 12))
    warped = warp(image, np.diag([0.5, 0.5, 1.0]), (6, 6), total=True)
    np.testing.assert_allclose(warped.image.sum(), image.sum(), rtol=WIDER)


# Masked arrays


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("matrix", [VIEW, np.eye(3), SHRUNK], ids=["grown", "identity", "shrunk"])
def test_a_mask_is_what_is_missing_and_comes_back(matrix, dtype):
    image = values(dtype, 15, 17)
    mask = np.zeros((15, 17), np.bool_)
    mask[3:8, 4:9] = True
    given = np.ma.MaskedArray(image, mask, fill_value=image[0, 0])
    warped = warp(given, matrix, SHAPE)
    assert isinstance(warped.image, np.ma.MaskedArray)
    assert warped.image.dtype == image.dtype
    assert warped.image.fill_value == image[0, 0]
    floats = np.where(mask, np.nan, image.astype(np.float64))
    expected = warp(floats, matrix, SHAPE).coverage
    np.testing.assert_allclose(warped.coverage, expected, atol=1e-6)
    np.testing.assert_array_equal(warped.image.mask, warped.coverage == 0.0)
    # Whatever lies under the mask has no say.
    other = np.ma.MaskedArray(np.where(mask, image[1, 1], image), mask, fill_value=image[0, 0])
    np.testing.assert_array_equal(warp(other, matrix, SHAPE).image.data, warped.image.data)


def test_channels_have_masks_of_their_own():
    image = np.ma.MaskedArray(np.full((8, 8, 3), 9, np.int16), np.zeros((8, 8, 3), np.bool_))
    image.mask[2:4, 2:4, 1] = True
    warped = warp(image, np.diag([4.0, 4.0, 1.0]), (32, 32), interpolation="nearest")
    expected = np.zeros((32, 32, 3), np.bool_)
    expected[8:16, 8:16, 1] = True
    np.testing.assert_array_equal(warped.image.mask, expected)
    assert (warped.image.compressed() == 9).all()
    np.testing.assert_allclose(warped.coverage, 1.0, atol=WIDER)


# Not a number


@pytest.mark.parametrize("edge", [*Edge, "reflect-101"])
@pytest.mark.parametrize(
    "method",
    [
        *("hybrid", "points", "supersample", "splats", "bilinear", "cubic", "lanczos4"),
        *("opencv-supersample", "nearest", "majority"),
    ],
)
def test_what_is_not_a_number_weighs_nothing_in_any_method(method, edge):
    image = np.full((16, 16, 2), [3.0, -5.0])
    image[4:7, 5:9, 0] = np.nan
    image[9, 9] = np.inf
    for matrix in (VIEW, SHRUNK):
        if method == "points" and matrix is VIEW:
            continue  # which leaves holes
        warped = warp(image, matrix, SHAPE, method, edge=edge)
        mean = warped.mean[warped.coverage > 0.05]
        for c, level in enumerate((3.0, -5.0)):
            if method in ("nearest", "majority"):
                continue
            known = mean[..., c][np.isfinite(mean[..., c])]
            np.testing.assert_allclose(known, level, rtol=1e-4)
        np.testing.assert_array_equal(np.isfinite(warped.image[..., 1]), warped.coverage > 0)


@pytest.mark.parametrize("edge", [*Edge, "reflect-101"])
def test_gaps_of_one_channel_leave_the_others_alone(edge):
    image = np.random.default_rng(7).random((15, 17, 3))
    holed = image.copy()
    holed[4:8, 5:9, 1] = np.nan
    whole, warped = warp(image, VIEW, SHAPE, edge=edge), warp(holed, VIEW, SHAPE, edge=edge)
    np.testing.assert_allclose(warped.coverage, whole.coverage, atol=1e-6)
    for c in (0, 2):
        np.testing.assert_allclose(warped.image[..., c], whole.image[..., c], atol=1e-6)
    assert np.isnan(warped.image[..., 1]).any()


def test_the_mean_of_a_pixel_is_that_of_the_values_that_are_there(rng):
    image = rng.random((32, 32, 3))
    image[rng.random((32, 32, 3)) < 0.3] = np.nan
    warped = warp(image, np.diag([0.125, 0.125, 1.0]), (4, 4), interpolation="nearest")
    blocks = image.reshape(4, 8, 4, 8, 3)
    np.testing.assert_allclose(warped.mean, np.nanmean(blocks, axis=(1, 3)), rtol=1e-4)


# Batches


@pytest.mark.some(4)
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float64"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_batch_is_its_pictures_one_by_one(dtype, channels):
    batch = values(dtype, 3, 15, 17, channels)
    for layout in ("c", "chw", "fortran"):
        warped = warp(LAYOUTS[layout](batch), VIEW, SHAPE)
        assert warped.image.shape == (3, *SHAPE, channels)
        assert warped.coverage.shape == (3, *SHAPE)
        for n in range(3):
            alone = warp(batch[n], VIEW, SHAPE)
            np.testing.assert_array_equal(warped.image[n], alone.image)
            np.testing.assert_array_equal(warped.coverage[n], alone.coverage)
        assert warped.mean.shape == warped.image.shape


def test_a_batch_may_be_masked_seen_in_part_and_reflected():
    batch = np.ma.MaskedArray(values("float32", 2, 15, 17, 3), values("bool", 2, 15, 17, 3))
    warped = warp(batch, VIEW, SHAPE, roi=(2, 3, 9, 7), edge="reflect-101")
    alone = warp(batch[1], VIEW, SHAPE, roi=(2, 3, 9, 7), edge="reflect-101")
    np.testing.assert_array_equal(warped.image[1].mask, alone.image.mask)
    np.testing.assert_array_equal(warped.image[1].data, alone.image.data)


# Arrays to write into


@pytest.mark.parametrize("matrix", [VIEW, np.eye(3)], ids=["warp", "identity"])
@pytest.mark.parametrize("shape", [(15, 17), (15, 17, 3), (2, 15, 17, 3)])
def test_the_result_is_put_where_it_is_asked_to_be(shape, matrix):
    image = values("int16", *shape)
    expected = warp(image, matrix, SHAPE)
    out = np.empty(expected.image.shape[::-1], np.int16).T
    warped = warp(image, matrix, SHAPE, out=out)
    assert warped.image is out
    np.testing.assert_array_equal(out, expected.image)


def test_a_picture_may_be_warped_in_place():
    image = values("float32", 18, 22)
    expected = warp(image, VIEW, SHAPE).image
    warp(image, VIEW, SHAPE, out=image)
    np.testing.assert_array_equal(image, expected)


@pytest.mark.parametrize(
    ("out", "message"),
    [
        (np.zeros((18, 22)), r"out is float64 of \(18, 22\); the result is float32 of \(18, 22\)"),
        (np.zeros((22, 18), np.float32), r"out is float32 of \(22, 18\); the result is"),
        ([0.0], "out is <class 'list'>; the result is"),
    ],
)
def test_an_array_that_does_not_fit_is_refused(out, message):
    with pytest.raises(ValueError, match=message):
        warp(values("float32", 15, 17), VIEW, SHAPE, out=out)


def test_an_array_without_a_mask_takes_no_masked_picture():
    image = np.ma.MaskedArray(values("float32", 15, 17), False)
    with pytest.raises(ValueError, match="give a masked array for a masked picture"):
        warp(image, VIEW, SHAPE, out=np.zeros(SHAPE, np.float32))
    out = np.ma.MaskedArray(np.zeros(SHAPE, np.float32), False)
    assert warp(image, VIEW, SHAPE, out=out).image is out


def test_a_read_only_array_is_refused():
    out = np.zeros(SHAPE, np.float32)
    out.setflags(write=False)
    with pytest.raises(ValueError, match="out is read-only"):
        warp(values("float32", 15, 17), VIEW, SHAPE, out=out)


# Functions of places


@pytest.mark.parametrize("convention", ["corner", "opencv"])
def test_a_function_leads_from_target_to_source(convention):
    image = values("float32", 15, 17)
    x, y = source_coordinates(Homography(VIEW), SHAPE, (15, 17))
    expected = warp(image, BackwardMap(x, y), SHAPE).image
    off = 0.0 if convention == "corner" else 0.5
    inverse = np.linalg.inv(VIEW)

    def places(x, y):
        u, v, w = np.tensordot(inverse, np.stack([x + off, y + off, np.ones_like(x)]), 1)
        return u / w - off, v / w - off

    warped = warp(image, places, SHAPE, convention=convention).image
    np.testing.assert_allclose(warped, expected, atol=1e-5)
    part = warp(image, places, SHAPE, convention=convention, roi=(3, 2, 8, 7)).image
    np.testing.assert_allclose(part, expected[2:9, 3:11], atol=1e-5)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, y: (x, y, x), "returned 3 arrays; it must return x and y"),
        (lambda x, y: (x * 1j, y), "the function must hold real numbers"),
    ],
)
def test_a_function_that_gives_no_places_is_refused(function, message):
    with pytest.raises(ValueError, match=message):
        warp(values("float32", 15, 17), function, SHAPE)


def test_a_function_has_no_inverse():
    with pytest.raises(ValueError, match="always maps target to source"):
        warp(values("float32", 15, 17), lambda x, y: (x, y), SHAPE, inverse=True)


# Reflection about the outermost centers


@pytest.mark.parametrize("size", [(15, 17), (1, 5), (2, 2), (3, 1)])
@pytest.mark.parametrize("kind", ["matrix", "map"])
def test_reflect_101_is_numpy_s_reflection(kind, size):
    image = values("float32", *size)
    matrix = np.array([[1.0, 0.0, 7.25], [0.0, 1.0, 9.5], [0.0, 0.0, 1.0]])
    padded = np.pad(image, 40, mode="reflect")
    within = matrix @ [[1, 0, -40], [0, 1, -40], [0, 0, 1.0]]
    given = [matrix, within]
    if kind == "map":
        given = [BackwardMap(*source_coordinates(Homography(m), (20, 24))) for m in given]
    warped = warp(image, given[0], (20, 24), edge="reflect-101")
    np.testing.assert_allclose(warped.image, warp(padded, given[1], (20, 24)).image, atol=2e-4)
    np.testing.assert_allclose(warped.coverage, 1.0, atol=1e-6)


@pytest.mark.sweep
@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    st.sampled_from(DTYPES),
    st.sampled_from(sorted(LAYOUTS)),
    st.sampled_from([None, 1, 2, 3, 4, 5]),
    st.sampled_from([*Edge, "reflect-101"]),
    st.sampled_from(["hybrid", "nearest", "majority", "bilinear"]),
    st.booleans(),
)
def test_a_constant_stays_what_it_is(dtype, layout, channels, edge, method, masked):
    image = np.broadcast_to(values(dtype, 1)[0], (9, 11) if channels is None else (9, 11, channels))
    given = LAYOUTS[layout](image.copy())
    if masked:
        given = np.ma.MaskedArray(given, False)
    warped = warp(given, VIEW, SHAPE, method, edge=edge, alpha="none")
    shown = np.ma.getdata(warped.image)[warped.coverage == 1.0]
    assert shown.dtype == np.dtype(dtype)
    rtol = 1e-6 if np.dtype(dtype).kind == "f" else 0
    np.testing.assert_allclose(shown, np.broadcast_to(image[0, 0], shown.shape), rtol=rtol)
