"""Render clouds stored in files: project discs in parts, paint tiles in groups.

A first pass counts the discs of each tile. Then consecutive tiles are painted in groups whose discs
fit into memory; only parts that these tiles show are projected again. Each tile gets the same discs
in the same order as with a cloud in memory: the result is bit-identical.
"""

from collections.abc import Callable, Iterator
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_in_file
from resample.painting.scenes.scene import dealt_to_tiles, tiles_along
from resample.types import Records, Screen
from resample.watching import portion, report, told
from resample_points.data.parts import rows_of, zeros_beside
from resample_points.geometry.spacing import Surfels

if TYPE_CHECKING:
    from resample_points.painting.kernels.painting import CloudPicture

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
    """Paint discs in files.

    Parameters
    ----------
    canvas
        Frame whose picture is filled; it must be transparent, with infinite depths.

    Returns
    -------
    What is visible of each disc, and seconds per stage.
    """
    job = _RenderJob(surfels, see, canvas, most, dict.fromkeys(STAGES, 0.0))
    with portion(0.0, SURVEYING):
        survey = _surveyed(job)
    spans = list(_spans(survey.start, most))
    for n, span in enumerate(spans):
        with told(None):  # of each part
            _paint_span(job, survey, span)
        with portion(SURVEYING, 1.0):
            report(n + 1, len(spans))
    return survey.visible, job.seconds


class _RenderJob(NamedTuple):
    """Arguments and times of `paint_in_windows`."""

    surfels: Surfels
    project: Projector
    canvas: WindowCanvas
    most: int  # bytes
    seconds: dict[str, float]  # so far, per stage


class _Survey(NamedTuple):
    """Result of the first pass over all discs."""

    visible: Visibility
    start: NDArray[np.int64]  # (T + 1,) number of discs in all previous tiles
    touched: NDArray[np.int64]  # (parts, 2) first and last tile that each part of the discs touches


def _surveyed(job: _RenderJob) -> _Survey:
    """Count the discs of each tile."""
    from resample.engine.tiles import CHUNKS, count_members
    from resample_points.painting.kernels.discs import SURFEL

    begin, canvas, position = perf_counter(), job.canvas, job.surfels.position
    rows, columns = tiles_along(canvas.screen, canvas.size)
    seen = zeros_beside(position, (len(position),), np.uint8)
    held, touched = np.zeros(rows * columns, np.int64), []
    for part in rows_of(position):
        records = np.zeros(part.stop - part.start, SURFEL)
        count = np.zeros((CHUNKS, held.size), np.int64)
        with told(None):
            job.project(part, records)
            count_members(records, canvas.screen, canvas.size, columns, count)
        seen[part] = kinds_of(records)
        held += count.sum(axis=0)
        tiles = np.flatnonzero(count.any(axis=0))
        touched.append((tiles[0], tiles[-1]) if tiles.size else (0, -1))
        report(part.stop, len(position))
    start = np.concatenate([[0], np.cumsum(held)])
    job.seconds["project"] += perf_counter() - begin
    return _Survey(seen, start, np.array(touched, np.int64).reshape(-1, 2))


def _spans(start: NDArray[np.int64], most: int) -> Iterator[tuple[int, int]]:
    """Yield spans of tiles whose discs fit into `most` bytes, or single tiles."""
    from resample_points.painting.kernels.discs import SURFEL

    discs = max(1, most // (SURFEL.itemsize + MEMBER))
    tile, count = 0, len(start) - 1
    while tile < count and start[tile] < start[-1]:
        last = int(np.searchsorted(start, start[tile] + discs, side="right")) - 1
        last = min(max(last, tile + 1), count)
        if start[last] > start[tile]:
            yield tile, last
        tile = last


def _paint_span(job: _RenderJob, survey: _Survey, span: tuple[int, int]) -> None:
    """Paint the tiles of a span."""
    from resample_points.painting.kernels.painting import Discs, paint

    times, canvas = [perf_counter()], job.canvas
    records, which = _discs_of(job, survey, span)
    times.append(perf_counter())
    tiles = dealt_to_tiles(records, canvas.screen, canvas.size)
    start = np.clip(tiles.start, tiles.start[span[0]], tiles.start[span[1]])  # exclude other tiles
    times.append(perf_counter())
    discs = Discs(records, np.zeros(len(records), np.uint8))
    paint(discs, tiles._replace(start=start), canvas.subpixels, canvas.picture)
    survey.visible[which[discs.shows > 0]] |= np.uint8(SHOWN)
    times.append(perf_counter())
    for stage, spent in zip(STAGES, np.diff(times).tolist(), strict=True):
        job.seconds[stage] += spent


def _discs_of(
    job: _RenderJob, survey: _Survey, span: tuple[int, int]
) -> tuple[Records, NDArray[np.int64]]:
    """Return the projected discs in a span's tiles, and their indices."""
    from resample_points.painting.kernels.discs import SURFEL
    from resample_points.painting.kernels.windows import find_overlapping

    canvas, count = job.canvas, 0
    held = int(survey.start[span[1]] - survey.start[span[0]])
    found, which = _allocate(job, held, SURFEL), _allocate(job, held, np.dtype(np.int64))
    shape = tiles_along(canvas.screen, canvas.size)
    for n, part in enumerate(rows_of(job.surfels.position)):
        if survey.touched[n, 0] >= span[1] or survey.touched[n, 1] < span[0]:
            continue
        records = np.zeros(part.stop - part.start, SURFEL)
        job.project(part, records)
        meets = np.zeros(len(records), np.bool_)
        find_overlapping(records, (*shape, canvas.size), span, meets)
        some = np.flatnonzero(meets)
        found[count : count + some.size] = records[some]
        which[count : count + some.size] = part.start + some
        count += some.size
    return found[:count], which[:count]


def _allocate(job: _RenderJob, count: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Allocate an array, in a file if it exceeds the memory limit."""
    if count * kind.itemsize <= job.most:
        return np.empty(count, kind)
    return array_in_file((count,), kind, job.most, "a cloud on the screen")
