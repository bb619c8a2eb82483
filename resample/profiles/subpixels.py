"""Pixel filters on sub-pixels: how many a filter needs, and their weights.

A picture is painted on sub-pixels, each with its own visibility, and filtered last: an object
behind an opaque half of a pixel must not show through the other half.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from resample.profiles.filters import PixelFilter, check_reach
from resample.progress import Progress
from resample.types import Doubles, Film, Floats, View

MOST = 4  # per side of a pixel; for filters that need more for exact results
FINE = 16  # positions along a sub-pixel at which a filter is evaluated
CLOSE = 1e-3  # fraction of a filter's mass; sub-pixels within this error count as exact
LARGEST_STRIP = 1 << 21  # sub-pixels held at a time


@dataclass(frozen=True)
class Strip:
    """Rows of a picture with the sub-pixels that their filter reads."""

    first: int  # row of the picture
    last: int  # row after the last one
    shape: tuple[int, int]  # rows and columns of sub-pixels
    matrix: Doubles  # (3, 3) from px of the picture to sub-pixels of the strip


@dataclass(frozen=True)
class Subpixels:
    """Sub-pixels weighted by a filter."""

    count: int  # per side of a pixel
    margin: int  # px around a pixel that its filter reads
    weight: Floats  # ((2 margin + 1) count,) along one axis, sum 1

    @property
    def per_pixel(self) -> Floats:
        """Weights (2 margin + 1,) of whole pixels."""
        return np.asarray(self.weight.reshape(-1, self.count).sum(axis=1), np.float32)

    def strips(self, shape: tuple[int, int]) -> Iterator[Strip]:
        """Divide a picture of (height, width) px into strips that fit into memory one by one."""
        height, width = shape
        columns = (width + 2 * self.margin) * self.count
        rows = LARGEST_STRIP // (columns * self.count) - 2 * self.margin
        step = max(1, rows)
        for first in range(0, height, step):
            last = min(first + step, height)
            inside = (last - first + 2 * self.margin) * self.count, columns
            n, left, top = float(self.count), float(self.margin), float(self.margin - first)
            matrix = np.array([[n, 0.0, n * left], [0.0, n, n * top], [0.0, 0.0, 1.0]])
            yield Strip(first, last, inside, matrix)


def subpixels_of(pixel_filter: PixelFilter, count: int | None = None) -> Subpixels:
    """Sub-pixels for a filter: `count` per side, or the fewest that represent it exactly.

    Without margin and with one sub-pixel, the result is the mean over the pixel: nothing is
    filtered. At most `MOST` per side are used unless more are requested.
    """
    check_reach(pixel_filter)
    margin = max(0, math.ceil(pixel_filter.radius - 0.5 - 1e-9))
    for n in range(1, MOST + 1) if count is None else [count]:
        # Weights ((2 margin + 1) n, FINE) of positions within a pixel's n sub-pixels, of sum 1.
        places = (np.arange((2 * margin + 1) * n * FINE) + 0.5) / (n * FINE) - margin - 0.5
        distance, radius = np.abs(places), pixel_filter.radius
        given = np.where(distance <= radius, pixel_filter(np.minimum(distance, radius)), 0.0)
        if not given.sum() > 0.0:
            raise ValueError(
                f"{pixel_filter} has the sum {given.sum()}, which cannot be scaled to 1"
            )
        fine = np.asarray((given / given.sum()).reshape(-1, FINE), np.float64)
        mean = fine.mean(axis=1, keepdims=True)
        if n in (MOST, count) or np.abs(fine - mean).sum() <= CLOSE:
            break
    return Subpixels(n, margin, fine.sum(axis=1).astype(np.float32))


def painted_on_subpixels(
    paint: Callable[[View, tuple[int, int]], Film],
    view: View,
    size: tuple[int, int],
    parts: Subpixels,
    progress: Progress | None,
) -> Film:
    """Picture of a size (height, width); `paint` gives one of sub-pixels, by a view of these."""
    from resample.engine.surfaces import resolve_rows

    rgba, coverage, depth = (np.empty((*size, count), np.float32) for count in (4, 1, 1))
    first = np.empty(size, np.float32)
    mean = np.full(parts.count, 1.0 / parts.count, np.float32)
    for strip in parts.strips(size):
        (n, _, left), (_, _, top) = strip.matrix[:2]
        fine, rows = (
            paint(
                view._replace(focal=n * view.focal, principal=n * view.principal + [left, top]),
                strip.shape,
            ),
            slice(strip.first, strip.last),
        )
        resolve_rows(fine.rgba.reshape(len(fine.rgba), -1), parts.weight, parts.count, rgba[rows])
        resolve_rows(fine.coverage, parts.weight, parts.count, coverage[rows])
        # Depths belong to a pixel's own square, weighted by visibility.
        alpha, own = fine.rgba[..., 3], np.empty((strip.last - strip.first, size[1], 2), np.float32)
        around = parts.margin * parts.count
        inner = slice(around, strip.shape[0] - around), slice(around, strip.shape[1] - around)
        far = np.where(alpha > 0, fine.depth, 0) * alpha
        stack = np.stack([far[inner], alpha[inner]], axis=-1)
        resolve_rows(stack.reshape(len(stack), -1), mean, parts.count, own)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth[rows, :, 0] = np.where(own[..., 1] > 0, own[..., 0] / own[..., 1], np.inf)
        near = fine.first_depth[inner]
        blocks = near.reshape(-1, parts.count, near.shape[1] // parts.count, parts.count)
        first[rows] = blocks.min(axis=(1, 3))
        if progress is not None:
            progress(strip.last / size[0])
    # Filters' negative lobes undershoot beside bright pixels.
    rgba[..., 3] = np.clip(rgba[..., 3], 0, 1)
    np.maximum(rgba[..., :3], 0, out=rgba[..., :3])
    return Film(rgba, depth[..., 0], first, np.clip(coverage[..., 0], 0, 1))
