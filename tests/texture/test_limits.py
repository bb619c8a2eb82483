"""Limits of overshoot, against their definition in NumPy."""

import numpy as np
import pytest
from scipy.ndimage import convolve1d

from resample.profiles.interpolation import (
    AreaSpline,
    InterpolatingLanczos,
    Spline,
    exact_prefilter,
    side_weights,
)
from resample_texture import BackwardMap, warp
from resample_texture.geometry.mappings import Homography, source_coordinates
from tests.bits import assert_threads_change_nothing

SHAPE = (40, 44)
EXCESS = {"range": 0.0, "peaks": 1.0}
MODES = {"mirror": "symmetric", "clamp": "edge", "wrap": "wrap", "transparent": "symmetric"}
BEYOND = 70  # texels of the continued plane


def noise(height=21, width=24, channels=3):
    return np.random.default_rng(3).random((height, width, channels)).astype(np.float32)


def about(angle, scale, tilt=0.0):
    turn = np.radians(angle)
    cosine, sine = scale * np.cos(turn), scale * np.sin(turn)
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [tilt, 0.5 * tilt, 1.0]])
    there = np.array([[1.0, 0.0, SHAPE[1] / 2], [0.0, 1.0, SHAPE[0] / 2], [0.0, 0.0, 1.0]])
    back = np.array([[1.0, 0.0, -12.0], [0.0, 1.0, -10.5], [0.0, 0.0, 1.0]])
    return there @ matrix @ back


def limits(source, u, v, edge, excess):
    """Least and greatest values (N, C) at places, from samples of the continued plane."""
    plane = np.pad(source.astype(float), ((BEYOND,) * 2, (BEYOND,) * 2, (0, 0)), MODES[edge])
    middle = plane[2:-2, 2:-2]
    above = np.maximum(0.0, [stands_out(plane, axis) for axis in (0, 1)]).max(axis=0)
    below = np.maximum(0.0, [stands_out(-plane, axis) for axis in (0, 1)]).max(axis=0)
    corners = [(slice(n, -1 + n or None), slice(m, -1 + m or None)) for n in (0, 1) for m in (0, 1)]
    low = np.min([middle[at] for at in corners], axis=0)
    high = np.max([middle[at] for at in corners], axis=0)
    low = low - excess * np.mean([below[at] for at in corners], axis=0)
    high = high + excess * np.mean([above[at] for at in corners], axis=0)
    x, y = u + BEYOND - 3, v + BEYOND - 3  # corners of the middle lie within it
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    x, y = (x - column)[:, None], (y - row)[:, None]

    def between(values):
        upper = (1 - x) * values[row, column] + x * values[row, column + 1]
        lower = (1 - x) * values[row + 1, column] + x * values[row + 1, column + 1]
        return (1 - y) * upper + y * lower

    return between(low), between(high)


def stands_out(plane, axis):
    """By how much samples are above both neighbours, within twice the steps behind those."""
    far, near, middle, after, beyond = (np.roll(plane, -n, axis) for n in range(-2, 3))
    ground = np.minimum(np.abs(near - far), np.abs(after - beyond))
    return np.min([middle - near, middle - after, 2.0 * ground], axis=0)[2:-2, 2:-2]


def across(plane, axis, along, over, extent):
    """Means (N, C) of splines across an axis, interpolated linearly along it."""
    plane = plane if axis == 1 else plane.swapaxes(0, 1)
    spline = AreaSpline()
    coefficients = convolve1d(plane, exact_prefilter(spline), axis=0)
    first, weight = side_weights(spline, over - 0.5 * extent, over + 0.5 * extent)
    before = np.floor(along - 0.5).astype(int)
    part = (along - 0.5 - before)[:, None, None]
    rows = first[:, None] + np.arange(weight.shape[1])
    lines = [coefficients[rows, (before + n)[:, None]] for n in (0, 1)]
    return ((1 - part) * lines[0] + part * lines[1]).swapaxes(1, 2) @ weight[..., None]


