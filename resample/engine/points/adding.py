"""Add points to the open sheet of a canvas, and put that sheet over what lies behind it.

Hot kernels take bare arrays and bundles of numbers: a bundle of arrays would have its reference
counts touched at every call.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.grid import point_width
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed, unit_lookup
from resample.engine.over import VISIBLE
from resample.types import Floats, Place, Record, Single, Style

MOST_TAPS = 64  # sub-pixels; wider filters are narrowed to it

Bounds = NDArray[np.int64]  # (4,) first and last row, first and last column


@kernel
def _weigh(
    center: Single, reach: Single, per_reach: Single, profile: Floats, weight: Floats
) -> tuple[int, int]:
    """Weights with sum 1 of the sub-pixels around `center`; gives the first one and their count."""
    first = math.floor(center - reach + 0.5)
    count = min(math.floor(center + reach - 0.5) - first + 1, weight.size)
    offset = np.float32(first + 0.5 - center)
    total = np.float32(0.0)
    for tap in range(count):
        weight[tap] = unit_lookup(profile, abs(offset + np.float32(tap)) * per_reach)
        total += weight[tap]
    if count < 1 or total == np.float32(0.0):  # a filter between two centers of sub-pixels
        first, count = math.floor(center), 1
        weight[0] = total = np.float32(1.0)
    share = np.float32(1.0) / total
    for tap in range(count):
        weight[tap] *= share
    return first, count


class Box(NamedTuple):
    """Sub-pixels that a point is spread over, and where its weights begin."""

    top: int
    bottom: int
    left: int
    right: int
    first_row: int
    first_column: int


@kernel
def box_around(
    sheet: Floats,
    x: float,
    y: float,
    reach: float,
    profile: Floats,
    across: Floats,
    down: Floats,
) -> Box:
    """Weights of a filter around a place of a sheet, in `across` and `down`, and what they meet.

    All in sub-pixels.
    """
    reach = min(reach, 0.5 * (MOST_TAPS - 2))
    per_reach = np.float32(1.0 / reach)
    left, columns = _weigh(x, reach, per_reach, profile, across)
    top, rows = _weigh(y, reach, per_reach, profile, down)
    return Box(
        max(0, top),
        min(sheet.shape[0], top + rows),
        max(0, left),
        min(sheet.shape[1], left + columns),
        top,
        left,
    )


@kernel
def box_of_point(
    sheet: Floats,
    place: Place,
    record: Record,
    style: Style,
    profile: Floats,
    across: Floats,
    down: Floats,
) -> Box:
    """Weights of a point's filter, in `across` and `down`, and the part of `sheet` they meet."""
    n = place.subpixels
    width = float(n)
    if style.variance > 0.0:
        width = point_width(record["spacing"] * n, style.variance)
    x, y = (record["x"] - place.x) * n, (record["y"] - place.y) * n
    return box_around(sheet, x, y, width * style.point_extent, profile, across, down)


@kernel
def add_point(
    sheet: Floats,
    dirty: Bounds,
    place: Place,
    record: Record,
    style: Style,
    profile: Floats,
    across: Floats,
    down: Floats,
) -> None:
    """Add a point's coverage, color and depth under its filter to the open sheet.

    Weighted by the area its layer has on screen: |det J|, part of the estimate. What is summed is
    opacity, not optical depth, as points of one layer lie side by side. `across` and `down`
    (MOST_TAPS,) are room to work in.
    """
    n = place.subpixels
    path = style.layer * record["obliquity"]
    area = np.float32(record["mass"] / path * (n * n))
    alpha = area * absorbed(record["extinction"] * path)
    box = box_of_point(sheet, place, record, style, profile, across, down)
    first_row, last_row, first_column, last_column, top, left = box
    if first_row >= last_row or first_column >= last_column:
        return
    dirty[0], dirty[1] = min(dirty[0], first_row), max(dirty[1], last_row)
    dirty[2], dirty[3] = min(dirty[2], first_column), max(dirty[3], last_column)
    red, green, blue, depth = record["red"], record["green"], record["blue"], record["depth"]
    zero, one, cover = np.float32(0.0), np.float32(1.0), area / alpha
    for row in range(first_row, last_row):
        seen = alpha * down[row - top]
        for column in range(first_column, last_column):
            opacity = seen * across[column - left]
            sheet[row, column, 0] += opacity * one  # eight products: one instruction
            sheet[row, column, 1] += opacity * red
            sheet[row, column, 2] += opacity * green
            sheet[row, column, 3] += opacity * blue
            sheet[row, column, 4] += opacity * depth
            sheet[row, column, 5] += opacity * cover
            sheet[row, column, 6] += opacity * zero
            sheet[row, column, 7] += opacity * zero


@kernel
def composite_sheet(pixel: Floats, sheet: Floats, dirty: Bounds, style: Style) -> int:
    """Put the open sheet behind what is painted and empty it; gives how many pixels it closed."""
    one, opaque, closed = np.float32(1.0), np.float32(style.opaque), 0
    first_row, last_row, first_column, last_column = dirty
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            total, before = sheet[row, column, 0], pixel[row, column, 3]
            if total > 0.0 and before > opaque:
                alpha = min(total, one)
                share = before * alpha / total
                for channel in range(3):
                    added = share * sheet[row, column, 1 + channel]
                    pixel[row, column, channel] += max(np.float32(0.0), added)
                after = before * (one - alpha)
                pixel[row, column, 3] = after
                pixel[row, column, 4] += share * sheet[row, column, 4]
                pixel[row, column, 7] += before * alpha
                pixel[row, column, 5] += sheet[row, column, 5]
                if pixel[row, column, 6] == np.inf and after < np.float32(1.0 - VISIBLE):
                    pixel[row, column, 6] = sheet[row, column, 4] / total
                if after <= opaque:
                    closed += 1
            for channel in range(8):
                sheet[row, column, channel] = 0.0
    dirty[0], dirty[2] = sheet.shape[0], sheet.shape[1]
    dirty[1], dirty[3] = 0, 0
    return closed
