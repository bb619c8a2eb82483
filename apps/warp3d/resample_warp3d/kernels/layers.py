"""Cells painted into two layers per pixel: the nearest surface, and the one behind it.

A band of the target's rows belongs to one thread, which walks the source's cells three times: for
the nearest surface of every pixel, for the nearest of those behind it, and to add colors. A cell
adds to a pixel what it covers of it; the sum of that is the layer's coverage. Where the nearest
surface leaves room, at silhouettes, the second one shows.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from resample.kernels.jit import kernel, parallel_kernel
from resample.types import Floats, Single
from resample_warp3d.kernels.cells import (
    HALF,
    ONE,
    ZERO,
    Plane,
    area_of,
    bends_of,
    corners_of,
    extent_of,
    floor_of,
    is_worth_painting,
    nearness_at,
    plane_of,
    range_of,
    shape_of,
    value_at,
    within,
)
from resample_warp3d.kernels.screen import SEGMENT, Corner, Indices
from resample_warp3d.types import Links

DISTINCT: Single = np.float32(0.99)  # of the nearness: what is nearer than that is the same surface
FULL: Single = np.float32(0.97)  # coverage of a full pixel; boxes stand for cells, which are none
TRACE: Single = np.float32(1e-4)  # coverage below which a pixel is empty
SLIGHT: Single = np.float32(1e-5)  # px; keeps divisions finite
SHEAR: Single = np.float32(0.3)  # of a cell's length: how much its sides may lean to be upright
MEAN_SQUARE: Single = np.float32(1 / 12)  # of what lies evenly in −1/2..1/2
NO_PLANE: Plane = (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
SMALL: Single = np.float32(0.9)  # px, at quality 1: shorter upright cells have one color
MANY = 64  # pixels of a cell that are looked at to see whether it lies alone there


class Frame(NamedTuple):
    """A band of a target's frame and what painters read as numbers."""

    first: int  # row of the target
    last: int  # row of the target, excluded
    width: int  # px
    quality: Single  # parts that a cell is cut into per px of the target
    orientation: Single  # 1, or −1 where the target is a mirror image
    is_label: bool  # colors are names, which must not be mixed


@kernel
def _meets(bounds: Floats, row: int, segment: int, frame: Frame) -> bool:
    """Whether a segment of cells may meet a band."""
    return bool(
        bounds[row, segment, 1] < frame.last
        and bounds[row, segment, 3] > frame.first
        and bounds[row, segment, 0] < frame.width
        and bounds[row, segment, 2] > 0
    )


@kernel
def _front_of_segment(
    screen: Floats, torn: Floats, index: Indices, row: int, segment: int, frame: Frame,
    front: Floats, area: Floats,
) -> None:  # fmt: skip
    """Find the nearest surface over each pixel, and how large its cells are there."""
    end = min(index.shape[1], (segment + 1) * SEGMENT)
    for column in range(segment * SEGMENT, end):
        is_there, p, q, r, s = corners_of(screen, torn, index, row, column)
        if not is_there:
            continue
        left, top, right, bottom = extent_of(p, q, r, s, frame.first, frame.last, frame.width)
        if left >= right or top >= bottom:
            continue
        if not is_worth_painting(p, q, r, s, frame.orientation):
            continue
        plane, covered = plane_of(p, q, r, s), abs(area_of(p, q, r, s))
        for y in range(top, bottom):
            for x in range(left, right):
                near = nearness_at(plane, x, y)
                if near > front[y - frame.first, x]:
                    front[y - frame.first, x] = near
                    area[y - frame.first, x] = covered


