import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from resample import registry
from resample.colors import from_srgb, to_srgb
from resample_texture import BackwardMap, Edge, ForwardMap, Homography, Hybrid, warp
from resample_texture.geometry.mappings import source_coordinates
from resample_texture.texels.encoding import DTYPES

PERSPECTIVE = np.array([[0.8, 0.1, 2.0], [-0.05, 0.9, 1.0], [0.002, 0.004, 1.0]])
FRAME = (18, 22)
ROUNDING = 2e-6  # of float32, over the few additions that a pixel takes
WIDER = 3e-5  # boxes are 1e-5 px wider than they should be, so that none is empty


def picture(dtype="float32", height=15, width=17, channels=None):
    shape = (height, width) if channels is None else (height, width, channels)
    values = np.random.default_rng(7).random(shape)
    is_integer = np.dtype(dtype).kind == "u"
    return (values * np.iinfo(dtype).max if is_integer else values).astype(dtype)


def checkerboard(size, low, high):
    return np.where(np.indices((size, size)).sum(axis=0) % 2, high, low).astype(np.uint8)


def zoom(x, y=None):
    return np.diag([x, x if y is None else y, 1.0])


def shift(x, y):
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def forward_map(matrix, shape):
    v, u = np.mgrid[: shape[0], : shape[1]] + 0.5
    x, y, d = np.tensordot(matrix, np.stack([u, v, np.ones_like(u)]), 1)
    return ForwardMap(x / d, y / d)


def backward_map(matrix, shape):
    return BackwardMap(*source_coordinates(Homography(matrix), shape))


# Forms


@pytest.mark.parametrize("channels", [None, *range(1, 8)])
@pytest.mark.parametrize("dtype", [*DTYPES, ">f4", ">u2"])
def test_the_result_has_the_type_and_the_channels_of_the_picture(dtype, channels):
    image = picture(dtype, channels=channels)
    warped = warp(image, PERSPECTIVE, FRAME)
    assert warped.image.dtype == image.dtype
    assert warped.image.shape == FRAME + image.shape[2:]
    assert warped.coverage.dtype == np.float32
    assert warped.coverage.shape == FRAME


@pytest.mark.parametrize("dtype", [*sorted({*DTYPES} - {"bool"}), ">f4", ">u2"])
def test_every_type_shows_the_same_picture(dtype):
    image = picture("uint8", channels=3)
    kind = np.dtype(dtype).kind
    largest = np.iinfo(dtype).max if kind in "iu" else 1.0
    given = np.rint(image / 255.0 * largest) if largest > 1 else image / 255.0
    choices = {"linear_light": False, "fill": "premultiplied"}
    shown = warp(given.astype(dtype), PERSPECTIVE, FRAME, **choices).image / largest
    expected = warp(image / 255.0, PERSPECTIVE, FRAME, **choices).image
    # Float16 has 11 bits, int8 7 and rounds twice; what rings beyond 0..1 is cut from integers.
    expected = np.clip(expected, 0.0 if kind == "u" else -1.0, 1.0) if largest > 1 else expected
    np.testing.assert_allclose(shown, expected, atol=9e-3 if dtype == "int8" else 2.1e-3)


def test_each_channel_is_warped_like_a_picture_of_its_own():
    image = picture(channels=5)
    together = warp(image, PERSPECTIVE, FRAME).image
    for c in range(5):
        alone = warp(image[..., c], PERSPECTIVE, FRAME).image
        np.testing.assert_allclose(together[..., c], alone, atol=ROUNDING)


def test_any_memory_layout_gives_the_same_pixels():
    image = picture(channels=3)
    expected = warp(image, PERSPECTIVE, FRAME).image
    turned = image[::-1, ::-1].copy()[::-1, ::-1]
    for same in (np.asfortranarray(image), turned, image.tolist()):
        np.testing.assert_array_equal(warp(same, PERSPECTIVE, FRAME).image, expected)