def straightened(source, free, u, v, extents, edge, excess):
    """What an area spline gives at places, near what it gives across straight edges."""
    plane = np.pad(source.astype(float), ((BEYOND,) * 2, (BEYOND,) * 2, (0, 0)), MODES[edge])
    low, high = limits(source, u, v, edge, excess)
    x, y = u + BEYOND, v + BEYOND
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    changes = []
    for axis, along, over, extent in ((1, x, y, extents[1]), (0, y, x, extents[0])):
        # At corners, how much samples vary along an axis in both rows beside, on the calmer side
        step = np.abs(plane - np.roll(plane, 1, axis))
        step = np.maximum(step, np.roll(step, 1, 1 - axis))
        at = np.maximum(step, np.minimum(np.roll(step, 1, axis), np.roll(step, -1, axis)))
        s, t = (x - column)[:, None], (y - row)[:, None]
        upper = (1 - s) * at[row, column] + s * at[row, column + 1]
        lower = (1 - s) * at[row + 1, column] + s * at[row + 1, column + 1]
        vary = (1 - t) * upper + t * lower
        tolerance = 2 * vary + 256 * np.maximum(vary - (high - low) / 128, 0)
        middle = across(plane, axis, along, over, extent)[..., 0]
        change = np.clip(free, middle - tolerance, middle + tolerance) - free
        changes.append(np.where(tolerance < high - low, change, 0.0))
    return free + np.maximum(0, changes).max(axis=0) + np.minimum(0, changes).min(axis=0)


VIEWS = {
    "grown": about(10.0, 3.1, 1e-3),
    "turned": about(7.0, 1.0),
    "by 45": about(45.0, 0.8),
    "small": about(0.0, 0.6),
}


def check(source, matrix, edge, limit, interpolation):
    kept = warp(source, matrix, SHAPE, edge=edge, interpolation=f"{interpolation}:limit={limit}")
    free = warp(source, matrix, SHAPE, edge=edge, interpolation=f"{interpolation}:limit=none")
    u, v = source_coordinates(Homography(matrix), SHAPE, source.shape[:2])
    near = np.isfinite(u) & (np.abs(u - 12) < BEYOND) & (np.abs(v - 12) < BEYOND)
    if edge == "transparent":
        near &= kept.coverage == 1
        np.testing.assert_array_equal(kept.coverage, free.coverage)
    low, high = limits(source, u[near], v[near], edge, EXCESS[limit])
    steps = [np.gradient(each.reshape(SHAPE)) for each in (u, v)]
    extents = [np.hypot(*each).ravel()[near.ravel()] for each in steps]
    expected = straightened(
        source, free.image[near], u[near], v[near], extents, edge, EXCESS[limit]
    )
    expected = np.clip(expected, low, high)
    assert near.mean() > 0.05
    # Places are kept in float64, but a pixel that leans is cut at its middle to second order.
    np.testing.assert_allclose(kept.image[near], expected, atol=2e-3)
    assert np.abs(kept.image[near] - expected).mean() < 1e-5


@pytest.mark.some(1)
@pytest.mark.parametrize("edge", MODES)
@pytest.mark.parametrize("view", VIEWS)
def test_pixels_are_kept_within_the_limits(view, edge):
    check(noise(), VIEWS[view], edge, "peaks", "area-spline")


@pytest.mark.parametrize("limit", EXCESS)
@pytest.mark.parametrize(
    "interpolation", ["area-spline:degree=3", "lanczos:a=3", "spline:degree=5"]
)
def test_other_interpolations_are_limited_too(interpolation, limit):
    name, _, choice = interpolation.partition(":")
    source = noise()
    kept, free = (
        warp(
            source,
            VIEWS["turned"],
            SHAPE,
            edge="mirror",
            interpolation=f"{name}:{choice},limit={each}",
        )
        for each in (limit, "none")
    )
    u, v = (each.ravel() for each in source_coordinates(Homography(VIEWS["turned"]), SHAPE))
    low, high = limits(source, u, v, "mirror", EXCESS[limit])
    expected = np.clip(free.image.reshape(-1, 3), low, high).reshape(free.image.shape)
    np.testing.assert_allclose(kept.image, expected, atol=1e-5)


