"""A linear warp of pictures, its adjoint, and its gradient by the geometry."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.memory.mapped import contiguous
from resample.messages import check_threads
from resample.registry import plugin_of
from resample.types import Doubles
from resample_gradients.interpolation import (
    coefficients,
    margin_of,
    pieces,
    ring_of,
    rules,
    transposed,
)
from resample_gradients.kernels.gather import (
    CoefficientPlate,
    change,
    gather,
    scatter_gradients,
)
from resample_gradients.kernels.points import REFLECT_101 as REFLECTED
from resample_gradients.kernels.points import InterpolatedSource
from resample_gradients.places import MapPlaces, MatrixPlaces
from resample_texture.arguments import REFLECT_101, axis_of, edge_named
from resample_texture.texels.forward import EDGES
from resample_texture.types import FRAMES, AnyAxis, AnyEdge, Edge

Integers = NDArray[np.int64]
Places = MatrixPlaces | MapPlaces

TILE = 32  # px per side of a tile of the adjoint
BATCH = 1 << 24  # most numbers in the patches of a batch
LARGEST_QUALITY = 16.0


@dataclass(frozen=True)
class LinearWarp:
    """Differentiable warp under the area filter, in float64.

    A pixel is the mean of the interpolated source over the pixel's footprint, a parallelogram: a
    sum over Gauss points, with more points where footprints are longer. Gradients are exact
    for these sums, at a fixed number of points: where that number changes, the picture changes by
    the error of the sums.

    Parameters
    ----------
    interpolation
        By name or as an object: a linear one (`limit=none`) with a slope, so not `nearest`.
    edge
        Edge mode: `transparent`, `clamp`, `wrap`, `mirror` or `reflect-101`. The picture is
        multiplied by its coverage, which is the warp of a picture of ones.
    quality
        Factor of the density of Gauss points, 1 to 16.
    threads
        Most threads to use; the result does not depend on it.

    Raises
    ------
    ValueError, LookupError
        An option is unknown or out of range.
    """

    interpolation: Any = "area-spline:limit=none"
    edge: AnyEdge = "transparent"
    quality: float = 1.0
    threads: int | None = None

    def __post_init__(self) -> None:
        built = plugin_of("interpolations", self.interpolation)
        object.__setattr__(self, "interpolation", built)
        pieces(self.interpolation)
        check_threads(self.threads)
        object.__setattr__(self, "edge", edge_named(self.edge))
        if not 1.0 <= self.quality <= LARGEST_QUALITY:
            raise ValueError(f"quality lies between 1 and {LARGEST_QUALITY:g}, not {self.quality}")

    def __call__(self, image: ArrayLike, places: Places, *, axis: AnyAxis | None = None) -> Doubles:
        """Warp a picture (H, W) or (H, W, C) to (h, w) or (h, w, C).

        Parameters
        ----------
        image, axis
            As `resample_texture.warp` takes them, but no stack.

        Raises
        ------
        ValueError
            The picture has a wrong shape, or does not fit the places.
        """
        texels = _picture(image, "a picture")
        if axis_of(np.asarray(image), axis) == FRAMES:
            raise ValueError("a stack; warp its frames one by one")
        _check_source(texels.shape[:2], places)
        plate = coefficients(texels, self.interpolation, self.edge)
        seen = places.places()
        picture = np.empty((*seen.shape[:2], texels.shape[2]))
        with _threads(self.threads):
            gather(_plate(plate), seen, self._lens(texels.shape[:2]), picture)
        return picture.reshape(seen.shape[:2] + np.shape(image)[2:])

    def by_image(
        self, gradient: ArrayLike, places: Places, source_shape: tuple[int, int]
    ) -> Doubles:
        """Apply the adjoint: a gradient by the result becomes one (H, W[, C]) by the source.

        Raises
        ------
        ValueError
            The gradient does not fit the places.
        """
        given = _picture(gradient, "a gradient")
        _check_source(source_shape, places)
        seen = places.places()
        _check_target(given.shape[:2], seen)
        lens = self._lens(source_shape)
        rows, columns = (size + 2 * lens.margin for size in lens.size)
        plate = np.zeros((rows, columns, given.shape[2]))
        with _threads(self.threads):
            _scatter_all(given, seen, lens, plate)
        texels = transposed(plate, self.interpolation, self.edge)
        return texels.reshape(tuple(source_shape) + np.shape(gradient)[2:])

    def by_places(self, gradient: ArrayLike, image: ArrayLike, places: Places) -> Doubles:
        """Convert a gradient by the result to one by the places' matrix or map (h, w, 2).

        Raises
        ------
        ValueError
            The gradient does not fit the places, or the picture's number of channels.
        """
        given, texels = _picture(gradient, "a gradient"), _picture(image, "a picture")
        _check_source(texels.shape[:2], places)
        seen = places.places()
        _check_target(given.shape[:2], seen)
        if given.shape[2] != texels.shape[2]:
            raise ValueError(f"a gradient of {given.shape[2]} channels, of {texels.shape[2]}")
        plate = coefficients(texels, self.interpolation, self.edge)
        changes = np.empty_like(seen)
        with _threads(self.threads):
            change(_plate(plate), seen, self._lens(texels.shape[:2]), given, changes)
        return places.gradient(changes)

    def _lens(self, source_shape: tuple[int, ...]) -> InterpolatedSource:
        weight, slope, shift = pieces(self.interpolation)
        margin, ring = (of(self.interpolation, self.edge) for of in (margin_of, ring_of))
        edge = REFLECTED if self.edge == REFLECT_101 else EDGES[Edge(self.edge)]
        size = int(source_shape[0]), int(source_shape[1])
        quality = float(self.quality)
        return InterpolatedSource(
            weight, slope, rules(), shift, size, margin, float(ring), edge, quality
        )


def _plate(coefficients: Doubles) -> CoefficientPlate:
    """Return coefficients (rows, columns, C) as kernels read them."""
    _, columns, channels = coefficients.shape
    return CoefficientPlate(coefficients.reshape(-1), columns, channels, 0, 0)


def _threads(count: int | None) -> Any:
    """Limit the threads, if a count is given; otherwise keep the current limit."""
    from contextlib import nullcontext

    from resample.engine.jit import threads

    return nullcontext() if count is None else threads(count)


def _scatter_all(
    gradient: Doubles, seen: Doubles, lens: InterpolatedSource, plate: Doubles
) -> None:
    """Add all pixels' gradients to the coefficients, tile by tile in a fixed order."""
    tiles = _tiles(seen.shape[:2])
    boxes = _boxes(seen, tiles, lens)
    tiles, boxes = (np.ascontiguousarray(a[boxes[:, 2] > boxes[:, 0]]) for a in (tiles, boxes))
    size = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]) * plate.shape[2]
    start = np.append(0, np.cumsum(size))
    first = 0
    while first < len(tiles):
        last = int(np.searchsorted(start, start[first] + BATCH, side="right")) - 1
        last = min(max(last, first + 1), len(tiles))
        ours = start[first : last + 1] - start[first]
        patches = np.empty(ours[-1])
        scatter_gradients(gradient, seen, lens, tiles[first:last], boxes[first:last], ours, patches)
        for n, (left, top, right, bottom) in enumerate(boxes[first:last]):
            part = plate[top:bottom, left:right]
            part += patches[ours[n] : ours[n + 1]].reshape(part.shape)
        first = last


