"""Warp pictures larger than memory, chunk by chunk.

The source is anything that can be sliced like an array, such as a zarr array, a dask array or a
memory-mapped file; only the parts that a chunk shows are read. The target is anything that can be
assigned slices.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.reading.limits import check_free
from resample_texture.arguments import (
    REFLECT_101,
    Places,
    edge_named,
    fill_for,
    geometry_of,
    method_named,
    whole_pair,
    within,
)
from resample_texture.drawing import MOST_IN_WINDOW, Drawing, drawn, drawn_in_parts, parts_of
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography
from resample_texture.geometry.shifts import whole_move
from resample_texture.geometry.windows import Rect, windows_of
from resample_texture.types import Method, Warped

SIDE = 1024  # px of chunks, unless the target has its own chunks


class Chunk(NamedTuple):
    """A warped rectangle of the target."""

    left: int  # px
    top: int
    warped: Warped

    @property
    def part(self) -> tuple[slice, slice]:
        """Rows and columns in the target."""
        height, width = self.warped.coverage.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


class _LazyPicture:
    """A stored picture, of which parts are read on demand."""

    def __init__(self, stored: Any) -> None:
        self.shape: tuple[int, ...] = tuple(int(size) for size in stored.shape)
        self.dtype, self.ndim = np.dtype(stored.dtype), len(self.shape)
        self._stored = stored

    def __getitem__(self, where: tuple[Any, Any]) -> NDArray[Any]:
        """Read the texels of two slices, or of rows (N, 1) and columns (M,)."""
        if all(isinstance(part, slice) for part in where):
            return np.ascontiguousarray(self._stored[where])
        rows, columns = where
        top, left = int(rows.min()), int(columns.min())
        around = np.s_[top : int(rows.max()) + 1, left : int(columns.max()) + 1]
        found: NDArray[Any] = np.asarray(self._stored[around])[rows - top, columns - left]
        return found

    def whole(self) -> NDArray[Any]:
        """Read the whole picture, if it fits into memory."""
        check_free("the source", math.prod(self.shape) * self.dtype.itemsize)
        return np.asarray(self._stored[...])


class _Way(NamedTuple):
    """Method, geometry, target size and edge mode of a warp."""

    method: Method
    geometry: Geometry
    shape: tuple[int, int]
    edge: str
    threads: int | None
    fill: Any  # see `Drawing.fill`


def warp_chunks(  # noqa: PLR0913 - what a user may say about a warp
    source: Any,
    matrix: ArrayLike | Geometry | Places,
    shape: tuple[int, int],
    method: str | Method = "hybrid",
    *,
    out: Any = None,
    side: int | tuple[int, int] | None = None,
    edge: str = "transparent",
    convention: str = "corner",
    inverse: bool = False,
    linear_light: bool | None = None,
    alpha: str | None = None,
    fill: float | str | None = None,
    threads: int | None = None,
) -> Any:
    """Warp a picture larger than memory, chunk by chunk; pixels equal those of `warp`.

    They are equal bit by bit with matrices, for targets of up to 2³⁰ px, where what is shown lies
    within the source; elsewhere coordinates may be rounded differently.

    Parameters
    ----------
    source
        (H, W) or (H, W, C), anything with `shape` and `dtype` that returns arrays for slices:
        `zarr.open_array(...)`, `dask.array`, `numpy.memmap`.
    matrix, shape, method, edge, convention, inverse, linear_light, alpha, fill, threads
        As `warp` takes them. Geometry must be a matrix or a backward map, and the method one whose
        pixels gather from a part of the source, as the default. `reflect-101` is not available.
    out
        (height, width) or (height, width, C): anything that takes arrays for slices; it is filled.
        None: return a dask array, whose chunks are warped on demand.
    side
        Height and width of chunks, px; by default those of a zarr `out`, else 1024.

    Returns
    -------
    `out`, or the dask array; with a dask source each chunk depends on the chunks that it shows.

    Raises
    ------
    ValueError
        As `warp` does; or sizes do not fit; or the source must be read as a whole, because it is
        shrunk much or its horizon is visible, and does not fit into memory; or dask is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp, warp_chunks
    >>> stored = np.random.default_rng(1).random((300, 400, 3), np.float32)
    >>> made = np.zeros((250, 200, 3), np.float32)
    >>> matrix = [[0.8, -0.2, 10], [0.2, 0.9, 0], [0, 1e-4, 1]]
    >>> _ = warp_chunks(stored, matrix, (250, 200), out=made, side=64)
    >>> bool((made == warp(stored, matrix, (250, 200)).image).all())
    True
    """
    kept = _LazyPicture(source)
    shape = whole_pair(shape, "height", "width")
    if out is not None and tuple(out.shape) != (*shape, *kept.shape[2:]):
        raise ValueError(f"out is of {tuple(out.shape)}; the result is {(*shape, *kept.shape[2:])}")
    sides = _sides(side, out)
    border = edge_named(edge)
    if border == REFLECT_101:
        raise ValueError(f"edge {REFLECT_101} is only for pictures in memory; use mirror")
    geometry = geometry_of(matrix, shape, convention, inverse)
    chosen = method_named(method)
    filling = fill_for(fill, kept, alpha, chosen)
    way = _Way(chosen, geometry, shape, border, threads, filling)
    light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
    if out is None:
        return _lazy(source, kept, way, sides, light)
    for chunk in _chunks(kept, way, sides, **light):
        out[chunk.part] = chunk.warped.image
    return out


@dataclass(frozen=True)
class _Placed:
    """A part of a source that is indexed like the whole."""

    values: NDArray[Any]
    left: int
    top: int
    shape: tuple[int, ...]  # of the whole

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of its values."""
        return self.values.dtype

    def __getitem__(self, where: Any) -> NDArray[Any]:
        """Return rows and columns of the whole, which must lie within this part."""
        rows, columns = where
        down = slice(rows.start - self.top, rows.stop - self.top)
        return self.values[down, columns.start - self.left : columns.stop - self.left]


