"""Label that covers the largest area of each pixel, by exact areas of polygons.

A pixel is a square on the screen, and lines between texels are straight there, under a homography
as under a map that is linear within each pixel. So the square is cut along columns of texels, and
each column where the label changes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import bands
from resample.engine.jit import Counter, kernel, parallel_kernel
from resample.engine.windows.boxes import MIRROR, TRANSPARENT, WRAP
from resample.types import Doubles, Floats, Indices

BAND = 16  # rows that a thread takes at a time
MOST_CORNERS = 24  # of a part: four, and at most two more for each line that cuts it
NOTHING = 1e-9  # of a pixel; areas count as equal within this, and smaller ones as zero
MOST_CELLS = 1 << 22  # texels beyond the edges from which a pixel's label is counted, at most
MOST_UNIFORM_TEXELS = 256.0  # texels that are read at most to find that they share one label
FRONT = 1e-12  # share of the largest third coordinate; below it lies the horizon


class PixelMapping(NamedTuple):
    """Where pixels read the source."""

    inverse: Doubles  # (3, 3) target to source, positive in front of the camera
    places: Doubles  # (6, h, w) instead, as `places_of` gives it; (6, 0, 0) under a homography


class LabelSource(NamedTuple):
    """A source's labels."""

    code: NDArray[np.int32]  # (H, W) from 0 in the order of labels; less than 0 for none
    codes: int  # how many there are
    common: int  # a texel, counted row by row, with the most common label; less than 0 for none
    edge: int  # TRANSPARENT, CLAMP, WRAP or MIRROR


class LabelPicture(NamedTuple):
    """Labels of pixels, to be filled in."""

    texel: Indices  # (h, w) a texel of the label, counted row by row
    coverage: Floats  # (h, w) share of the pixel that has a label


class Tally(NamedTuple):
    """Areas of a pixel's labels, and scratch for its polygons."""

    area: Doubles  # (codes,) by code, 0 for all but the current pixel's
    texel: Indices  # (codes,) where the code was met
    met: Indices  # (codes,) codes that were met
    rows: Doubles  # (3, 3) from places relative to a pixel's center to those of the source
    parts: (
        Doubles  # (5, MOST_CORNERS, 2) polygons: the rest of a square, the rest of a column, a part
    )


@kernel
def _fill_matrix(mapping: PixelMapping, row: int, column: int, rows: Doubles) -> bool:
    """Fill in the matrix of a pixel, around its center; False if it shows nothing."""
    # Under a homography, move the origin to the pixel's center.
    if mapping.places.shape[1] == 0:
        rows[:] = mapping.inverse
        for n in range(3):
            rows[n, 2] += rows[n, 0] * (column + 0.5) + rows[n, 1] * (row + 0.5)
        return True
    # Under a map, take its linear part around the pixel's center.
    place = mapping.places[:, row, column]
    for n in range(2):
        rows[n, 2], rows[n, 0], rows[n, 1] = place[n], place[2 + n], place[4 + n]
    rows[2, 0], rows[2, 1], rows[2, 2] = 0.0, 0.0, 1.0
    return bool(np.isfinite(rows).all())


@kernel
def _cut(
    part: Doubles, count: int, line: tuple[float, float, float], below: Doubles, above: Doubles
) -> tuple[int, int]:
    """Cut a convex polygon by a line; count the corners of both parts.

    The line's values are negative below. Sutherland-Hodgman, with both sides kept.
    """
    # Start from the last corner, so that the closing edge is visited too.
    low = high = 0
    a, b, c = line
    x, y = part[count - 1, 0], part[count - 1, 1]
    before = a * x + b * y + c
    for n in range(count):
        next_x, next_y = part[n, 0], part[n, 1]
        after = a * next_x + b * next_y + c
        # Add the intersection to both parts where the edge crosses the line.
        if (before < 0.0) != (after < 0.0):
            share = before / (before - after)
            cut_x, cut_y = x + share * (next_x - x), y + share * (next_y - y)
            below[low, 0], below[low, 1] = cut_x, cut_y
            above[high, 0], above[high, 1] = cut_x, cut_y
            low, high = low + 1, high + 1
        # Add the corner to the part on its side.
        if after < 0.0:
            below[low, 0], below[low, 1] = next_x, next_y
            low += 1
        else:
            above[high, 0], above[high, 1] = next_x, next_y
            high += 1
        x, y, before = next_x, next_y, after
    return low, high


@kernel
def _area(part: Doubles, count: int) -> float:
    """Area of a convex polygon."""
    twice = 0.0
    for n in range(1, count - 1):
        ax, ay = part[n, 0] - part[0, 0], part[n, 1] - part[0, 1]
        bx, by = part[n + 1, 0] - part[0, 0], part[n + 1, 1] - part[0, 1]
        twice += ax * by - ay * bx
    return abs(twice) / 2.0


