"""Render clouds stored in files: project discs in parts, paint tiles in groups.

A first pass counts the discs of each tile. Then consecutive tiles are painted in groups with
discs that fit into memory; only parts they show are projected again. A tile gets the same discs
in the same order as with a cloud in memory: the result is bit-identical.
"""

from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_in_file
from resample.outofcore.passes import PassContext, passed, spans_within
from resample.painting.scenes import dealt_to_tiles, tiles_along
from resample.progress import progress_here, told
from resample.types import Indices, Records, Screen
from resample_points.data.parts import rows_of, zeros_beside
from resample_points.geometry.spacing import Surfels

if TYPE_CHECKING:
    from resample_points.kernels.discs import CloudPicture

POINT, SPLAT, SHOWN = 1, 2, 4  # state of a disc on the screen
VISIBILITY_KINDS = 1 + (POINT | SPLAT | SHOWN)  # number of combinations of these
STAGES = "project", "sort", "paint"
MEMBER = 16  # bytes of a disc in a tile, beside its record
SURVEYING = 0.3  # share of the first pass in the work

Projector = Callable[[slice, Records], None]  # projects discs into as many records
Visibility = NDArray[np.uint8]  # (N,) `POINT` or `SPLAT`, if a disc is in the frame, and `SHOWN`


class WindowCanvas(NamedTuple):
    """A frame, cut into tiles."""

    screen: Screen
    size: int  # px, of a tile
    subpixels: int  # per side of a pixel
    picture: "CloudPicture"


def kinds_of(records: Records) -> Visibility:
    """Classify projected discs."""
    kind = np.where(records["weight"] < 1, np.uint8(POINT), np.uint8(SPLAT))
    return np.where(records["left"] <= records["right"], kind, np.uint8(0))


def paint_in_windows(
    surfels: Surfels, see: Projector, canvas: WindowCanvas, most: int
) -> tuple[Visibility, dict[str, float]]:
    """Paint discs in files; at most `most` bytes of them are in memory.

    Return counts of visible samples, and seconds per stage. The canvas is transparent before.
    """
    from resample_points.kernels.discs import SURFEL

    position, context = surfels.position, PassContext(tell=progress_here())
    rows, seen = list(rows_of(position)), zeros_beside(position, (len(position),), np.uint8)
    cloud = CloudInFiles(rows, see, canvas, most, seen, dict.fromkeys(STAGES, 0.0))
    counts, touched = zip(*passed(cloud.survey, rows, context.portion(0, SURVEYING)), strict=True)
    cloud = cloud._replace(touched=np.array(touched), start=np.cumsum([0, *sum(counts)]))
    spans = list(spans_within(cloud.start, max(1, most // (SURFEL.itemsize + MEMBER))))
    for _ in passed(cloud.paint, spans, context.portion(SURVEYING, 1.0)):
        pass
    return seen, cloud.seconds


class CloudInFiles(NamedTuple):
    """A cloud in parts, with spans of tiles as windows; see `resample.outofcore.ellipsoids`."""

    rows: list[slice]  # of the parts
    project: Projector
    canvas: WindowCanvas
    most: int  # bytes
    visible: Visibility  # found by the passes
    seconds: dict[str, float]  # so far, per stage
    start: Indices = np.zeros(0, np.int64)  # (T + 1,) number of discs in all previous tiles
    touched: Indices = np.zeros((0, 2), np.int64)  # (parts, 2) first and last tile of each

    def survey(self, part: slice) -> tuple[Indices, tuple[int, int]]:
        """Return the number of a part's discs in each tile, and its first and last tile."""
        from resample.engine.tiles import CHUNKS, count_members

        begin, canvas = perf_counter(), self.canvas
        rows, columns = tiles_along(canvas.screen, canvas.size)
        count = np.zeros((CHUNKS, rows * columns), np.int64)
        with told(None):  # of each kernel
            records = self._projected(part)
            count_members(records, canvas.screen, canvas.size, columns, count)
        self.visible[part] = kinds_of(records)
        held = count.sum(axis=0)
        tiles = np.flatnonzero(held)
        self.seconds["project"] += perf_counter() - begin
        return held, (int(tiles[0]), int(tiles[-1])) if tiles.size else (0, -1)

    def _projected(self, part: slice) -> Records:
        """Return the projected discs of a part."""
        from resample_points.kernels.discs import SURFEL

        records = np.zeros(part.stop - part.start, SURFEL)
        self.project(part, records)
        return records

    def bounds(self, span: tuple[int, int]) -> list[slice]:
        """Return the parts that have discs in a span of tiles."""
        are_near = (self.touched[:, 0] < span[1]) & (self.touched[:, 1] >= span[0])
        return [self.rows[n] for n in np.flatnonzero(are_near)]

    def load(self, span: tuple[int, int]) -> tuple[Records, Indices]:
        """Return the projected discs in a span of tiles, and their indices."""
        from resample_points.kernels.discs import SURFEL, find_overlapping

        canvas, count = self.canvas, 0
        held = int(self.start[span[1]] - self.start[span[0]])
        found, which = self._allocate(held, SURFEL), self._allocate(held, np.dtype(np.int64))
        shape = tiles_along(canvas.screen, canvas.size)
        for part in self.bounds(span):
            records = self._projected(part)
            meets = np.zeros(len(records), np.bool_)
            find_overlapping(records, (*shape, canvas.size), span, meets)
            some = np.flatnonzero(meets)
            found[count : count + some.size] = records[some]
            which[count : count + some.size] = part.start + some
            count += some.size
        return found[:count], which[:count]

    def _allocate(self, count: int, kind: np.dtype[Any]) -> NDArray[Any]:
        """Allocate an array, in a file if it exceeds the memory limit."""
        if count * kind.itemsize <= self.most:
            return np.empty(count, kind)
        return array_in_file((count,), kind, self.most, "a cloud on the screen")

    def paint(self, span: tuple[int, int]) -> None:
        """Paint the tiles of a span."""
        begin = perf_counter()
        with told(None):  # of each kernel
            records, which = self.load(span)
            self.seconds["project"] += perf_counter() - begin
            is_shown = paint_discs(records, self.canvas, self.seconds, span)
        self.visible[which[is_shown]] |= np.uint8(SHOWN)


def paint_discs(
    records: Records,
    canvas: WindowCanvas,
    seconds: dict[str, float],
    span: tuple[int, int] = (0, -1),
) -> NDArray[np.bool_]:
    """Paint projected discs on a span of tiles, or on all; return flags of visible discs."""
    from resample_points.kernels.discs import Discs, paint

    begin = perf_counter()
    with told(None):
        tiles = dealt_to_tiles(records, canvas.screen, canvas.size)
    own = np.clip(tiles.start, tiles.start[span[0]], tiles.start[span[1]])  # no other tiles
    sorted_at = perf_counter()
    discs = Discs(records, np.zeros(len(records), np.uint8))
    paint(discs, tiles._replace(start=own), canvas.subpixels, canvas.picture)
    seconds["sort"] += sorted_at - begin
    seconds["paint"] += perf_counter() - sorted_at
    return np.asarray(discs.shows > 0)
