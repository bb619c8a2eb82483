"""Read a pyramid of box means as a graphics card does: bilinear taps in the two nearest levels.

OpenGL's EXT_texture_filter_anisotropic, with the exact axes of the pixel's ellipse in the source
for its approximate ones: taps lie along the major axis, and their level is that of one tap's width.
With one tap this is trilinear mip mapping.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.roles import making_role, plays
from resample.types import Doubles, Floats, Single

TRANSPARENT, CLAMP, WRAP, MIRROR = range(4)
TINY = 1e-30  # texels
FARTHEST = 1e15  # texels; beyond it coordinates have no fractions, and nothing is drawn


class Reading(NamedTuple):
    """Choices of the user."""

    most_taps: int
    edge: int  # TRANSPARENT, CLAMP, WRAP or MIRROR


class Means(NamedTuple):
    """Box means of a source, level by level."""

    texel: Floats  # of all levels, flat
    levels: NDArray[np.int64]  # (L, 3) where each begins, its height and its width


class ByMatrix(NamedTuple):
    """A homography."""

    inverse: Doubles  # (3, 3) target to source, positive before the eye


class ByMap(NamedTuple):
    """What every pixel shows."""

    places: Doubles  # (6, h, w) of what `_read_row` reads in (w, 6)


class Picture(NamedTuple):
    """What is read, empty before."""

    image: Floats  # (h, w, c)
    coverage: Floats  # (h, w)


class Taps(NamedTuple):
    """Taps at equal steps, texels of the finest level."""

    number: int
    x: float  # the middle of them
    y: float
    side_x: float  # what they divide
    side_y: float


class Level(NamedTuple):
    """Where one level lies."""

    start: int  # in the array of all texels
    height: int
    width: int


@kernel
def _settle(position: float, size: int, edge: int) -> float:
    """Coordinate at most one texel outside a level that shows what the given one shows."""
    if edge == WRAP:
        return position - size * float(np.floor(position / size))
    if edge == MIRROR:
        along = position - 2 * size * float(np.floor(position / (2 * size)))
        return min(along, 2 * size - along)
    return min(max(position, -1.0), size + 1.0)


@kernel
def _pair(position: float, size: int, edge: int) -> tuple[int, int, Single, Single]:
    """Two texels of a row or column around a coordinate, and their weights."""
    settled = _settle(position, size, edge) - 0.5
    first = math.floor(settled)
    second = first + 1
    weight = np.float32(settled - first)
    other = np.float32(1.0) - weight
    if first >= 0 and second < size:
        return first, second, other, weight
    if edge == TRANSPARENT:
        other = other if 0 <= first < size else np.float32(0.0)
        weight = weight if 0 <= second < size else np.float32(0.0)
    if edge == WRAP:
        return first % size, second % size, other, weight
    return min(max(first, 0), size - 1), min(max(second, 0), size - 1), other, weight


@kernel
def _weigh(
    level: Level, x: float, y: float, channels: int, edge: int
) -> tuple[tuple[int, int, int, int], tuple[Single, Single, Single, Single]]:
    """Where the 2 × 2 texels around a place begin, and their bilinear weights; 0 for no texel."""
    left, right, on_left, on_right = _pair(x, level.width, edge)
    upper, lower, above, below = _pair(y, level.height, edge)
    upper = level.start + upper * level.width * channels
    lower = level.start + lower * level.width * channels
    left, right = left * channels, right * channels
    start = upper + left, upper + right, lower + left, lower + right
    return start, (above * on_left, above * on_right, below * on_left, below * on_right)


@kernel
def _taps(seen: Doubles, column: int, most: int) -> tuple[Taps, float]:
    """Taps for a pixel, and the width of one of them in texels.

    A disk in the pixel is an ellipse in the source; J Jᵀ has its axes. Where that ellipse is less
    than a texel wide, more taps would read the same texels again.
    """
    across_x, across_y = seen[column, 2], seen[column, 3]
    down_x, down_y = seen[column, 4], seen[column, 5]
    xx, yy = across_x**2 + down_x**2, across_y**2 + down_y**2
    xy = across_x * across_y + down_x * down_y
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    longer, shorter = math.sqrt(mean + root), max(math.sqrt(max(mean - root, 0.0)), 1.0)
    ratio = longer / shorter - 1e-6  # so that rounding adds no tap to a ratio of 4
    count = max(1, math.ceil(ratio)) if ratio < most else most
    axis_x = half + root if half >= 0.0 else xy
    axis_y = xy if half >= 0.0 else root - half
    scale = longer / max(math.sqrt(axis_x**2 + axis_y**2), TINY)
    side = axis_x * scale, axis_y * scale
    return Taps(count, seen[column, 0], seen[column, 1], side[0], side[1]), longer / count


@kernel
def _is_somewhere(seen: Doubles, column: int) -> bool:
    """Whether a pixel shows a place that numbers can tell."""
    total = 0.0
    for k in range(6):
        total += abs(seen[column, k])
    return total < FARTHEST


@kernel
def _read_row(means: Means, seen: Doubles, reading: Reading, picture: Picture, row: int) -> None:
    """Fill a row of pixels, each from the two levels whose texels are nearest to a tap's width.

    `seen` (w, 6) is what the row shows, texels: a pixel's center (x, y), its side along the
    row and its side along the column; not finite where there is nothing.
    """
    (texel, levels), (image, coverage) = means, picture
    channels = image.shape[2]
    last = levels.shape[0] - 1
    for column in range(coverage.shape[1]):
        if not _is_somewhere(seen, column):
            continue
        taps, width = _taps(seen, column, reading.most_taps)
        fineness = min(max(math.log2(max(width, TINY)), 0.0), float(last))
        fine = int(fineness)
        coarse_share = np.float32(fineness - fine)
        filled = np.float32(0.0)
        for number in range(fine, fine + (2 if coarse_share > 0.0 else 1)):
            share = coarse_share if number > fine else np.float32(1.0) - coarse_share
            share /= np.float32(taps.number)
            level = Level(levels[number, 0], levels[number, 1], levels[number, 2])
            scale_x, scale_y = level.width / levels[0, 2], level.height / levels[0, 1]
            for tap in range(taps.number):
                along = (tap + 0.5) / taps.number - 0.5
                x, y = taps.x + along * taps.side_x, taps.y + along * taps.side_y
                start, weight = _weigh(level, x * scale_x, y * scale_y, channels, reading.edge)
                for c in range(channels):
                    image[row, column, c] += share * (
                        weight[0] * texel[start[0] + c]
                        + weight[1] * texel[start[1] + c]
                        + weight[2] * texel[start[2] + c]
                        + weight[3] * texel[start[3] + c]
                    )
                filled += share * (weight[0] + weight[1] + weight[2] + weight[3])
        is_full = reading.edge != TRANSPARENT or filled > 1.0
        coverage[row, column] = np.float32(1.0) if is_full else filled


@making_role
def see_row(geometry: ByMatrix | ByMap, row: int, seen: Doubles) -> None:
    """Fill in what a row shows, as `_read_row` reads it; there is nothing yet."""
    raise NotImplementedError


@plays(see_row, ByMatrix)
def _see_by_matrix(geometry, row, seen):  # type: ignore[no-untyped-def]
    inverse, y = geometry.inverse, row + 0.5
    for column in range(seen.shape[0]):
        x = column + 0.5
        w = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        if w > 0.0:
            u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / w
            v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / w
            seen[column, 0], seen[column, 1] = u, v
            for axis in range(2):
                seen[column, 2 + 2 * axis] = (inverse[0, axis] - u * inverse[2, axis]) / w
                seen[column, 3 + 2 * axis] = (inverse[1, axis] - v * inverse[2, axis]) / w


@plays(see_row, ByMap)
def _see_by_map(geometry, row, seen):  # type: ignore[no-untyped-def]
    for column in range(seen.shape[0]):
        for k in range(6):
            seen[column, k] = geometry.places[k, row, column]


@kernel
def _fill_row(
    means: Means, geometry: ByMatrix | ByMap, reading: Reading, picture: Picture, row: int
) -> None:
    seen = np.full((picture.coverage.shape[1], 6), np.inf)
    see_row(geometry, row, seen)
    _read_row(means, seen, reading, picture, row)


@parallel_kernel
def read(
    counter: Counter,
    means: Means,
    geometry: ByMatrix | ByMap,
    reading: Reading,
    picture: Picture,
) -> None:
    """Fill an empty picture with what its pixels show of a source."""
    for row in tasks(counter, picture.coverage.shape[0]):
        _fill_row(means, geometry, reading, picture, row)