@kernel
def _line(rows: Doubles, axis: int, at: float) -> tuple[float, float, float]:
    """Line on the screen where a source coordinate has a value; it is positive beyond."""
    return (
        rows[axis, 0] - at * rows[2, 0],
        rows[axis, 1] - at * rows[2, 1],
        rows[axis, 2] - at * rows[2, 2],
    )


@kernel
def _range(part: Doubles, count: int, rows: Doubles, axis: int) -> tuple[float, float]:
    """Smallest and largest source coordinate in a polygon, by its corners."""
    low, high = np.inf, -np.inf
    for n in range(count):
        x, y = part[n, 0], part[n, 1]
        value = rows[axis, 0] * x + rows[axis, 1] * y + rows[axis, 2]
        value /= rows[2, 0] * x + rows[2, 1] * y + rows[2, 2]
        low, high = min(low, value), max(high, value)
    return low, high


@kernel
def _texel(index: int, size: int, edge: int) -> int:
    """Texel at an index under the edge rule; of a transparent source, inside only."""
    if edge == WRAP:
        return index % size
    if edge == MIRROR:
        folded = index % (2 * size)
        return min(folded, 2 * size - 1 - folded)
    return min(max(index, 0), size - 1)


@kernel
def _cells(low: float, high: float, size: int, edge: int) -> tuple[int, int]:
    """First and last texel of a range."""
    if edge in (WRAP, MIRROR):
        return int(np.floor(low)), max(int(np.floor(low)), int(np.ceil(high)) - 1)
    first = int(np.floor(min(max(low, 0.0), size - 1.0)))
    return first, max(first, int(np.ceil(min(max(high, 0.0), float(size)))) - 1)


@kernel
def _square(tally: Tally, sizes: tuple[int, int], edge: int) -> tuple[int, int]:
    """Clip a pixel's square to the source; count corners, tell which of `parts`."""
    parts, rows = tally.parts, tally.rows
    # Start from the pixel's square around its center.
    for n in range(4):
        parts[0, n, 0] = 0.5 if n in (1, 2) else -0.5
        parts[0, n, 1] = 0.5 if n >= 2 else -0.5
    count, now = 4, 0
    # Clip to the part in front of the horizon.
    least = FRONT * (abs(rows[2, 0]) + abs(rows[2, 1]) + abs(rows[2, 2]))
    front = rows[2, 0], rows[2, 1], rows[2, 2] - least
    _, count = _cut(parts[now], count, front, parts[4], parts[1 - now])
    now = 1 - now
    # Clip to the four edges of a transparent source.
    if edge == TRANSPARENT:
        for axis in range(2):
            for at in (0.0, float(sizes[axis])):
                if count == 0:
                    return 0, now
                # Keep the side within: above the first edge of an axis, below its last.
                below, above = _cut(
                    parts[now], count, _line(rows, axis, at), parts[4], parts[1 - now]
                )
                if at == 0.0:
                    count, now = above, 1 - now
                else:
                    parts[now, :below] = parts[4, :below]
                    count = below
    return count, now


@kernel
def _add_column(
    labels: LabelSource, tally: Tally, column: int, corners: tuple[int, int], met: int
) -> int:
    """Add areas of labels in one column of texels; return how many were met."""
    count, now = corners
    parts = tally.parts
    height = labels.code.shape[0]

    # Find the rows of texels that the polygon meets.
    low, high = _range(parts[now], count, tally.rows, 1)
    row, last = _cells(low, high, height, labels.edge)
    at = _texel(row, height, labels.edge)
    code = labels.code[at, column]
    while row <= last:
        # Join the run of rows that have one label.
        start, current = at, code
        row += 1
        while row <= last:
            at = _texel(row, height, labels.edge)
            code = labels.code[at, column]
            if code != current:
                break
            row += 1
        # Cut the run off at its last row; the rest of the polygon stays.
        if row <= last:
            below, above = _cut(
                parts[now], count, _line(tally.rows, 1, float(row)), parts[4], parts[5 - now]
            )
            area = _area(parts[4], below)
            now, count = 5 - now, above
        else:
            area = _area(parts[now], count)
        # Add its area to the label's, and note labels met for the first time.
        if current >= 0 and area > 0.0:
            if tally.area[current] == 0.0:
                tally.met[met] = current
                tally.texel[current] = start * labels.code.shape[1] + column
                met += 1
            tally.area[current] += area
        if count == 0:
            break
    return met


