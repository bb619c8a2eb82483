"""Labels: copied as they are, by the texel at a pixel's center or by what covers the most of it."""

from fractions import Fraction

import numpy as np
import pytest

from resample_labels import Majority, codes_of
from resample_texture import BackwardMap, Edge, ForwardMap, Homography, warp
from resample_texture.geometry.mappings import source_coordinates

VIEWS = {
    "shrunk": np.array([[0.31, 0.04, 1.0], [-0.03, 0.27, 2.0], [0.0, 0.0, 1.0]]),
    "perspective": np.array([[0.31, 0.04, 1.0], [-0.03, 0.27, 2.0], [0.004, 0.006, 1.0]]),
    "grown": np.array([[3.1, 0.4, 1.0], [-0.3, 2.7, 2.0], [0.01, 0.02, 1.0]]),
    "turned": np.array([[0.0, -0.5, 21.0], [0.7, 0.0, 1.0], [0.0, 0.0, 1.0]]),
    "floor": np.array([[1.0, 11.0, -20.0], [0.0, 10.0, 30.0], [0.0, 1.0, 0.2]]),
}
SHAPE = (20, 22)
DTYPES = ["bool", "uint8", "int16", "uint16", "int32", "int64", "uint64", "float32", "float64"]
PARTS = 16  # per side of a pixel


def labels(dtype="int64", height=40, width=44, count=7):
    numbers = np.random.default_rng(7).integers(0, count, (height // 2, width // 2))
    numbers = np.kron(numbers, np.ones((2, 2), np.int64))
    numbers[::5] = np.random.default_rng(8).integers(0, count, numbers[::5].shape)
    if dtype == "bool":
        return numbers % 2 == 0
    return (numbers + (10**12 if dtype in ("int64", "uint64") else 0)).astype(dtype)


def counted(image, matrix, edge):
    """Shares of pixels by label (L, h, w), from 16 × 16 places in each; and the labels."""
    fine = warp(image, np.diag([PARTS, PARTS, 1.0]) @ matrix, (SHAPE[0] * PARTS, SHAPE[1] * PARTS),
                "nearest", edge=edge)  # fmt: skip
    known = np.unique(image)
    is_one = (fine.image == known[:, None, None]) & (fine.coverage > 0)
    split = is_one.reshape(len(known), SHAPE[0], PARTS, SHAPE[1], PARTS)
    return split.mean(axis=(2, 4)), known


@pytest.mark.parametrize("edge", [*Edge, "reflect-101"])
@pytest.mark.parametrize("view", VIEWS)
def test_the_nearest_texel_is_the_one_at_the_pixel_s_center(view, edge):
    image = labels()
    warped = warp(image, VIEWS[view], SHAPE, "nearest", edge=edge)
    x, y = source_coordinates(Homography(VIEWS[view]), SHAPE, image.shape)
    for row, column in np.ndindex(SHAPE):
        u, v = x[row, column], y[row, column]
        expected, there = 0, np.isfinite(u)
        if there:
            j, i, inside = int(np.floor(u)), int(np.floor(v)), True
            if edge == "transparent":
                inside = 0 <= j < 44 and 0 <= i < 40
            elif edge == "wrap":
                j, i = j % 44, i % 40
            elif edge == "clamp":
                j, i = min(max(j, 0), 43), min(max(i, 0), 39)
            else:
                periods = (88, 80) if edge == "mirror" else (86, 78)
                last = -1 if edge == "mirror" else 0
                j, i = j % periods[0], i % periods[1]
                j = j if j < 44 else periods[0] + last - j
                i = i if i < 40 else periods[1] + last - i
            there = inside
            expected = image[i, j] if inside else 0
        assert warped.image[row, column] == expected
        assert warped.coverage[row, column] == there


@pytest.mark.each_value
@pytest.mark.parametrize("method", ["nearest", "majority"])
@pytest.mark.parametrize("channels", [None, 1, 3, 4])
@pytest.mark.parametrize("dtype", DTYPES)
def test_no_label_is_invented(dtype, channels, method):
    image = labels(dtype)
    if channels:
        image = np.stack([np.roll(image, c, axis=c % 2) for c in range(channels)], axis=2)
    for view in VIEWS.values():
        warped = warp(image, view, SHAPE, method)
        there = warped.image[warped.coverage > 0].reshape(-1, channels or 1)
        known = set(map(tuple, image.reshape(-1, channels or 1).tolist()))
        assert set(map(tuple, there.tolist())) <= known
        assert warped.image.dtype == image.dtype


@pytest.mark.parametrize("edge", [*Edge, "reflect-101"])
@pytest.mark.parametrize("view", sorted({*VIEWS} - {"floor"}))
def test_the_majority_is_that_of_many_places_in_each_pixel(view, edge):
    image = labels()
    share, known = counted(image, VIEWS[view], edge)
    warped = warp(image, VIEWS[view], SHAPE, "majority", edge=edge)
    first, second = np.sort(share, axis=0)[[-1, -2]]
    clear = first - second > 0.1  # lines of 16 places are right to 1/16, a few of them count
    assert clear.sum() > 30
    np.testing.assert_array_equal(warped.image[clear], known[share.argmax(axis=0)][clear])
    np.testing.assert_allclose(warped.coverage, share.sum(axis=0), atol=0.05)


def clipped(polygon, a, b, c):
    """Part of a polygon where a x + b y >= c, in rational numbers."""
    kept = []
    for n, (x, y) in enumerate(polygon):
        before_x, before_y = polygon[n - 1]
        here, before = a * x + b * y - c, a * before_x + b * before_y - c
        if (here >= 0) != (before >= 0):
            t = before / (before - here)
            kept.append((before_x + t * (x - before_x), before_y + t * (y - before_y)))
        if here >= 0:
            kept.append((x, y))
    return kept


def exact_areas(image, inverse, row, column):
    """Area of each label in a pixel, in rational numbers, by clipping with every texel."""
    a, b, c = ([Fraction(float(n)) for n in line] for line in inverse)
    assert c == [0, 0, 1]
    corners = [
        (Fraction(column + x), Fraction(row + y)) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    areas = {}
    for i, j in np.ndindex(image.shape):
        part = clipped(corners, a[0], a[1], j - a[2])
        part = clipped(part, -a[0], -a[1], a[2] - j - 1)
        part = clipped(part, b[0], b[1], i - b[2])
        part = clipped(part, -b[0], -b[1], b[2] - i - 1)
        twice = sum(part[n - 1][0] * p[1] - p[0] * part[n - 1][1] for n, p in enumerate(part))
        areas[image[i, j]] = areas.get(image[i, j], 0) + abs(twice) / 2
    return areas


@pytest.mark.sweep
@pytest.mark.parametrize("inverse", [
    np.array([[1.75, 0.25, -1.0], [-0.5, 2.25, 1.5], [0, 0, 1]]),
    np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0, 0, 1]]),  # ties
    pytest.param(
        np.array([[1.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0, 0, 1]]),
        marks=pytest.mark.sweep,
    ),
])  # fmt: skip
def test_the_majority_is_exact(inverse):
    image = np.random.default_rng(7).integers(-2, 2, (10, 11)).astype(np.int8)
    warped = warp(image, inverse, (5, 6), "majority", inverse=True)
    ties = 0
    for row, column in np.ndindex(5, 6):
        areas = {k: v for k, v in exact_areas(image, inverse, row, column).items() if v > 0}
        if not areas:
            assert warped.coverage[row, column] == 0
            continue
        most = max(areas.values())
        best = sorted(label for label, area in areas.items() if area == most)
        ties += len(best) > 1
        assert warped.image[row, column] == best[0]
        np.testing.assert_allclose(
            warped.coverage[row, column], float(sum(areas.values())), rtol=1e-6
        )
    assert ties > 0 or inverse[0, 0] != 2.0