@pytest.mark.parametrize("channels", [1, 2, 4, 60, pytest.param(20_000, marks=pytest.mark.sweep)])
def test_any_number_of_channels_is_limited(channels):
    source = np.tile(noise(6, 7, 1), (1, 1, channels))
    one, all_ = (
        warp(each, about(9.0, 4.0), (12, 14), edge="clamp", axis=-1).image
        for each in (source[..., :1], source)
    )
    np.testing.assert_allclose(all_, np.tile(one, (1, 1, channels)), atol=1e-6)


def test_a_map_that_leads_anywhere_is_limited():
    source, rng = noise(300, 400, 1), np.random.default_rng(4)
    v, u = np.mgrid[0:64, 0:64] + 0.5
    jump = np.where(v > 32, 300.0, 0.0)  # two parts of a tile, too far apart for one part
    geometry = BackwardMap(u + jump, v + np.where(u > 20, 200.0, 0.0) + rng.random((64, 64)) * 0.2)
    found, free = (
        warp(
            source, geometry, (64, 64), edge="mirror", interpolation=f"area-spline:limit={each}"
        ).image
        for each in ("peaks", "none")
    )
    low, high = limits(source, geometry.x.ravel(), geometry.y.ravel(), "mirror", 1.0)
    expected = np.clip(free.reshape(-1, 1), low, high).reshape(free.shape)
    inner = np.ones((64, 64), bool)
    inner[31:34], inner[:, 19:22] = False, False  # pixels at the tears
    np.testing.assert_allclose(found[inner], expected[inner], atol=5e-3)
    assert np.mean(found != free) > 1e-3


def test_hard_edges_do_not_ring():
    checker = np.kron(np.indices((6, 6)).sum(axis=0) % 2, np.ones((4, 4), np.float32)) * 0.5 + 0.2
    image = warp(checker, about(8.0, 9.0), (200, 200), edge="mirror").image
    assert image.min() > 0.2 - 1e-6
    assert image.max() < 0.7 + 1e-6
    rings = warp(
        checker, about(8.0, 9.0), (200, 200), edge="mirror", interpolation="area-spline:limit=none"
    )
    assert rings.image.max() > 0.8


def squares(size=8, count=8, levels=(0, 255)):
    y, x = np.mgrid[: size * count, : size * count] // size
    return np.array(levels, np.uint8)[(x + y) % 2]


@pytest.mark.some(1)
@pytest.mark.parametrize("lean", [0.0, 1e-6])  # by sums along the axes, and pixel by pixel
@pytest.mark.parametrize("is_across", [False, True])
def test_a_straight_edge_stays_straight(is_across, lean):
    matrix = np.array([[8.0, lean, 0.6], [0.0, 8.0, 0.6], [0.0, 0.0, 1.0]])
    picture = warp(squares(), matrix, (512, 512), edge="mirror").image.astype(int)
    picture = picture.T if is_across else picture
    beside = picture[185:201, 201:249]  # a texel from the corners of a square of 193 to 257
    assert np.ptp(beside, axis=1).max() <= 1
    assert 210 < beside[5, 0] < 225
    assert 40 < beside[9, 0] < 60


@pytest.mark.parametrize(
    "levels", [(0, 20), (0, 60), (100, 150), (128, 200), (200, 230), (225, 255), (235, 255)]
)
def test_a_faint_straight_edge_stays_as_straight(levels):
    matrix = np.array([[8.0, 0.0, 0.6], [0.0, 8.0, 0.6], [0.0, 0.0, 1.0]])
    picture = warp(squares(levels=levels), matrix, (512, 512), edge="mirror").image.astype(int)
    assert np.ptp(picture[185:201, 201:249], axis=1).max() <= 4


@pytest.mark.some(1)
@pytest.mark.parametrize("lean", [0.0, 1e-6])
def test_edges_in_some_channels_leave_others_alone(lean):
    matrix = np.array([[5.0, lean, 0.6], [0.0, 5.0, 0.2], [0.0, 0.0, 1.0]])
    planes = [squares(6, 6), squares(4, 9)[:36, :36], np.full((36, 36), 90, np.uint8)]
    planes += [each.T for each in planes[:2]] + [255 - each for each in planes[:2]]
    together = warp(np.stack(planes, axis=-1), matrix, (180, 180), edge="mirror").image
    for n, plane in enumerate(planes):
        alone = warp(plane, matrix, (180, 180), edge="mirror").image
        np.testing.assert_allclose(together[..., n], alone, atol=1)


