from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.sheets import CLASSES, _classes, _spread, sheet_of
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage
from tests.warp3d import naive_sheet
from tests.warp3d.naive_sheet import EMPTY, camera_at, depth_image, flat, pattern, plane
from tests.warp3d.naive_warp import random_source

AROUND = ((0, 0), (0, 1), (1, 0), (1, 1))  # of a cell: its corners, as they are numbered


def cells_corners(sheet):
    """Corners of all cells, (H, W, 4, 3): x, y and nearness; not a number where no cell is."""
    height, width = sheet.torn.shape
    found = np.full((height, width, 4, 3), np.nan)
    for row, column in np.argwhere(sheet.torn == -1):
        for k, (down, right) in enumerate(AROUND):
            r, c = row + down, column + right
            found[row, column, k] = c, r, sheet.vertex[r, c]
    own = sheet.torn >= 0
    found[own] = sheet.corner[sheet.torn[own]]
    return found


def torn_source(rng, height=20, width=24):
    """Slanted surfaces and noise, with links as they were found and a tenth of them cut."""
    source = random_source(height, width, channels=3)
    links = source.links.copy()
    for row, column in zip(*np.nonzero(rng.random(links.shape) < 0.1), strict=True):
        if column + 1 < width:
            links[row, column] &= ~np.uint8(RIGHT)
            links[row, column + 1] &= ~np.uint8(LEFT)
        if row + 1 < height and rng.random() < 0.5:
            links[row, column] &= ~np.uint8(DOWN)
            links[row + 1, column] &= ~np.uint8(UP)
    return source._replace(links=links)


@pytest.mark.sweep
def test_linked_neighbours_share_their_corners(rng):
    source = torn_source(rng)
    corner = cells_corners(sheet_of(source))
    # Some are sums of float32, some of float64 that are rounded: 1e-5 px on the screen.
    near = {"rtol": 3e-7, "atol": 0}
    for row, column in np.argwhere(source.links & RIGHT):
        here, there = corner[row, column, 1::2], corner[row, column + 1, ::2]
        np.testing.assert_allclose(here, there, **near)
    for row, column in np.argwhere(source.links & DOWN):
        here, there = corner[row, column, 2:], corner[row + 1, column, :2]
        np.testing.assert_allclose(here, there, **near)


def test_every_sample_with_a_depth_has_a_cell_and_no_other(rng):
    source = torn_source(rng)
    sheet = sheet_of(source)
    np.testing.assert_array_equal(sheet.torn == -2, source.nearness == 0)
    own = sheet.torn[sheet.torn >= 0]
    np.testing.assert_array_equal(np.sort(own), np.arange(len(sheet.corner)))


@pytest.mark.sweep
def test_corners_are_as_near_as_the_surfaces_samples_around_them_say(rng):
    source = torn_source(rng)
    corner = cells_corners(sheet_of(source))
    for row, column in np.argwhere(source.nearness > 0):
        for k, (down, right) in enumerate(AROUND):
            expected = naive_sheet.corner_nearness(
                source.nearness.astype(float), source.links, (row + down, column + right),
                (row, column), corner[row, column, k, :2],
            )  # fmt: skip
            # float32 nearness of order 1; limbs are looked up in steps of 1e-5 samples.
            assert corner[row, column, k, 2] == pytest.approx(expected, abs=3e-6)


def test_corners_of_a_plane_lie_on_it_even_where_it_is_torn():
    y, x = np.mgrid[:24, :32] + 0.5
    nearness = 0.4 + 0.01 * x - 0.005 * y
    is_near = (x > 8) & (x < 20) & (y > 6) & (y < 15)
    both = np.where(is_near, 3 * nearness, nearness).astype(np.float32)
    sheet = sheet_of(prepare(DepthImage(np.zeros((24, 32, 3), np.float32), both, EMPTY), step=0.0))
    corner = cells_corners(sheet)
    expected = 0.4 + 0.01 * corner[..., 0] - 0.005 * corner[..., 1]
    expected *= np.where(is_near, 3, 1)[..., None]
    np.testing.assert_allclose(corner[..., 2], expected, atol=1e-6)


