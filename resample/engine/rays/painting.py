"""Tiles of the screen with sub-pixels that integrate a field along rays."""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, packed_kernel, tasks
from resample.engine.lookup import radial
from resample.engine.rays.media import Medium
from resample.engine.rays.meshes import Way, integrate_with_mesh, is_on_mesh
from resample.types import Film, Flags, Floats, Indices, Tables, View


class Home(NamedTuple):
    """A tile and the frame it belongs to, px."""

    left: int
    top: int
    size: int
    width: int
    height: int


@kernel
def pixel_weights(tables: Tables, n: int) -> Floats:
    """Weights, with sum 1, of the sub-pixels along one axis that a pixel's filter covers."""
    margin = tables.pixel_margin
    weight, total = np.zeros((2 * margin + 1) * n, np.float32), np.float32(0.0)
    # Evaluate the filter at the sub-pixels' centers, then normalize.
    for tap in range(weight.size):
        distance = abs((tap + 0.5) / n - margin - 0.5)
        weight[tap] = radial(tables.pixel, tables.pixel_extent, distance)
        total += weight[tap]
    for tap in range(weight.size):
        weight[tap] /= total
    return weight


# Positions of a sub-pixel's numbers; the first three are red, green and blue.
ALPHA, DEEP, FIRST, COVER, VALUE, PRESENCE = range(3, 9)
NUMBERS = 9  # per sub-pixel
# Weights of a cubic's middle for the nearer and the farther samples of two lines.
NEAR, FAR, THREE = np.float32(9 / 32), np.float32(1 / 32), np.float32(3.0)


class Evenness(NamedTuple):
    """Tolerance for bends where sub-pixels are interpolated."""

    bend: float  # of colors, absolute
    share: float  # of colors, relative to the largest nearby
    value: float  # data units


Line = tuple[int, int, int, int, int, int, int, int]  # rows and columns of four sub-pixels


@inner_kernel
def line_through(row: int, column: int, down: int, right: int) -> Line:
    """Sub-pixels at -3, -1, 1 and 3 steps of (down, right) from a position."""
    return (
        row - 3 * down, column - 3 * right, row - down, column - right,
        row + down, column + right, row + 3 * down, column + 3 * right,
    )  # fmt: skip


@inner_kernel
def _is_even(fine: Floats, one: Line, two: Line, number: int, even: Evenness) -> bool:
    """Whether one number is even along two lines, and both predict the same in the middle."""
    # Load the eight samples.
    a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
    c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
    e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
    g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
    # Set the tolerance: absolute, and relative to the nearer samples.
    most = max(abs(b), abs(c), abs(f), abs(g))
    slack = even.value if number == VALUE else even.bend + even.share * most
    # Compare what both lines predict in the middle.
    twist = abs(NEAR * (b + c - f - g) - FAR * (a + d - e - h))
    # Compare third differences; NaN compares as uneven.
    return bool(
        abs(a - d + THREE * (c - b)) <= slack
        and abs(e - h + THREE * (g - f)) <= slack
        and twist <= slack
    )


@inner_kernel
def is_even(fine: Floats, one: Line, two: Line, even: Evenness) -> bool:
    """Whether color, opacity, value and presence are even along two lines."""
    for number in (0, 1, 2, ALPHA, VALUE, PRESENCE):
        if not _is_even(fine, one, two, number, even):
            return False
    return True


@inner_kernel
def fill(fine: Floats, one: Line, two: Line, here: Floats) -> None:
    """Interpolate a sub-pixel from two lines, clamped to the samples on them."""
    for number in range(NUMBERS):
        a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
        c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
        e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
        g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
        # A nearest depth is not interpolated: take the least of the nearer four.
        if number == FIRST:
            here[number] = min(b, c, f, g)
            continue
        # Average the cubics of both lines, and clamp overshoot.
        between = NEAR * (b + c + f + g) - FAR * (a + d + e + h)
        least, most = min(a, b, c, d, e, f, g, h), max(a, b, c, d, e, f, g, h)
        here[number] = min(most, max(least, between))


