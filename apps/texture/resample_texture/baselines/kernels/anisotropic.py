"""Read a pyramid of box means as a graphics card does.

Bilinear taps in the two nearest levels: OpenGL's EXT_texture_filter_anisotropic, but with the exact
axes of the pixel's ellipse in the source instead of approximate ones: taps lie along the major
axis, and one tap's width sets their level. With one tap this is trilinear mip mapping.
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


class MipPyramid(NamedTuple):
    """Box means of a source, level by level."""

    texel: Floats  # of all levels, flat
    levels: NDArray[np.int64]  # (L, 3) where each begins, its height and its width


class ByMatrix(NamedTuple):
    """A homography."""

    inverse: Doubles  # (3, 3) target to source, positive in front of the camera


class ByMap(NamedTuple):
    """A map: places and sides of all pixels in the source."""

    places: Doubles  # (6, h, w) of what `_read_row` reads in (w, 6)


class TapPicture(NamedTuple):
    """Picture to fill, empty before."""

    image: Floats  # (h, w, c)
    coverage: Floats  # (h, w)


class Taps(NamedTuple):
    """Taps at equal steps along a line, texels of the finest level."""

    number: int
    x: float  # the middle of them
    y: float
    side_x: float  # length of the line, which they divide
    side_y: float


@kernel
def _settle(position: float, size: int, edge: int) -> float:
    """Equivalent coordinate under the edge rule, at most one texel outside the level."""
    if edge == WRAP:
        return position - size * float(np.floor(position / size))
    if edge == MIRROR:
        along = position - 2 * size * float(np.floor(position / (2 * size)))
        return min(along, 2 * size - along)
    return min(max(position, -1.0), size + 1.0)


@kernel
def _pair(position: float, size: int, edge: int) -> tuple[int, int, Single, Single]:
    """Two texels of a row or column around a coordinate, and their linear weights."""
    # Texel centers lie at half-integers.
    settled = _settle(position, size, edge) - 0.5
    first = math.floor(settled)
    second = first + 1
    weight = np.float32(settled - first)
    other = np.float32(1.0) - weight
    # Inside the level, no edge rule applies.
    if first >= 0 and second < size:
        return first, second, other, weight
    # Beyond a transparent edge there is no texel to weigh.
    if edge == TRANSPARENT:
        other = other if 0 <= first < size else np.float32(0.0)
        weight = weight if 0 <= second < size else np.float32(0.0)
    # Wrapped indices come around; mirrored ones are at most one outside, so clamping reflects them.
    if edge == WRAP:
        return first % size, second % size, other, weight
    return min(max(first, 0), size - 1), min(max(second, 0), size - 1), other, weight


@kernel
def _weigh(
    level: tuple[int, int, int], x: float, y: float, channels: int, edge: int
) -> tuple[tuple[int, int, int, int], tuple[Single, Single, Single, Single]]:
    """Offsets and bilinear weights of the 2 × 2 texels around a place; 0 for no texel.

    A level is where it begins in the array of all texels, its height and its width.
    """
    first, height, width = level
    left, right, on_left, on_right = _pair(x, width, edge)
    upper, lower, above, below = _pair(y, height, edge)
    upper = first + upper * width * channels
    lower = first + lower * width * channels
    left, right = left * channels, right * channels
    start = upper + left, upper + right, lower + left, lower + right
    return start, (above * on_left, above * on_right, below * on_left, below * on_right)


@kernel
def _taps(seen: Doubles, column: int, most: int) -> tuple[Taps, float]:
    """Choose a pixel's taps, and return the width of one of them in texels.

    A disk in the pixel is an ellipse in the source, whose axes are those of J Jᵀ. Where that
    ellipse is less than a texel wide, more taps would read the same texels again.
    """
    # Take J Jᵀ from the pixel's sides.
    across_x, across_y = seen[column, 2], seen[column, 3]
    down_x, down_y = seen[column, 4], seen[column, 5]
    xx, yy = across_x**2 + down_x**2, across_y**2 + down_y**2
    xy = across_x * across_y + down_x * down_y
    # Find its eigenvalues: the squared axes of the ellipse.
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = math.sqrt(half * half + xy * xy)
    longer, shorter = math.sqrt(mean + root), max(math.sqrt(max(mean - root, 0.0)), 1.0)
    # Use one tap per minor axis along the major; rounding must not add one to a ratio of 4.
    ratio = longer / shorter - 1e-6
    count = max(1, math.ceil(ratio)) if ratio < most else most
    # Find the direction of the major axis by the better conditioned of two formulas.
    axis_x = half + root if half >= 0.0 else xy
    axis_y = xy if half >= 0.0 else root - half
    scale = longer / max(math.sqrt(axis_x**2 + axis_y**2), TINY)
    side = axis_x * scale, axis_y * scale
    return Taps(count, seen[column, 0], seen[column, 1], side[0], side[1]), longer / count


@kernel
def _is_somewhere(seen: Doubles, column: int) -> bool:
    """Whether a pixel shows a place that numbers can resolve."""
    total = 0.0
    for k in range(6):
        total += abs(seen[column, k])
    return total < FARTHEST


@kernel
def _read_row(
    means: MipPyramid, seen: Doubles, reading: Reading, picture: TapPicture, row: int
) -> None:
    """Fill a row of pixels, each from the two levels nearest to a tap's width.

    `seen` (w, 6) is what the row shows, texels: a pixel's center (x, y), its side along the
    row and its side along the column; not finite where there is nothing.
    """
    (texel, levels), (image, coverage) = means, picture
    channels = image.shape[2]
    last = levels.shape[0] - 1
    for column in range(coverage.shape[1]):
        # Skip pixels that show nothing.
        if not _is_somewhere(seen, column):
            continue
        # Choose the taps, and the two levels around the width of one.
        taps, width = _taps(seen, column, reading.most_taps)
        fineness = min(max(math.log2(max(width, TINY)), 0.0), float(last))
        fine = int(fineness)
        coarse_share = np.float32(fineness - fine)
        filled = np.float32(0.0)
        # Blend the finer and the coarser level.
        for number in range(fine, fine + (2 if coarse_share > 0.0 else 1)):
            share = coarse_share if number > fine else np.float32(1.0) - coarse_share
            share /= np.float32(taps.number)
            level = levels[number, 0], levels[number, 1], levels[number, 2]
            # Scale places to the level: sizes are rounded, so each axis has its own factor.
            scale_x, scale_y = level[2] / levels[0, 2], level[1] / levels[0, 1]
            # Sum bilinear taps along the major axis.
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
        # Coverage below 1 only occurs at a transparent edge.
        is_full = reading.edge != TRANSPARENT or filled > 1.0
        coverage[row, column] = np.float32(1.0) if is_full else filled


@making_role
def fill_row(geometry: ByMatrix | ByMap, row: int, seen: Doubles) -> None:
    """Fill in what a row shows, as `_read_row` reads it.

    It is infinite before, which means nothing.
    """
    raise NotImplementedError


@plays(fill_row, ByMatrix)
def _fill_by_matrix(geometry, row, seen):  # type: ignore[no-untyped-def]
    """Project a row of pixels into the source."""
    inverse, y = geometry.inverse, row + 0.5
    for column in range(seen.shape[0]):
        x = column + 0.5
        w = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2]
        # Leave pixels behind the horizon infinite.
        if w > 0.0:
            u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / w
            v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / w
            seen[column, 0], seen[column, 1] = u, v
            # Differentiate the homography for the pixel's sides.
            for axis in range(2):
                seen[column, 2 + 2 * axis] = (inverse[0, axis] - u * inverse[2, axis]) / w
                seen[column, 3 + 2 * axis] = (inverse[1, axis] - v * inverse[2, axis]) / w


@plays(fill_row, ByMap)
def _fill_by_map(geometry, row, seen):  # type: ignore[no-untyped-def]
    """Copy a row of the map."""
    for column in range(seen.shape[0]):
        for k in range(6):
            seen[column, k] = geometry.places[k, row, column]


@kernel
def _fill_row(
    means: MipPyramid, geometry: ByMatrix | ByMap, reading: Reading, picture: TapPicture, row: int
) -> None:
    """Fill one row of the picture."""
    seen = np.full((picture.coverage.shape[1], 6), np.inf)
    fill_row(geometry, row, seen)
    _read_row(means, seen, reading, picture, row)


@parallel_kernel
def read(
    counter: Counter,
    means: MipPyramid,
    geometry: ByMatrix | ByMap,
    reading: Reading,
    picture: TapPicture,
) -> None:
    """Fill an empty picture with what its pixels show of a source."""
    for row in tasks(counter, picture.coverage.shape[0]):
        _fill_row(means, geometry, reading, picture, row)
