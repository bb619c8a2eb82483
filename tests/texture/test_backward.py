import math
from functools import partial
from itertools import product

import cv2
import numpy as np
import pytest

import resample_texture
from resample.profiles.filters import Area, Gaussian, Tent
from resample.profiles.interpolation import (
    Bilinear,
    InterpolatingCatmullRom,
    InterpolatingGaussian,
    Nearest,
    Spline,
)
from resample_texture import BackwardMap, Edge, Homography
from resample_texture.geometry.mappings import source_coordinates
from resample_texture.texels.forward import CellGrid
from resample_texture.texels.gather import collect_from, extended
from tests.texture import naive_forward

warp = partial(resample_texture.warp, fill="premultiplied")  # what the twins give, too
GROWN = np.array([[2.3, 0.4, -1.0], [-0.3, 1.9, 2.0], [0.002, 0.003, 1.0]])
SHRUNK = np.array([[0.30, 0.04, 3.0], [-0.03, 0.29, 2.0], [0.0002, 0.0003, 1.0]])
UNEVEN = np.array([[1.9, 0.4, 3.0], [-0.03, 0.5, 2.0], [0.0002, 0.0003, 1.0]])
TABLE = 1e-3  # 1/8192 texel or 1/4096 px off, by the steps of tables, at slopes of 2 to 4


def noise(height=12, width=14, channels=2):
    return np.random.default_rng(7).random((height, width, channels), np.float32)


def grid(x, y):
    """Map of a row of x and a column of y."""
    return BackwardMap(*np.meshgrid(np.asarray(x, float), np.asarray(y, float)))


def of(matrix, shape):
    return BackwardMap(*source_coordinates(Homography(matrix), shape))


def bent(height, width):
    """A map that shrinks on the left, grows on the right, and has a hole."""
    y, x = np.mgrid[:height, :width] + 0.5
    u = 15.0 * (x / width) ** 0.5 + 0.6 * np.sin(0.9 * y) - 1.0
    v = 1.4 * y - 0.3 * x + 0.7 * np.cos(0.8 * x) + 1.0
    u[4:6, 3:5] = np.nan
    return BackwardMap(u, v)


def decibel(image, truth):
    return 10 * np.log10(1.0 / np.mean((image.astype(float) - truth) ** 2))


def naive(source, geometry, edge, cells):
    """Image and coverage by loops over pixels and their parts."""
    height, width, channels = source.shape
    rows, columns = geometry.x.shape
    around = 0 if isinstance(cells.pixel_filter, Area) else math.ceil(cells.pixel_filter.radius) + 1
    x, y = (extended(a, around + 1) for a in (geometry.x, geometry.y))
    sums = np.zeros((rows, columns, channels + 1))
    for row, column in product(range(1, x.shape[0] - 1), range(1, x.shape[1] - 1)):
        here = np.array([x[row, column], y[row, column]])
        if np.isnan(here).any():
            continue
        across = naive_steps(x[row, column - 1 : column + 2], y[row, column - 1 : column + 2])
        down = naive_steps(x[row - 1 : row + 2, column], y[row - 1 : row + 2, column])
        quality = cells.quality
        if edge is Edge.TRANSPARENT and crosses(here, across, down, (width, height)):
            quality = max(quality, 8)
        parts = [
            max(math.ceil(quality), math.ceil(np.linalg.norm(side, axis=1).max() - 1e-9))
            for side in (across, down)
        ]
        for n, m in product(range(parts[0]), range(parts[1])):
            a, b = (n + 0.5) / parts[0] - 0.5, (m + 0.5) / parts[1] - 0.5
            step_x, step_y = across[int(a > 0)], down[int(b > 0)]
            u, v = here + a * step_x + b * step_y
            if edge is Edge.TRANSPARENT and not (0 <= u <= width and 0 <= v <= height):
                continue
            weight_u = naive_forward.interpolated(u, width, edge, cells.interpolation)
            weight_v = naive_forward.interpolated(v, height, edge, cells.interpolation)
            value = np.einsum("v,vuc,u->c", weight_v, source, weight_u)
            if cells.is_sum:
                value = value * abs(step_x[0] * step_y[1] - step_x[1] * step_y[0])
            at = column - around - 0.5 + a, row - around - 0.5 + b
            shares = [spread(at[k], (columns, rows)[k], cells.pixel_filter) for k in (0, 1)]
            for (j, across_share), (i, down_share) in product(shares[0].items(), shares[1].items()):
                mass = across_share * down_share / (parts[0] * parts[1])
                sums[i, j] += mass * np.append(value, 1.0)
    return naive_forward.finished(sums, geometry, (height, width), edge, cells)


