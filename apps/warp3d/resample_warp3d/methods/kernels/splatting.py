"""Elliptical Gaussian splats of a depth image's samples; points are splats of one size.

Samples are painted in segments of a source row, whose order in the source is that of their sums.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.roles import plays
from resample.engine.surfaces.blocks import WEIGHT, Block, Surfaces
from resample.engine.surfaces.ellipses import beyond_center, first_center, held_ellipse
from resample.engine.surfaces.painting import add, claim, paint_tile, write
from resample.types import Floats, Single, Tiles
from resample_warp3d.methods.kernels.jacobian import (
    ACROSS,
    DOWNWARD,
    NEARNESS,
    SEGMENT,
    XU,
    XV,
    YU,
    YV,
    X,
    Y,
)
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links, Rendered

GROUP = 3  # channels that are summed at a time, beside their weight


SLACK: Single = np.float32(1.001)  # of squares of distances, that rounding leaves nothing out


class Brush(NamedTuple):
    """How samples are drawn."""

    core: float  # px of the source from a sample toward its links where it hides what is behind
    tolerance: float  # of the nearness: what is further than this behind the nearest is hidden
    radius: float  # px of the source from a splat's center to its rim
    least: float  # px of the target per px of the source along any direction; shorter axes grow
    most: float  # as `least`; longer axes shrink
    reach: float  # px of the target that a sample can reach at most
    profile: Floats  # (N,) weights over the square of the distance from the center, 0 to the rim


class Samples(NamedTuple):
    """A source's samples on the screen."""

    color: Floats  # (H, W, C)
    links: Links  # (H, W)
    sample: Floats  # (H, FIELDS, W)
    brush: Brush


class Surroundings(NamedTuple):
    """Bounds of what may reach a block, px."""

    left: Single
    top: Single
    right: Single
    bottom: Single
    reach: Single  # from the block itself


@kernel
def _around(block: Block, reach: float) -> Surroundings:
    rows, columns = block.floor.shape
    return Surroundings(
        np.float32(block.left - reach),
        np.float32(block.top - reach),
        np.float32(block.left + columns + reach),
        np.float32(block.top + rows + reach),
        np.float32(reach),
    )


@kernel
def _is_near(x: Single, y: Single, around: Surroundings) -> bool:
    """Whether a place is within bounds; not if it is not a number."""
    return bool(around.left < x < around.right and around.top < y < around.bottom)


@kernel
def _apart(x: Single, y: Single, around: Surroundings) -> tuple[Single, Single]:
    """How far a place that is near lies beside and above or below a block, px."""
    zero, reach = np.float32(0), around.reach
    return (
        max(around.left + reach - x, x - around.right + reach, zero),
        max(around.top + reach - y, y - around.bottom + reach, zero),
    )


