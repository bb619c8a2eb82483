import math

import numpy as np
import pytest

from resample.cameras.models import Camera
from resample.cameras.pixels import distorted_places, pixel_centers
from resample_warp3d.depth.equation import between, inverse, warp_places
from resample_warp3d.sheet.filling import bridged
from resample_warp3d.sheet.kernels import bridging
from resample_warp3d.types import Hole, Rendered
from resample_warp3d.warping import warp
from tests.kernels import run_in_python
from tests.warp3d.naive_sheet import camera_at

SHAPE = 64, 64
SOURCE = camera_at()
NEAR, FAR = 2.0, 4.0
CARD = np.s_[20:44, 24:40]
UNKNOWN = np.s_[50:60, 4:14]
RED, GRAY = (0.9, 0.1, 0.1), (0.4, 0.5, 0.6)


def scene():
    """Color and depth of a red card before a gray wall, a part of which has no depth."""
    color, depth = np.full((*SHAPE, 3), GRAY, np.float32), np.full(SHAPE, FAR)
    color[CARD], depth[CARD] = RED, NEAR
    depth[UNKNOWN] = np.nan
    return color, depth


def seen_from(x):
    """The scene from x to the right: the card moves by 32 px per unit, the wall by 16."""
    return warp(*scene(), SOURCE, camera_at((x, 0, 0)), step=0.0)


def row_of(coverage, nearness):
    """Rendered picture of five equal rows, whose color is half the nearness."""
    coverage = np.tile(np.float32(coverage), (5, 1))
    nearness = np.tile(np.float32(nearness), (5, 1)) * (coverage > 0)
    image = (0.5 * nearness * coverage)[..., None]
    return Rendered(image, coverage, nearness, np.ones_like(coverage), np.zeros((5, 12), bool))


@pytest.mark.parametrize("width", [1, 2])
def test_a_narrow_gap_is_filled_from_the_farther_side(width):
    nearness = np.where(np.arange(12) < 5, 2.0, 1.0)
    is_gap = (np.arange(12) >= 5) & (np.arange(12) < 5 + width)
    given = bridged(row_of(~is_gap, nearness))
    np.testing.assert_array_equal(given.image[2, :, 0], np.where(is_gap, 0.5, 0.5 * nearness))
    np.testing.assert_array_equal(given.nearness[2], np.where(is_gap, 1.0, nearness))
    np.testing.assert_array_equal(given.coverage, 1)
    np.testing.assert_array_equal(given.bridged, np.broadcast_to(is_gap, (5, 12)))


def test_a_narrow_gap_in_one_surface_is_filled_from_both_sides():
    given = bridged(row_of(np.arange(12) != 5, 1 + 0.001 * np.arange(12)))
    assert given.image[2, 5, 0] == pytest.approx(0.5 * 1.005, rel=1e-6)


@pytest.mark.parametrize("width", [3, 4, 6])
def test_a_wide_gap_stays(width):
    is_gap = (np.arange(12) >= 3) & (np.arange(12) < 3 + width)
    given = bridged(row_of(~is_gap, np.ones(12)))
    np.testing.assert_array_equal(given.coverage, np.broadcast_to(~is_gap, (5, 12)))
    assert not given.bridged.any()
    assert not given.image[:, is_gap].any()


def test_a_narrow_column_of_holes_is_filled_as_a_narrow_row():
    row = row_of(np.arange(12) != 5, np.where(np.arange(12) < 5, 2.0, 1.0))
    column = Rendered(*(np.ascontiguousarray(part.swapaxes(0, 1)) for part in row))
    expected = bridged(row)
    given = bridged(column)
    np.testing.assert_array_equal(given.image, expected.image.swapaxes(0, 1))


def test_what_is_covered_in_part_keeps_its_part():
    coverage = np.where(np.arange(12) == 5, 0.75, 1.0)
    nearness = np.where(np.arange(12) < 6, 2.0, 1.0)
    given = bridged(row_of(coverage, nearness))
    # Three quarters of the near surface (1.0), a quarter of the far one (0.5).
    assert given.image[2, 5, 0] == pytest.approx(0.875)
    assert given.coverage[2, 5] == 1
    assert given.nearness[2, 5] == 2
    assert not given.bridged.any()


def test_a_gap_at_the_frame_has_one_side_only_and_stays():
    given = bridged(row_of(np.arange(12) < 11, np.ones(12)))
    assert not given.coverage[:, 11].any()


def test_an_empty_picture_stays_empty():
    given = bridged(row_of(np.zeros(12), np.ones(12)))
    assert not given.coverage.any()
    assert not given.bridged.any()


def test_a_gap_that_the_view_opens_is_a_crack_of_the_walls_color():
    given = seen_from(0.07)  # a gap of 1.1 px
    gap = given.holes[22:42] == Hole.CRACK
    assert gap.any(axis=1).all()
    wall = np.broadcast_to(GRAY, (gap.sum(), 3))
    np.testing.assert_allclose(given.image[22:42][gap], wall, atol=0.02)
    np.testing.assert_allclose(given.depth[22:42][gap], FAR, rtol=1e-3)


def test_what_the_card_hid_is_disoccluded():
    given = seen_from(0.5)  # the card's right side moves to 24, the wall behind it to 32
    assert (given.holes[22:42, 26:31] == Hole.DISOCCLUDED).all()
    assert not given.coverage[22:42, 26:31].any()
    assert (given.holes[22:42, 10:22] == Hole.NONE).all()