def naive_steps(x, y):
    """Steps (2, 2) to both neighbours; for a missing or torn one, the other one."""
    steps = np.diff(np.stack([x, y], axis=1), axis=0)
    for k in (0, 1):
        left, right = steps[0, k], steps[1, k]
        if np.isnan(left) or abs(left) > 8 * abs(right) + 8:
            steps[0, k] = right
        elif np.isnan(right) or abs(right) > 8 * abs(left) + 8:
            steps[1, k] = left
    return np.nan_to_num(steps)


def crosses(here, across, down, size):
    """Whether an edge of the source is in reach."""
    reach = 0.5 * (np.abs(across).max(axis=0) + np.abs(down).max(axis=0))
    near = np.minimum(np.abs(here), np.abs(here - size))
    return bool((near < reach - 1e-9).any())


def spread(at, size, pixel_filter):
    if isinstance(pixel_filter, Area):
        return {math.floor(at): 1.0}
    return naive_forward.pixel_shares(at, 0.0, size, pixel_filter)


@pytest.mark.sweep
@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize(
    "cells",
    [
        CellGrid(),
        CellGrid(Area(), Bilinear(), 3.0),
        CellGrid(Area(), Nearest(), 1.0, is_sum=True),
        CellGrid(Gaussian(0.6), Bilinear(), 2.0),
        CellGrid(Tent(1.5), InterpolatingCatmullRom(), 1.0, is_sum=True),
    ],
    ids=["default", "bilinear", "sum", "gaussian", "tent-sum"],
)
def test_pixels_are_those_of_the_obvious_loops(cells, edge):
    source, geometry = noise(), bent(9, 11)
    warped = collect_from(source, geometry, (9, 11), edge, cells)
    image, coverage = naive(source, geometry, edge, cells)
    np.testing.assert_allclose(warped.coverage, coverage, atol=TABLE)
    np.testing.assert_allclose(warped.image, image, atol=TABLE * max(1.0, image.max()))


@pytest.mark.sweep
@pytest.mark.parametrize("interpolation", [Spline(), InterpolatingGaussian()], ids=repr)
@pytest.mark.parametrize("edge", [Edge.TRANSPARENT, Edge.MIRROR, Edge.WRAP])
def test_prefiltered_interpolations_are_those_of_the_obvious_loops(edge, interpolation):
    source, geometry, cells = noise(), bent(6, 8), CellGrid(Area(), interpolation, 1.0)
    warped = collect_from(source, geometry, (6, 8), edge, cells)
    image, _ = naive(source, geometry, edge, cells)
    np.testing.assert_allclose(warped.image, image, atol=2 * TABLE)  # steeper than Catmull-Rom


@pytest.mark.parametrize("filter", ["area", "gaussian"])
@pytest.mark.parametrize("matrix", [GROWN, SHRUNK, UNEVEN], ids=["grown", "shrunk", "uneven"])
def test_a_homography_by_its_map_is_the_homography(matrix, filter, record):  # noqa: A002
    source, shape = cv2.GaussianBlur(noise(80, 90, 1)[..., 0], (0, 0), 1.2), (50, 60)
    choice = {"filter": filter, "quality": 4.0}
    straight = warp(source, matrix, shape, **choice)
    mapped = warp(source, of(matrix, shape), shape, **choice)
    record.quality("picture", decibel(mapped.image, straight.image))
    record.quality(
        "coverage", decibel(mapped.coverage, straight.coverage)
    )  # 8 parts where edges are


def test_quality_comes_closer_to_the_truth():
    source, shape = noise(60, 60, 1), (30, 30)
    matrix = np.array([[0.37, -0.31, 13.0], [0.33, 0.35, -5.0], [0.0, 0.0, 1.0]])
    fine = np.diag([12.0, 12.0, 1.0]) @ matrix
    choices = {"interpolation": "area-spline:limit=none", "edge": "mirror"}
    truth = warp(source, of(fine, (360, 360)), (360, 360), **choices).image
    truth = truth.reshape(30, 12, 30, 12, 1).mean(axis=(1, 3))
    errors = [
        decibel(warp(source, of(matrix, shape), shape, quality=q, **choices).image, truth)
        for q in (1.0, 2.0, 4.0, 8.0)
    ]
    assert errors == sorted(errors)
    assert errors[-1] > errors[0] + 20


