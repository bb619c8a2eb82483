"""Elliptical Gaussian splats of a depth image's samples; points are splats of one size.

The target is cut into bands of rows. A band's thread takes the samples in the source's order, and
does so twice: each pixel has to know what is nearest there before what lies on that surface is
summed. A pixel has one owner, who sees its samples in one order.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Single
from resample_warp3d.methods.kernels.jacobian import (
    ACROSS,
    DOWNWARD,
    NEARNESS,
    SEGMENT,
    XU,
    XV,
    YU,
    YV,
    Placed,
    X,
    Y,
)
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links, Rendered, Source

ROWS = 32  # of a band
GROUP = 3  # channels that are summed at a time, beside their weight
ROUND: Single = np.float32(1e-6)  # of the mean stretch: an ellipse that differs by less is a circle
TINY: Single = np.float32(1e-30)


class Brush(NamedTuple):
    """How samples are drawn."""

    core: float  # px of the source from a sample toward its links where it hides what is behind
    tolerance: float  # of the nearness: what is further than this behind the nearest is hidden
    radius: float  # px of the source from a splat's center to its rim
    least: float  # px of the target per px of the source along any direction; shorter axes grow
    most: float  # as `least`; longer axes shrink
    reach: float  # px of the target that a sample can reach at most
    profile: Floats  # (N,) weights over the square of the distance from the center, 0 to the rim


class Strip(NamedTuple):
    """A band of the target's rows."""

    top: int
    bottom: int  # one beyond the last
    sums: Floats  # (ROWS, W, GROUP + 1) of some channels and of their weights


@kernel
def ellipse(
    xu: Single, xv: Single, yu: Single, yv: Single, least: Single, most: Single
) -> tuple[Single, Single, Single]:
    """Image V of the unit circle under J, its stretches (squares) held between two bounds.

    V is J Jᵀ with its eigenvalues clamped; returned are V_yy, V_xy / V_yy and V_yy / det V. In the
    row of pixels dy from the center, q = dᵀ V⁻¹ d is least, dy² / V_yy, at dx = the second × dy; it
    grows from there as the third × the square of the distance.
    """
    half = np.float32(0.5)
    a, b, c = xu * xu + xv * xv, xu * yu + xv * yv, yu * yu + yv * yv
    odd, area = half * (a - c), xu * yv - xv * yu
    mean, spread = half * (a + c), math.sqrt(odd * odd + b * b)
    large = mean + spread
    small = area * area / (large + TINY)
    longer, shorter = min(max(large, least), most), min(max(small, least), most)
    # A function of a 2 × 2 matrix is linear in it: V = longer + scale (J Jᵀ − large).
    scale = half * (longer - shorter) / spread if spread > ROUND * mean else np.float32(0)
    high = longer + scale * (c - large)
    return high, scale * b / high, high / (longer * shorter)


@kernel
def _first(edge: Single, least: int) -> int:
    """First pixel whose center is not before an edge, and not before `least`."""
    return int(max(edge + np.float32(0.5), np.float32(least)))


@kernel
def _beyond(edge: Single, most: int) -> int:
    """One beyond the last pixel whose center is before an edge, and at most `most`."""
    return int(min(max(edge + np.float32(0.5), np.float32(0)), np.float32(most)))


@kernel
def _is_near(x: Single, y: Single, reach: Single, strip: Strip) -> bool:
    """Whether a place is within reach of a strip; not if it is not a number."""
    is_beside = y + reach > strip.top and y - reach < strip.bottom
    return bool(is_beside and x + reach > 0 and x - reach < strip.sums.shape[1])


@kernel
def _cover_segment(
    links: Links, placed: Placed, at: tuple[int, int], brush: Brush, strip: Strip, picture: Rendered
) -> None:
    """Let samples hide what is behind them, where their cells hold the centers of pixels.

    A cell ends half a px from the sample at boundaries, and overlaps those of its links.
    """
    half, sample, row = np.float32(0.5), placed.sample, at[0]
    core, edge = np.float32(brush.core), min(half, np.float32(brush.core))
    reach = np.float32(brush.reach)
    for n in range(at[1] * SEGMENT, min((at[1] + 1) * SEGMENT, sample.shape[2])):
        x, y = sample[row, X, n], sample[row, Y, n]
        if not _is_near(x, y, reach, strip):
            continue
        xu, xv = sample[row, XU, n], sample[row, XV, n]
        yu, yv = sample[row, YU, n], sample[row, YV, n]
        wide = min(core * (abs(xu) + abs(xv)), reach)
        high = min(core * (abs(yu) + abs(yv)), reach)
        top, bottom = _first(y - high, strip.top), _beyond(y + high, strip.bottom)
        left, right = _first(x - wide, 0), _beyond(x + wide, strip.sums.shape[1])
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
                    if nearness > picture.nearness[r, c]:
                        picture.nearness[r, c] = nearness
                        picture.magnification[r, c] = abs(area)