@pytest.mark.parametrize("matrix", [PERSPECTIVE, np.eye(3), shift(2, 1)], ids=["warp", "id", "sh"])
@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
def test_the_picture_is_only_read(dtype, matrix):
    image = picture(dtype, channels=4)
    before = image.copy()
    image.setflags(write=False)
    warped = warp(image, matrix, FRAME)
    warped.image[:] = 0
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("matrix", [np.eye(3)[:2], np.eye(3)[:2].tolist(), np.eye(3, dtype=int)])
def test_a_matrix_may_be_affine_or_a_list_or_of_integers(matrix):
    image = picture()
    np.testing.assert_array_equal(warp(image, matrix, image.shape).image, image)


@pytest.mark.parametrize("shape", [[18, 22], np.array([18, 22]), (np.int32(18), np.uint8(22))])
def test_a_shape_may_be_any_two_whole_numbers(shape):
    geometry = backward_map(PERSPECTIVE, FRAME)
    assert warp(picture(), geometry, shape).image.shape == FRAME


# Shifts


@pytest.mark.each_value
@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize("channels", [None, 2, 3, 4])
@pytest.mark.parametrize("dtype", [*DTYPES, ">f4"])
def test_the_identity_leaves_every_bit(dtype, channels, edge):
    image = picture(dtype, channels=channels)
    warped = warp(image, np.eye(3), image.shape[:2], edge=edge)
    np.testing.assert_array_equal(warped.image, image)
    assert (warped.coverage == 1).all()


@pytest.mark.parametrize("dtype", ["uint8", "float64"])
def test_a_shift_by_whole_pixels_leaves_every_bit(dtype):
    image = picture(dtype, channels=4)
    warped = warp(image, shift(3, -2), (15, 17))
    np.testing.assert_array_equal(warped.image[:-2, 3:], image[2:, :-3])
    assert (warped.image[-2:] == 0).all()
    np.testing.assert_array_equal(warped.coverage[-3:, 2:4], [[0, 1], [0, 0], [0, 0]])


def test_a_shift_keeps_the_color_of_what_is_transparent():
    image = np.full((4, 4, 4), [90, 60, 30, 0], np.uint8)
    np.testing.assert_array_equal(warp(image, shift(1, 1), (4, 4)).image[1:, 1:], image[1:, 1:])


@pytest.mark.parametrize("filter", ["gaussian", "tent:radius=1.5"])
def test_a_filter_that_blurs_has_its_way_with_the_identity_too(filter):  # noqa: A002
    image = picture()
    assert np.abs(warp(image, np.eye(3), image.shape, filter=filter).image - image).max() > 0.01


@pytest.mark.parametrize("quality", [1.0, 1.5, 4.0])
def test_all_levels_survive_a_matrix_next_to_the_identity(quality):
    # Not taken for a shift, hence decoded, cut into parts, summed and encoded; flat, so that
    # interpolation adds nothing.
    almost = zoom(1.0 + 1e-9)
    for level in (0, 1, 2, 10, 13, 100, 128, 254, 255):
        image = np.full((6, 6, 3), level, np.uint8)
        warped = warp(image, almost, (6, 6), quality=quality).image
        np.testing.assert_array_equal(warped[1:-1, 1:-1], image[1:-1, 1:-1])


def test_encoded_levels_survive_a_change_of_size_by_two():
    image = np.repeat(np.repeat(picture("uint8", 8, 8, 3), 2, axis=0), 2, axis=1)
    shrunk = warp(image, zoom(0.5), (8, 8), quality=1.0).image
    np.testing.assert_array_equal(shrunk, image[::2, ::2])


# Light


@pytest.mark.parametrize(("linear_light", "level"), [(True, 188), (False, 127.5)])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_black_and_white_mix_to_half_of_the_light(dtype, linear_light, level):
    image = checkerboard(60, 0, 1) * np.array(np.iinfo(dtype).max, dtype)
    shrunk = warp(image, zoom(0.1), (6, 6), linear_light=linear_light).image
    step = np.iinfo(dtype).max // 255
    np.testing.assert_allclose(shrunk[1:-1, 1:-1] / step, level, atol=0.51)  # rounded level


