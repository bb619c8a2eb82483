"""Drop-ins that are partly OpenCV's: its own bits where no pixel shrinks, own tiles elsewhere."""

import cv2
import numpy as np
import pytest
import scipy.ndimage
from hypothesis import given, settings
from hypothesis import strategies as st

from conftest import real
from resample_dropins import common, ndimage, opencv
from resample_texture import Homography
from resample_texture.texels.gather import places_of
from resample_texture.texels.kernels.gather import put_shares

SHAPE = (150, 170)
TILE = common.TILE
# Texels per px grow from 0.6 to 2.5 from left to right.
BACK = np.array([[0.62, 0.05, 9.0], [-0.04, 0.62, 20.0], [-2.8e-3, 0.0, 1.0]])
FLAGS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC, "lanczos4": cv2.INTER_LANCZOS4}
KERNELS = {"linear": "bilinear", "cubic": "cubic", "lanczos4": "lanczos:a=4"}
INVERSE = cv2.WARP_INVERSE_MAP


def noise(dtype="uint8", channels=3, shape=(220, 300)):
    values = np.random.default_rng(7).random((*shape, channels) if channels else shape)
    return values.astype(dtype) if dtype[0] == "f" else (200 * values).astype(dtype)


def places():
    """Source coordinates of pixels by `BACK`, as `cv2.remap` takes them."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    u, v, w = np.tensordot(BACK, np.stack([x, y, np.ones_like(x)]), 1)
    return (u / w).astype(np.float32), (v / w).astype(np.float32)


def pixels(tiles):
    return tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[: SHAPE[0], : SHAPE[1]]


def both(name, image, flag, border=cv2.BORDER_REFLECT, dst=None):
    """Our picture and OpenCV's."""
    for module in (opencv, cv2):
        target = None if dst is None else dst.copy()
        if name == "remap":
            yield module.remap(image, *places(), flag, target, border, (9, 8, 7, 6))
        else:
            size = SHAPE[::-1]
            yield module.warpPerspective(
                image, BACK, size, target, flag | INVERSE, border, (9, 8, 7, 6)
            )


@pytest.mark.some(6)
@pytest.mark.parametrize("border", range(5))
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32"])
@pytest.mark.parametrize("channels", [None, 1, 3, 4])
@pytest.mark.parametrize("flag", FLAGS)
@pytest.mark.parametrize("name", ["warpPerspective", "remap"])
def test_tiles_that_do_not_shrink_are_opencv_s_bit_by_bit(name, flag, channels, dtype, border):
    ours, theirs = both(name, noise(dtype, channels), FLAGS[flag], border)
    most = opencv.LIMITS[KERNELS[flag]]
    back = tuple((BACK / BACK[2, 2]).ravel().tolist())
    tiles = common.by_matrix(back, SHAPE, most)
    assert 0.1 < tiles.mean() < 0.9
    assert ours.shape == theirs.shape
    same = ours == theirs
    if name == "warpPerspective":  # a map is looked at here and there
        assert same[~pixels(tiles)].all()
    assert same[:, : TILE * int(np.flatnonzero(tiles.any(axis=0))[0])].all()
    assert same[pixels(tiles)].mean() < 0.6


@pytest.mark.parametrize("name", ["warpPerspective", "remap"])
@pytest.mark.parametrize("flag", FLAGS)
def test_tiles_that_shrink_are_own_code_s(flag, name):
    image = noise("float32")
    ours, _ = both(name, image, FLAGS[flag])
    size, border = SHAPE[::-1], cv2.BORDER_REFLECT
    method = common.method_for(KERNELS[flag])
    alone = opencv.warpPerspective(
        image, BACK, size, None, FLAGS[flag] | INVERSE, border, method=method
    )
    # A map's pixels are estimated from their neighbours.
    tolerance = 1e-6 if name == "warpPerspective" else 0.02
    np.testing.assert_allclose(ours[:, -TILE:], alone[:, -TILE:], atol=tolerance)


@pytest.mark.parametrize("name", ["warpPerspective", "remap"])
def test_what_shows_through_does_in_all_tiles(name):
    image, dst = noise(shape=(150, 200)), noise(shape=SHAPE)[..., ::-1].copy()
    ours, theirs = both(name, image, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT, dst)
    x, y = places()
    outside = (x < -4) | (y < -4) | (x > image.shape[1] + 4) | (y > image.shape[0] + 4)
    assert outside[:, -TILE:].any()
    np.testing.assert_array_equal(ours[outside], theirs[outside])


def test_the_source_may_be_the_target():
    image = noise(shape=SHAPE)
    expected = opencv.warpPerspective(image, BACK, SHAPE[::-1], flags=1 | INVERSE)
    made = opencv.warpPerspective(image, BACK, SHAPE[::-1], image, flags=1 | INVERSE)
    assert made is image
    np.testing.assert_array_equal(made, expected)


