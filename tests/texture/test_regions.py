"""Regions of a target, and parts that it is drawn in, have the bits of the whole."""

from itertools import product

import numpy as np
import pytest

from resample_texture import BackwardMap, Hybrid, Points, Supersample, warp
from resample_texture import drawing as drawings

RNG = np.random.default_rng(8)
IMAGE = RNG.random((150, 210, 3)).astype(np.float32)
FRAME = 130, 190
WAYS = {
    "turned": [[0.8, -0.3, 20], [0.25, 0.9, 3], [0, 0, 1]],
    "seen aslant": [[0.7, -0.2, 30], [0.1, 0.6, 9], [4e-4, 9e-4, 1]],
    "enlarged": [[7.3, 0.4, -300], [0.2, 6.1, -200], [0, 0, 1]],
    "to the horizon": [[1.0, 0.6, 10], [0.0, 0.55, 30], [0.0, 9e-3, 0.4]],
    "made small": [[0.11, 0.02, 60], [0.01, 0.09, 50], [0, 0, 1]],
}
REGIONS = [(0, 0, 40, 40), (31, 33, 66, 1), (77, 41, 113, 89), (150, 90, 3, 7)]
EDGES = ("transparent", "clamp", "wrap", "mirror", "reflect-101")


QUICK = list(zip(WAYS, ("mirror", "clamp", "wrap", "transparent", "reflect-101"), strict=True))
MORE = [pair for pair in product(WAYS, EDGES) if pair not in QUICK]


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("way", "edge"), [*QUICK, *(pytest.param(*pair, marks=pytest.mark.sweep) for pair in MORE)]
)
def test_a_region_has_the_bits_of_the_whole(way, edge):
    whole = warp(IMAGE, WAYS[way], FRAME, edge=edge)
    for left, top, width, height in REGIONS:
        part = warp(IMAGE, WAYS[way], FRAME, edge=edge, roi=(left, top, width, height))
        here = np.s_[top : top + height, left : left + width]
        np.testing.assert_array_equal(part.image, whole.image[here])
        np.testing.assert_array_equal(part.coverage, whole.coverage[here])


@pytest.mark.some(3)
@pytest.mark.parametrize(
    "method",
    [
        Hybrid(filter="gaussian:sigma=0.5"),
        Hybrid(filter="lanczos:a=3"),
        Hybrid(filter="mitchell", interpolation="bilinear"),
        Hybrid(total=True),
        Points(),
        Supersample(),
    ],
    ids=repr,
)
@pytest.mark.parametrize("way", ["seen aslant", "to the horizon"])
def test_a_region_under_another_filter_has_the_bits_of_the_whole(way, method):
    edges = ("transparent", "clamp", "mirror") if way == "seen aslant" else ("transparent",)
    for edge in edges:
        whole = warp(IMAGE, WAYS[way], FRAME, method, edge=edge)
        for left, top, width, height in REGIONS[1:3]:
            part = warp(IMAGE, WAYS[way], FRAME, method, edge=edge, roi=(left, top, width, height))
            here = np.s_[top : top + height, left : left + width]
            np.testing.assert_array_equal(part.image, whole.image[here])
            np.testing.assert_array_equal(part.coverage, whole.coverage[here])


@pytest.mark.parametrize("edge", ["transparent", "mirror"])
def test_a_region_of_a_map_has_the_bits_of_the_whole(edge):
    y, x = np.mgrid[: FRAME[0], : FRAME[1]] + 0.5
    places = BackwardMap(x + 9 * np.sin(y / 20), 0.9 * y + 5 * np.cos(x / 30))
    whole = warp(IMAGE, places, FRAME, edge=edge)
    for left, top, width, height in REGIONS:
        part = warp(IMAGE, places, FRAME, edge=edge, roi=(left, top, width, height))
        here = np.s_[top : top + height, left : left + width]
        np.testing.assert_array_equal(part.image, whole.image[here])
        np.testing.assert_array_equal(part.coverage, whole.coverage[here])


@pytest.mark.some(1)
@pytest.mark.parametrize("way", ["turned", "seen aslant", "enlarged"])
def test_a_picture_drawn_in_parts_has_the_bits_of_one_drawn_at_once(way, monkeypatch):
    whole = warp(IMAGE, WAYS[way], FRAME)
    region = warp(IMAGE, WAYS[way], FRAME, roi=REGIONS[2])
    monkeypatch.setattr(drawings, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(drawings, "MOST_IN_WINDOW", 3000)
    parts = warp(IMAGE, WAYS[way], FRAME)
    np.testing.assert_array_equal(parts.image, whole.image)
    np.testing.assert_array_equal(parts.coverage, whole.coverage)
    part = warp(IMAGE, WAYS[way], FRAME, roi=REGIONS[2])
    np.testing.assert_array_equal(part.image, region.image)


@pytest.mark.sweep
def test_far_beyond_a_clamped_edge_is_the_outermost_texel_alone():
    tiny = [[0.02, 0.003, 15], [0.001, 0.015, 12], [0, 0, 1]]
    image = warp(IMAGE, tiny, (45, 50), edge="clamp").image
    np.testing.assert_allclose(image[0, 0], IMAGE[0, 0], atol=3e-5)  # sums of weights
    np.testing.assert_allclose(image[-1, -1], IMAGE[-1, -1], atol=3e-5)


@pytest.mark.parametrize("roi", [(32, 0, 96, 60), (0, 0, 40, 60), (600, 7, 33, 21)])
def test_a_region_of_a_tiled_picture_along_the_axes_has_the_bits_of_the_whole(roi):
    image = np.random.default_rng(0).random((40, 64)).astype(np.float32)
    matrix = [[0.9, 0, 0.3], [0, 0.8, 0.2], [0, 0, 1]]  # the whole leads far beyond the picture
    whole = warp(image, matrix, (60, 900), edge="wrap").image
    left, top, width, height = roi
    part = warp(image, matrix, (60, 900), edge="wrap", roi=roi).image
    np.testing.assert_array_equal(part, whole[top : top + height, left : left + width])