def test_one_reading_per_pixel_is_cv2_remap():
    source = noise(30, 40, 1)[..., 0]
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:50, :60].astype(np.float32)
    x, y = 4 + 0.5 * x + 0.3 * rng.random((50, 60)), 3 + 0.45 * y + 0.3 * rng.random((50, 60))
    x, y = x.astype(np.float32), y.astype(np.float32)
    theirs = cv2.remap(source, x, y, cv2.INTER_LINEAR)
    geometry = BackwardMap.from_opencv(x, y)
    cells = CellGrid(interpolation=Bilinear(), quality=1.0)
    ours = collect_from(source[..., None], geometry, (50, 60), Edge.TRANSPARENT, cells).image
    np.testing.assert_allclose(ours[..., 0], theirs, atol=TABLE)


def test_the_identity_at_one_reading_per_pixel_is_the_picture():
    source = noise()
    ours = warp(source, grid(np.arange(14) + 0.5, np.arange(12) + 0.5), (12, 14), quality=1.0)
    np.testing.assert_allclose(ours.image, source, atol=TABLE)
    assert (ours.coverage == 1).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2)])
def test_a_picture_may_be_a_pixel_or_a_line_of_pixels(shape):
    source = noise()
    geometry = grid(np.arange(shape[1]) + 2.5, np.arange(shape[0]) + 3.5)
    for choice in ("area", "gaussian", "lanczos"):
        warped = warp(source, geometry, shape, filter=choice, quality=1.0)
        np.testing.assert_allclose(warped.coverage, 1.0, atol=1e-6)
    exact = warp(source, geometry, shape, quality=1.0).image
    expected = source[3 : 3 + shape[0], 2 : 2 + shape[1]]
    np.testing.assert_allclose(exact, expected, atol=TABLE)


def test_a_source_of_one_texel_is_a_square():
    geometry = grid((np.arange(40) + 0.5) / 10 - 1.5, (np.arange(30) + 0.5) / 10 - 0.5)
    warped = warp(np.full((1, 1), 0.7), geometry, (30, 40))
    expected = np.zeros((30, 40))
    expected[5:15, 15:25] = 1.0
    np.testing.assert_array_equal(warped.coverage, expected)
    np.testing.assert_allclose(warped.image, 0.7 * expected, atol=3e-6)


@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize("filter", ["area", "gaussian", "tent"])
def test_a_hole_in_the_map_stays_one(filter, edge):  # noqa: A002
    source = np.ones((30, 30), np.float32)
    x, y = np.meshgrid(np.arange(20) + 5.3, np.arange(20) + 4.8)
    x[6:16, 6:16] = np.nan
    warped = warp(source, BackwardMap(x, y), (20, 20), filter=filter, edge=edge)
    assert not warped.coverage[9:13, 9:13].any()
    is_far = np.ones((20, 20), bool)
    is_far[4:18, 4:18] = False
    assert (warped.coverage[is_far] == 1).all()
    np.testing.assert_allclose(warped.image, warped.coverage, atol=1e-5)
    if filter == "area":
        np.testing.assert_array_equal(warped.coverage == 1, np.isfinite(x))


def test_a_pixel_alone_among_holes_is_read():
    x, y = np.full((5, 5), np.nan), np.full((5, 5), np.nan)
    x[2, 2], y[2, 2] = 3.5, 6.5
    source = noise(channels=1)
    warped = warp(source, BackwardMap(x, y), (5, 5))
    np.testing.assert_allclose(warped.image[2, 2], source[6, 3], atol=TABLE)
    assert warped.coverage.sum() == 1


def test_a_map_of_nothing_gives_nothing():
    nothing = np.full((5, 6), np.nan)
    warped = warp(noise(), BackwardMap(nothing, nothing), (5, 6))
    assert not warped.coverage.any()
    assert not warped.image.any()


@pytest.mark.parametrize("edge", Edge)
@pytest.mark.parametrize("far", [1e10, 1e15, 1e19, -1e19, 1e300])
def test_a_map_may_lead_as_far_as_it_likes(far, edge):
    x, y = np.meshgrid(np.arange(6) + 3.5, np.arange(5) + 2.5)
    x[2, 3] = far
    source = noise(channels=1)
    warped = warp(source, BackwardMap(x, y), (5, 6), edge=edge, interpolation="bilinear")
    assert np.isfinite(warped.image).all()
    assert warped.image.max() <= source.max()
    elsewhere = warp(source, BackwardMap(x, y), (5, 6), edge=edge, quality=1.0).image
    np.testing.assert_allclose(elsewhere[:, :2], source[2:7, 3:5], atol=TABLE)