@kernel
def _add_segment(
    color: Floats,
    channels: tuple[int, int, int],
    placed: Placed,
    at: tuple[int, int],
    brush: Brush,
    strip: Strip,
    picture: Rendered,
) -> None:
    """Sum what samples give to pixels where they are on the nearest surface.

    Where no cell has been, all are, and the nearest so far is noted as a negative number.
    """
    half, sample = np.float32(0.5), placed.sample
    rim, keep = np.float32(brush.radius**2), np.float32(1.0 - brush.tolerance)
    least, most = np.float32(brush.least**2), np.float32(brush.most**2)
    entries = brush.profile.shape[0]
    last, scale = np.float32(entries - 1), np.float32(entries / brush.radius**2)
    row, first = at[0], at[1] * SEGMENT
    for n in range(first, min(first + SEGMENT, sample.shape[2])):
        x, y = sample[row, X, n], sample[row, Y, n]
        if not _is_near(x, y, np.float32(brush.reach), strip):
            continue
        xu, xv = sample[row, XU, n], sample[row, XV, n]
        yu, yv = sample[row, YU, n], sample[row, YV, n]
        square, tilt, curve = ellipse(xu, xv, yu, yv, least, most)
        high, narrow = math.sqrt(rim * square), np.float32(1) / math.sqrt(curve)
        near = sample[row, NEARNESS, n]
        across, downward = sample[row, ACROSS, n], sample[row, DOWNWARD, n]
        value_0, value_1 = color[row, n, channels[0]], color[row, n, channels[1]]
        value_2 = color[row, n, channels[2]]
        for r in range(_first(y - high, strip.top), _beyond(y + high, strip.bottom)):
            dy = np.float32(r) + half - y
            q, middle = dy * dy / square, x + tilt * dy
            wide = narrow * math.sqrt(max(rim - q, np.float32(0)))
            for c in range(_first(middle - wide, 0), _beyond(middle + wide, strip.sums.shape[1])):
                center, nearest = np.float32(c) + half, picture.nearness[r, c]
                nearness = near + across * (center - x) + downward * dy
                if nearness < keep * nearest:
                    continue
                if -nearness < nearest <= 0:
                    picture.nearness[r, c] = -nearness
                    picture.magnification[r, c] = abs(xu * yv - xv * yu)
                dx = center - middle
                weight = brush.profile[int(min((q + dx * dx * curve) * scale, last))]
                strip.sums[r - strip.top, c, 0] += weight * value_0
                strip.sums[r - strip.top, c, 1] += weight * value_1
                strip.sums[r - strip.top, c, 2] += weight * value_2
                strip.sums[r - strip.top, c, 3] += weight


@kernel
def _cover(links: Links, placed: Placed, brush: Brush, strip: Strip, picture: Rendered) -> None:
    """Find what is nearest in each pixel of a strip."""
    for r in range(strip.top, strip.bottom):
        for c in range(strip.sums.shape[1]):
            picture.nearness[r, c], picture.magnification[r, c] = np.float32(0), np.float32(0)
    touched = placed.touched
    for row in range(touched.shape[0]):
        for segment in range(touched.shape[1]):
            if touched[row, segment, 0] < strip.bottom and touched[row, segment, 1] > strip.top:
                _cover_segment(links, placed, (row, segment), brush, strip, picture)


@kernel
def _add(
    color: Floats, first: int, placed: Placed, brush: Brush, strip: Strip, picture: Rendered
) -> None:
    """Sum a group of channels and their weights in a strip."""
    for r in range(strip.bottom - strip.top):
        for c in range(strip.sums.shape[1]):
            for k in range(GROUP + 1):
                strip.sums[r, c, k] = np.float32(0)
    most, touched = color.shape[2] - 1, placed.touched
    channels = first, min(first + 1, most), min(first + 2, most)
    for row in range(touched.shape[0]):
        for segment in range(touched.shape[1]):
            if touched[row, segment, 0] < strip.bottom and touched[row, segment, 1] > strip.top:
                _add_segment(color, channels, placed, (row, segment), brush, strip, picture)


@kernel
def _average(first: int, strip: Strip, picture: Rendered) -> None:
    """Turn the sums of a group of channels into means."""
    channels = min(GROUP, picture.image.shape[2] - first)
    for r in range(strip.top, strip.bottom):
        for c in range(strip.sums.shape[1]):
            weight = strip.sums[r - strip.top, c, GROUP]
            share = np.float32(1) / weight if weight > 0 else np.float32(0)
            for k in range(channels):
                picture.image[r, c, first + k] = strip.sums[r - strip.top, c, k] * share


@kernel
def _conclude(strip: Strip, picture: Rendered) -> None:
    """Say which pixels are covered and which of them no cell has been in."""
    for r in range(strip.top, strip.bottom):
        for c in range(strip.sums.shape[1]):
            is_covered = strip.sums[r - strip.top, c, GROUP] > 0
            picture.coverage[r, c] = np.float32(1) if is_covered else np.float32(0)
            picture.bridged[r, c] = is_covered and picture.nearness[r, c] <= 0
            picture.nearness[r, c] = abs(picture.nearness[r, c]) * picture.coverage[r, c]
            picture.magnification[r, c] *= picture.coverage[r, c]


@kernel
def _paint_band(source: Source, placed: Placed, brush: Brush, picture: Rendered, band: int) -> None:
    height, width = picture.nearness.shape
    sums = np.empty((ROWS, width, GROUP + 1), np.float32)
    strip = Strip(band * ROWS, min((band + 1) * ROWS, height), sums)
    _cover(source.links, placed, brush, strip, picture)
    for first in range(0, source.color.shape[2], GROUP):
        _add(source.color, first, placed, brush, strip, picture)
        _average(first, strip, picture)
    _conclude(strip, picture)


@parallel_kernel
def paint_bands(
    counter: Counter, source: Source, placed: Placed, brush: Brush, picture: Rendered
) -> None:
    """Paint the samples of a source of C > 0 channels that were placed in a frame.

    All of `picture` is filled. Image and coverage are those of the nearest surface: whole where any
    of its samples reach, else 0.
    """
    for band in tasks(counter, -(-picture.nearness.shape[0] // ROWS)):
        _paint_band(source, placed, brush, picture, int(band))
