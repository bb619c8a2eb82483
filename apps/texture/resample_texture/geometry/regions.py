"""Regions of pictures: edge modes, copied texels, and windows of a large target."""

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats, Indices
from resample_texture.geometry.mappings import BackwardMap, Homography, Size, TargetRegion

FARTHEST = 2.0**52  # px or texels; beyond it float64 has no halves
MOST_TWICE = 1.5  # source texels of both halves over the whole's; above, windows stay whole
LEFT, TOP, RIGHT, BOTTOM = range(4)

Integers = NDArray[np.int64]


class Edge(StrEnum):
    """Edge modes: continuation beyond the source's edges.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Edge, warp
    >>> row, right = np.uint8([[1, 2, 3, 4]]), [[1, 0, 2], [0, 1, 0]]
    >>> for edge in Edge:
    ...     print(f"{edge:11}", *warp(row, right, (1, 6), edge=edge).image[0])
    transparent 0 0 1 2 3 4
    clamp       1 1 1 2 3 4
    wrap        3 4 1 2 3 4
    mirror      2 1 1 2 3 4
    """

    TRANSPARENT = "transparent"  # nothing: coverage ends there
    CLAMP = "clamp"  # the outermost texels, repeated
    WRAP = "wrap"  # the source again: a b c | a b c
    MIRROR = "mirror"  # the source's mirror image: a b c | c b a


AnyEdge = Edge | Literal["transparent", "clamp", "wrap", "mirror", "reflect-101"]


