import numpy as np
import pytest

from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.sheets import sheet_of
from resample_warp3d.types import DepthImage
from tests.warp3d.naive_sheet import EMPTY, camera_at, colors_of, depth_image, flat, plane

SIZE = 24
RED, BLUE = np.array([0.8, 0.2, 0.1]), np.array([0.1, 0.4, 0.9])
NOTHING = np.zeros((SIZE, SIZE, 1))
POSITIONS = [11.6, 11.95, 12.05, 12.2, 12.49, 12.51, 12.8, 12.95]


def side_by_side(position, left, right, *, is_left_near=True):
    """Surfaces that meet at x = position, with pixels that mix them; colors (H, W, 3)."""
    share = np.clip(position - np.arange(SIZE), 0, 1)[:, None]
    is_left = np.arange(SIZE) + 0.5 < position
    color = share * (left + NOTHING) + (1 - share) * (right + NOTHING)
    nearness = np.where(is_left == is_left_near, 1.0, 0.5) + NOTHING[..., 0]
    return DepthImage(color.astype(np.float32), nearness.astype(np.float32), EMPTY)


def last_left(position):
    """Column of the last sample that lies on the left surface."""
    return round(position - 1)


def found(sheet, position):
    """Right ends of the left surface's cells beside the silhouette: x of the upper corner."""
    return sheet.corner[sheet.torn[:, last_left(position)], 1, 0]


@pytest.mark.parametrize("is_left_near", [True, False])
@pytest.mark.parametrize("position", POSITIONS)
def test_a_silhouette_between_flat_colors_is_found(position, is_left_near):
    image = side_by_side(position, RED, BLUE, is_left_near=is_left_near)
    # A thousandth of the contrast is not trusted (FAINT), which is 5e-4 px here.
    np.testing.assert_allclose(found(sheet_of(prepare(image)), position), position, atol=1e-3)