def test_floats_are_light_already():
    image = checkerboard(60, 0, 1).astype(np.float32)
    shrunk = warp(image, zoom(0.1), (6, 6)).image
    np.testing.assert_allclose(shrunk[1:-1, 1:-1], 0.5, atol=1e-5)


def test_light_that_integers_encode_is_filtered_if_asked_for():
    image = picture("uint8", channels=3)
    light = warp(from_srgb(image / 255.0), PERSPECTIVE, FRAME, fill="premultiplied").image
    expected = to_srgb(np.clip(light, 0.0, 1.0)) * 255
    # The table has 65535 steps of light, of which 20 make one of the darkest levels.
    shown = warp(image, PERSPECTIVE, FRAME, linear_light=True).image
    np.testing.assert_allclose(shown, expected, atol=0.53)


# Opacity


def half_transparent(dtype):
    """White and opaque on the left, green and transparent on the right."""
    largest = np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1
    image = np.zeros((12, 12, 4), dtype)
    image[:, :6] = largest
    image[:, 6:] = [0, largest, 0, 0]
    return image


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float16", "float32", "float64"])
@pytest.mark.parametrize("scale", [0.37, 0.8, 2.3])
def test_what_is_transparent_does_not_bleed_its_color(scale, dtype):
    size = int(12 * scale)
    image = half_transparent(dtype)
    warped = warp(image, zoom(scale), (size, size), alpha="straight", filter="gaussian").image
    largest = image.max()
    there = warped[..., 3] > 0.02 * largest
    assert there.any()
    colors = warped[there][:, :3].astype(float) / float(largest)
    np.testing.assert_allclose(colors, 1.0, atol=3e-3)  # float16 has 11 bits


def test_integers_have_straight_opacity_unless_it_is_none():
    image = half_transparent("uint8")
    straight = warp(image, zoom(0.5), (6, 6)).image
    np.testing.assert_array_equal(warp(image, zoom(0.5), (6, 6), alpha="straight").image, straight)
    as_data = warp(image, zoom(0.5, 0.5) @ shift(1, 0), (6, 6), alpha="none").image
    np.testing.assert_array_equal(as_data[2, 3], [188, 255, 188, 188])


def test_floats_have_premultiplied_opacity():
    image = picture(channels=4)
    expected = warp(image, PERSPECTIVE, FRAME, alpha="none", fill="premultiplied").image
    np.testing.assert_array_equal(warp(image, PERSPECTIVE, FRAME).image, expected)
    straight = np.concatenate([image[..., :3] / image[..., 3:], image[..., 3:]], axis=2)
    warped = warp(straight, PERSPECTIVE, FRAME, alpha="straight", interpolation="bilinear").image
    back = np.concatenate([warped[..., :3] * warped[..., 3:], warped[..., 3:]], axis=2)
    expected = warp(image, PERSPECTIVE, FRAME, interpolation="bilinear").image
    np.testing.assert_allclose(back, expected, atol=1e-5)


def test_coverage_multiplies_opacity_or_else_the_color():
    matrix = shift(0.25, 0)
    white = np.full((4, 4, 4), 255, np.uint8)
    np.testing.assert_array_equal(warp(white, matrix, (4, 5)).image[1, 0], [255, 255, 255, 191])
    gray = np.ones((4, 4), np.float32)
    warped = warp(gray, matrix, (4, 5), fill="premultiplied")
    np.testing.assert_allclose(warped.image[1], [0.75, 1, 1, 1, 0.25], atol=1e-6)
    np.testing.assert_allclose(warped.coverage[1], [0.75, 1, 1, 1, 0.25], atol=1e-6)
    np.testing.assert_allclose(warped.mean[1], 1.0, atol=1e-6)