@pytest.mark.parametrize("flag", FLAGS)
def test_no_seam_is_seen_between_tiles(flag, record):
    photo = cv2.imread(str(real("textures") / "kodim23.png"))
    shape, back = (600, 600), np.array([[0.7, 0.02, 9.0], [-0.02, 0.7, 9.0], [-9e-4, 0, 1.0]])
    if flag != "linear":
        back[2, 0] = -5e-4
    given = back, shape[::-1], None, FLAGS[flag] | INVERSE, cv2.BORDER_REFLECT
    theirs = cv2.warpPerspective(photo, *given).astype(float)
    own = opencv.warpPerspective(photo, *given, method=common.method_for(KERNELS[flag]))
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    long, w = common._scaled(tuple(back.ravel().tolist()), x, y)
    long, most = long / w**4, opencv.LIMITS[KERNELS[flag]]
    seam, grown = abs(long / most - 1.0) < 0.02, long < 0.9
    assert seam.mean() > 0.005
    assert grown.mean() > 0.1
    step = np.abs(theirs - own)
    record.error("levels at the seam", np.sqrt(np.square(step[seam]).mean()))
    assert step[seam].max() <= max(2.0, step[grown].max())  # as OpenCV's own rounding


@pytest.mark.sweep
@settings(deadline=None, max_examples=120, derandomize=True)
@given(st.integers(0, 10**6))
def test_tiles_shrink_where_one_of_their_pixels_does(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + rng.normal(0, [[0.4, 0.4, 30], [0.4, 0.4, 30], [4e-3, 4e-3, 0]])
    geometry = Homography(matrix)
    size, most = (90, 110), float(rng.choice([common.SHARP, common.LINEAR]))
    shares, far = np.empty(SHAPE, np.float32), 50.0
    put_shares(places_of(size, geometry, SHAPE), (0.0, far), SHAPE, shares.reshape(-1))
    longest = far * (1.0 - shares)
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    centered = np.linalg.inv(half) @ matrix @ half
    tiles = common.by_matrix(opencv._back(centered, False, size), SHAPE, most)
    tiles = np.zeros((5, 6), np.bool_) if tiles is None else tiles
    longer = ~(longest.astype(float) ** 2 <= most)
    near = np.abs(longest.astype(float) ** 2 / most - 1.0) < 1e-4  # by rounding either
    for row in range(5):
        for column in range(6):
            part = np.s_[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
            if not near[part].any():
                assert tiles[row, column] == longer[part].any()


@pytest.mark.parametrize("form", ["pair", "one array", "fixed point", "relative"])
def test_maps_of_all_forms_are_looked_at(form):
    x, y = places()
    image = noise()
    maps, flag = (x, y), cv2.INTER_LINEAR
    if form == "one array":
        maps = np.stack([x, y], axis=2), None
    elif form == "fixed point":
        maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
    elif form == "relative":
        rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
        maps = (x - columns).astype(np.float32), (y - rows).astype(np.float32)
        flag |= cv2.WARP_RELATIVE_MAP
    ours, theirs = (module.remap(image, *maps, flag) for module in (opencv, cv2))
    np.testing.assert_array_equal(ours[:, :TILE], theirs[:, :TILE])
    assert (ours[:, -TILE:] != theirs[:, -TILE:]).mean() > 0.3


def test_places_that_are_not_numbers_are_the_border():
    y, x = np.mgrid[:64, :80].astype(np.float32)
    x[20:40, 30:50] = np.nan
    ours = opencv.remap(noise(), x, y, cv2.INTER_LINEAR, borderValue=(7, 8, 9))
    assert (ours[20:40, 30:50] == [7, 8, 9]).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (3, 5), (9, 9), (33, 8), (65, 64)])
def test_maps_of_all_sizes_are_opencv_s(shape):
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    for scale in (0.5, 0.9):
        given = noise(), scale * x, scale * y, cv2.INTER_CUBIC
        np.testing.assert_array_equal(opencv.remap(*given), cv2.remap(*given))
    if min(shape) > 1:
        given = noise(), 3 * x, 3 * y, cv2.INTER_CUBIC
        assert (opencv.remap(*given) != cv2.remap(*given)).any()


@pytest.mark.parametrize("flag", [*FLAGS.values(), cv2.INTER_LINEAR_EXACT])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32", "float64"])
@pytest.mark.parametrize("size", [(70, 50), (50, 40), (120, 41)])
def test_a_picture_that_keeps_its_size_or_grows_is_resized_by_opencv(size, dtype, flag):
    image = noise(dtype, 3, (40, 50))
    ours, theirs = (module.resize(image, size, interpolation=flag) for module in (opencv, cv2))
    np.testing.assert_array_equal(ours, theirs)


def test_blocks_are_opencv_s_but_where_one_axis_grows():
    image = noise()
    for size in ((100, 55), (150, 110), (299, 219)):
        ours, theirs = (m.resize(image, size, interpolation=cv2.INTER_AREA) for m in (opencv, cv2))
        np.testing.assert_array_equal(ours, theirs)
    ours, theirs = (m.resize(image, (30, 440), interpolation=3) for m in (opencv, cv2))
    assert ours.std() < 0.7 * theirs.std()


