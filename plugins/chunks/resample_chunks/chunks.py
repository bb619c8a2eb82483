"""Warp pictures larger than memory, chunk by chunk.

The source is anything that can be sliced like an array, such as a zarr array, a dask array or a
memory-mapped file; only the parts that a chunk shows are read. The target is anything that can be
assigned slices.
"""

import math
from collections import defaultdict
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import takes
from resample.messages import check_threads
from resample.outofcore.bricks import Box, boxes_of
from resample.reading.limits import check_free
from resample_texture.arguments import (
    REFLECT_101,
    Places,
    axis_of,
    check_shape,
    check_sums,
    edge_named,
    fill_for,
    geometry_of,
    method_named,
    whole_pair,
    within,
)
from resample_texture.drawing import MOST_IN_WINDOW, Drawing, drawn, drawn_in_parts, parts_of
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography
from resample_texture.geometry.regions import Rect, whole_move, windows_of
from resample_texture.types import (
    FRAMES,
    AnyAlpha,
    AnyEdge,
    AnyLight,
    Fill,
    Method,
    PlaceOptions,
    StackOptions,
    Warped,
)

SIDE = 1024  # px of chunks, unless the target has its own chunks


class ChunkOptions(PlaceOptions, StackOptions, total=False):
    """Options of `warp_chunks`, as `warp` describes them."""

    linear_light: AnyLight | None
    alpha: AnyAlpha | None
    fill: Fill | None
    total: bool | None
    threads: int | None


class _LazyPicture:
    """A stored picture, or a part that is indexed like the whole; texels are read on demand."""

    def __init__(
        self, stored: Any, first: tuple[int, int] = (0, 0), shape: tuple[int, ...] | None = None
    ) -> None:
        self.shape: tuple[int, ...] = tuple(int(size) for size in shape or stored.shape)
        self.dtype, self.ndim = np.dtype(stored.dtype), len(self.shape)
        self._stored, self._first = stored, first  # row and column of the whole

    def __getitem__(self, where: tuple[Any, Any]) -> NDArray[Any]:
        """Read the texels of two slices, or of rows (N, 1) and columns (M,)."""
        if all(isinstance(part, slice) for part in where):
            shifts = zip(where, self._first, strict=True)
            own = tuple(slice(part.start - n, part.stop - n) for part, n in shifts)
            return np.ascontiguousarray(self._stored[own])
        rows, columns = where
        top, left = int(rows.min()), int(columns.min())
        around = self[top : int(rows.max()) + 1, left : int(columns.max()) + 1]
        found: NDArray[Any] = around[rows - top, columns - left]
        return found

    def whole(self) -> NDArray[Any]:
        """Read the whole picture, if it fits into memory."""
        check_free("the source", math.prod(self.shape) * self.dtype.itemsize)
        return np.asarray(self._stored[...])