GRID, CENTERS, BETWEEN, REST = range(4)  # stages of sampling
ALIKE = np.float32(0.1)  # opacity by which squares beside each other differ that are even
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Output(NamedTuple):
    """The picture that is painted, tile by tile."""

    camera: View
    tables: Tables
    film: Film
    value: Floats  # (H, W) values of projections; or (0, 0)
    is_sum: bool  # values are integrals, not to be weighed by presence
    even: Evenness  # tolerance for sub-pixels that are interpolated
    drift: float  # of rays in sub-pixels, from one row or column to the next; 0..1, 0: a grid
    apart: int  # sub-pixels between rays of the coarsest grid, a power of 2
    shown: Flags  # (R, C) squares of the screen in which something may be visible; or (0, 0)
    per_square: float  # squares per px; the first begins at the first tile
    size: int  # px, side of a tile
    columns: int  # tiles in a row of them
    which: Indices  # (T,) numbers of the tiles to be painted
    left: int  # px, of the first tile
    top: int  # px, of the first tile


@inner_kernel
def _point(output: Output, home: Home, n: int, row: int, column: int) -> tuple[float, float]:
    """Screen point that the ray of a sub-pixel passes through, px.

    All rays of a row are moved right alike, and rays of a column up. So a thin line along an
    axis is met by as many rays wherever it is, if the drift is the golden ratio.
    """
    # Count sub-pixels from the frame's corner.
    margin, drift = output.tables.pixel_margin, output.drift
    down, right = (home.top - margin) * n + row, (home.left - margin) * n + column
    first = 0.5 - 0.5 * drift
    x, y = right + (first + drift * down) % 1.0, down + 1.0 - (first + drift * right) % 1.0
    return x / n, y / n


@inner_step
def _cast(
    way: Any, medium: Medium, output: Output, home: Home, n: int, place: tuple[int, int],
    here: Floats, fine: Floats, beside: tuple[int, int],
) -> None:  # fmt: skip
    """Cast the ray of a sub-pixel, and store its result in `here`.

    `place`: its row and column in `fine`. `beside`: how far up and left one lies that was cast
    before, unless that is outside the tile.
    """
    row, column = place
    x, y = _point(output, home, n, row, column)
    up, left, hint = row - beside[0], column - beside[1], math.inf
    if up >= 0 and left >= 0:
        hint = float(fine[up, left, FIRST])
    result = integrate_with_mesh(x, y, hint, way, medium, output.camera)
    here[0], here[1], here[2] = result[0], result[1], result[2]
    here[ALPHA], here[DEEP], here[FIRST] = result[3], result[4], result[5]
    here[COVER], here[VALUE], here[PRESENCE] = result[6], result[7], result[8]


@inner_kernel
def _interpolate_if_even(
    medium: Medium, output: Output, home: Home, n: int, fine: Floats, at: tuple[int, int, int, int]
) -> bool:
    """Interpolate a sub-pixel if it is even along two lines through it; return whether so."""
    # Silhouettes of meshes are sharp: cast a ray there.
    row, column, down, right = at
    x, y = _point(output, home, n, row, column)
    if is_on_mesh(x, y, medium.mesh, output.camera):
        return False
    # Test the sub-pixels on two lines at right angles.
    one = line_through(row, column, down, right)
    two = line_through(row, column, -right, down)
    if not is_even(fine, one, two, output.even):
        return False
    fill(fine, one, two, fine[row, column])
    return True


