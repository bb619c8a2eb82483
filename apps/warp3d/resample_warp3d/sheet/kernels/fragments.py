"""Fragments: contributions of a run's cells to one pixel each.

Each cell of a run has as many slots for pixels as the largest cell needs. One slot of all cells is
filled at a time, which vectorizes; a fragment with pixel −1 is empty. Work to be done one by
one, as cells share pixels, is left to `layers`.
"""

import numpy as np

from resample.engine.cells.bands import Pixel, beyond, length, pixel_of, within
from resample.engine.jit import inner_kernel
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.colors import MEAN_SQUARE, color_at
from resample_warp3d.sheet.kernels.screen import Indices
from resample_warp3d.sheet.kernels.segments import (
    A_X,
    A_Y,
    B_X,
    B_Y,
    BLUE,
    CHANNEL,
    COLUMN,
    DENSITY,
    DEPTH,
    EAST,
    FROM_COLUMN,
    FROM_ROW,
    GREEN,
    HALF,
    LEAST,
    MASS,
    MEAN,
    MOST,
    NEAR,
    NORTH,
    ONE,
    PART,
    PARTS_U,
    PARTS_V,
    PIXEL,
    RED,
    ROW,
    SHARE_X,
    SHARE_Y,
    SLACK,
    SLOPE_X,
    SLOPE_Y,
    SOUTH,
    T_X,
    T_Y,
    TO_COLUMN,
    TO_ROW,
    U_X,
    U_Y,
    V_X,
    V_Y,
    WEST,
    ZERO,
    BandFrame,
    X,
    Y,
)

SLIGHT: Single = np.float32(1e-5)  # px; keeps divisions finite
NONE = np.int32(-1)  # pixel


@inner_kernel
def nearness_at(numbers: Floats, m: np.uint64, column: Pixel, row: Pixel) -> Single:
    """Nearness of a cell's plane at a pixel's center, clamped to its own limits."""
    x = np.float32(column) + HALF - numbers[X + m]
    y = np.float32(row) + HALF - numbers[Y + m]
    near = numbers[NEAR + m] + numbers[SLOPE_X + m] * x + numbers[SLOPE_Y + m] * y
    return min(max(near, numbers[LEAST + m]), numbers[MOST + m])


@inner_kernel
def fill_depths(
    begin: int, end: int, i: int, j: int, frame: BandFrame, numbers: Floats, places: Indices
) -> int:
    """Fill the slot in column i, row j of cells' pixels with their nearness.

    Like all functions that fill slots, returns how many are not empty.
    """
    found = 0
    # Rasterize the bounds of each cell; pixels beyond its own are empty.
    for n in range(begin, end):
        m = np.uint64(n)
        column, row = np.int32(places[FROM_COLUMN + m] + i), np.int32(places[FROM_ROW + m] + j)
        is_met = (column < places[TO_COLUMN + m]) & (row < places[TO_ROW + m])
        pixel = np.int32((row - frame.first) * frame.width + column)
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found


@inner_kernel
def set_boxes(
    begin: int, end: int, frame: BandFrame, numbers: Floats, places: Indices
) -> tuple[int, int]:
    """Turn upright cells into boxes; return the most rows and columns that one meets."""
    rows, columns = np.int32(0), np.int32(0)
    for n in range(begin, end):
        m = np.uint64(n)
        # Take the box around the cell's middle.
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        determinant = ax * by - ay * bx
        inverse = ONE / determinant
        across, down = abs(ax), abs(by)
        west, north = numbers[X + m] - HALF * across, numbers[Y + m] - HALF * down
        numbers[WEST + m], numbers[NORTH + m] = west, north
        numbers[EAST + m], numbers[SOUTH + m] = west + across, north + down
        # Invert the cell's sides: how u and v change along the screen's axes.
        numbers[U_X + m], numbers[U_Y + m] = by * inverse, -bx * inverse
        numbers[V_X + m], numbers[V_Y + m] = -ay * inverse, ax * inverse
        # Keep the cell's mass, although its box is a little larger.
        numbers[DENSITY + m] = abs(determinant) / (across * down)
        # Find the box's pixels within the band.
        column = np.int32(max(pixel_of(west), 0))
        row = np.int32(max(pixel_of(north), frame.first))
        east, south = pixel_of(numbers[EAST + m]), pixel_of(numbers[SOUTH + m])
        columns = max(columns, np.int32(min(east + 1, frame.width) - column))
        rows = max(rows, np.int32(min(south + 1, frame.last) - row))
        places[COLUMN + m], places[ROW + m] = column, row
    return int(rows), int(columns)