def test_beyond_the_sources_frame_is_outside():
    given = seen_from(0.5)  # the wall's end moves to 56
    beyond = given.holes[2:-2, 58:]
    assert (beyond == Hole.OUTSIDE).all()
    assert not (given.holes[2:-2, :54] == Hole.OUTSIDE).any()


def test_what_had_no_depth_has_none():
    given = seen_from(0.1)
    rows, columns = UNKNOWN
    moved = np.s_[rows.start + 1 : rows.stop - 1, columns.start : columns.stop - 4]
    assert (given.holes[moved] == Hole.NO_DEPTH).all()
    assert (given.holes == Hole.NO_DEPTH).sum() <= 110


def test_holes_are_where_nothing_is_and_cracks_where_something_was_put():
    given = seen_from(0.5)
    is_hole = np.isin(given.holes, [Hole.DISOCCLUDED, Hole.OUTSIDE, Hole.NO_DEPTH])
    np.testing.assert_array_equal(is_hole, given.coverage == 0)
    assert np.isinf(given.depth[is_hole]).all()
    # A box is 1e-5 px wider than its cell.
    assert np.isfinite(given.depth[given.coverage > 1e-3]).all()
    assert (given.coverage[given.holes == Hole.CRACK] == 1).all()


def test_cracks_are_less_sure_than_what_was_seen():
    given = seen_from(0.07)
    confidence = given.confidence[22:42]
    crack = given.holes[22:42] == Hole.CRACK
    assert confidence[crack].max() <= 0.5
    assert np.median(confidence[~crack]) > 0.9


@pytest.mark.parametrize("distortion", [None, (0.1, 0.0, 0.0, 0.0), (-0.15, 0.02, 0.01, -0.01)])
@pytest.mark.parametrize("roll", [0.0, 0.3])
def test_every_hole_is_what_the_source_shows_at_its_place_on_the_wall(distortion, roll, record):
    source = Camera.from_intrinsics(64, 64, 32, 32, distortion=distortion)
    target = camera_at((0.5, 0.1, -0.4), 0.05, roll)
    color, depth = scene()
    given = warp(color, depth, source, target, step=0.0)
    # A plane z = FAR of the source, as near as the target sees it along each of its rays.
    equation = between(source, target)
    place = pixel_centers(SHAPE)
    ray = np.concatenate([place, np.ones((*SHAPE, 1))], axis=2) @ np.linalg.inv(target.matrix).T
    turned = ray @ target.world_to_camera[:3, :3]
    eye = -target.world_to_camera[:3, :3].T @ target.world_to_camera[:3, 3]
    nearness = turned[..., 2] / (FAR - eye[2])
    back, _ = warp_places(inverse(equation), place, nearness)
    column, row = np.moveaxis(np.floor(distorted_places(source, back)), 2, 0)
    is_inside = (column >= 0) & (column < 64) & (row >= 0) & (row < 64)
    known = np.isfinite(depth)[
        np.where(is_inside, row, 0).astype(int), np.where(is_inside, column, 0).astype(int)
    ]
    expected = np.where(known, Hole.DISOCCLUDED, Hole.NO_DEPTH)
    expected = np.where(is_inside, expected, Hole.OUTSIDE)
    # How far a hole is, what is in its row tells.
    is_hole = (given.coverage == 0) & given.coverage.any(axis=1, keepdims=True)
    assert is_hole.mean() > 0.1
    # At the borders of what is known and of the frame, pixels' centers decide by rounding.
    record.error("wrong causes", (given.holes != expected)[is_hole])


def test_a_camera_beyond_everything_sees_nothing_of_it():
    given = warp(*scene(), SOURCE, camera_at((0, 0, 5.0)))
    assert not given.coverage.any()
    assert (given.holes != Hole.NONE).all()
    assert not given.image.any()


def test_a_camera_that_looks_away_sees_what_is_outside():
    given = warp(*scene(), SOURCE, camera_at((0, 0, 0), math.pi))
    assert (given.holes == Hole.OUTSIDE).all()


def test_pixels_are_reached_in_narrow_gaps_and_as_far_as_surfaces_may_extend(rng, monkeypatch):
    """Gaps of up to two pixels in four directions; surfaces along rows and columns."""
    run_in_python(monkeypatch, bridging)
    grown, (height, width) = bridging.GROWN, (9, 14)
    reach = np.zeros((height + 2 * grown, width + 2 * grown), np.uint8)
    inside = rng.integers(1, grown + 2, (height, width)) * (rng.uniform(size=(height, width)) < 0.2)
    reach[grown:-grown, grown:-grown] = inside
    for row in range(height):
        reached = np.full(width, 9, np.uint8)
        bridging._find_reached(reach, row, reached)
        for column in range(width):
            r, c = row + grown, column + grown
            gaps = [
                reach[r + a * dr, c + a * dc] and reach[r - b * dr, c - b * dc]
                for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1))
                for a, b in ((1, 1), (1, 2), (2, 1))
            ]
            rims = [
                reach[r + dr * n, c + dc * n] > n
                for n in range(1, grown + 1)
                for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0))
            ]
            assert reached[column] == (any(gaps) or any(rims))