@inner_kernel
def _place_in_square(apart: int, top: int, left: int, fine: Floats) -> tuple[int, int]:
    """Sub-pixel that is cast first in a square of `apart` sub-pixels, by the square's corner.

    As in `_point`: a line along an axis passes one in three of the squares on it, if it is half as
    wide as they are.
    """
    down = int(apart * (GOLDEN * (left // apart) % 1.0))
    right = int(apart * (GOLDEN * (top // apart) % 1.0))
    return min(fine.shape[0] - 1, top + down), min(fine.shape[1] - 1, left + right)


@inner_kernel
def _may_show(shown: Flags, row: float, column: float) -> bool:
    """Whether anything may be visible around a place, in squares; True if unknown."""
    if shown.size == 0:
        return True
    rows, columns = shown.shape
    return bool(shown[min(max(0, int(row)), rows - 1), min(max(0, int(column)), columns - 1)])


@inner_kernel
def _fill_even_squares(
    apart: int, shown: Flags, first: tuple[float, float], per: float, fine: Floats
) -> None:
    """Copy the first ray of each square, at its corner, to the whole square if even.

    A square is even if it is as opaque as those around it, by the first ray of each. Where one of
    them is empty, but something may be visible, it may lie between the rays. Elsewhere opacity that
    is not a number tells where rays are still to be cast. `first`: place of the tile, in squares
    that may be shown, `per` sub-pixel.
    """
    rows, columns, _ = fine.shape
    # Decide for all squares before any corner changes; light leaves room for that in its value.
    for top in range(0, rows, apart):
        for left in range(0, columns, apart):
            above = below = fine[top, left, ALPHA]
            for row in range(max(0, top - apart), min(rows, top + 2 * apart), apart):
                for column in range(max(0, left - apart), min(columns, left + 2 * apart), apart):
                    beside = fine[row, column, ALPHA]
                    above, below = max(above, beside), min(below, beside)
            is_even = above - below <= ALIKE and (
                below > 0.0 or not _may_show(shown, first[0] + top * per, first[1] + left * per)
            )
            fine[top, left, VALUE] = 1.0 if is_even else 0.0
    for top in range(0, rows, apart):
        for left in range(0, columns, apart):
            here = fine[top, left]
            is_even, here[VALUE] = here[VALUE] > 0.0, np.float32(0.0)
            known = _place_in_square(apart, top, left, fine)
            for number in range(NUMBERS):
                fine[known[0], known[1], number] = here[number]
            for row in range(top, min(rows, top + apart)):
                for column in range(left, min(columns, left + apart)):
                    if is_even:
                        for number in range(NUMBERS):
                            fine[row, column, number] = here[number]
                    elif apart > 2 or row != known[0] or column != known[1]:
                        fine[row, column, ALPHA] = np.nan


@inner_kernel
def _cast_rays(way: Any, medium: Medium, output: Output, home: Home, n: int, fine: Floats) -> None:
    """Sample the sub-pixels (R, C, NUMBERS) of a tile adaptively.

    First cast rays `apart`. Then, at half that distance, fill in those in the middle of four, and
    those between these, by rays only where their surroundings are uneven; and so on.

    Rays of a grid that drifts are cast one in each square, then one in each of its quarters where
    it differs from those around, and so on.
    """
    rows, columns, _ = fine.shape
    half, stage = output.apart, GRID
    is_in_squares = output.drift > 0.0 and output.apart > 1
    # Place of the tile, and of a sub-pixel, in squares of the screen.
    per, margin = output.per_square / n, output.tables.pixel_margin
    first = (
        (home.top - margin - output.top) * output.per_square,
        (home.left - margin - output.left) * output.per_square,
    )
    while half > 0:
        for row in range(
            half if stage == CENTERS else 0, rows, half if stage != CENTERS else 2 * half
        ):
            # Points between start half a step in, in every other row.
            is_each = stage == GRID or is_in_squares
            start = 0 if is_each or (stage == BETWEEN and row % (2 * half) > 0) else half
            for column in range(start, columns, half if is_each else 2 * half):
                # Skip empty and known sub-pixels.
                place = row, column
                if stage == REST and not np.isnan(fine[row, column, ALPHA]):
                    continue
                if stage != REST and not _may_show(
                    output.shown, first[0] + row * per, first[1] + column * per
                ):
                    fine[row, column, FIRST] = np.inf
                    continue
                if is_in_squares:
                    place = _place_in_square(half, row, column, fine)
                # Interpolate where four sub-pixels on each line are inside the tile.
                far = 3 * half
                if (
                    not is_each
                    and far <= row < rows - far
                    and far <= column < columns - far
                    and _interpolate_if_even(
                        medium, output, home, n, fine,
                        (row, column, 0 if stage == BETWEEN else half, half),
                    )
                ):  # fmt: skip
                    continue
                up = half if stage == CENTERS or column == 0 else 0
                left = half if stage == CENTERS or column > 0 else 0
                _cast(way, medium, output, home, n, place, fine[row, column], fine, (up, left))
        # Halve the distance: first the centers of squares, then the points between.
        if is_in_squares:
            if half > 1:
                _fill_even_squares(half, output.shown, first, per, fine)
            half, stage = half >> 1, REST
        elif stage == CENTERS:
            stage = BETWEEN
        else:
            half, stage = half >> 1, CENTERS


@kernel
def _resolve(fine: Floats, n: int, weight: Floats, home: Home, output: Output) -> None:
    """Filter the sub-pixels of a tile to its pixels."""
    # Find the footprint of the pixel filter.
    film, (height, width) = output.film, output.film.depth.shape
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    total = np.empty(NUMBERS, np.float32)
    for row in range(home.top, min(home.top + home.size, height)):
        for column in range(home.left, min(home.left + home.size, width)):
            # Convolve the sub-pixels around the pixel with the filter.
            total[:] = 0.0
            first, present = np.float32(np.inf), np.float32(0.0)
            for down in range(weight.size):
                for right in range(weight.size):
                    here = fine[(row - home.top) * n + down, (column - home.left) * n + right]
                    # Nothing adds nothing, except to the length over which values are integrated.
                    is_nothing = here[ALPHA] == 0.0 and here[COVER] == 0.0 and here[PRESENCE] == 0.0
                    if is_nothing and not output.is_sum:
                        continue
                    share = weight[down] * weight[right]
                    # All numbers are averages, but for the nearest depth and the weighted value.
                    for number in range(NUMBERS):
                        if number not in (FIRST, VALUE):
                            total[number] += share * here[number]
                    # Weigh values by presence, so that rays that miss the field do not count.
                    of_value = share if output.is_sum else share * here[PRESENCE]
                    total[VALUE] += of_value * here[VALUE]
                    present += of_value
                    # The nearest depth is the least within the pixel proper.
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, here[FIRST])
            # Clamp what negative lobes of the filter leave, and store the pixel.
            alpha = total[ALPHA]
            for channel in range(3):
                film.rgba[row, column, channel] = max(np.float32(0.0), total[channel])
            film.rgba[row, column, 3] = min(np.float32(1.0), max(np.float32(0.0), alpha))
            film.depth[row, column] = total[DEEP] / alpha if alpha > 0.0 else np.float32(np.inf)
            film.first_depth[row, column] = first
            film.coverage[row, column] = min(np.float32(1.0), max(np.float32(0.0), total[COVER]))
            # Normalize the value by its weights.
            if output.value.size and present > 0.0:
                output.value[row, column] = total[VALUE] / present


@kernel
def paint_tile(tile: int, n: int, way: Any, medium: Medium, output: Output) -> None:
    """Sample a tile by rays, and filter it to its pixels."""
    # Lay out the tile within the frame, with the filter's margin.
    size, margin = output.size, output.tables.pixel_margin
    height, width = output.film.depth.shape
    left = output.left + tile % output.columns * size
    top = output.top + tile // output.columns * size
    home = Home(left, top, size, width, height)
    rows = (min(size, height - home.top) + 2 * margin) * n
    columns = (min(size, width - home.left) + 2 * margin) * n
    # Sample its sub-pixels, then filter them to pixels.
    fine = np.zeros((rows, columns, NUMBERS), np.float32)
    _cast_rays(way, medium, output, home, n, fine)
    _resolve(fine, n, pixel_weights(output.tables, n), home, output)


@packed_kernel
def paint_rays(
    counter: Counter, count: int, fineness: int, way: Way, medium: Medium, output: Output
) -> None:
    """Paint tiles of a picture by casting rays.

    `count`: tiles to paint. `fineness`: Sub-pixels per side of a pixel. `way`: the integrand
    along rays. `medium`: the field. `output`: the picture, filled.
    """
    for task in tasks(counter, count):
        paint_tile(output.which[task], fineness, way, medium, output)


@kernel
def weigh_neighbours(lines: Floats, middle: float, side: float, weighed: Floats) -> None:
    """Sum each value and both its neighbours in a line; ends are repeated.

    `lines`: (lines, places, numbers). `middle`, `side`: weights. `weighed`: result; may be `lines`.
    """
    before = np.empty(lines.shape[2])
    for line in range(lines.shape[0]):
        before[:] = lines[line, 0]
        for place in range(lines.shape[1]):
            after = min(place + 1, lines.shape[1] - 1)
            for n in range(lines.shape[2]):
                here = float(lines[line, place, n])
                weighed[line, place, n] = here * middle + (before[n] + lines[line, after, n]) * side
                before[n] = here