def _tiles(shape: tuple[int, ...]) -> Integers:
    """Return the tiles (T, 4) of a picture: left, top, right and bottom, px."""
    top, left = (a.ravel() for a in np.mgrid[0 : shape[0] : TILE, 0 : shape[1] : TILE])
    right, bottom = np.minimum(left + TILE, shape[1]), np.minimum(top + TILE, shape[0])
    return np.stack([left, top, right, bottom], axis=1).astype(np.int64)


def _boxes(seen: Doubles, tiles: Integers, lens: InterpolatedSource) -> Integers:
    """Return the coefficients (T, 4) that tiles may read: left, top, right, bottom."""
    boxes = np.zeros(tiles.shape, np.int64)
    for axis in (0, 1):
        reach = 0.5 * (abs(seen[..., 2 + axis]) + abs(seen[..., 4 + axis]))
        low, high = seen[..., axis] - reach, seen[..., axis] + reach
        is_seen = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(is_seen, low, np.inf), np.where(is_seen, high, -np.inf)
        for n, (left, top, right, bottom) in enumerate(tiles):
            ends = low[top:bottom, left:right].min(), high[top:bottom, left:right].max()
            if ends[0] <= ends[1]:
                first, last = _within(*ends, float(lens.size[1 - axis]), lens)
                before = lens.margin - math.ceil(0.5 * lens.weight.shape[1]) - 1
                boxes[n, axis] = math.floor(first) + before
                boxes[n, 2 + axis] = math.ceil(last) + 2 * lens.margin - before
    return boxes


def _within(low: float, high: float, size: float, lens: InterpolatedSource) -> tuple[float, float]:
    """Fold an interval of coordinates into the source and its ring."""
    if lens.edge in (EDGES[Edge.TRANSPARENT], EDGES[Edge.CLAMP]):
        low, high = (min(max(end, -lens.ring), size + lens.ring) for end in (low, high))
        return low, high
    if low >= 0.0 and high <= size:
        return low, high
    if lens.edge == EDGES[Edge.WRAP] or low < -size or high > 2.0 * size:
        return 0.0, size
    if low < 0.0:
        return 0.0, min(max(high, 1.0 - low), size)
    return max(min(low, 2.0 * size - 1.0 - high), 0.0), size


def _picture(given: ArrayLike, name: str) -> Doubles:
    """Return a float64 array (H, W, C) for the kernels."""
    array = np.asarray(given)
    if array.ndim not in (2, 3) or array.size == 0 or array.dtype.kind not in "buif":
        raise ValueError(
            f"{name} has numbers of the shape (height, width) or (height, width, C), "
            f"not {array.dtype} of {array.shape}"
        )
    array = array if array.ndim == 3 else array[..., None]
    return contiguous(array, np.float64)


def _check_source(shape: tuple[int, ...], places: Places) -> None:
    if isinstance(places, MatrixPlaces) and tuple(places.source_shape) != tuple(shape):
        raise ValueError(f"places for a source of {places.source_shape}, which is of {shape}")


def _check_target(shape: tuple[int, ...], seen: Doubles) -> None:
    if tuple(shape) != seen.shape[:2]:
        raise ValueError(f"a gradient of {shape} px does not fit places of {seen.shape[:2]}")