# Gaps


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
def test_missing_texels_weigh_nothing(dtype, missing):
    image = np.full((8, 8), 0.75, dtype)
    image[3, 2] = missing
    warped = warp(image, zoom(0.5), (4, 4), quality=1.0)
    np.testing.assert_allclose(warped.coverage[1, 1], 0.75, atol=1e-3)
    np.testing.assert_allclose(warped.image, 0.75, atol=1e-3)
    np.testing.assert_allclose(warped.mean, 0.75, atol=1e-3)
    assert (np.delete(warped.coverage, 5) > 0.999).all()


def test_a_hole_where_texels_grow_is_a_hole():
    image = np.ones((6, 6, 2), np.float32)
    image[2, 3, 1] = np.nan
    warped = warp(image, zoom(8), (48, 48), interpolation="nearest")
    expected = np.ones((48, 48))
    np.testing.assert_allclose(warped.coverage, expected, atol=WIDER)
    np.testing.assert_allclose(warped.image[..., 0], expected, atol=WIDER)
    expected[16:24, 24:32] = np.nan  # of the channel that has the hole
    np.testing.assert_allclose(warped.image[..., 1], expected, atol=WIDER)
    image[2, 3] = np.nan
    warped = warp(image, zoom(8), (48, 48), interpolation="nearest")
    np.testing.assert_allclose(warped.coverage, np.isfinite(expected), atol=WIDER)
    np.testing.assert_allclose(warped.image[..., 0], expected, atol=WIDER)
    assert np.isnan(warped.mean[20, 28]).all()


@pytest.mark.parametrize("matrix", [np.eye(3), PERSPECTIVE, zoom(3)], ids=["id", "warp", "zoom"])
def test_a_picture_of_nothing_gives_nothing(matrix):
    with pytest.warns(UserWarning, match="no value of the picture is finite"):
        warped = warp(np.full((6, 6, 3), np.nan), matrix, (6, 6))
    assert np.isnan(warped.image).all()
    assert not warped.coverage.any()
    assert np.isnan(warped.mean).all()


@pytest.mark.parametrize("edge", ["clamp", "wrap", "mirror"])
def test_beyond_the_edges_gaps_go_on_like_values(edge):
    image = np.ones((6, 6), np.float32)
    image[:, 0] = np.nan
    warped = warp(image, shift(6, 0), (6, 12), edge=edge)
    expected = {"clamp": [0] * 7, "wrap": [0, 1, 1, 1, 1, 1, 0], "mirror": [1] * 5 + [0, 0]}[edge]
    np.testing.assert_array_equal(warped.coverage[3, :7], expected)


@pytest.mark.parametrize("dtype", ["float16", "float64"])
def test_a_shift_moves_gaps_and_leaves_every_bit_of_the_rest(dtype):
    image = picture(dtype, channels=2)
    image[4, 5, 1] = np.nan
    image[7, 8] = np.nan
    warped = warp(image, shift(1, 2), FRAME)
    values, coverage = np.full((*FRAME, 2), np.nan), np.zeros(FRAME)
    values[2:17, 1:18], coverage[2:17, 1:18] = image, 1.0
    coverage[9, 9] = 0.0
    np.testing.assert_array_equal(warped.image, values)
    np.testing.assert_array_equal(warped.coverage, coverage)


# Conventions


def test_opencv_counts_from_pixel_centers():
    image = picture()
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix = half @ PERSPECTIVE @ np.linalg.inv(half)
    ours = warp(image, matrix, FRAME).image
    theirs = warp(image, PERSPECTIVE, FRAME, convention="opencv").image
    np.testing.assert_allclose(theirs, ours, atol=ROUNDING)


def test_an_inverse_matrix_leads_from_target_to_source():
    image = picture()
    expected = warp(image, PERSPECTIVE, FRAME).image
    given = np.linalg.inv(PERSPECTIVE)
    np.testing.assert_allclose(warp(image, given, FRAME, inverse=True).image, expected, atol=1e-5)
    given = np.linalg.inv(np.diag([2.0, 2.0, 1.0]))[:2]
    np.testing.assert_allclose(
        warp(image, given, FRAME, inverse=True).image, warp(image, zoom(2), FRAME).image, atol=1e-6
    )