@takes(ChunkOptions)
def warp_chunks(
    source: Any,
    matrix: ArrayLike | Geometry | Places,
    shape: tuple[int, int],
    method: str | Method = "hybrid",
    *,
    out: Any = None,
    side: int | tuple[int, int] | None = None,
    edge: AnyEdge = "transparent",
    **options: Unpack[ChunkOptions],
) -> Any:
    """Warp a picture larger than memory, chunk by chunk; pixels equal those of `warp`.

    They are equal bit by bit with matrices, for targets of up to 2³⁰ px, where the picture lies
    within the source; elsewhere coordinates may be rounded differently.

    Parameters
    ----------
    source
        (H, W) or (H, W, C), anything with `shape` and `dtype` that returns arrays for slices:
        `zarr.open_array(...)`, `dask.array`, `numpy.memmap`.
    matrix, shape, method, edge, options
        As `warp` takes them; of its options `convention`, `inverse`, `axis` (no frames),
        `linear_light`, `alpha`, `fill`, `total` and `threads`. Geometry must be a matrix or a
        backward map, and with the method pixels gather from a part of the source, as in the
        default. `reflect-101` is not available. With `total` the source is read as a whole, and
        sums are those of `warp`.
    out
        (height, width) or (height, width, C): anything that takes arrays for slices; it is filled.
        None: return a dask array with chunks that are warped on demand.
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
    >>> from resample_chunks import warp_chunks
    >>> from resample_texture import warp
    >>> stored = np.random.default_rng(1).random((300, 400, 3), np.float32)
    >>> made = np.zeros((250, 200, 3), np.float32)
    >>> matrix = [[0.8, -0.2, 10], [0.2, 0.9, 0], [0, 1e-4, 1]]
    >>> _ = warp_chunks(stored, matrix, (250, 200), out=made, side=64)
    >>> np.array_equal(made, warp(stored, matrix, (250, 200)).image, equal_nan=True)
    True
    """
    threads, total, alpha = options.get("threads"), options.get("total"), options.get("alpha")
    check_threads(threads)
    kept = _LazyPicture(source)
    if axis_of(kept, options.get("axis")) == FRAMES:
        raise ValueError(f"a source {kept.shape} of frames; warp them one by one")
    shape = whole_pair(shape, "height", "width")
    if out is not None and tuple(out.shape) != (*shape, *kept.shape[2:]):
        raise ValueError(f"out is of {tuple(out.shape)}; the result is {(*shape, *kept.shape[2:])}")
    if side is None:
        chunks = getattr(out, "shards", None) or getattr(out, "chunks", None)
        side = chunks[:2] if chunks and isinstance(chunks[0], int) else SIDE
    sides = whole_pair((side, side) if isinstance(side, int) else side, "height", "width")
    if min(sides) < 1:
        raise ValueError(f"chunks of {sides[0]} × {sides[1]} px; give 1 px or more")
    check_shape(shape)
    border = edge_named(edge)
    if border == REFLECT_101:
        raise ValueError(f"edge {REFLECT_101} is only for pictures in memory; use mirror")
    geometry = geometry_of(
        matrix, shape, options.get("convention", "corner"), options.get("inverse", False)
    )
    chosen = method_named(method, total=total)
    check_sums(kept.dtype, chosen)
    filling = fill_for(options.get("fill"), kept, alpha, chosen)
    light: dict[str, Any] = {"linear_light": options.get("linear_light"), "alpha": alpha}
    way = Drawing(chosen, geometry, shape, border, threads, fill=filling, **light)
    is_partly, boxes = _is_read_in_parts(kept, way), boxes_of(shape, sides)
    chunk = partial(_chunk, way=way, is_partly=is_partly)
    if out is None:
        try:
            dask: Any = import_module("dask")
            import_module("dask.array")
        except ImportError as error:
            raise ValueError(
                f"without out the result is a dask array, and {error.name} is not installed: "
                "pip install 'hybrid-resample[dist]'"
            ) from None
        given = source if dask.is_dask_collection(source) else dask.delayed(source, traverse=False)
        made: dict[int, list[Any]] = defaultdict(list)  # by first row
        for box in boxes:
            one = chunk(box)
            seen = one.bounds(kept)
            block = dask.delayed(one.load)(given[seen.part], seen, kept.shape)
            form = *(side.stop - side.start for side in box), *kept.shape[2:]
            made[box[0].start].append(dask.array.from_delayed(block, form, kept.dtype))
        rows = [dask.array.concatenate(row, axis=1) for row in made.values()]
        return dask.array.concatenate(rows, axis=0)
    shown: Any = kept if is_partly else kept.whole()
    for box in boxes:
        out[box] = chunk(box).paint(shown).image
    return out


class _Chunk(NamedTuple):
    """A chunk of the target: which part of a source it shows, and how it is warped."""

    drawing: Drawing
    part: tuple[slice, slice]  # of the drawing
    is_partly: bool  # whether it reads a part of the source

    def bounds(self, source: _LazyPicture) -> Rect:
        """Return the part of the source that it reads."""
        height, width = source.shape[:2]
        parts = parts_of(source, self.drawing) if self.is_partly else None
        if parts is None or parts.mixed is not None:
            return Rect(0, 0, width, height)
        most = max(1, MOST_IN_WINDOW // math.prod(source.shape[2:]))
        windows = windows_of(parts.windows, (height, width), most)
        return Rect.around([window.source for window in windows], (height, width))

    def load(self, values: Any, seen: Rect, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return its pixels, from values of the part that it reads of a source of a shape."""
        source: Any = np.asarray(values)
        if self.is_partly:
            source = _LazyPicture(source, (seen.top, seen.left), shape)
        return self.paint(source).image

    def paint(self, source: Any) -> Warped:
        """Warp it from the part of a stored source that it shows, or from one in memory."""
        parts = None
        if isinstance(source, _LazyPicture):
            parts = parts_of(source, self.drawing)
            source = source if parts else source.whole()
        if parts is None:
            warped = drawn(source, self.drawing)
        else:
            warped = drawn_in_parts(source, self.drawing, parts)
        return type(warped)(warped.image[self.part], warped.coverage[self.part])


def _chunk(box: Box, way: Drawing, is_partly: bool) -> _Chunk:
    """Return the chunk of rows and columns of the target."""
    rows, columns = box
    roi = columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start
    geometry, form, part = within(way.geometry, way.shape, roi, way.method)
    return _Chunk(way._replace(geometry=geometry, shape=form), part, is_partly)


def _is_read_in_parts(source: _LazyPicture, way: Drawing) -> bool:
    """Whether the part of the source that each chunk shows is known beforehand."""
    geometry: Any = way.geometry
    if isinstance(geometry, ForwardMap) or not hasattr(way.method, "visible_tiles"):
        return False
    if isinstance(geometry, Homography) and whole_move(geometry.matrix) is not None:
        return False
    if isinstance(geometry, BackwardMap):
        return True
    return parts_of(source, way) is not None