@pytest.mark.parametrize("scale", [(5.0, 0.0, 3.0), (5.0, 1e-6, 3.0), (0.8, -0.3, 0.9)])
@pytest.mark.parametrize("edge", ["mirror", "wrap"])
def test_a_region_with_straight_edges_has_the_bits_of_the_whole(scale, edge):
    matrix = np.array([[scale[0], scale[1], 0.6], [0.0, scale[2], 0.3], [0.0, 0.0, 1.0]])
    whole = warp(squares(), matrix, (130, 190), edge=edge)
    for left, top, width, height in [(31, 33, 66, 1), (77, 41, 113, 89)]:
        part = warp(squares(), matrix, (130, 190), edge=edge, roi=(left, top, width, height))
        here = np.s_[top : top + height, left : left + width]
        np.testing.assert_array_equal(part.image, whole.image[here])


@pytest.mark.parametrize("lean", [0.0, 0.01])
def test_threads_leave_straight_edges_alone(lean):
    matrix = np.array([[5.0, lean, 0.6], [0.0, 5.0, 0.6], [0.0, 0.0, 1.0]])
    assert_threads_change_nothing(lambda: warp(squares(), matrix, (320, 320)).image)


def test_a_leaning_edge_and_texture_are_left_alone(record):
    y, x = np.mgrid[:40, :40]
    texture = noise(40, 40, 1)[..., 0] + (x > y).astype(np.float32)
    matrix = np.array([[3.0, 0.0, 0.5], [0.0, 3.0, 0.2], [0.0, 0.0, 1.0]])
    free, kept = (
        warp(texture, matrix, (120, 120), edge="mirror", interpolation=f"area-spline:limit={each}")
        for each in ("none", "peaks")
    )
    y, x = (each.ravel() + 0.5 for each in np.mgrid[:120, :120])
    low, high = limits(texture[..., None], (x - 0.5) / 3, (y - 0.2) / 3, "mirror", 1.0)
    expected = np.clip(free.image.reshape(-1, 1), low, high).reshape(free.image.shape)
    record.error("wrong pixels", np.abs(kept.image - expected) > 1e-4)


def test_nothing_is_darker_than_black_beside_a_lamp():
    hdr = np.full((30, 30, 3), 0.01, np.float32)
    hdr[12:18, 12:18] = 5000.0
    image = warp(hdr, about(20.0, 1.7), (60, 60), edge="clamp", linear_light=False).image
    assert image.min() > 0.0099
    assert image.max() < 5000.5


def test_a_line_stands_out_and_has_no_halos():
    line = np.zeros((15, 15), np.float32)
    line[:, 6:9] = 0.3, 1.0, 0.3
    zoom = np.diag([8.0, 8.0, 1.0])
    free, peaks, kept = (
        warp(line, zoom, (120, 120), edge="mirror", interpolation=f"area-spline:limit={each}").image
        for each in ("none", "peaks", "range")
    )
    assert free.max() == pytest.approx(peaks.max(), abs=1e-6)
    assert peaks.max() > 1.1
    assert kept.max() == 1.0
    assert free.min() < -0.01
    assert peaks.min() == kept.min() == 0.0


def test_what_is_drawn_with_hard_edges_keeps_its_levels():
    drawing = np.full((15, 15), 0.2, np.float32)
    drawing[:, 7] = 1.0
    image = warp(drawing, about(20.0, 6.0), (120, 120), edge="mirror").image
    assert 0.2 - 1e-6 < image.min() < image.max() < 1 + 1e-6


@pytest.mark.some(1)
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("is_across", [False, True])
def test_long_pixels_are_kept_within_the_mean_of_limits(is_across, channels):
    source = np.repeat(np.kron(noise(8, 9, channels) > 0.5, np.ones((5, 5, 1))), 4, axis=0)
    source = source.astype(np.float32).swapaxes(0, 1) if is_across else source.astype(np.float32)
    scale = (0.2, 1.5) if is_across else (1.5, 0.2)
    matrix, shape = np.diag([*scale, 1.0]), (30, 32)
    free, kept = (
        warp(source, matrix, shape, edge="clamp", interpolation=f"area-spline:limit={each}").image
        for each in ("none", "peaks")
    )
    y, x = (each.ravel() + 0.5 for each in np.mgrid[: shape[0], : shape[1]])
    apart = (np.arange(5) + 0.5) / 5 - 0.5
    each = [
        limits(
            source,
            (x + t * is_across) / scale[0],
            (y + t * (not is_across)) / scale[1],
            "clamp",
            1.0,
        )
        for t in apart
    ]
    low, high = np.mean(each, axis=0)
    expected = np.clip(free.reshape(-1, channels), low, high).reshape(free.shape)
    assert (np.abs(expected - free) > 0.01).mean() > 0.01
    np.testing.assert_allclose(kept, expected, atol=1e-5)