def test_a_matrix_and_its_homography_are_one():
    image = picture()
    expected = warp(image, PERSPECTIVE, FRAME).image
    np.testing.assert_array_equal(warp(image, Homography(PERSPECTIVE), FRAME).image, expected)
    np.testing.assert_array_equal(warp(image, -3.0 * PERSPECTIVE, FRAME).image.shape, FRAME)
    np.testing.assert_allclose(warp(image, -3.0 * PERSPECTIVE, FRAME).image, expected, atol=1e-6)


def test_a_turn_by_180_degrees_turns_the_picture():
    image = picture()
    turn = np.array([[-1, 0, 17], [0, -1, 15], [0, 0, 1.0]])
    np.testing.assert_allclose(
        warp(image, PERSPECTIVE @ turn, FRAME).image,
        warp(image[::-1, ::-1], PERSPECTIVE, FRAME).image,
        atol=ROUNDING,
    )


def test_there_and_back_is_close(record):
    v, u = np.mgrid[:60, :70] / 6.0
    image = (0.5 + 0.3 * np.sin(u) * np.cos(v)).astype(np.float32)
    matrix = zoom(2.1) @ [[1, 0.1, 3], [-0.1, 1, 9], [0.0008, 0.0004, 1]]
    away = warp(image, matrix, (170, 170), interpolation="spline", quality=3)
    back = warp(away.image, np.linalg.inv(matrix), (60, 70), interpolation="spline", quality=3)
    error = (back.image - image)[5:-5, 5:-5]
    record.quality(
        "picture", 10 * np.log10(1 / np.mean(error**2))
    )  # it was blurred by a pixel's area twice


# Parts and threads


@pytest.mark.parametrize("filter", ["area", "gaussian:sigma=1.2"])
@pytest.mark.parametrize("kind", [Homography, ForwardMap, BackwardMap])
def test_a_region_is_the_crop_of_the_whole(kind, filter):  # noqa: A002
    image = picture(channels=3)
    geometry = {
        Homography: Homography(PERSPECTIVE),
        ForwardMap: forward_map(PERSPECTIVE, (15, 17)),
        BackwardMap: backward_map(PERSPECTIVE, FRAME),
    }[kind]
    whole = warp(image, geometry, FRAME, filter=filter)
    part = warp(image, geometry, FRAME, filter=filter, roi=(5, 3, 9, 12))
    np.testing.assert_allclose(part.image, whole.image[3:15, 5:14], atol=ROUNDING)
    np.testing.assert_allclose(part.coverage, whole.coverage[3:15, 5:14], atol=ROUNDING)


def test_a_region_of_a_target_that_is_too_large_is_drawn():
    part = warp(picture(), zoom(1e5), (1_500_000, 1_700_000), roi=(850_000, 750_000, 4, 3))
    assert part.image.shape == (3, 4)
    assert (part.coverage == 1).all()


@pytest.mark.parametrize("kind", ["matrix", "forward", "backward"])
def test_pixels_do_not_depend_on_the_number_of_threads(kind):
    image = picture("float32", 150, 140, 3)
    geometry = {
        "matrix": PERSPECTIVE,
        "forward": forward_map(PERSPECTIVE, (150, 140)),
        "backward": backward_map(PERSPECTIVE, (120, 130)),
    }[kind]
    for choice in ("area", "gaussian"):
        one, two = (
            warp(image, geometry, (120, 130), filter=choice, threads=count) for count in (1, 2)
        )
        np.testing.assert_array_equal(one.image, two.image)
        np.testing.assert_array_equal(one.coverage, two.coverage)


# Totals


