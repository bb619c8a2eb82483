"""One look per pixel: the nearest cell over its center, and that cell's color there."""

import numpy as np
from numba import prange

from resample.kernels.jit import kernel, parallel_kernel
from resample.types import Floats, Single
from resample_warp3d.kernels.cells import (
    HALF,
    ONE,
    ZERO,
    corners_of,
    floor_of,
    is_worth_painting,
    shape_of,
)
from resample_warp3d.kernels.screen import SEGMENT, Indices
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links

REACH: Single = np.float32(0.52)  # of a cell from its middle; neighbours overlap a little


@kernel
def _look_at_segment(
    screen: Floats, torn: Floats, index: Indices, row: int, segment: int,
    first: int, last: int, orientation: Single, front: Floats, owner: Indices,
) -> None:  # fmt: skip
    """Find the nearest cell of a segment over each pixel's center."""
    width = front.shape[1]
    columns = index.shape[1]
    for column in range(segment * SEGMENT, min(columns, (segment + 1) * SEGMENT)):
        is_there, p, q, r, s = corners_of(screen, torn, index, row, column)
        if not is_there:
            continue
        left = max(0, floor_of(min(p[0], q[0], r[0], s[0]) + HALF))
        right = min(width, floor_of(max(p[0], q[0], r[0], s[0]) + HALF))
        top = max(first, floor_of(min(p[1], q[1], r[1], s[1]) + HALF))
        bottom = min(last, floor_of(max(p[1], q[1], r[1], s[1]) + HALF))
        if left >= right or top >= bottom:
            continue
        if not is_worth_painting(p, q, r, s, orientation):
            continue
        x, y, near, ax, ay, an, bx, by, bn, _, _, _ = shape_of(p, q, r, s)
        inverse = ONE / (ax * by - ay * bx)
        for pixel_row in range(top, bottom):
            dy = np.float32(pixel_row) + HALF - y
            for pixel in range(left, right):
                dx = np.float32(pixel) + HALF - x
                u, v = (dx * by - dy * bx) * inverse, (dy * ax - dx * ay) * inverse
                if max(abs(u), abs(v)) > REACH:
                    continue
                here = near + u * an + v * bn
                if here > front[pixel_row - first, pixel]:
                    front[pixel_row - first, pixel] = here
                    owner[pixel_row - first, pixel] = row * columns + column


@kernel
def _slopes(
    color: Floats, links: Links, group: int, row: int, column: int, c: int
) -> tuple[Single, Single]:
    """Change of a channel to the next column and row, on the sample's surface."""
    bits, here = links[row, column], color[group, row, column, c]
    right = color[group, row, column + 1, c] if bits & RIGHT else here
    left = color[group, row, column - 1, c] if bits & LEFT else here
    below = color[group, row + 1, column, c] if bits & DOWN else here
    above = color[group, row - 1, column, c] if bits & UP else here
    return HALF * (right - left), HALF * (below - above)


@kernel
def _look_in_band(
    screen: Floats, torn: Floats, index: Indices, bounds: Floats, color: Floats, links: Links,
    first: int, orientation: Single,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats, band: int,
) -> None:  # fmt: skip
    height, width = coverage.shape
    last = min(height, first + band)
    front = np.zeros((last - first, width), np.float32)
    owner = np.zeros((last - first, width), np.int32)
    for row in range(bounds.shape[0]):
        for segment in range(bounds.shape[1]):
            if bounds[row, segment, 1] < last and bounds[row, segment, 3] > first:
                _look_at_segment(
                    screen, torn, index, row, segment, first, last, orientation, front, owner
                )  # fmt: skip
    columns = index.shape[1]
    for y in range(first, last):
        for x in range(width):
            near = front[y - first, x]
            coverage[y, x] = ONE if near > ZERO else ZERO
            nearness[y, x], magnification[y, x] = near, ZERO
            for channel in range(image.shape[2]):
                image[y, x, channel] = ZERO
            if not near > ZERO:
                continue
            row, column = divmod(owner[y - first, x], columns)
            _, p, q, r, s = corners_of(screen, torn, index, row, column)
            middle_x, middle_y, _, ax, ay, _, bx, by, _, _, _, _ = shape_of(p, q, r, s)
            area = ax * by - ay * bx
            dx, dy = np.float32(x) + HALF - middle_x, np.float32(y) + HALF - middle_y
            u, v = (dx * by - dy * bx) / area, (dy * ax - dx * ay) / area
            magnification[y, x] = abs(area)
            for channel in range(image.shape[2]):
                group, c = channel // 3, channel % 3
                slope_x, slope_y = _slopes(color, links, group, row, column, c)
                image[y, x, channel] = color[group, row, column, c] + slope_x * u + slope_y * v


@parallel_kernel
def look_in_bands(
    screen: Floats, torn: Floats, index: Indices, bounds: Floats, color: Floats, links: Links,
    band: int, orientation: float,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
) -> None:  # fmt: skip
    """Give each pixel the color of the nearest cell over its center.

    Parameters are those of `layers.paint_bands`, without a quality.
    """
    for n in prange((coverage.shape[0] + band - 1) // band):
        _look_in_band(
            screen, torn, index, bounds, color, links, int(np.int64(n)) * band,
            np.float32(orientation), image, coverage, nearness, magnification, band,
        )  # fmt: skip
