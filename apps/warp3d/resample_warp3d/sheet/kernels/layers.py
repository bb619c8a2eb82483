"""Cells painted into two layers per pixel: the nearest surface, and the one behind it.

A band of the target's rows belongs to one thread, which walks the source's cells three times: for
the nearest surface of every pixel, for the nearest of those behind it, and to add colors. A cell
adds to a pixel what it covers of it; the sum of that is the layer's coverage. Where the nearest
surface leaves room, at silhouettes, the second one shows.

Calls are made per run of cells, never per cell: to hand over ten arrays costs as much as to paint.
"""

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.colors import write_colors, write_means
from resample_warp3d.sheet.kernels.fragments import (
    count_parts,
    fill_depths,
    fill_from_boxes,
    fill_from_parts,
    set_boxes,
    set_parts,
)
from resample_warp3d.sheet.kernels.screen import SEGMENT, Indices
from resample_warp3d.sheet.kernels.segments import (
    AREA,
    BEGIN,
    BLUE,
    COLUMNS,
    DEPTH,
    END,
    GREEN,
    HALF,
    LEAST,
    MASS,
    NUMBERS,
    ONE,
    PIXEL,
    PLACES,
    RED,
    ROWS,
    SLACK,
    UPRIGHT,
    WAY,
    WHOLE,
    ZERO,
    Frame,
    measure,
)
from resample_warp3d.types import Links

DISTINCT: Single = np.float32(0.99)  # of the nearness: what is nearer than that is the same surface
FULL: Single = np.float32(0.97)  # coverage of a full pixel; boxes stand for cells, which are none
TRACE: Single = np.float32(1e-4)  # coverage below which a pixel is empty
EVERYTHING: Single = np.float32(np.inf)  # nearer than all


@kernel
def _segments_met(bounds: Indices, frame: Frame) -> Indices:
    """Segments of cells that may meet a band, counted row by row."""
    met = np.empty(bounds.shape[0] * bounds.shape[1] + 1, np.int32)
    count = 0
    for row in range(bounds.shape[0]):
        for segment in range(bounds.shape[1]):
            left, top = bounds[row, segment, 0], bounds[row, segment, 1]
            right, bottom = bounds[row, segment, 2], bounds[row, segment, 3]
            is_met = (top < frame.last) & (bottom >= frame.first)
            is_met &= (left < frame.width) & (right >= 0)
            met[count] = row * bounds.shape[1] + segment
            count += int(is_met)
    return met[:count]


@kernel
def _find_front(
    begin: int, end: int, numbers: Floats, places: Indices, front: Floats, area: Floats
) -> None:
    """Let fragments be the nearest of their pixels, and tell how large their cells are."""
    for n in range(begin, end):
        m = np.uint64(n)
        pixel = places[PIXEL + m]
        if pixel >= 0:
            i, near = np.uint64(pixel), numbers[DEPTH + m]
            nearest, largest, covered = front[i], area[i], abs(numbers[AREA + m])
            front[i] = near if near > nearest else nearest
            area[i] = covered if near > nearest else largest


@kernel
def _find_behind(
    begin: int, end: int, numbers: Floats, places: Indices, front: Floats, behind: Floats
) -> None:
    """Let fragments be the nearest of those that are not the front."""
    for n in range(begin, end):
        m = np.uint64(n)
        pixel = places[PIXEL + m]
        if pixel >= 0:
            i, near = np.uint64(pixel), numbers[DEPTH + m]
            if near + numbers[SLACK + m] < front[i] * DISTINCT and near > behind[i]:
                behind[i] = near


@kernel
def _vote(sums: Floats, at: np.uint64, a: Single, b: Single, c: Single, d: Single) -> None:
    """Vote for a label by what it covers; the one that has most of the votes stays.

    Boyer and Moore's majority vote with weights: other labels wear the one that stands down.
    """
    if sums[at] == a and sums[at + np.uint64(1)] == b and sums[at + np.uint64(2)] == c:
        sums[at + np.uint64(3)] += d
    elif sums[at + np.uint64(3)] >= d:
        sums[at + np.uint64(3)] -= d
    else:
        sums[at], sums[at + np.uint64(1)], sums[at + np.uint64(2)] = a, b, c
        sums[at + np.uint64(3)] = d - sums[at + np.uint64(3)]