def test_a_polar_picture_is_opencv_s_but_near_the_pole():
    image, flags = noise(shape=(360, 100)), cv2.INTER_LINEAR | cv2.WARP_FILL_OUTLIERS
    given = image, (224, 224), (112.0, 112.0), 90.0, flags | INVERSE
    ours, theirs = opencv.warpPolar(*given), cv2.warpPolar(*given)
    np.testing.assert_array_equal(ours[:64], theirs[:64])
    assert (ours[100:124, 100:124] != theirs[100:124, 100:124]).mean() > 0.3


def test_behind_the_horizon_is_the_border():
    # The source's first ten rows are behind, where OpenCV draws them in rows above 60.
    move = np.array([[1, 0, 100], [0, 1, 60], [0, 0, 1.0]])
    matrix = move @ [[1, 0, 0], [0, 1, 0], [0, 0.03, -0.3]]
    given = 1 + noise(shape=(40, 170)), matrix, SHAPE[::-1]
    ours, theirs = (m.warpPerspective(*given) for m in (opencv, cv2))
    assert theirs[:60].any()
    assert not ours[:60].any()
    assert ours[100:].any()


def test_pictures_without_an_array_are_opencv_s():
    given = np.eye(2, 3), (9, 8)
    with pytest.raises(cv2.error):
        opencv.warpAffine(None, *given)
    made = opencv.warpAffine(cv2.UMat(noise()), *given)
    np.testing.assert_array_equal(made.get(), cv2.warpAffine(noise(), *given))


# SciPy


@pytest.mark.parametrize("mode", ["wrap", "grid-wrap", "nearest", "mirror", "reflect"])
@pytest.mark.parametrize("order", [1, 3])
def test_a_map_for_scipy_is_own_code_s_where_it_shrinks(order, mode):
    y, x = np.mgrid[:256, :256]
    rings = 0.5 + 0.5 * np.cos(0.0055 * (x * x + y * y))
    grid = np.mgrid[:60, :60] * 4.0 + 1.5
    ours = ndimage.map_coordinates(rings, grid, order=order, mode=mode)
    assert ours[30:, 30:].std() < 0.4 * rings[128:, 128:].std()
    near = ndimage.map_coordinates(rings, grid / 5, order=order, mode=mode)
    theirs = scipy.ndimage.map_coordinates(rings, grid / 5, order=order, mode=mode)
    np.testing.assert_array_equal(near, theirs)


def test_wrap_repeats_a_picture_without_its_last_texels():
    image = np.random.default_rng(7).random((33, 33))
    image[-1], image[:, -1] = image[0], image[:, 0]
    image[-1, -1] = image[0, 0]
    grid = np.mgrid[:48, :48] * 2.0 - 32.0
    wrapped = ndimage.map_coordinates(image, grid, order=1, mode="wrap")
    np.testing.assert_allclose(wrapped[:32], wrapped[16:48], atol=1e-6)
    np.testing.assert_allclose(wrapped[8:40, 8:24], wrapped[8:40, 24:40], atol=1e-6)


def test_arrays_of_other_dimensions_and_coefficients_are_scipy_s():
    volume = np.random.default_rng(7).random((9, 10, 11))
    for call in (
        lambda m: m.zoom(volume, 0.5),
        lambda m: m.shift(volume, 0.5, order=1),
        lambda m: m.rotate(volume, 20, axes=(0, 2)),
        lambda m: m.affine_transform(volume, np.diag([2.0, 2.0, 2.0])),
        lambda m: m.map_coordinates(volume, np.mgrid[:4, :4, :4] * 2.0),
        lambda m: m.zoom(volume[0], 0.5, prefilter=False),
        lambda m: m.zoom(volume[0], 0.5, order=0),
    ):
        np.testing.assert_array_equal(call(ndimage), call(scipy.ndimage))


def test_planes_are_scaled_one_by_one():
    image = np.random.default_rng(7).random((40, 50, 3))
    ours = ndimage.zoom(image, (0.25, 0.5, 1), mode="reflect")
    for n in range(3):
        plane = ndimage.zoom(image[..., n], (0.25, 0.5), mode="reflect")
        np.testing.assert_allclose(ours[..., n], plane, atol=1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_is_found_among_large_ones(value):
    image = np.full((40, 50), 1e30, np.float32)  # whose squares are no numbers in 32 bits
    turn = cv2.getRotationMatrix2D((25, 20), 7, 1.2)[:2]
    given = turn, (60, 50), None, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE
    ours, theirs = (module.warpAffine(image, *given) for module in (opencv, cv2))
    np.testing.assert_array_equal(ours, theirs)
    image[20, 25] = value
    ours = opencv.warpAffine(image, *given)
    np.testing.assert_allclose(ours[np.isfinite(ours)], 1e30, rtol=1e-6)
    assert 0 < (~np.isfinite(ours)).sum() < 5