@kernel
def _behind_segment(
    screen: Floats, torn: Floats, index: Indices, row: int, segment: int, frame: Frame,
    front: Floats, behind: Floats,
) -> None:  # fmt: skip
    """Find the nearest surface over each pixel that is not the front."""
    end = min(index.shape[1], (segment + 1) * SEGMENT)
    for column in range(segment * SEGMENT, end):
        is_there, p, q, r, s = corners_of(screen, torn, index, row, column)
        if not is_there:
            continue
        left, top, right, bottom = extent_of(p, q, r, s, frame.first, frame.last, frame.width)
        least = min(p[2], q[2], r[2], s[2])
        is_front = True
        for y in range(top, bottom):
            for x in range(left, right):
                is_front = is_front and least >= front[y - frame.first, x] * DISTINCT
        if is_front:
            continue
        if not is_worth_painting(p, q, r, s, frame.orientation):
            continue
        plane = plane_of(p, q, r, s)
        for y in range(top, bottom):
            for x in range(left, right):
                near = nearness_at(plane, x, y)
                is_behind = near + plane[7] < front[y - frame.first, x] * DISTINCT
                if is_behind and near > behind[y - frame.first, x]:
                    behind[y - frame.first, x] = near


@kernel
def _add_four(sums: Floats, at: int, a: Single, b: Single, c: Single, d: Single) -> None:
    """Add to four numbers in a row; read first, so that the compiler makes it one addition."""
    i = np.uint64(at)
    j, k, m = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
    a, b, c, d = sums[i] + a, sums[j] + b, sums[k] + c, sums[m] + d
    sums[i], sums[j], sums[k], sums[m] = a, b, c, d


@kernel
def _vote(sums: Floats, at: int, a: Single, b: Single, c: Single, d: Single) -> None:
    """Vote for a label by what it covers; the one that has most of the votes stays.

    Boyer and Moore's majority vote with weights: other labels wear the one that stands down.
    """
    if sums[at] == a and sums[at + 1] == b and sums[at + 2] == c:
        sums[at + 3] += d
    elif sums[at + 3] >= d:
        sums[at + 3] -= d
    else:
        sums[at], sums[at + 1], sums[at + 2] = a, b, c
        sums[at + 3] = d - sums[at + 3]


@kernel
def _is_alone(left: int, top: int, right: int, bottom: int, frame: Frame, behind: Floats) -> bool:
    """Whether a cell meets only pixels of one surface; no where it is large."""
    if (right - left) * (bottom - top) > MANY:
        return False
    is_alone = True
    for y in range(top, bottom):
        for x in range(left, right):
            is_alone = is_alone and behind[y - frame.first, x] == ZERO
    return is_alone


@kernel
def _overlap(middle: Single, length: Single) -> tuple[int, Single]:
    """First pixel along an axis that a box overlaps, and the box's share of the next one."""
    start = middle - HALF * length
    pixel = floor_of(start)
    return pixel, max(ZERO, (start + length - np.float32(pixel) - ONE) / length)


@kernel
def _add_box(
    x: Single, y: Single, across: Single, down: Single, mass: Single,
    red: Single, green: Single, blue: Single, frame: Frame, sums: Floats,
) -> None:  # fmt: skip
    """Add an upright box, at most 1 px wide, to the front of the 2 × 2 pixels it overlaps.

    All of them are in the band; `x` and `y` are the box's middle.
    """
    column, share = _overlap(x, across)
    row, share_below = _overlap(y, down)
    below = share_below * mass
    above = mass - below
    at = ((row - frame.first) * frame.width + column) * 8
    m = above * share
    n = above - m
    _add_four(sums, at, red * n, green * n, blue * n, n)
    _add_four(sums, at + 8, red * m, green * m, blue * m, m)
    m = below * share
    n = below - m
    at += 8 * frame.width
    _add_four(sums, at, red * n, green * n, blue * n, n)
    _add_four(sums, at + 8, red * m, green * m, blue * m, m)


@kernel
def _layer_at(
    plane: Plane, column: int, row: int, frame: Frame, front: Floats, behind: Floats
) -> int:
    """Layer that a cell belongs to over a pixel: 0 front, 1 behind, 2 hidden."""
    near = nearness_at(plane, column, row) + plane[7]
    if near >= front[row - frame.first, column] * DISTINCT:
        return 0
    return 1 if near >= behind[row - frame.first, column] * DISTINCT else 2