@inner_kernel
def fill_from_boxes(
    begin: int, end: int, i: int, j: int, frame: BandFrame, numbers: Floats, places: Indices
) -> int:
    """Fill a slot with boxes' mean colors over the part of a pixel they cover."""
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        # Clip the box to the pixel.
        column, row = np.int32(places[COLUMN + m] + i), np.int32(places[ROW + m] + j)
        west, east = within(numbers[WEST + m], numbers[EAST + m], np.float32(column))
        north, south = within(numbers[NORTH + m], numbers[SOUTH + m], np.float32(row))
        width, height = east - west, south - north
        # Find the middle of the overlap in the cell.
        x, y = HALF * (west + east) - numbers[X + m], HALF * (north + south) - numbers[Y + m]
        u = x * numbers[U_X + m] + y * numbers[U_Y + m]
        v = x * numbers[V_X + m] + y * numbers[V_Y + m]
        # Take the means of u² and v² over the overlap, so that parabolas are integrated exactly.
        share_u, share_v = width * numbers[U_X + m], height * numbers[V_Y + m]
        uu = u * u + (share_u * share_u - ONE) * MEAN_SQUARE
        vv = v * v + (share_v * share_v - ONE) * MEAN_SQUARE
        # Weigh the color by the mass.
        mass = width * height * numbers[DENSITY + m]
        numbers[MASS + m] = mass
        numbers[RED + m] = mass * color_at(numbers, m, u, v, uu, vv)
        numbers[GREEN + m] = mass * color_at(numbers, CHANNEL + m, u, v, uu, vv)
        numbers[BLUE + m] = mass * color_at(numbers, CHANNEL + CHANNEL + m, u, v, uu, vv)
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row) + numbers[SLACK + m]
        # Mark slots that the box misses as empty.
        is_met = (width > ZERO) & (height > ZERO) & (column < frame.width) & (row < frame.last)
        pixel = np.int32((row - frame.first) * frame.width + column)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found


@inner_kernel
def count_parts(
    begin: int, end: int, quality: Single, numbers: Floats, places: Indices
) -> tuple[int, int]:
    """Count the parts of cells along both sides; return the largest counts."""
    most_u, most_v = np.int32(1), np.int32(1)
    for n in range(begin, end):
        m = np.uint64(n)
        # Cut by the sides' lengths; the margin keeps cells of exactly one part whole.
        side_u = length(numbers[A_X + m], numbers[A_Y + m])
        side_v = length(numbers[B_X + m], numbers[B_Y + m])
        count_u = np.int32(pixel_of(side_u * quality - np.float32(0.01)) + 1)
        count_v = np.int32(pixel_of(side_v * quality - np.float32(0.01)) + 1)
        most_u, most_v = max(most_u, count_u), max(most_v, count_v)
        places[PARTS_U + m], places[PARTS_V + m] = count_u, count_v
    return int(most_u), int(most_v)


