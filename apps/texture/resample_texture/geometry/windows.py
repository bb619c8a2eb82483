"""Windows of a large target, and the part of the source that each shows."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_texture.geometry.mappings import BackwardMap, Homography, TargetRegion

MOST_TWICE = 1.5  # source texels of both halves over those of the whole; above, windows stay whole
LEFT, TOP, RIGHT, BOTTOM = range(4)

Integers = NDArray[np.int64]


class Rect(NamedTuple):
    """A rectangle of pixels; right and bottom are exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def part(self) -> tuple[slice, slice]:
        """Rows and columns, as slices."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def is_within(self, size: tuple[int, int]) -> bool:
        """Whether it lies within a picture (height, width)."""
        return min(self.left, self.top) >= 0 and self.right <= size[1] and self.bottom <= size[0]

    @classmethod
    def around(cls, parts: Sequence["Rect"], size: tuple[int, int]) -> "Rect":
        """Rectangle around others; the whole picture (height, width) if they reach beyond it."""
        sides = np.array(parts)
        (left, top), (right, bottom) = sides[:, :2].min(axis=0), sides[:, 2:].max(axis=0)
        found = cls(int(left), int(top), int(right), int(bottom))
        return found if found.is_within(size) else cls(0, 0, size[1], size[0])

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return max(0, self.right - self.left) * max(0, self.bottom - self.top)


class PictureWindow(NamedTuple):
    """A part of the target, and the part of the source that contributes to it.

    If the source is repeated, the part may lie beyond its edges.
    """

    target: Rect
    source: Rect


class VisibleTiles(NamedTuple):
    """Tiles of a target, and the bounds of the source that each gathers from."""

    tiles: Integers  # (T, 4) px, row by row
    bounds: Doubles  # (T, 4) texels; first > last where a tile shows nothing
    reach: int  # texels around those bounds that contribute
    is_endless: bool  # the source is repeated beyond its edges


def windows_of(seen: VisibleTiles, size: tuple[int, int], most: int) -> Iterator[PictureWindow]:
    """Yield windows of a target, from the top, with their parts of a source (height, width).

    A window is halved while it, or its source, has more than `most` pixels, unless it is a single
    tile, or both halves would need almost the same source.
    """
    columns = int((seen.tiles[:, TOP] == seen.tiles[0, TOP]).sum())
    waiting = [np.arange(len(seen.tiles)).reshape(-1, columns)]
    while waiting:
        part = waiting.pop()
        window = _window(seen, part, size)
        halves = np.array_split(part, 2, axis=int(part.shape[0] < part.shape[1]))
        both = sum(_window(seen, half, size).source.pixels for half in halves if half.size)
        is_small = max(window.target.pixels, window.source.pixels) <= most
        if is_small or part.size == 1 or both > MOST_TWICE * window.source.pixels:
            is_all = window.source.pixels >= size[0] * size[1]
            yield window._replace(source=Rect(0, 0, size[1], size[0])) if is_all else window
        else:
            waiting += halves[::-1]


def between(
    geometry: Homography | BackwardMap, window: PictureWindow, size: tuple[int, int],
    shape: tuple[int, int] = (0, 0),
) -> Homography | BackwardMap:  # fmt: skip
    """Return the geometry from a window's part of a source (height, width) to its target.

    A map still covers the whole target. If that target's `shape` is known, the window's pixels are
    bit-identical to the whole's.
    """
    (u, v, *_), (x, y, *_) = window.source, window.target
    if isinstance(geometry, BackwardMap):
        return BackwardMap(geometry.x - u, geometry.y - v)
    there = np.array([[1.0, 0.0, u], [0.0, 1.0, v], [0.0, 0.0, 1.0]])
    back = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
    outer, region = geometry.region or TargetRegion(geometry, 0, 0, shape), None
    if window.source.is_within(size):
        region = outer._replace(left=outer.left + x, top=outer.top + y, size=size, first=(u, v))
    return Homography(back @ geometry.oriented(size) @ there, is_signed=True, region=region)


def _window(seen: VisibleTiles, which: Integers, size: tuple[int, int]) -> PictureWindow:
    """Return the window of some tiles."""
    tiles, bounds = seen.tiles[which.ravel()], seen.bounds[which.ravel()]
    low, high = tiles[:, :2].min(axis=0), tiles[:, 2:].max(axis=0)
    target = Rect(int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    first, last = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    if seen.is_endless and (first <= last).all():
        sides = *(np.floor(first) - seen.reach), *(np.ceil(last) + seen.reach)
        return PictureWindow(target, Rect(*(int(side) for side in sides)))
    across = _stretch(first[0], last[0], size[1], seen.reach)
    down = _stretch(first[1], last[1], size[0], seen.reach)
    return PictureWindow(target, Rect(across[0], down[0], across[1], down[1]))


def _stretch(first: float, last: float, size: int, reach: int) -> tuple[int, int]:
    """Return the range of visible texels and `reach` around it, within `size`; never empty."""
    if first > last:
        return 0, min(size, reach)
    low = math.floor(min(max(first - reach, 0.0), size - 1.0))
    high = math.ceil(min(max(last + reach, low + 1.0), size))
    return low, high