@kernel
def _span(samples: Samples, member: int) -> tuple[int, int, int]:
    """Row of a segment in the source, and its first and last + 1 column."""
    width = samples.sample.shape[2]
    row, segment = divmod(int(np.int64(member)), -(-width // SEGMENT))
    return row, segment * SEGMENT, min((segment + 1) * SEGMENT, width)


@plays(claim, Samples)
def _cover(samples: Samples, member: int, block: Block) -> None:
    """Let samples hide what is behind them, where their cells hold the centers of pixels.

    A cell ends half a px from the sample at boundaries, and overlaps those of its links. What is
    nearest stands in the floor.
    """
    half, sample, links, brush = np.float32(0.5), samples.sample, samples.links, samples.brush
    core, edge = np.float32(brush.core), min(half, np.float32(brush.core))
    reach, floor, area_of = np.float32(brush.reach), block.floor, block.area
    rows, columns = floor.shape
    row, first, last = _span(samples, member)
    around = _around(block, brush.reach)
    for n in range(first, last):
        x, y = sample[row, X, n], sample[row, Y, n]
        if not _is_near(x, y, around):
            continue
        xu, xv = sample[row, XU, n], sample[row, XV, n]
        yu, yv = sample[row, YU, n], sample[row, YV, n]
        wide = min(core * (abs(xu) + abs(xv)), reach)
        high = min(core * (abs(yu) + abs(yv)), reach)
        beside, below = _apart(x, y, around)
        if beside > wide or below > high:
            continue
        top, bottom = first_center(y - high, block.top), beyond_center(y + high, block.top + rows)
        left = first_center(x - wide, block.left)
        right = beyond_center(x + wide, block.left + columns)
        if top >= bottom or left >= right:
            continue
        area, link = xu * yv - xv * yu, links[row, n]
        share = np.float32(1) / area
        least_u, most_u = -core if link & LEFT else -edge, core if link & RIGHT else edge
        least_v, most_v = -core if link & UP else -edge, core if link & DOWN else edge
        near = sample[row, NEARNESS, n]
        across, downward = sample[row, ACROSS, n], sample[row, DOWNWARD, n]
        for r in range(top, bottom):
            dy = np.float32(r) + half - y
            for c in range(left, right):
                dx = np.float32(c) + half - x
                u, v = (yv * dx - xv * dy) * share, (xu * dy - yu * dx) * share
                if least_u <= u <= most_u and least_v <= v <= most_v:
                    nearness = near + across * dx + downward * dy
                    i, j = np.uint64(r - block.top), np.uint64(c - block.left)
                    if nearness > floor[i, j]:
                        floor[i, j], area_of[i, j] = nearness, abs(area)


@plays(add, Samples)
def _splat(samples: Samples, member: int, group: int, block: Block) -> None:
    """Sum what samples give to pixels where they are on the nearest surface.

    Where no cell has been, all are, and the nearest so far is noted as a negative number.
    """
    half, sample, color, brush = np.float32(0.5), samples.sample, samples.color, samples.brush
    floor, sums, profile = block.floor, block.sums, brush.profile
    rim, keep = np.float32(brush.radius**2), np.float32(1.0 - brush.tolerance)
    least, most = np.float32(brush.least**2), np.float32(brush.most**2)
    loose = rim * SLACK
    entries, channel = brush.profile.shape[0], color.shape[2] - 1
    last_entry, scale = np.float32(entries - 1), np.float32(entries / brush.radius**2)
    bottom, end = block.top + floor.shape[0], block.left + floor.shape[1]
    k0 = GROUP * group
    k1, k2 = min(k0 + 1, channel), min(k0 + 2, channel)
    row, first, last = _span(samples, member)
    around = _around(block, brush.reach)
    for n in range(first, last):
        x, y = sample[row, X, n], sample[row, Y, n]
        if not _is_near(x, y, around):
            continue
        xu, xv = sample[row, XU, n], sample[row, XV, n]
        yu, yv = sample[row, YU, n], sample[row, YV, n]
        # No form is larger than J Jᵀ + least along any axis.
        beside, below = _apart(x, y, around)
        if beside * beside > loose * (xu * xu + xv * xv + least):
            continue
        if below * below > loose * (yu * yu + yv * yv + least):
            continue
        ellipse = held_ellipse((xu, yu), (xv, yv), least, most)
        high = math.sqrt(rim * ellipse.high)
        narrow = np.float32(1) / math.sqrt(ellipse.curve)
        near = sample[row, NEARNESS, n]
        across, downward = sample[row, ACROSS, n], sample[row, DOWNWARD, n]
        red, green, blue = color[row, n, k0], color[row, n, k1], color[row, n, k2]
        for r in range(first_center(y - high, block.top), beyond_center(y + high, bottom)):
            dy = np.float32(r) + half - y
            q, middle = dy * dy / ellipse.high, x + ellipse.slope * dy
            wide = narrow * math.sqrt(max(rim - q, np.float32(0)))
            i = np.uint64(r - block.top)
            for c in range(
                first_center(middle - wide, block.left), beyond_center(middle + wide, end)
            ):
                j, center = np.uint64(c - block.left), np.float32(c) + half
                nearest = floor[i, j]
                nearness = near + across * (center - x) + downward * dy
                if nearness < keep * nearest:
                    continue
                if -nearness < nearest <= 0:
                    floor[i, j] = -nearness
                    block.area[i, j] = abs(xu * yv - xv * yu)
                dx = center - middle
                entry = int(min((q + dx * dx * ellipse.curve) * scale, last_entry))
                weight = profile[np.uint64(entry)]
                sums[i, j, 0] += weight * red
                sums[i, j, 1] += weight * green
                sums[i, j, 2] += weight * blue
                sums[i, j, WEIGHT] += weight


@plays(write, Rendered)
def _write(picture: Rendered, block: Block, group: int) -> None:
    """Write a group of channels and, with the first one, what is covered and how near it is."""
    image, seen, floor, area = picture.image, block.seen, block.floor, block.area
    coverage, bridged, nearness = picture.coverage, picture.bridged, picture.nearness
    channels = min(GROUP, image.shape[2] - GROUP * group)
    for row in range(floor.shape[0]):
        r, y = np.uint64(row), np.uint64(block.top + row)
        for column in range(floor.shape[1]):
            c, x = np.uint64(column), np.uint64(block.left + column)
            for k in range(channels):
                image[y, x, np.uint64(GROUP * group + k)] = seen[r, c, np.uint64(k)]
            if group > 0:
                continue
            covered, nearest = seen[r, c, 3], floor[r, c]
            coverage[y, x] = covered
            bridged[y, x] = (covered > 0) & (nearest <= 0)  # no cell has been there
            nearness[y, x] = abs(nearest) * covered
            picture.magnification[y, x] = area[r, c] * covered


@parallel_kernel
def paint_samples(counter: Counter, samples: Samples, tiles: Tiles, picture: Rendered) -> None:
    """Paint the samples of a source of C > 0 channels that were placed in a frame.

    Parameters
    ----------
    tiles
        Which segments touch which tile, counted row by row.
    picture
        Filled; empty before. Image and coverage are those of the nearest surface: whole where any
        of its samples reach, else 0.
    """
    height, width, channels = picture.image.shape
    surfaces = Surfaces(1, 1, -(-channels // GROUP), 4)
    for tile in tasks(counter, tiles.start.size - 1):
        paint_tile(samples, tiles, tile, (height, width), surfaces, picture)