@kernel
def _add(
    begin: int, end: int, frame: Frame, numbers: Floats, places: Indices,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add fragments to the layers of their pixels where they are seen; labels are voted for."""
    for n in range(begin, end):
        m = np.uint64(n)
        if places[PIXEL + m] < 0:
            continue
        pixel, near = np.uint64(places[PIXEL + m]), numbers[DEPTH + m]
        layer = np.uint64(0)
        if near < front[pixel] * DISTINCT:
            if near < behind[pixel] * DISTINCT:
                continue
            layer = np.uint64(1)
        at = np.uint64(8) * pixel + np.uint64(4) * layer
        red, green, blue = numbers[RED + m], numbers[GREEN + m], numbers[BLUE + m]
        mass = numbers[MASS + m]
        if frame.is_label:
            voted[np.uint64(2) * pixel + layer] += mass
            _vote(sums, at, red, green, blue, mass)
        else:
            sums[at] += red
            sums[at + np.uint64(1)] += green
            sums[at + np.uint64(2)] += blue
            sums[at + np.uint64(3)] += mass


@kernel
def _add_run(
    k: np.uint64, frame: Frame, numbers: Floats, places: Indices,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add a run of cells to a band's two layers."""
    begin, end = int(places[BEGIN + k]), int(places[END + k])
    way = places[WAY + np.uint64(begin)]
    if way == UPRIGHT:
        rows, columns = set_boxes(begin, end, frame, numbers, places)
        for j in range(rows):
            for i in range(columns):
                if fill_from_boxes(begin, end, i, j, frame, numbers, places):
                    _add(begin, end, frame, numbers, places, front, behind, sums, voted)
        return
    is_whole = way == WHOLE
    most_u, most_v = count_parts(begin, end, frame, numbers, places)
    for part in range(1 if is_whole else most_u * most_v):
        v, u = divmod(part, most_u)
        if set_parts(begin, end, u, v, is_whole, frame, numbers, places):
            for slot in range(4):
                is_flat = is_whole or frame.is_label
                if fill_from_parts(
                    begin, end, slot % 2, slot // 2, is_flat, frame, numbers, places
                ):
                    _add(begin, end, frame, numbers, places, front, behind, sums, voted)


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
            pixel = (y - frame.first) * frame.width + x
            at = np.uint64(8 * pixel)
            near_mass, far_mass = sums[at + np.uint64(3)], sums[at + np.uint64(7)]
            # Boxes stand for cells: what is nearly full is full, and more than full is as much.
            filled = min(max(near_mass + far_mass, FULL), ONE)
            share = min(near_mass / filled, ONE)
            total = min((near_mass + far_mass) / filled, ONE)
            if near_mass + far_mass < TRACE:
                share, total = ZERO, ZERO
            by_near = share / max(near_mass, np.float32(1e-20))
            by_far = (total - share) / max(far_mass, np.float32(1e-20))
            if frame.is_label:
                near_mass, far_mass = voted[2 * pixel], voted[2 * pixel + 1]
                total = ONE if near_mass + far_mass >= HALF else ZERO
                share = total if near_mass >= min(HALF, far_mass) else ZERO
                by_near, by_far = share, total - share
            for c in range(channels):
                k = at + np.uint64(c)
                image[y, x, 3 * group + c] = by_near * sums[k] + by_far * sums[k + np.uint64(4)]
            if group == 0:
                is_near = share >= total - share
                near = front[pixel] if is_near else behind[pixel]
                coverage[y, x] = total
                nearness[y, x] = near if total > ZERO else ZERO
                magnification[y, x] = area[pixel] if total > ZERO else ZERO


@kernel
def _least(runs: int, numbers: Floats, places: Indices) -> Single:
    """Nearness of the farthest corner of the cells of all runs."""
    least = EVERYTHING
    for run in range(runs):
        k = np.uint64(run)
        for n in range(places[BEGIN + k], places[END + k]):
            least = min(least, numbers[LEAST + np.uint64(n)])
    return least


@kernel
def _is_front(
    bounds: Indices, row: int, segment: int, least: Single, frame: Frame, front: Floats
) -> bool:
    """Whether nothing that is as far as `least` or nearer is behind the front within bounds."""
    left, right = max(0, bounds[row, segment, 0]), min(frame.width, bounds[row, segment, 2] + 1)
    top = max(frame.first, bounds[row, segment, 1])
    bottom = min(frame.last, bounds[row, segment, 3] + 1)
    hidden = 0
    for y in range(top, bottom):
        at = np.uint64((y - frame.first) * frame.width)
        for x in range(left, right):
            hidden += int(least < front[at + np.uint64(x)] * DISTINCT)
    return hidden == 0


@kernel
def _find_layers(
    screen: Floats, torn: Floats, index: Indices, bounds: Indices, met: Indices, frame: Frame,
    numbers: Floats, places: Indices, front: Floats, behind: Floats, area: Floats,
) -> None:  # fmt: skip
    """Find the nearest surface over each pixel of a band, and the nearest behind it."""
    least = np.empty(met.size, np.float32)
    for look in range(2):
        for n in range(met.size):
            row, segment = divmod(met[n], bounds.shape[1])
            if look == 1 and _is_front(bounds, row, segment, least[n], frame, front):
                continue
            runs = measure(screen, torn, index, row, segment, frame, numbers, places)
            least[n] = _least(runs, numbers, places)
            for run in range(runs):
                k = np.uint64(run)
                begin, end = int(places[BEGIN + k]), int(places[END + k])
                for j in range(places[ROWS + k]):
                    for i in range(places[COLUMNS + k]):
                        if not fill_depths(begin, end, i, j, frame, numbers, places):
                            continue
                        if look == 0:
                            _find_front(begin, end, numbers, places, front, area)
                        else:
                            _find_behind(begin, end, numbers, places, front, behind)


@kernel
def _add_colors(
    screen: Floats, torn: Floats, index: Indices, met: Indices, color: Floats, links: Links,
    group: int, frame: Frame, numbers: Floats, places: Indices,
    front: Floats, behind: Floats, sums: Floats, voted: Floats,
) -> None:  # fmt: skip
    """Add what cells cover of a band's pixels to their layers."""
    segments = -(-index.shape[1] // SEGMENT)
    for n in range(met.size):
        row, segment = divmod(met[n], segments)
        runs = measure(screen, torn, index, row, segment, frame, numbers, places)
        for run in range(runs):
            k, start = np.uint64(run), segment * SEGMENT
            begin, end = int(places[BEGIN + k]), int(places[END + k])
            if places[WAY + np.uint64(begin)] == WHOLE or frame.is_label:
                write_means(color, group, row, start, begin, end, numbers)
            else:
                write_colors(color, links, group, row, start, begin, end, numbers)
            _add_run(k, frame, numbers, places, front, behind, sums, voted)


@parallel_kernel
def paint_bands(
    counter: Counter, screen: Floats, torn: Floats, index: Indices, bounds: Indices, color: Floats,
    links: Links, band: int, quality: float, orientation: float, is_label: bool,
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
) -> None:  # fmt: skip
    """Paint a source's cells; each band of rows belongs to one thread.

    Parameters
    ----------
    screen, torn, index, bounds
        As `kernels.screen` makes them.
    color
        (G, 3, H, W) channels in groups of three.
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
    count = (height + band - 1) // band
    for n in tasks(counter, count):
        first = band * n
        frame = Frame(
            first, min(height, first + band), width,
            np.float32(orientation), np.float32(quality), is_label,
        )  # fmt: skip
        size = (frame.last - frame.first) * width
        front, behind = np.zeros(size, np.float32), np.zeros(size, np.float32)
        area = np.zeros(size, np.float32)
        numbers, places = np.zeros(NUMBERS, np.float32), np.zeros(PLACES, np.int32)
        met = _segments_met(bounds, frame)
        _find_layers(
            screen, torn, index, bounds, met, frame, numbers, places, front, behind, area
        )  # fmt: skip
        for group in range(color.shape[0]):
            sums = np.zeros(size * 8, np.float32)
            voted = np.zeros(2 * size if is_label else 0, np.float32)
            _add_colors(
                screen, torn, index, met, color, links, group, frame, numbers, places,
                front, behind, sums, voted,
            )  # fmt: skip
            _resolve(
                sums, voted, group, front, behind, area, frame,
                image, coverage, nearness, magnification,
            )  # fmt: skip