def test_pixels_of_many_texels_are_what_they_were():
    source, matrix = noise(90, 90), np.diag([0.4, 0.4, 1.0])
    free = warp(
        source, matrix, (36, 36), edge="mirror", interpolation="area-spline:limit=none"
    ).image
    np.testing.assert_array_equal(warp(source, matrix, (36, 36), edge="mirror").image, free)


def test_threads_change_nothing():
    assert_threads_change_nothing(lambda: warp(noise(90, 90), about(13.0, 1.1), (150, 150)).image)


@pytest.mark.parametrize("kind", [AreaSpline, InterpolatingLanczos, Spline])
def test_a_limit_has_a_name(kind):
    with pytest.raises(
        ValueError, match="limit is one of none, range, levels, peaks, usual, not 'all'"
    ):
        kind(limit="all")


def stars():
    sky, places = np.full((96, 96), 0.1, np.float32), np.random.default_rng(0)
    sky[places.integers(0, 96, 70), places.integers(0, 96, 70)] = 1000.0
    return sky


@pytest.mark.parametrize("angle", [0.0, 7.0])
@pytest.mark.parametrize("scale", [1 / 2.1, 1 / 2.5, 1 / 3.3, 1 / 5.7, 1 / 8])
def test_between_stars_nothing_is_darker_than_black(scale, angle):
    image = warp(stars(), about(angle, scale), SHAPE, edge="mirror", linear_light=False).image
    assert image.min() >= 0.0


@pytest.mark.parametrize("scale", [(0.02, 0.4), (0.02, 1.0), (0.03, 2.0)])
def test_between_stars_that_are_squeezed_nothing_is_darker_than_black(scale):
    shape = 192, max(2, int(96 * scale[0]))
    image = warp(stars(), np.diag([*scale, 1.0]), shape, edge="mirror", linear_light=False).image
    assert image.min() >= 0.0


@pytest.mark.some(4)
@pytest.mark.parametrize("angle", [0.0, 7.0, 45.0])
@pytest.mark.parametrize("shrink", [1.5, 2.05, 2.1, 2.5, 3.3, 4.0, 6.0, 8.0])
def test_shrunk_lamps_have_no_halos_below_zero(shrink, angle):
    hdr = np.full((96, 96), 0.1, np.float32)
    hdr[32:64, 32:64] = 1000.0
    image = warp(hdr, about(angle, 1 / shrink), SHAPE, edge="mirror", linear_light=False).image
    assert image.min() >= 0.0


def test_shrunk_pictures_that_are_below_zero_stay_there():
    signed = -noise(96, 96, 1)
    for matrix in (about(0.0, 0.3), about(7.0, 0.3)):
        kept, free = (
            warp(signed, matrix, SHAPE, edge="mirror", interpolation=each).image
            for each in ("area-spline", "area-spline:limit=none")
        )
        assert free.max() < 0.0
        np.testing.assert_array_equal(kept, free)


def test_shrunk_pictures_are_kept_above_what_pixels_read_alone():
    signed, matrix = np.full((96, 96), 0.1, np.float32), np.diag([0.4, 0.4, 1.0])
    signed[32:64, 32:64], signed[:10] = 1000.0, -5.0
    free, kept = (
        warp(signed, matrix, (38, 38), edge="mirror", linear_light=False, interpolation=each).image
        for each in ("area-spline:limit=none", "area-spline")
    )
    assert free[8:].min() < -1.0
    assert kept[8:].min() >= 0.0
    np.testing.assert_array_equal(kept[:3], np.maximum(free[:3], -5.0))