@kernel
def _add_seen(
    x: Single, y: Single, across: Single, down: Single, mass: Single,
    red: Single, green: Single, blue: Single, plane: Plane, frame: Frame,
    front: Floats, behind: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Add a box to the pixels of the band that it overlaps, in the layer where its cell is seen."""
    column, share_x = _overlap(x, across)
    row, share_y = _overlap(y, down)
    for r in range(max(row, frame.first), min(row + 2, frame.last)):
        along_y = share_y if r > row else ONE - share_y
        for c in range(max(column, 0), min(column + 2, frame.width)):
            m = mass * along_y * (share_x if c > column else ONE - share_x)
            layer = _layer_at(plane, c, r, frame, front, behind)
            if layer < 2 and m > ZERO:
                at = ((r - frame.first) * frame.width + c) * 8 + 4 * layer
                _add_four(sums, at, red * m, green * m, blue * m, m)


@kernel
def _add_label(
    x: Single, y: Single, across: Single, down: Single, mass: Single,
    red: Single, green: Single, blue: Single, plane: Plane, frame: Frame,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Let a box vote for its label in the pixels of the band that it overlaps."""
    column, share_x = _overlap(x, across)
    row, share_y = _overlap(y, down)
    for r in range(max(row, frame.first), min(row + 2, frame.last)):
        along_y = share_y if r > row else ONE - share_y
        for c in range(max(column, 0), min(column + 2, frame.width)):
            m = mass * along_y * (share_x if c > column else ONE - share_x)
            layer = _layer_at(plane, c, r, frame, front, behind)
            if layer < 2:
                voted[r - frame.first, c, layer] += m
                at = ((r - frame.first) * frame.width + c) * 8 + 4 * layer
                _vote(sums, at, red, green, blue, m)


@kernel
def _parts(length: Single, quality: Single) -> int:
    return floor_of(length * quality - np.float32(0.01)) + 1


@kernel
def _length(a: Single, b: Single) -> Single:
    return np.float32(math.sqrt(a * a + b * b))


@kernel
def _add_small(
    p: Corner, q: Corner, r: Corner, s: Corner, is_alone: bool,
    red: Single, green: Single, blue: Single, frame: Frame,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add a cell of one part."""
    x, y, _, ax, ay, _, bx, by, _, _, _, _ = shape_of(p, q, r, s)
    mass = frame.orientation * (ax * by - ay * bx)
    across, down = min(_length(ax, bx), ONE) + SLIGHT, min(_length(ay, by), ONE) + SLIGHT
    if is_alone:
        _add_box(x, y, across, down, mass, red, green, blue, frame, sums)
        return
    plane = plane_of(p, q, r, s)
    if frame.is_label:
        _add_label(
            x, y, across, down, mass, red, green, blue, plane, frame, front, behind, sums, voted
        )  # fmt: skip
    else:
        _add_seen(x, y, across, down, mass, red, green, blue, plane, frame, front, behind, sums)


@kernel
def _add_large(
    p: Corner, q: Corner, r: Corner, s: Corner, is_alone: bool, color: Floats, links: Links,
    group: int, row: int, column: int, frame: Frame,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add a cell part by part."""
    plane = plane_of(p, q, r, s)
    x, y, _, ax, ay, _, bx, by, _, tx, ty, _ = shape_of(p, q, r, s)
    count_u = _parts(_length(ax, ay), frame.quality)
    count_v = _parts(_length(bx, by), frame.quality)
    red, green = color[group, row, column, 0], color[group, row, column, 1]
    blue = color[group, row, column, 2]
    flat = (ZERO, ZERO), (ZERO, ZERO), ZERO
    (red_x, red_y, red_t), (green_x, green_y, green_t) = flat, flat
    blue_x, blue_y, blue_t = flat
    if not frame.is_label:
        red_x, red_y, red_t = bends_of(color, links, group, row, column, 0)
        green_x, green_y, green_t = bends_of(color, links, group, row, column, 1)
        blue_x, blue_y, blue_t = bends_of(color, links, group, row, column, 2)
    red_range = range_of(color, links, group, row, column, 0)
    green_range = range_of(color, links, group, row, column, 1)
    blue_range = range_of(color, links, group, row, column, 2)
    step_u, step_v = ONE / np.float32(count_u), ONE / np.float32(count_v)
    for part_v in range(count_v):
        v = (np.float32(part_v) + HALF) * step_v - HALF
        middle, reach = y + by * v, HALF * abs(ay + ty * v) + ONE
        if middle + reach < frame.first or middle - reach > frame.last:
            continue
        side_x, side_y = (ax + tx * v) * step_u, (ay + ty * v) * step_u
        for part_u in range(count_u):
            u = (np.float32(part_u) + HALF) * step_u - HALF
            other_x, other_y = (bx + tx * u) * step_v, (by + ty * u) * step_v
            mass = frame.orientation * (side_x * other_y - side_y * other_x)
            if not mass > ZERO:
                continue
            part_x, part_y = x + ax * u + bx * v + tx * u * v, y + ay * u + by * v + ty * u * v
            across = min(_length(side_x, other_x), ONE) + SLIGHT
            down = min(_length(side_y, other_y), ONE) + SLIGHT
            here_red = within(value_at(u, v, red, red_x, red_y, red_t), red_range)
            here_green = within(value_at(u, v, green, green_x, green_y, green_t), green_range)
            here_blue = within(value_at(u, v, blue, blue_x, blue_y, blue_t), blue_range)
            if is_alone:
                _add_box(
                    part_x, part_y, across, down, mass, here_red, here_green, here_blue, frame, sums
                )
            elif frame.is_label:
                _add_label(
                    part_x, part_y, across, down, mass, here_red, here_green, here_blue, plane,
                    frame, front, behind, sums, voted,
                )  # fmt: skip
            else:
                _add_seen(
                    part_x, part_y, across, down, mass, here_red, here_green, here_blue, plane,
                    frame, front, behind, sums,
                )  # fmt: skip


@kernel
def _is_upright(ax: Single, ay: Single, bx: Single, by: Single, shear: Single) -> bool:
    """Whether a cell's sides run along the pixels', nearly."""
    return bool(abs(ay) <= shear * abs(ax) and abs(bx) <= shear * abs(by))


@kernel
def _add_upright(
    p: Corner, q: Corner, r: Corner, s: Corner, is_alone: bool, color: Floats, links: Links,
    group: int, row: int, column: int, frame: Frame,
    front: Floats, behind: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Add a cell as one upright box, with the mean of its color over each pixel's share of it."""
    plane = NO_PLANE if is_alone else plane_of(p, q, r, s)
    x, y, _, ax, ay, _, bx, by, _, _, _, _ = shape_of(p, q, r, s)
    red, green = color[group, row, column, 0], color[group, row, column, 1]
    blue = color[group, row, column, 2]
    red_x, red_y, red_t = bends_of(color, links, group, row, column, 0)
    green_x, green_y, green_t = bends_of(color, links, group, row, column, 1)
    blue_x, blue_y, blue_t = bends_of(color, links, group, row, column, 2)
    red_range = range_of(color, links, group, row, column, 0)
    green_range = range_of(color, links, group, row, column, 1)
    blue_range = range_of(color, links, group, row, column, 2)
    determinant = ax * by - ay * bx
    inverse = ONE / determinant
    # The box's sides in pixels, and how the cell's own coordinates change along the pixels'.
    across, down = abs(ax), abs(by)
    u_x, u_y, v_x, v_y = by * inverse, -bx * inverse, -ay * inverse, ax * inverse
    density = abs(determinant) / (across * down)
    left, top = x - HALF * across, y - HALF * down
    right, bottom = left + across, top + down
    first, last = max(floor_of(top), frame.first), min(floor_of(bottom) + 1, frame.last)
    begin, end = max(floor_of(left), 0), min(floor_of(right) + 1, frame.width)
    for pixel_row in range(first, last):
        above = max(top, np.float32(pixel_row))
        below = min(bottom, np.float32(pixel_row) + ONE)
        height, offset_y = below - above, HALF * (above + below) - y
        share_v = height * v_y
        spread_v = (share_v * share_v - ONE) * MEAN_SQUARE
        for pixel in range(begin, end):
            before, after = max(left, np.float32(pixel)), min(right, np.float32(pixel) + ONE)
            width, offset_x = after - before, HALF * (before + after) - x
            m = width * height * density
            if not m > ZERO:
                continue
            at = ((pixel_row - frame.first) * frame.width + pixel) * 8
            if not is_alone:
                layer = _layer_at(plane, pixel, pixel_row, frame, front, behind)
                if layer == 2:
                    continue
                at += 4 * layer
            u, v = offset_x * u_x + offset_y * u_y, offset_x * v_x + offset_y * v_y
            share_u = width * u_x
            uu = u * u + (share_u * share_u - ONE) * MEAN_SQUARE
            vv, uv = v * v + spread_v, u * v
            a = red + red_x[0] * u + red_y[0] * v + red_x[1] * uu + red_y[1] * vv + red_t * uv
            b = green + green_x[0] * u + green_y[0] * v + green_x[1] * uu + green_y[1] * vv
            b += green_t * uv
            c = blue + blue_x[0] * u + blue_y[0] * v + blue_x[1] * uu + blue_y[1] * vv
            c += blue_t * uv
            a, b, c = within(a, red_range), within(b, green_range), within(c, blue_range)
            _add_four(sums, at, a * m, b * m, c * m, m)


@kernel
def _is_inside(left: int, top: int, right: int, bottom: int, frame: Frame) -> bool:
    """Whether all that boxes of a cell may overlap lies in the band."""
    return top > frame.first and bottom < frame.last and left > 0 and right < frame.width


@kernel
def _add_segment(
    screen: Floats, torn: Floats, index: Indices, color: Floats, links: Links,
    group: int, row: int, segment: int, frame: Frame,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add a segment's cells to a band's two layers."""
    end = min(index.shape[1], (segment + 1) * SEGMENT)
    # Squared lengths up to which cells have one color: upright ones, and those that lean.
    whole = ONE / (frame.quality * frame.quality)
    small = SMALL * SMALL * whole
    shear = ZERO if frame.is_label else SHEAR / max(frame.quality, ONE)
    for column in range(segment * SEGMENT, end):
        is_there, p, q, r, s = corners_of(screen, torn, index, row, column)
        if not is_there:
            continue
        left, top, right, bottom = extent_of(p, q, r, s, frame.first, frame.last, frame.width)
        if left >= right or top >= bottom:
            continue
        if not is_worth_painting(p, q, r, s, frame.orientation):
            continue
        is_alone = _is_inside(left, top, right, bottom, frame) and not frame.is_label
        is_alone = is_alone and _is_alone(left, top, right, bottom, frame, behind)
        ax, ay = HALF * (q[0] - p[0] + s[0] - r[0]), HALF * (q[1] - p[1] + s[1] - r[1])
        bx, by = HALF * (r[0] - p[0] + s[0] - q[0]), HALF * (r[1] - p[1] + s[1] - q[1])
        longest = max(ax * ax + ay * ay, bx * bx + by * by)
        is_upright = not frame.is_label and _is_upright(ax, ay, bx, by, shear)
        if longest <= (small if is_upright else whole):
            red, green = color[group, row, column, 0], color[group, row, column, 1]
            blue = color[group, row, column, 2]
            _add_small(
                p, q, r, s, is_alone, red, green, blue, frame, front, behind, sums, voted
            )  # fmt: skip
        elif is_upright:
            _add_upright(
                p, q, r, s, is_alone, color, links, group, row, column, frame,
                front, behind, sums,
            )  # fmt: skip
        else:
            _add_large(
                p, q, r, s, is_alone, color, links, group, row, column, frame,
                front, behind, sums, voted,
            )  # fmt: skip


@kernel
def _resolve(
    sums: Floats, voted: Floats, group: int, front: Floats, behind: Floats, area: Floats,
    frame: Frame,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
) -> None:  # fmt: skip
    """Composite a band's two layers."""
    channels = min(3, image.shape[2] - 3 * group)
    for y in range(frame.first, frame.last):
        for x in range(frame.width):
            at = ((y - frame.first) * frame.width + x) * 8
            near_mass, far_mass = sums[at + 3], sums[at + 7]
            # Boxes stand for cells: what is nearly full is full, and more than full is as much.
            filled = min(max(near_mass + far_mass, FULL), ONE)
            share = min(near_mass / filled, ONE)
            total = min((near_mass + far_mass) / filled, ONE)
            if near_mass + far_mass < TRACE:
                share, total = ZERO, ZERO
            by_near = share / max(near_mass, np.float32(1e-20))
            by_far = (total - share) / max(far_mass, np.float32(1e-20))
            if frame.is_label:
                near_mass = voted[y - frame.first, x, 0]
                far_mass = voted[y - frame.first, x, 1]
                total = ONE if near_mass + far_mass >= HALF else ZERO
                share = total if near_mass >= min(HALF, far_mass) else ZERO
                by_near, by_far = share, total - share
            for c in range(channels):
                image[y, x, 3 * group + c] = by_near * sums[at + c] + by_far * sums[at + 4 + c]
            if group == 0:
                is_near = share >= total - share
                near = front[y - frame.first, x] if is_near else behind[y - frame.first, x]
                coverage[y, x] = total
                nearness[y, x] = near if total > ZERO else ZERO
                magnification[y, x] = area[y - frame.first, x] if total > ZERO else ZERO


@kernel
def _paint_band(
    screen: Floats, torn: Floats, index: Indices, bounds: Floats, color: Floats, links: Links,
    frame: Frame,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
) -> None:  # fmt: skip
    height = frame.last - frame.first
    front = np.zeros((height, frame.width), np.float32)
    behind = np.zeros((height, frame.width), np.float32)
    area = np.zeros((height, frame.width), np.float32)
    for row in range(bounds.shape[0]):
        for segment in range(bounds.shape[1]):
            if _meets(bounds, row, segment, frame):
                _front_of_segment(screen, torn, index, row, segment, frame, front, area)
    for row in range(bounds.shape[0]):
        for segment in range(bounds.shape[1]):
            if _meets(bounds, row, segment, frame):
                _behind_segment(screen, torn, index, row, segment, frame, front, behind)
    sums = np.zeros(height * frame.width * 8, np.float32)
    voted = np.zeros((height if frame.is_label else 0, frame.width, 2), np.float32)
    for group in range(color.shape[0]):
        if group > 0:
            sums[:] = ZERO
            voted[:] = ZERO
        for row in range(bounds.shape[0]):
            for segment in range(bounds.shape[1]):
                if _meets(bounds, row, segment, frame):
                    _add_segment(
                        screen, torn, index, color, links, group, row, segment, frame,
                        front, behind, sums, voted,
                    )  # fmt: skip
        _resolve(
            sums, voted, group, front, behind, area, frame,
            image, coverage, nearness, magnification,
        )  # fmt: skip


@parallel_kernel
def paint_bands(
    screen: Floats, torn: Floats, index: Indices, bounds: Floats, color: Floats, links: Links,
    band: int, quality: float, orientation: float, is_label: bool,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
) -> None:  # fmt: skip
    """Paint a source's cells; each band of rows belongs to one thread.

    Parameters
    ----------
    screen, torn, index, bounds
        As `kernels.screen` makes them.
    color
        (G, H, W, 3) channels in groups of three.
    links
        (H, W) which neighbours a color may be interpolated with.
    band
        Rows of a band.
    quality, orientation, is_label
        As in `Frame`.
    image
        (height, width, C) filled, multiplied by the coverage.
    coverage, nearness, magnification
        (height, width) filled.
    """
    height, width = coverage.shape
    for n in prange((height + band - 1) // band):
        first = int(np.int64(n)) * band
        frame = Frame(
            first, min(height, first + band), width,
            np.float32(quality), np.float32(orientation), is_label,
        )  # fmt: skip
        _paint_band(
            screen, torn, index, bounds, color, links, frame,
            image, coverage, nearness, magnification,
        )  # fmt: skip