class Picks(NamedTuple):
    """The texel that each pixel copies."""

    row: Indices  # (h, w), or (h, 1) or (1, w) if pixel rows or columns share texel rows
    column: Indices  # (h, w), (1, w) or (h, 1)
    coverage: Floats  # (h, w); 0 where no texel is shown

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the copied values (h, w) or (h, w, C), 0 without a texel."""
        values = np.array(image[self.row, self.column])
        values[self.coverage == 0.0] = 0
        return values


class Move(NamedTuple):
    """A shift by whole pixels, after a quarter turn or a flip if any."""

    shift: tuple[int, int]  # along x and y, px
    sign: tuple[int, int]  # −1 where the target's x or y runs against the source's axis
    is_turned: bool = False  # the target's x is the source's y, and vice versa


def whole_move(matrix: Doubles) -> Move | None:
    """Return the move of a matrix (3, 3); None if it does anything else."""
    scaled = matrix / matrix[2, 2] if matrix[2, 2] else matrix
    turn, shift = scaled[:2, :2], scaled[:2, 2]
    is_turned = bool(turn[0, 0] == 0.0)
    sign = (turn[0, 1], turn[1, 0]) if is_turned else (turn[0, 0], turn[1, 1])
    straight = np.array([[0.0, sign[0]], [sign[1], 0.0]]) if is_turned else np.diag(sign)
    is_whole = np.array_equal(shift, np.rint(shift)) and float(abs(shift).max()) <= FARTHEST
    is_move = np.array_equal(turn, straight) and np.array_equal(np.abs(sign), [1.0, 1.0])
    if not (is_whole and is_move and np.array_equal(scaled[2], [0.0, 0.0, 1.0])):
        return None
    return Move((int(shift[0]), int(shift[1])), (int(sign[0]), int(sign[1])), is_turned)


def whole_shift(x: Doubles, y: Doubles) -> Move | None:
    """Return the shift by whole pixels of a backward map (h, w); None if it is any other."""
    across, down = np.arange(x.shape[1]) + 0.5, np.arange(x.shape[0])[:, None] + 0.5
    right, below = float(x[0, 0]) - 0.5, float(y[0, 0]) - 0.5
    if not (right.is_integer() and below.is_integer() and max(abs(right), abs(below)) <= FARTHEST):
        return None
    ends = np.s_[[0, -1]], np.s_[:, [0, -1]]  # most other maps differ here
    for part in (*ends, np.s_[:]):
        is_along = np.array_equal(x[part], np.broadcast_to(across + right, x.shape)[part])
        if not (is_along and np.array_equal(y[part], np.broadcast_to(down + below, y.shape)[part])):
            return None
    return Move((-int(right), -int(below)), (1, 1))


def picks_of_move(move: Move, source_shape: Size, shape: Size, edge: Edge) -> Picks:
    """Return the texels that pixels copy after a move."""
    column, row = (  # the texel index of each pixel along an axis, possibly counted from the end
        place if sign > 0 else -1 - place
        for place, sign in (
            (np.arange(shape[1])[None] - move.shift[0], move.sign[0]),
            (np.arange(shape[0])[:, None] - move.shift[1], move.sign[1]),
        )
    )
    if move.is_turned:
        column, row = row, column
    row, row_is_in = texels_at(row, source_shape[0], edge)
    column, column_is_in = texels_at(column, source_shape[1], edge)
    return Picks(row, column, (row_is_in & column_is_in).astype(np.float32))


def nearest_texels(x: Doubles, y: Doubles, source_shape: Size, edge: Edge) -> Picks:
    """Return the texels at places, (h, w) each; none where these are NaN."""
    is_place = (abs(x) < FARTHEST) & (abs(y) < FARTHEST)
    places = (np.floor(np.where(is_place, a, 0.0)).astype(np.int64) for a in (y, x))
    (row, row_is_in), (column, column_is_in) = (
        texels_at(index, size, edge) for index, size in zip(places, source_shape, strict=True)
    )
    return Picks(row, column, (row_is_in & column_is_in & is_place).astype(np.float32))


def texels_at(index: Indices, size: int, edge: Edge) -> tuple[Indices, NDArray[np.bool_]]:
    """Return the texels at indices under an edge mode, and whether they exist."""
    if edge is Edge.WRAP:
        return index % size, np.ones(index.shape, np.bool_)
    if edge is Edge.MIRROR:
        folded = index % (2 * size)
        return np.minimum(folded, 2 * size - 1 - folded), np.ones(index.shape, np.bool_)
    is_in = (index >= 0) & (index < size)
    return np.clip(index, 0, size - 1), is_in if edge is Edge.TRANSPARENT else np.ones_like(is_in)


def unfolded(image: NDArray[Any]) -> NDArray[Any]:
    """Mirror a picture about the centers of its last texels, for one period: a b c d | c b."""
    for axis in (0, 1):
        size = image.shape[axis]
        there_and_back = np.concatenate([np.arange(size), np.arange(size - 2, 0, -1)])
        image = image.take(there_and_back, axis)
    return image


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

    def is_within(self, size: Size) -> bool:
        """Whether it lies within a picture (height, width)."""
        return min(self.left, self.top) >= 0 and self.right <= size[1] and self.bottom <= size[0]

    @classmethod
    def around(cls, parts: Sequence["Rect"], size: Size) -> "Rect":
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
    """A part of the target, and the part of the source that contributes to it."""

    target: Rect
    source: Rect  # beyond the edges of a source that is repeated


class VisibleTiles(NamedTuple):
    """Tiles of a target, and the bounds of the source that each gathers from."""

    tiles: Integers  # (T, 4) px, row by row
    bounds: Doubles  # (T, 4) texels; first > last where a tile shows nothing
    reach: int  # texels around those bounds that contribute
    is_endless: bool  # the source is repeated beyond its edges


def windows_of(seen: VisibleTiles, size: Size, most: int) -> Iterator[PictureWindow]:
    """Yield windows of a target, from the top, halved while they have more than `most` pixels."""
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
    geometry: Homography | BackwardMap, window: PictureWindow, size: Size,
    shape: Size = (0, 0),
) -> Homography | BackwardMap:  # fmt: skip
    """Return the geometry from a window's part of a source to its target; maps cover it all."""
    (u, v, *_), (x, y, *_) = window.source, window.target
    if isinstance(geometry, BackwardMap):
        return BackwardMap(geometry.x - u, geometry.y - v)
    there = np.array([[1.0, 0.0, u], [0.0, 1.0, v], [0.0, 0.0, 1.0]])
    back = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
    outer, region = geometry.region or TargetRegion(geometry, 0, 0, shape), None
    if window.source.is_within(size):
        region = outer._replace(left=outer.left + x, top=outer.top + y, size=size, first=(u, v))
    return Homography(back @ geometry.oriented(size) @ there, is_signed=True, region=region)


def _window(seen: VisibleTiles, which: Integers, size: Size) -> PictureWindow:
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