@pytest.mark.parametrize("turns", [1, 2, 3])
@pytest.mark.parametrize("position", [11.8, 12.3])
def test_silhouettes_are_found_in_rows_and_columns_and_from_both_sides(position, turns):
    image = side_by_side(position, RED, BLUE)
    turned = [np.ascontiguousarray(np.rot90(part, turns)) for part in image[:2]]
    sheet = sheet_of(prepare(DepthImage(*turned, EMPTY)))
    cell = np.rot90(sheet.torn, -turns)[SIZE // 2, last_left(position)]
    corner = sheet.corner[cell, :, :2]
    for _ in range(turns):
        corner = np.stack([SIZE - corner[:, 1], corner[:, 0]], axis=1)
    assert corner[:, 0].max() == pytest.approx(position, abs=1e-3)


@pytest.mark.parametrize("is_left_near", [True, False])
@pytest.mark.parametrize("position", POSITIONS)
def test_flat_colors_are_unmixed(position, is_left_near):
    image = side_by_side(position, RED, BLUE, is_left_near=is_left_near)
    is_left = np.arange(SIZE) + 0.5 < position
    pure = np.where(is_left[:, None], RED, BLUE) + NOTHING
    np.testing.assert_allclose(colors_of(sheet_of(prepare(image))), pure, atol=1e-3)


@pytest.mark.parametrize("position", [12.1, 12.3, 12.7, 12.9])
def test_gradients_are_unmixed_to_the_colors_of_the_samples_beside(position):
    rise = 0.01
    ramp = rise * np.arange(SIZE)[:, None] + NOTHING
    left, right = RED + ramp, BLUE - ramp
    image = side_by_side(position, left, right)
    pure = np.where((np.arange(SIZE) + 0.5 < position)[:, None], left, right)
    # Mixed ones err by up to 0.28. The colors beside are a step of the ramp off, the position too.
    np.testing.assert_allclose(colors_of(sheet_of(prepare(image))), pure, atol=2 * rise)


@pytest.mark.parametrize("position", [12.1, 12.3, 12.7, 12.9])
@pytest.mark.parametrize("rise", [0.0, 0.01])
def test_colors_by_the_area_they_fill_add_up_to_what_was_measured(position, rise):
    ramp = rise * np.arange(SIZE)[:, None] + NOTHING
    image = side_by_side(position, RED + ramp, BLUE - ramp)
    sheet = sheet_of(prepare(image))
    column = last_left(position)
    width = found(sheet, position)[:, None] - column
    color = colors_of(sheet)
    given = width * color[:, column] + (2 - width) * color[:, column + 1]
    measured = image.color[:, column] + image.color[:, column + 1]
    # What is put in is the color of the sample beside: a step of the ramp off, on both sides.
    np.testing.assert_allclose(given, measured, atol=1e-3 + 2 * rise)


def test_the_only_colors_that_change_are_beside_silhouettes(rng):
    texture = rng.random((SIZE, SIZE, 3))
    image = side_by_side(12.3, texture, 1 - texture)
    is_far = np.abs(np.arange(SIZE) - 11.5) > 1
    given = colors_of(sheet_of(prepare(image)))
    np.testing.assert_array_equal(given[:, is_far], image.color[:, is_far])


def test_textures_that_hide_the_silhouette_leave_it_in_the_middle(rng, record):
    left, right = (RED + rng.normal(0, 0.3, (SIZE, SIZE, 3)) for _ in range(2))
    # 12.4 is the truth, 12 the middle between the samples.
    record.error(
        "largest, px",
        np.abs(found(sheet_of(prepare(side_by_side(12.4, left, right))), 12.4) - 12).max(),
    )


def test_equal_colors_leave_it_in_the_middle():
    image = side_by_side(12.4, RED, RED)
    sheet = sheet_of(prepare(image))
    np.testing.assert_array_equal(found(sheet, 12.4), 12)
    np.testing.assert_array_equal(colors_of(sheet), image.color)


@pytest.mark.parametrize("shift", np.arange(0, 1, 0.125))
def test_the_depth_of_a_limb_tells_where_it_ends(shift):
    # An upright cylinder of 34 px radius without any contrast to what is behind it.
    direction = (np.arange(96) + 0.5 - 48 + shift) / 96
    inner = 9 - 8 * (direction**2 + 1)
    depth = np.where(inner > 0, (3 - np.sqrt(np.maximum(inner, 0))) / (direction**2 + 1), 6.0)
    nearness = np.broadcast_to(1 / depth, (8, 96)).astype(np.float32)
    image = DepthImage(np.full((8, 96, 3), 0.5, np.float32), nearness, EMPTY)
    sheet = sheet_of(prepare(image, noise=0.0, step=0.0))
    end = 48 + 96 / np.sqrt(8) - shift
    last = np.flatnonzero(depth < 5)[-1]
    given = sheet.corner[sheet.torn[:, last], 1, 0]
    # Near its limb a cylinder is taken for a parabola: up to 0.14 px at this radius.
    np.testing.assert_allclose(given, end, atol=0.15)


def test_a_slightly_slanted_silhouette_is_straightened(record):
    slant = 0.2
    is_left = lambda point: point[..., 0] < slant * point[..., 1] + 0.05  # noqa: E731
    things = [
        plane((0, 0, 1), 3.0, flat(*RED), is_left), plane((0, 0, 1), 6.0, flat(*BLUE)),
    ]  # fmt: skip
    camera = camera_at(focal=SIZE, shape=(SIZE, SIZE))
    image = depth_image(things, camera, (SIZE, SIZE))
    sheet = sheet_of(prepare(image, step=0.0))
    is_near = image.nearness > 0.25
    ends = [(row, np.flatnonzero(is_near[row])[-1]) for row in range(2, SIZE - 2)]
    corner = np.array([sheet.corner[sheet.torn[key], k, :2] for key in ends for k in (1, 3)])
    x, y = corner[:, 0] - SIZE / 2, corner[:, 1] - SIZE / 2
    away = np.abs(x - slant * y - 0.05 * SIZE / 3)
    record.error("largest, px", away.max())  # 0.5 without


def test_labels_have_their_silhouettes_in_the_middle_and_stay_unmixed():
    image = side_by_side(12.3, RED, BLUE)
    sheet = sheet_of(prepare(image), is_label=True)
    np.testing.assert_array_equal(found(sheet, 12.3), 12)
    np.testing.assert_array_equal(colors_of(sheet), image.color)


@pytest.mark.parametrize("channels", [1, 2, 4, 7])
def test_any_number_of_channels_tells_the_silhouette(channels, rng):
    left, right = rng.random((2, channels))
    image = side_by_side(12.3, left, right)
    contrast = np.sum((left - right) ** 2)
    # FAINT is 1e-3 of squared contrast.
    tolerance = 0.3 * 1e-3 / contrast + 1e-4
    np.testing.assert_allclose(found(sheet_of(prepare(image)), 12.3), 12.3, atol=tolerance)


def test_beside_what_is_unknown_there_is_no_silhouette():
    image = side_by_side(12.3, RED, BLUE)
    image.nearness[:, 12:] = 0
    sheet = sheet_of(prepare(image))
    np.testing.assert_array_equal(found(sheet, 12.0), 12)
    np.testing.assert_array_equal(colors_of(sheet), image.color)