@pytest.mark.parametrize("scale", [0.21, 0.7, 1.9])
@pytest.mark.parametrize(
    "method",
    [
        *("hybrid", "points", "supersample"),
        # Of maps, what finds a block's texels is compiled once more.
        pytest.param("splats", marks=pytest.mark.sweep),
        pytest.param("paper", marks=pytest.mark.sweep),
    ],
)
def test_totals_are_kept(method, scale):
    image = picture("float64", 20, 20)
    matrix = shift(6, 5) @ zoom(scale, 0.8 * scale) @ [[1, 0.1, 0], [0, 1, 0], [0.002, 0, 1]]
    for geometry in (matrix, forward_map(matrix, (20, 20))):
        warped = warp(image, geometry, (60, 70), method, total=True)
        # Half a part per texel is quadrature of the map's area, and Gaussians are cut at 3 or 4 σ.
        np.testing.assert_allclose(warped.image.sum(), image.sum(), rtol=2e-3)


def test_totals_by_a_backward_map_are_kept():
    image = picture("float64", 20, 20)
    matrix = shift(6, 5) @ zoom(0.7) @ [[1, 0.1, 0], [0, 1, 0], [0.002, 0, 1]]
    warped = warp(image, backward_map(matrix, (40, 40)), (40, 40), total=True)
    # Edges are found to 1/8 px; there are 52 px of them around 180 px².
    np.testing.assert_allclose(warped.image.sum(), image.sum(), rtol=0.01)


def test_a_total_is_divided_among_pixels():
    warped = warp(np.full((3, 3), 8.0), zoom(2), (6, 6), total=True)
    np.testing.assert_allclose(warped.image, 2.0, rtol=WIDER)
    np.testing.assert_allclose(warped.coverage, 1.0, rtol=WIDER)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_totals_leave_gaps_out_and_show_them(scale):
    image = picture("float64", 8, 8)
    image[2:4, 4:6] = np.nan
    size = int(8 * scale)
    warped = warp(image, zoom(scale), (size, size), total=True, interpolation="nearest")
    np.testing.assert_allclose(warped.image.sum(), np.nansum(image), rtol=1e-5)
    expected = np.kron(np.isfinite(image[::2, ::2]), np.ones((size // 4, size // 4)))
    np.testing.assert_allclose(warped.coverage, expected, atol=WIDER)


@pytest.mark.parametrize("asked", [{"total": True}, {"method": Hybrid(total=True)}])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_totals_of_integers_are_refused_as_they_would_not_fit(dtype, asked):
    with pytest.raises(ValueError, match=rf"sums do not fit {dtype}; give floats"):
        warp(picture(dtype), zoom(0.5), (6, 6), **asked)


# Views


def test_what_is_behind_the_eye_is_not_drawn():
    behind = Homography([[1, 0, 0], [0, 1, 0], [0, -1, -1.0]], is_signed=True)
    warped = warp(picture(), behind, FRAME)
    assert np.isnan(warped.image).all()
    assert not warped.coverage.any()


@pytest.mark.parametrize("edge", Edge)
def test_nothing_is_above_the_horizon(edge):
    # A floor whose horizon is the line y = 10; its far part is seen from d > 0 on.
    matrix = np.array([[4.0, 11.0, -20.0], [0.0, 10.0, 30.0], [0.0, 1.0, 0.2]])
    warped = warp(np.ones((200, 40), np.float32), matrix, (40, 22), edge=edge)
    is_shown = warped.coverage > 0
    assert not is_shown[:9].any()
    assert (warped.coverage[12:25, 12:20] == 1).all()
    np.testing.assert_allclose(warped.image, np.where(is_shown, 1.0, np.nan), atol=1e-5)


def test_a_source_beside_the_frame_shows_nothing():
    warped = warp(picture(), shift(100.5, 0), FRAME)
    assert not warped.coverage.any()
    assert np.isnan(warped.image).all()


@pytest.mark.parametrize("edge", ["clamp", "wrap", "mirror"])
def test_a_continued_source_covers_the_frame(edge):
    image = picture()
    warped = warp(image, shift(7.5, -3.25) @ zoom(0.9), (40, 40), edge=edge)
    np.testing.assert_allclose(warped.coverage, 1.0, atol=1e-6)
    padding = {"clamp": "edge", "wrap": "wrap", "mirror": "symmetric"}[edge]
    padded = np.pad(image, 60, mode=padding)
    matrix = shift(7.5, -3.25) @ zoom(0.9) @ shift(-60, -60)
    expected = warp(padded, matrix, (40, 40)).image
    np.testing.assert_allclose(warped.image, expected, atol=1e-5)  # other sums of other blocks


@pytest.mark.sweep
@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=2),
    st.sampled_from(["area", "gaussian", "box", "tent"]),
    st.sampled_from(list(Edge)),
)
def test_any_homography_gives_finite_pixels_within_the_source_s_range(affine, last, name, edge):
    matrix = np.array([affine[:3], affine[3:], [*last, 1.0]]) + shift(9.0, 8.0) - np.eye(3)
    with np.errstate(all="ignore"):
        assume(abs(np.linalg.det(matrix)) > 1e-3)
    image = picture() + np.float32(0.5)
    choices = {"filter": name, "interpolation": "bilinear", "edge": edge}
    warped = warp(image, matrix, FRAME, fill="premultiplied", **choices)
    assert np.isfinite(warped.image).all()
    assert warped.coverage.min() >= 0.0
    assert warped.coverage.max() <= 1.0
    assert warped.image.min() >= 0.0
    assert warped.image.max() <= image.max() + 1e-5
    mean = warped.mean[warped.coverage > 0.1]
    assert mean.size == 0 or mean.min() >= image.min() - 1e-4
    assert mean.size == 0 or mean.max() <= image.max() + 1e-4


# Refusals


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (-1, 3), (10**6, 10**6)])
def test_a_target_has_at_least_one_pixel_and_fits_in_memory(shape):
    with pytest.raises(ValueError, match=r"give a height and a width of 1 px or more"):
        warp(picture(), np.eye(3), shape)


