"""Preview: the nearest cell over each pixel's center, and its color there."""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import bands, overlapping, take, walk
from resample.engine.jit import Counter, inner_kernel, parallel_kernel, plays
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.layers import CellColors, LayerPicture
from resample_warp3d.sheet.kernels.screen import SEGMENT, Indices, SheetScreen
from resample_warp3d.sheet.kernels.segments import (
    A_X,
    A_Y,
    B_X,
    B_Y,
    BEGIN,
    COLUMNS,
    DEPTH,
    END,
    FROM_COLUMN,
    FROM_ROW,
    HALF,
    NEAR,
    NONE,
    NUMBERS,
    ONE,
    P_NEAR,
    P_X,
    P_Y,
    PIXEL,
    PLACES,
    Q_NEAR,
    Q_X,
    Q_Y,
    QUARTER,
    R_NEAR,
    R_X,
    R_Y,
    ROWS,
    S_NEAR,
    S_X,
    S_Y,
    TO_COLUMN,
    TO_ROW,
    ZERO,
    BandFrame,
    SegmentCells,
    SheetStrip,
    X,
    Y,
)
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, UP

Corner = tuple[Single, Single, Single]

REACH: Single = np.float32(0.52)  # half a cell, in cells; neighbours overlap a little


class NearestCells(NamedTuple):
    """The pass that finds the nearest cell over each pixel's center."""

    front: Floats  # (pixels,) nearness
    owner: Indices  # (pixels,) number of the cell


@inner_kernel
def _fill_slots(
    begin: int, end: int, i: int, j: int, frame: BandFrame, numbers: Floats, places: Indices
) -> None:
    """Fill a slot with the pixels with centers covered by cells, and their nearness."""
    for n in range(begin, end):
        m = np.uint64(n)
        # Reject pixels outside the cell's bounds.
        px, qx, rx, sx = numbers[P_X + m], numbers[Q_X + m], numbers[R_X + m], numbers[S_X + m]
        py, qy, ry, sy = numbers[P_Y + m], numbers[Q_Y + m], numbers[R_Y + m], numbers[S_Y + m]
        column, row = np.int32(places[FROM_COLUMN + m] + i), np.int32(places[FROM_ROW + m] + j)
        x, y = np.float32(column) + HALF, np.float32(row) + HALF
        is_over = (x > min(px, qx, rx, sx)) & (x <= max(px, qx, rx, sx))
        is_over &= (y > min(py, qy, ry, sy)) & (y <= max(py, qy, ry, sy))
        is_over &= (column < places[TO_COLUMN + m]) & (row < places[TO_ROW + m])
        # Invert the cell's sides: the center must lie within the cell.
        dx, dy = x - numbers[X + m], y - numbers[Y + m]
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        inverse = ONE / (ax * by - ay * bx)
        u, v = (dx * by - dy * bx) * inverse, (dy * ax - dx * ay) * inverse
        is_over &= max(abs(u), abs(v)) <= REACH
        # Interpolate the nearness there.
        pn, qn, rn, sn = (
            numbers[P_NEAR + m], numbers[Q_NEAR + m], numbers[R_NEAR + m], numbers[S_NEAR + m]
        )  # fmt: skip
        an, bn = HALF * (qn - pn + sn - rn), HALF * (rn - pn + sn - qn)
        numbers[DEPTH + m] = numbers[NEAR + m] + u * an + v * bn
        pixel = np.int32((row - frame.first) * frame.width + column)
        places[PIXEL + m] = pixel if is_over else NONE


@plays(take, NearestCells)
def _take(
    looks: NearestCells,
    strip: SheetStrip,
    member: int,
    nth: int,  # noqa: ARG001
    run: int,
    cells: SegmentCells,
) -> None:
    """Find the nearest cells: depth-test a run, slot by slot."""
    k, (numbers, places), (front, owner) = np.uint64(run), cells, looks
    row, segment = divmod(member, strip.screen.bounds.shape[1])
    first = row * strip.screen.own.shape[1] + segment * SEGMENT
    begin, end = int(places[BEGIN + k]), int(places[END + k])
    for j in range(places[ROWS + k]):
        for i in range(places[COLUMNS + k]):
            _fill_slots(begin, end, i, j, strip.frame, numbers, places)
            for n in range(begin, end):
                m = np.uint64(n)
                pixel = places[PIXEL + m]
                if pixel >= 0 and numbers[DEPTH + m] > front[np.uint64(pixel)]:
                    front[np.uint64(pixel)] = numbers[DEPTH + m]
                    owner[np.uint64(pixel)] = first + n