@pytest.mark.sweep
def test_torn_cells_stop_at_the_silhouette():
    things = [
        plane((0, 0, 1), 3.0, flat(0.9), lambda point: point[..., 0] < 0.0375),
        plane((0, 0, 1), 6.0, flat(0.1)),
    ]
    camera = camera_at(focal=24.0, shape=(24, 24))
    sheet = sheet_of(prepare(depth_image(things, camera, (24, 24)), step=0.0))
    corner = cells_corners(sheet)
    near_end, far_end = corner[:, 11, 1::2, 0], corner[:, 12, ::2, 0]
    np.testing.assert_allclose(near_end, 12.3, atol=0.02)  # 16 rays per pixel
    np.testing.assert_array_equal(near_end, far_end)


def test_no_corner_moves_by_more_than_half_a_pixel(rng):
    corner = cells_corners(sheet_of(torn_source(rng)))
    lattice = np.array([[[(c + k % 2, r + k // 2) for k in range(4)] for c in range(24)]
                        for r in range(20)])  # fmt: skip
    assert np.nanmax(np.abs(corner[..., :2] - lattice)) <= 0.5


def test_nearness_stays_above_0(rng):
    source = torn_source(rng)
    corner = cells_corners(sheet_of(source))
    assert (corner[source.nearness > 0][..., 2] > 0).all()


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 7])
def test_channels_come_in_groups_of_three_filled_up_with_zeros(channels):
    things = [plane((0, 0, 1), 3.0, pattern(channels=channels))]
    image = depth_image(things, camera_at(), (16, 16), rays=1)
    sheet = sheet_of(prepare(image))
    together = naive_sheet.colors_of(sheet)
    np.testing.assert_array_equal(together[..., :channels], image.color)
    assert not together[..., channels:].any()
    assert sheet.color.shape == (-(-channels // 3), 3, 20, 20)  # a margin of 2 around


def test_a_lens_that_only_shifts_and_scales_shifts_and_scales_all_corners(rng):
    source = torn_source(rng)
    y, x = np.mgrid[:20, :24] + 0.5
    bent = source._replace(place=np.stack([1.1 * x + 3, 0.9 * y - 2], axis=2))
    plain, given = sheet_of(source), sheet_of(bent)
    rows, columns = np.mgrid[:21, :25]
    expected = np.stack([1.1 * columns + 3, 0.9 * rows - 2], axis=2)
    np.testing.assert_allclose(given.place, expected, atol=1e-9)
    moved = plain.corner * [1.1, 0.9, 1.0] + [3, -2, 0]
    np.testing.assert_allclose(given.corner, moved, atol=1e-5)  # float32 of 30 px


def test_corners_between_bent_samples_lie_between_them():
    source = random_source(is_placed=True)
    sheet = sheet_of(source)
    for row, column in product((1, 7, 19), (1, 10, 23)):
        around = source.place[row - 1 : row + 1, column - 1 : column + 1].reshape(4, 2)
        np.testing.assert_allclose(sheet.place[row, column], around.mean(axis=0), atol=1e-12)


def test_colors_spread_to_what_is_hidden_from_all_around():
    """A hole in an even surface gets that surface's color, not that of what hides it."""
    shape, hole = (12, 14), np.s_[4:8, 5:9]
    color = np.full((*shape, 3), 0.25, np.float32)
    color[hole] = 0.75
    chosen = np.zeros(shape, np.bool_)
    chosen[hole] = True
    flat = np.ones(shape, np.float32)
    spread = _spread(color, flat, ~chosen, np.full(shape, 5 * 14 + 6), chosen)
    np.testing.assert_allclose(spread, 0.25, atol=1e-3)


def test_far_sides_are_divided_by_their_nearness():
    """Each class holds as many samples, from the farthest to the nearest."""
    nearness = np.linspace(0.1, 1.0, 120, dtype=np.float32).reshape(10, 12)
    source = SimpleNamespace(nearness=nearness, slope=np.zeros((10, 12, 2), np.float32))
    classes = _classes(source, np.ones((10, 12), np.bool_), 5.0)
    counts = [np.count_nonzero(distance == 0) for distance, *_ in classes]
    assert len(counts) == CLASSES
    assert sum(counts) == 120
    assert max(counts) - min(counts) <= 1