def test_the_seam_of_a_panorama_leaves_no_smeared_column():
    # The ramp makes each pixel show where it was read; a smear would read all of 0..1.
    width = 128
    angle = 2 * np.pi * (np.arange(width) + 0.5) / width
    panorama = np.tile(np.sin(angle).astype(np.float32), (32, 1))
    x = ((np.arange(100) + 0.5) * 1.28 + 40.3) % width  # jumps back by 128 in the middle
    geometry = grid(x, np.arange(20) + 3.5)
    warped = warp(panorama, geometry, (20, 100), edge="wrap")
    assert (warped.coverage == 1).all()
    np.testing.assert_allclose(warped.image[8], np.sin(2 * np.pi * x / width), atol=2e-3)


def test_a_seam_across_both_axes_leaves_the_rest_alone():
    source = noise(64, 64, 1)
    x, y = np.meshgrid((np.arange(40) * 1.5 + 20.2) % 64, (np.arange(40) * 1.5 + 30.7) % 64)
    torn = warp(source, BackwardMap(x, y), (40, 40), edge="wrap")
    whole_x, whole_y = np.meshgrid(np.arange(40) * 1.5 + 20.2, np.arange(40) * 1.5 + 30.7)
    whole = warp(source, BackwardMap(whole_x, whole_y), (40, 40), edge="wrap")
    np.testing.assert_allclose(torn.image, whole.image, atol=TABLE)


@pytest.mark.parametrize("filter", ["area", "gaussian:sigma=0.8", "lanczos"])
def test_a_frame_full_of_the_source_is_covered_up_to_its_border(filter):  # noqa: A002
    source = np.ones((60, 60), np.float32)
    geometry = of(np.array([[1.1, 0.2, -20], [-0.1, 1.2, -15], [0.001, 0.002, 1]]), (30, 32))
    warped = warp(source, geometry, (30, 32), filter=filter)
    np.testing.assert_allclose(warped.coverage, 1.0, atol=1e-6)
    np.testing.assert_allclose(warped.image, 1.0, atol=1e-5)


@pytest.mark.parametrize("edge", ["clamp", "wrap", "mirror"])
def test_a_continued_source_is_that_of_a_padded_one(edge):
    source = noise(16, 18, 1)[..., 0]
    x, y = np.meshgrid(np.linspace(-25, 40, 50), np.linspace(-22, 37, 45))
    padding = {"clamp": "edge", "wrap": "wrap", "mirror": "symmetric"}[edge]
    padded = np.pad(source, 40, mode=padding)
    expected = warp(padded, BackwardMap(x + 40, y + 40), (45, 50)).image
    ours = warp(source, BackwardMap(x, y), (45, 50), edge=edge)
    np.testing.assert_allclose(ours.image, expected, atol=TABLE)
    assert (ours.coverage == 1).all()


@pytest.mark.parametrize("minified", [3, 20, 50, 150])
def test_a_checkerboard_shrinks_to_gray(minified):
    board = (np.indices((600, 600)).sum(axis=0) % 2).astype(np.float32)
    count = 600 // minified
    at = (np.arange(count) + 0.5) * minified
    warped = warp(board, grid(at, at), (count, count))
    # Of 3 × 3 texels, 5 are of one color; for more parts than 64 a side, parts are skipped.
    np.testing.assert_allclose(warped.image, 0.5, atol=0.06 if minified == 3 else 1e-3)


def test_edges_of_the_source_are_found_to_an_eighth_of_a_pixel(record):
    geometry = grid(np.arange(20) * 2.0 - 6.3, np.arange(20) * 2.0 - 5.1)
    warped = warp(np.ones((25, 24), np.float32), geometry, (20, 20))
    # Pixel n covers 2 n − 7.3 to 2 n − 5.3.
    record.error("coverage at the left", abs(warped.coverage[10, 3] - 0.7 / 2))
    record.error("coverage at the right", abs(warped.coverage[10, 15] - 1.3 / 2))


@pytest.mark.parametrize("edge", Edge)
def test_a_map_is_as_large_as_the_picture(edge):
    with pytest.raises(ValueError, match=r"a map of \(1, 3\) does not fit a target of \(2, 3\)"):
        collect_from(noise(), grid([1, 2, 3], [1]), (2, 3), edge, CellGrid())


@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (3, 1)])
def test_totals_of_a_line_of_pixels_are_refused(shape):
    geometry = grid(np.arange(shape[1]), np.arange(shape[0]))
    with pytest.raises(ValueError, match="tells no areas, which sums need; give 2 × 2 px or more"):
        warp(noise(), geometry, shape, total=True)


def test_a_map_goes_on_as_it_ends():
    places = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 5.0]])
    np.testing.assert_array_equal(extended(places, 1)[1], [0.0, 1.0, 2.0, 4.0, 6.0])
    np.testing.assert_array_equal(extended(places, 1)[:, 1], [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(extended(places[:1], 1)[:, 2], [2.0, 2.0, 2.0])