@inner_kernel
def _corners_of(
    screen: Floats, torn: Floats, index: Indices, row: int, column: int
) -> tuple[Corner, Corner, Corner, Corner]:
    """Corners of a cell, x, y and nearness: top left, top right, bottom left, bottom right."""
    # A torn cell has its own; the others share the lattice's.
    n = index[row, column]
    if n >= 0:
        return (
            (torn[n, 0, 0], torn[n, 0, 1], torn[n, 0, 2]),
            (torn[n, 1, 0], torn[n, 1, 1], torn[n, 1, 2]),
            (torn[n, 2, 0], torn[n, 2, 1], torn[n, 2, 2]),
            (torn[n, 3, 0], torn[n, 3, 1], torn[n, 3, 2]),
        )
    below, right = row + 1, column + 1
    return (
        (screen[0, row, column], screen[1, row, column], screen[2, row, column]),
        (screen[0, row, right], screen[1, row, right], screen[2, row, right]),
        (screen[0, below, column], screen[1, below, column], screen[2, below, column]),
        (screen[0, below, right], screen[1, below, right], screen[2, below, right]),
    )


@inner_kernel
def _resolve(
    strip: SheetStrip, looks: NearestCells, colors: CellColors, picture: LayerPicture
) -> None:
    """Color each pixel of a band by the cell that it shows."""
    (screen, torn, index, _), frame, (front, owner) = strip.screen, strip.frame, looks
    (color, links), (image, coverage, nearness, magnification) = colors, picture
    columns = index.shape[1]
    for y in range(frame.first, frame.last):
        for x in range(frame.width):
            pixel = (y - frame.first) * frame.width + x
            near = front[pixel]
            # Write depth and coverage, and clear the color.
            coverage[y, x] = ONE if near > ZERO else ZERO
            nearness[y, x], magnification[y, x] = near, ZERO
            for channel in range(image.shape[2]):
                image[y, x, channel] = ZERO
            # Leave empty pixels black.
            if not near > ZERO:
                continue
            # Find the pixel's center in the cell, by its middle and sides.
            row, column = divmod(owner[pixel], columns)
            p, q, r, s = _corners_of(screen, torn, index, row, column)
            ax, ay = HALF * (q[0] - p[0] + s[0] - r[0]), HALF * (q[1] - p[1] + s[1] - r[1])
            bx, by = HALF * (r[0] - p[0] + s[0] - q[0]), HALF * (r[1] - p[1] + s[1] - q[1])
            area = ax * by - ay * bx
            dx = np.float32(x) + HALF - QUARTER * (p[0] + q[0] + r[0] + s[0])
            dy = np.float32(y) + HALF - QUARTER * (p[1] + q[1] + r[1] + s[1])
            u, v = (dx * by - dy * bx) / area, (dy * ax - dx * ay) / area
            magnification[y, x] = abs(area)
            # Interpolate the color linearly within the sample; its arrays have a margin.
            row, column = row + MARGIN, column + MARGIN
            for channel in range(image.shape[2]):
                group, c = channel // 3, channel % 3
                bits, here = links[row, column], color[group, c, row, column]
                right = color[group, c, row, column + 1] if bits & RIGHT else here
                left = color[group, c, row, column - 1] if bits & LEFT else here
                below = color[group, c, row + 1, column] if bits & DOWN else here
                above = color[group, c, row - 1, column] if bits & UP else here
                slope_x, slope_y = HALF * (right - left), HALF * (below - above)
                image[y, x, channel] = here + slope_x * u + slope_y * v


@parallel_kernel
def fill_picture(
    counter: Counter,
    screen: SheetScreen,
    colors: CellColors,
    band: int,
    like: BandFrame,
    picture: LayerPicture,
) -> None:
    """Give each pixel the color of the nearest cell over its center, as `layers.paint_layers`."""
    bounds = screen.bounds.reshape((-1, 4))
    for first, last in bands(counter, like.last, band):
        strip = SheetStrip(screen, BandFrame(first, last, like.width, like.orientation, ONE, False))
        size = (last - first) * like.width
        looks = NearestCells(np.zeros(size, np.float32), np.zeros(size, np.int32))
        cells = SegmentCells(np.zeros(NUMBERS, np.float32), np.zeros(PLACES, np.int32))
        walk(looks, strip, overlapping(bounds, (first, last), like.width), cells)
        _resolve(strip, looks, colors, picture)