@kernel
def _add_pixel(labels: LabelSource, tally: Tally) -> int:
    """Add areas of labels in a pixel; count labels, −1 if there are too many texels."""
    height, width = labels.code.shape

    # Clip the pixel's square to the source.
    count, now = _square(tally, (width, height), labels.edge)
    if count < 3:
        return 0

    # Bound the texels that it meets.
    low, high = _range(tally.parts[now], count, tally.rows, 0)
    top, bottom = _range(tally.parts[now], count, tally.rows, 1)

    # Give up near the horizon of a repeated source, where a pixel covers countless texels.
    if labels.edge in (WRAP, MIRROR):
        if not (high - low + 2.0) * (bottom - top + 2.0) < MOST_CELLS:
            return -1
        if max(abs(low), abs(high), abs(top), abs(bottom)) > 2.0**52:
            return -1
    first, last = _cells(low, high, width, labels.edge)
    met = 0

    # Cut the polygon at each column of texels, from left to right.
    for column in range(first, last + 1):
        if column < last:
            line = _line(tally.rows, 0, column + 1.0)
            below, above = _cut(tally.parts[now], count, line, tally.parts[2], tally.parts[1 - now])
            now = 1 - now
        else:
            below, above = count, 0
            tally.parts[2, :count] = tally.parts[now, :count]
        # Add the column's labels; continue with the part to its right.
        if below >= 3:
            texel = _texel(column, width, labels.edge)
            met = _add_column(labels, tally, texel, (below, 2), met)
        count = above
        if count < 3:
            break
    return met


@kernel
def _largest(tally: Tally, met: int) -> tuple[int, float]:
    """Smallest label of the largest area, and the sum of all areas; clears the areas."""
    # Find the largest area.
    total = most = 0.0
    for n in range(met):
        area = tally.area[tally.met[n]]
        total += area
        most = max(most, area)
    # Break ties by the smallest label, and clear the areas for the next pixel.
    best = -1
    for n in range(met):
        code = tally.met[n]
        if tally.area[code] >= most - NOTHING and (best < 0 or code < best):
            best = code
        tally.area[code] = 0.0
    return best, total


@kernel
def _single(labels: LabelSource, rows: Doubles) -> int:
    """Texel of a pixel if its texels share one label; less than 0 if they differ."""
    # Bound the pixel's corners in the source.
    height, width = labels.code.shape
    left = top = np.inf
    right = bottom = -np.inf
    for n in range(4):
        x, y = 0.5 if n in (1, 2) else -0.5, 0.5 if n >= 2 else -0.5
        w = rows[2, 0] * x + rows[2, 1] * y + rows[2, 2]
        # Leave pixels that cross the horizon to the exact areas.
        if w <= 0.0:
            return -1
        u = (rows[0, 0] * x + rows[0, 1] * y + rows[0, 2]) / w
        v = (rows[1, 0] * x + rows[1, 1] * y + rows[1, 2]) / w
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    # Test only small areas within the source.
    is_within = left >= 0.0 and top >= 0.0 and right <= width and bottom <= height
    if not is_within or (right - left) * (bottom - top) > MOST_UNIFORM_TEXELS:
        return -1
    # Compare the labels of all texels within the bounds.
    first_row, last_row = _cells(top, bottom, height, TRANSPARENT)
    first, last = _cells(left, right, width, TRANSPARENT)
    code = labels.code[first_row, first]
    for row in range(first_row, last_row + 1):
        for column in range(first, last + 1):
            if labels.code[row, column] != code:
                return -1
    return first_row * width + first if code >= 0 else -1


@kernel
def _find_band(
    mapping: PixelMapping, labels: LabelSource, found: LabelPicture, rows: tuple[int, int]
) -> None:
    """Find the labels of some rows of pixels."""
    tally = Tally(
        np.zeros(labels.codes),
        np.zeros(labels.codes, np.int64),
        np.zeros(labels.codes, np.int64),
        np.zeros((3, 3)),
        np.zeros((5, MOST_CORNERS, 2)),
    )
    for row in range(rows[0], rows[1]):
        for column in range(found.texel.shape[1]):
            # Skip pixels that show nothing.
            if not _fill_matrix(mapping, row, column, tally.rows):
                continue
            # Try the cheap case first: all texels around have one label.
            alike = _single(labels, tally.rows)
            if alike >= 0:
                found.texel[row, column], found.coverage[row, column] = alike, np.float32(1.0)
                continue
            # Otherwise add the exact areas; too large areas take the most common label.
            met = _add_pixel(labels, tally)
            if met < 0 and labels.common >= 0:
                found.texel[row, column] = labels.common
                found.coverage[row, column] = np.float32(1.0)
            if met <= 0:
                continue
            # Store the label of the largest area, and how much of the pixel has any.
            best, total = _largest(tally, met)
            if total >= NOTHING:
                found.texel[row, column] = tally.texel[best]
                found.coverage[row, column] = np.float32(1.0 if total > 1.0 - NOTHING else total)


@parallel_kernel
def find_labels(
    counter: Counter, mapping: PixelMapping, labels: LabelSource, found: LabelPicture
) -> None:
    """Find each pixel's label of the largest area, the smallest of equal ones."""
    for rows in bands(counter, found.texel.shape[0], BAND):
        _find_band(mapping, labels, found, rows)