@pytest.mark.parametrize("shape", [5, (5,), (5, 5, 3), (2.5, 3), ("5", "5")])
def test_a_shape_is_two_whole_numbers(shape):
    with pytest.raises(ValueError, match="is not height and width: give two whole numbers"):
        warp(picture(), np.eye(3), shape)


def test_without_a_shape_the_target_has_the_picture_s_or_that_of_the_maps():
    image = picture()
    assert warp(image, np.eye(3)).image.shape == image.shape
    x, y = np.meshgrid(np.arange(5, dtype=np.float32), np.arange(4, dtype=np.float32))
    for maps in ((x, y), BackwardMap.from_opencv(x, y)):
        np.testing.assert_array_equal(warp(image, maps).image, image[:4, :5])


@pytest.mark.parametrize("roi", [(-1, 0, 4, 4), (0, -1, 4, 4), (19, 0, 4, 4), (0, 15, 4, 4)])
def test_a_region_lies_within_the_target(roi):
    with pytest.raises(ValueError, match="does not lie within 22 × 18 px"):
        warp(picture(), np.eye(3), FRAME, roi=roi)


@pytest.mark.parametrize("roi", [(0, 0, 4), (0, 0, 4, 4, 1), (0.5, 0, 4, 4), (0, 0, 4, 4.5)])
def test_a_region_is_four_whole_numbers(roi):
    with pytest.raises(ValueError, match="width and height, whole numbers of px"):
        warp(picture(), np.eye(3), FRAME, roi=roi)


def test_a_region_has_at_least_one_pixel():
    with pytest.raises(ValueError, match="a target of 0 × 3 px"):
        warp(picture(), np.eye(3), FRAME, roi=(1, 1, 0, 3))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.zeros((3, 3)), "no inverse"),
        (np.ones((3, 3)), "no inverse"),
        (np.full((3, 3), np.nan), "finite"),
        (np.diag([1, np.inf, 1]), "finite"),
        (np.eye(2), r"\(3, 3\), or \(2, 3\)"),
        (np.eye(4), r"\(3, 3\), or \(2, 3\)"),
        (np.eye(3).ravel(), r"\(3, 3\), or \(2, 3\)"),
        ("1,0,0,0,1,0,0,0,1", r"\(3, 3\), or \(2, 3\)"),
        (np.eye(3) * 1j, r"\(3, 3\), or \(2, 3\)"),
    ],
)
def test_a_matrix_that_maps_nothing_is_refused(matrix, message):
    with pytest.raises(ValueError, match=message):
        warp(picture(), matrix, FRAME)