@inner_kernel
def set_parts(
    begin: int, end: int, i: int, j: int, is_whole: bool, frame: BandFrame,
    numbers: Floats, places: Indices,
) -> int:  # fmt: skip
    """Cut part (i, j) out of every cell; count those that may lie in the band.

    A part is an upright box of one color, at most 1 px wide.
    """
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        # Find the middle of the part in the cell.
        count_u = ONE if is_whole else np.float32(places[PARTS_U + m])
        count_v = ONE if is_whole else np.float32(places[PARTS_V + m])
        step_u, step_v = ONE / count_u, ONE / count_v
        u = (np.float32(i) + HALF) * step_u - HALF
        v = (np.float32(j) + HALF) * step_v - HALF
        # Map it to the screen, and take the bilinear map's derivatives as its sides.
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        tx, ty = numbers[T_X + m], numbers[T_Y + m]
        x = numbers[X + m] + ax * u + bx * v + tx * u * v
        y = numbers[Y + m] + ay * u + by * v + ty * u * v
        side_x, side_y = (ax + tx * v) * step_u, (ay + ty * v) * step_u
        other_x, other_y = (bx + tx * u) * step_v, (by + ty * u) * step_v
        # Take the signed area as mass, and the box around the sides.
        mass = frame.orientation * (side_x * other_y - side_y * other_x)
        across = min(length(side_x, other_x), ONE) + SLIGHT
        down = min(length(side_y, other_y), ONE) + SLIGHT
        west, north = x - HALF * across, y - HALF * down
        # Find the first of the 2 × 2 pixels that the box meets.
        column, row = pixel_of(west), pixel_of(north)
        # Drop parts that the cell does not have, seen from behind, or outside the band.
        is_there = (np.float32(i) < count_u) & (np.float32(j) < count_v) & (mass > ZERO)
        is_there &= (row < frame.last) & (row + 2 > frame.first)
        found += int(is_there)
        numbers[PART + m] = mass if is_there else ZERO
        # Split the box between the pixels.
        numbers[SHARE_X + m] = beyond(west, across, np.float32(column))
        numbers[SHARE_Y + m] = beyond(north, down, np.float32(row))
        places[COLUMN + m], places[ROW + m] = column, row
        # Store where the color is evaluated, unless the cell has one color.
        if not is_whole:
            uu, vv = u * u - MEAN_SQUARE, v * v - MEAN_SQUARE
            numbers[U_X + m], numbers[U_Y + m], numbers[V_X + m], numbers[V_Y + m] = u, v, uu, vv
    return found


@inner_kernel
def fill_from_parts(
    begin: int, end: int, i: int, j: int, is_flat: bool, frame: BandFrame,
    numbers: Floats, places: Indices,
) -> int:  # fmt: skip
    """Fill one slot of 2 × 2 with parts' contributions; labels are not weighted."""
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        column, row = np.int32(places[COLUMN + m] + i), np.int32(places[ROW + m] + j)
        # Take the share of the part's mass that falls into this pixel.
        share_x, share_y = numbers[SHARE_X + m], numbers[SHARE_Y + m]
        mass = numbers[PART + m] * (share_y if j else ONE - share_y)
        mass *= share_x if i else ONE - share_x
        # Evaluate the color, and weigh it by the mass.
        weight = ONE if frame.is_label else mass
        red, green = numbers[MEAN + m], numbers[MEAN + CHANNEL + m]
        blue = numbers[MEAN + CHANNEL + CHANNEL + m]
        if not is_flat:
            u, v, uu, vv = numbers[U_X + m], numbers[U_Y + m], numbers[V_X + m], numbers[V_Y + m]
            red = color_at(numbers, m, u, v, uu, vv)
            green = color_at(numbers, CHANNEL + m, u, v, uu, vv)
            blue = color_at(numbers, CHANNEL + CHANNEL + m, u, v, uu, vv)
        numbers[MASS + m] = mass
        numbers[RED + m], numbers[GREEN + m], numbers[BLUE + m] = (
            weight * red,
            weight * green,
            weight * blue,
        )
        # Mark slots without mass or outside the band as empty.
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row) + numbers[SLACK + m]
        is_met = (mass > ZERO) & (column >= 0) & (column < frame.width)
        is_met &= (row >= frame.first) & (row < frame.last)
        pixel = np.int32((row - frame.first) * frame.width + column)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found