def test_the_majority_of_a_map_is_that_of_its_homography():
    image = labels()
    for view in ("shrunk", "grown", "turned"):
        by_matrix = warp(image, VIEWS[view], SHAPE, "majority")
        places = BackwardMap(*source_coordinates(Homography(VIEWS[view]), SHAPE))
        by_map = warp(image, places, SHAPE, "majority")
        if view == "grown":  # perspective; a map is linear within each pixel
            assert (by_map.image == by_matrix.image).mean() > 0.97
            continue
        same = by_map.image == by_matrix.image
        assert same.mean() > 0.995  # ties go by rounding
        np.testing.assert_allclose(by_map.coverage, by_matrix.coverage, atol=1e-6)


def test_pixels_that_see_a_plane_up_to_the_horizon_show_its_most_frequent_label():
    image = np.zeros((8, 8), np.uint8)
    image[:3] = 9
    warped = warp(image, VIEWS["floor"], (24, 22), "majority", edge="wrap")
    assert warped.coverage[12:].all()
    assert (warped.image[10][warped.coverage[10] > 0] == 0).all()


@pytest.mark.parametrize("masked", [True, False])
def test_missing_labels_do_not_count(masked):
    image = np.array([[1, 1, 2, 2], [3, 1, 2, 2], [1, 1, 5, 5], [1, 1, 5, 4]], np.float32)
    lost = image == 1
    given = np.ma.MaskedArray(image, lost) if masked else np.where(lost, np.nan, image)
    warped = warp(given, np.diag([0.5, 0.5, 1.0]), (2, 2), "majority")
    np.testing.assert_array_equal(warped.coverage, [[0.25, 1.0], [0.0, 1.0]])
    nothing = 0 if masked else np.nan
    np.testing.assert_array_equal(np.ma.getdata(warped.image), [[3, 2], [nothing, 5]])
    if masked:
        np.testing.assert_array_equal(warped.image.mask, [[False, False], [True, False]])


def test_labels_are_counted_in_their_order():
    for image in (labels("int16"), labels("float64") - 3.5, labels("uint64") * 7**5, -labels()):
        code, count = codes_of(image)
        order = np.argsort(image.ravel(), kind="stable")
        np.testing.assert_array_equal(np.sort(code.ravel()), code.ravel()[order])
        assert code.max() < count


def test_channels_are_one_label():
    image = np.array([[[1, 2], [1, 3]], [[2, 2], [1, 3]]], np.int32)
    warped = warp(image, np.diag([0.5, 0.5, 1.0]), (1, 1), "majority")
    np.testing.assert_array_equal(warped.image, [[[1, 3]]])


def test_threads_find_the_same_labels():
    one, two = (warp(labels(), VIEWS["shrunk"], SHAPE, "majority", threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.image, two.image)


@pytest.mark.parametrize("method", ["nearest", "majority"])
def test_a_forward_map_is_refused(method):
    forward = ForwardMap(np.zeros((40, 44)), np.zeros((40, 44)))
    with pytest.raises(ValueError, match=f"{method} takes a matrix or a backward map"):
        warp(labels(), forward, SHAPE, method)


def test_the_role_of_a_method_is_played_too():
    source = labels("float32")[..., None]
    warped = Majority()(source, Homography(VIEWS["shrunk"]), SHAPE, Edge.TRANSPARENT)
    assert warped.image.shape == (*SHAPE, 1)
    np.testing.assert_allclose(warped.image[..., 0] >= 0, True)