@pytest.mark.parametrize("dtype", ["object", "datetime64[s]", "S3"])
def test_other_types_of_picture_are_refused(dtype):
    with pytest.raises(TypeError, match=r"a picture of .*; its values must be real or complex"):
        warp(np.zeros((4, 4), dtype), PERSPECTIVE, FRAME)


@pytest.mark.parametrize(
    "shape", [(0, 4), (4, 0, 3), (4,), (0, 4, 4, 3), (2, 4, 0, 3), (1, 2, 4, 4, 3)]
)
def test_other_shapes_of_picture_are_refused(shape):
    with pytest.raises(ValueError, match=r"a picture is|a batch has one picture or more"):
        warp(np.zeros(shape), PERSPECTIVE, FRAME)


@pytest.mark.parametrize(
    ("choice", "known"),
    [
        ({"method": "hybird"}, "did you mean 'hybrid'.*bilinear.*paper"),
        ({"filter": "gauss"}, "known filters: area, box"),
        ({"interpolation": "linearly"}, "known interpolations: area-spline, bilinear"),
    ],
)
def test_an_unknown_plugin_is_answered_with_the_known_ones(choice, known):
    with pytest.raises(LookupError, match=known):
        warp(picture(), PERSPECTIVE, FRAME, **choice)


@pytest.mark.parametrize(
    ("choice", "known"),
    [
        ({"edge": "torus"}, "'torus'; known: transparent, clamp, wrap, mirror"),
        ({"convention": "cv2"}, "'cv2'; known: corner, opencv"),
        ({"alpha": "yes"}, "'yes'; known: straight, premultiplied, none"),
        ({"quality": 0.5}, "between 1 and 16, not at 0.5"),
        ({"interpolation": 3}, "known interpolations: area-spline, bilinear"),
    ],
)
def test_an_unknown_choice_is_answered_with_the_known_ones(choice, known):
    with pytest.raises(ValueError, match=known):
        warp(picture(), PERSPECTIVE, FRAME, **choice)


@pytest.mark.parametrize("method", sorted(set(registry.names("methods")) - {"oiio"}))
def test_a_choice_that_a_method_does_not_know_is_refused(method):
    known = registry.parameters(registry.load("methods", method))
    choices = {"filter": "gaussian", "interpolation": "bilinear", "quality": 2.0, "total": True}
    for name in choices.keys() - known.keys():
        with pytest.raises(ValueError, match=f"{method} takes no {name}; hybrid does"):
            warp(picture(), PERSPECTIVE, FRAME, method, **{name: choices[name]})


@pytest.mark.parametrize("said", [{"inverse": True}, {"convention": "opencv"}])
def test_what_is_said_about_a_matrix_does_not_go_with_a_geometry(said):
    with pytest.raises(ValueError, match="apply to a matrix, not to a geometry"):
        warp(picture(), Homography(PERSPECTIVE), FRAME, **said)


@pytest.mark.parametrize("roi", [None, (0, 0, 2, 2)])
def test_a_backward_map_is_as_large_as_the_target(roi):
    geometry = backward_map(PERSPECTIVE, (18, 21))
    with pytest.raises(
        ValueError, match=r"a map of \(18, 21\) does not fit a target of \(18, 22\)"
    ):
        warp(picture(), geometry, FRAME, roi=roi)


def test_a_forward_map_is_as_large_as_the_source():
    with pytest.raises(
        ValueError, match=r"a map of \(15, 16\) does not fit a source of \(15, 17\)"
    ):
        warp(picture(), forward_map(PERSPECTIVE, (15, 16)), FRAME)