def _lazy(
    source: Any, kept: _LazyPicture, way: _Way, sides: tuple[int, int], light: dict[str, Any]
) -> Any:
    """Return the target as a dask array, whose chunks depend on the parts they show."""
    dask, is_partly = _dask(), _is_read_in_parts(kept, way)
    is_dask = dask.is_dask_collection(source)
    height, width = way.shape
    made = []
    for top in range(0, height, sides[0]):
        row = []
        for left in range(0, width, sides[1]):
            roi = left, top, min(sides[1], width - left), min(sides[0], height - top)
            drawing, part = _drawing(way, roi)
            seen = _source_rect(kept, drawing) if is_partly else Rect(0, 0, *kept.shape[1::-1])
            values = (source if is_dask else dask.delayed(source, traverse=False))[seen.part]
            block = dask.delayed(_block)(values, seen, kept.shape, drawing, part, light, is_partly)
            form = (roi[3], roi[2], *kept.shape[2:])
            row.append(dask.array.from_delayed(block, form, kept.dtype))
        made.append(dask.array.concatenate(row, axis=1))
    return dask.array.concatenate(made, axis=0)


def _dask() -> Any:
    """Import dask, an optional dependency."""
    try:
        import dask.array
    except ImportError as error:
        raise ValueError(
            f"without out the result is a dask array, and {error.name} is not installed: "
            "pip install 'hybrid-resample[dist]'"
        ) from None
    return dask


def _block(
    values: Any,
    seen: Rect,
    shape: tuple[int, ...],
    drawing: Drawing,
    part: tuple[slice, slice],
    light: dict[str, Any],
    is_partly: bool,
) -> NDArray[Any]:
    """Warp one chunk of the target from the part of the source that it shows."""
    values = np.asarray(values)
    source: Any = _LazyPicture(_Placed(values, seen.left, seen.top, shape)) if is_partly else values
    return _drawn(source, drawing, **light).image[part]


def _drawing(way: _Way, roi: tuple[int, int, int, int]) -> tuple[Drawing, tuple[slice, slice]]:
    """Return the drawing for a region (left, top, width, height), and its part of it."""
    geometry, form, part = within(way.geometry, way.shape, roi, way.method)
    drawing = Drawing(way.method, geometry, form, way.edge, way.threads, fill=way.fill)
    return drawing, part


def _source_rect(source: _LazyPicture, drawing: Drawing) -> Rect:
    """Return the part of the source that a chunk reads."""
    height, width = source.shape[:2]
    parts = parts_of(source, drawing)
    if parts is None or parts.mixed is not None:
        return Rect(0, 0, width, height)
    most = max(1, MOST_IN_WINDOW // math.prod(source.shape[2:]))
    windows = windows_of(parts.windows, (height, width), most)
    sources = np.array([window.source for window in windows])
    left, top = sources[:, :2].min(axis=0)
    right, bottom = sources[:, 2:].max(axis=0)
    if min(left, top) < 0 or right > width or bottom > height:  # continued beyond its edges
        return Rect(0, 0, width, height)
    return Rect(int(left), int(top), int(right), int(bottom))


def _sides(given: int | tuple[int, int] | None, out: Any) -> tuple[int, int]:
    """Return height and width of chunks."""
    if given is None:
        chunks = getattr(out, "shards", None) or getattr(out, "chunks", None)
        given = chunks[:2] if chunks and isinstance(chunks[0], int) else SIDE
    sides = (given, given) if isinstance(given, int) else given
    height, width = whole_pair(sides, "height", "width")
    if min(height, width) < 1:
        raise ValueError(f"chunks of {height} × {width} px; give 1 px or more")
    return height, width


def _chunks(
    source: _LazyPicture,
    way: _Way,
    sides: tuple[int, int],
    *,
    linear_light: bool | None,
    alpha: str | None,
) -> Iterator[Chunk]:
    """Yield all chunks of the target, row by row."""
    if not _is_read_in_parts(source, way):
        source = source.whole()  # type: ignore[assignment]
    height, width = way.shape
    for top in range(0, height, sides[0]):
        for left in range(0, width, sides[1]):
            roi = left, top, min(sides[1], width - left), min(sides[0], height - top)
            drawing, part = _drawing(way, roi)
            warped = _drawn(source, drawing, linear_light=linear_light, alpha=alpha)
            yield Chunk(left, top, Warped(warped.image[part], warped.coverage[part]))


def _is_read_in_parts(source: _LazyPicture, way: _Way) -> bool:
    """Whether the part of the source that each chunk shows is known beforehand."""
    geometry: Any = way.geometry
    if isinstance(geometry, ForwardMap) or not hasattr(way.method, "visible_tiles"):
        return False
    if isinstance(geometry, Homography) and whole_move(geometry.matrix) is not None:
        return False
    if isinstance(geometry, BackwardMap):
        return True
    return parts_of(source, Drawing(*way)) is not None


def _drawn(
    source: Any, drawing: Drawing, *, linear_light: bool | None, alpha: str | None
) -> Warped:
    """Draw one chunk from the part of a source that it shows, or from one in memory."""
    parts = None
    if isinstance(source, _LazyPicture):
        parts = parts_of(source, drawing)
        source = source if parts else source.whole()
    if parts is None:
        return drawn(source, drawing, linear_light=linear_light, alpha=alpha)
    return drawn_in_parts(source, drawing, parts, linear_light=linear_light, alpha=alpha)
