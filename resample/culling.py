"""Samples in blocks, of which those are skipped that lie outside the view or are hidden.

The picture is the one that all samples would give, bit for bit: tiles get the grid that they would
have, and only that is left out which would have fallen on opaque pixels. Blocks are tested as in
Zhang, Manocha, Hudson and Hoff, Visibility Culling Using Hierarchical Occlusion Maps, 1997; the
occluders are what has been painted so far. See `resample.engine.culling`.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from resample.layers import layers_of, sheets_of
from resample.profiles.orders import EverySample
from resample.scene import (
    Clock,
    Painted,
    Progress,
    Scene,
    check_samples,
    dealt_to_tiles,
    in_steps,
    size_of_tiles,
    tile_size,
    tiles_along,
)
from resample.types import (
    FOOTPRINT,
    LAST_SHEET,
    Blocked,
    Blocks,
    Doubles,
    Floats,
    Records,
    Samples,
    Sheets,
    Statistics,
    View,
)

if TYPE_CHECKING:
    from resample.engine.culling import Canvases, Outlines, Pyramid

BLOCK_SIZE = 8  # voxels
PASSES = 6  # at most
SAMPLES_PER_PASS = 50_000  # fewer are painted sooner than it takes to see what they hide
EARLIER = 1.5  # the first passes are short: they hide samples from all others
MOST_CANVASES = 2**31  # bytes; where the sub-pixels of all tiles take more, none hides another
PROBE = 13  # every so many samples are looked at to find the grids of tiles
FARTHEST_BRICK = 2.0**40  # beyond, neighbouring bricks become one

Indices = NDArray[np.int64]


def bricks(position: Floats, lattice: Doubles, size: int = BLOCK_SIZE) -> tuple[Indices, Blocks]:
    """Blocks of samples that lie in the same `size`³ cells of their lattice.

    Parameters
    ----------
    position
        (N, 3) scene units, finite.
    lattice
        (3, 3) as in `Samples`.
    size
        Cells along a side of a block.

    Returns
    -------
    Order (N,) that sorts samples, or whatever has their positions, into blocks; and the blocks.

    Raises
    ------
    ValueError
        The size is not 1 or more.
    """
    if size < 1:
        raise ValueError(f"blocks of {size} cells; they need a side of 1 or more")
    place = np.asarray(position, np.float64) @ np.linalg.inv(lattice).T
    brick = np.floor((place - place.min(axis=0, initial=np.inf) + 0.5) / size)
    x, y, z = np.minimum(brick, FARTHEST_BRICK).astype(np.int64).T
    across, down = x.max(initial=0) + 1, y.max(initial=0) + 1
    number = (z * down + y) * across + x  # if it overflows, distant bricks become one
    order = np.argsort(number, kind="stable")
    number = number[order]
    start = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
    placed = np.asarray(position, np.float32)[order]
    low = np.minimum.reduceat(placed, start) if start.size else placed
    high = np.maximum.reduceat(placed, start) if start.size else placed
    return order, Blocks(np.append(start, number.size), low, high)


def blocked(samples: Samples, size: int = BLOCK_SIZE) -> Blocked:
    """Samples sorted into blocks of `size`³ cells of their lattice, to be painted many times.

    Their colors and extinctions may be replaced later, and their positions may not.

    Raises
    ------
    ValueError
        As `resample.scene.check_samples`, or the size is not 1 or more.
    """
    if not isinstance(samples, Samples):
        raise ValueError(
            f"only samples can be skipped by blocks, not a {type(samples).__name__}; a field needs "
            "image-sheets, which sum all that lies in a slab"
        )
    position, color, extinction, lattice = check_samples(samples)
    order, blocks = bricks(position, lattice, size)
    return Blocked(Samples(position[order], color[order], extinction[order], lattice), blocks)


def check_blocked(given: Blocked) -> Blocked:
    """Blocks that fit their samples, as far as that can be seen from each block's ends.

    Samples themselves are checked when their turn comes, as `check_samples` does.

    Raises
    ------
    ValueError
        Shapes do not fit, or samples are not sorted as blocks say.
    """
    samples, (start, low, high) = given
    count = len(samples.extinction)
    if samples.position.shape != (count, 3) or samples.color.shape != (count, 3):
        raise ValueError(
            f"positions {samples.position.shape}, colors {samples.color.shape} and extinctions "
            f"{samples.extinction.shape} do not fit; they have shapes (N, 3), (N, 3) and (N,)"
        )
    whole = start.size and start[0] == 0 and start[-1] == count and (np.diff(start) > 0).all()
    if not whole or low.shape != (start.size - 1, 3) or low.shape != high.shape:
        raise ValueError(f"{start.size - 1} blocks do not fit {count} samples; make them anew")
    for end in (start[:-1], start[1:] - 1):
        place = samples.position[end]
        if ((place < low) | (place > high)).any():
            raise ValueError("a sample lies outside its block; sort samples by `blocked` first")
    return given


def paint_blocks(
    scene: Scene, given: Blocked, order: EverySample, progress: Progress | None
) -> tuple[Painted, Statistics]:
    """Picture of what is not skipped, and counts of what is."""
    stage = _Stage(scene, given, order)
    outlines, clock = stage.outlines, Clock()
    inside = np.flatnonzero(outlines.bounds[:, 0] <= outlines.bounds[:, 2])
    inside = inside[np.argsort(outlines.front[inside], kind="stable")]
    painted, occluded = scene.blank(1), inside[:0]
    clock.lap("cull")
    if inside.size:
        painted, occluded = _front_to_back(stage, inside, clock, progress)
    count = np.diff(given.blocks.start)
    statistics = painted.statistics(int(count.sum()), clock.seconds)
    return painted, statistics._replace(
        outside=int(count.sum() - count[inside].sum()),
        occluded=int(count[occluded].sum()),
        blocks=count.size,
        blocks_outside=count.size - inside.size,
        blocks_occluded=occluded.size,
    )


@dataclass(frozen=True)
class _Stage:
    """Blocked samples before a camera."""

    scene: Scene
    given: Blocked
    order: EverySample

    @cached_property
    def outlines(self) -> "Outlines":
        """What is known of blocks before any of their samples is looked at."""
        from resample.engine.culling import Outlines, outline_blocks

        blocks, scene = self.given.blocks, self.scene
        count = len(blocks.low)
        outlines = Outlines(np.zeros((count, 4)), np.zeros(count), np.zeros(count))
        by_distance = self.order.key == "distance"
        outline_blocks(
            blocks, scene.view, scene.ellipsoid, scene.screen, scene.style, by_distance, outlines
        )
        return outlines

    def gathered(self, chosen: Indices, step: int = 1) -> Samples:
        """Every so many samples of the chosen blocks, which are in ascending order."""
        samples, start = self.given.samples, self.given.blocks.start
        follows = np.diff(chosen) == 1  # blocks that lie together are taken together
        first = chosen[np.append(True, ~follows)[: chosen.size]]
        last = chosen[np.append(~follows, True)[: chosen.size]]
        parts = [slice(*ends, step) for ends in zip(start[first], start[last + 1], strict=True)]
        arrays = [
            np.concatenate([array[:0], *(array[part] for part in parts)])
            for array in (samples.position, samples.color, samples.extinction)
        ]
        return check_samples(Samples(arrays[0], arrays[1], arrays[2], samples.lattice))

    def grids(self, inside: Indices) -> tuple[int, Floats]:
        """Size of tiles in px, and for each (T,) a spacing with the grid that it is to have.

        Some samples say how fine a grid must be at least, and blocks how fine it could have to be
        at most. Where these do not agree, all samples of the block are looked at.
        """
        from resample.engine.grid import grid
        from resample.engine.tiles import smallest_spacing

        scene = self.scene
        screen, style = scene.screen, scene.style
        finest = grid(self.outlines.spacing[inside].min(), style)
        if style.subpixels > 0 or finest == 1:
            size = size_of_tiles(finest)
            return size, np.full(math.prod(tiles_along(screen, size)), np.inf, np.float32)
        known = scene.project(self.gathered(np.sort(inside), PROBE))
        smallest = np.full(1, smallest_spacing(known), np.float32)
        doubtful = self._doubtful(max(screen.width, screen.height) + 1, 1, smallest)
        more = scene.project(self.gathered(np.flatnonzero(doubtful)))
        known = np.concatenate([known, more])
        size = tile_size(known, style)
        tiles = dealt_to_tiles(known, screen, size)
        rest = self._doubtful(size, tiles.columns, tiles.spacing) & ~doubtful
        more = scene.project(self.gathered(np.flatnonzero(rest)))
        return size, np.minimum(tiles.spacing, dealt_to_tiles(more, screen, size).spacing)

    def _doubtful(self, size: int, columns: int, smallest: Floats) -> NDArray[np.bool_]:
        """Blocks (B,) that may need a finer grid than the smallest spacing known of a tile does."""
        from resample.engine.culling import mark_doubtful

        marked = np.zeros(self.outlines.front.size, bool)
        mark_doubtful(
            self.outlines, self.scene.screen, self.scene.style, size, columns, smallest, marked
        )
        return marked


class _Canvases:
    """All tiles' sub-pixels from pass to pass, and the occlusion map above them."""

    def __init__(self, scene: Scene, size: int, spacing: Floats) -> None:
        from resample.engine.culling import lay_out

        self.scene, self.size, self.spacing = scene, size, spacing
        self.margin = scene.tables.pixel_margin
        self.rows, self.columns = tiles_along(scene.screen, size)
        self.painted = scene.blank(spacing.size)
        self.start = np.zeros(spacing.size + 1, np.int64)
        lay_out(spacing, size, self.columns, scene.screen, scene.style, self.margin, self.start)

    @property
    def fit(self) -> bool:
        """Whether they are small enough to be kept."""
        return bool(4 * self.start[-1] <= MOST_CANVASES)

    @cached_property
    def canvases(self) -> "Canvases":
        """What the kernels write to."""
        from resample.engine.culling import Canvases

        side = self.size + 2 * self.margin
        return Canvases(
            np.empty(self.start[-1], np.float32),
            self.start,
            np.full(self.spacing.size, -1),
            np.ones((self.spacing.size, side, side), np.float32),
        )

    @cached_property
    def pyramid(self) -> "Pyramid":
        """Room for the occlusion map."""
        from resample.engine.culling import Pyramid

        screen = self.scene.screen
        rows, columns = [screen.height + 2 * self.margin], [screen.width + 2 * self.margin]
        while rows[-1] > 1 or columns[-1] > 1:
            rows.append(-(-rows[-1] // 2))
            columns.append(-(-columns[-1] // 2))
        start = np.concatenate([[0], np.cumsum(np.multiply(rows, columns))])
        light = np.zeros(start[-1], np.float32)
        return Pyramid(light, start, np.array(rows), np.array(columns))

    def paint(self, records: Records, sheets: Sheets, first: int, last: int) -> None:
        """Go on with samples of the sheets from `first` to before `last`."""
        from resample.engine.culling import paint_pass

        scene = self.scene
        tiles = dealt_to_tiles(records, scene.screen, self.size)._replace(spacing=self.spacing)
        for turn, _ in in_steps(np.diff(tiles.start)):
            paint_pass(
                turn,
                tiles,
                records,
                sheets,
                sheets.key.view(np.uint32),
                first,
                last,
                scene.view,
                scene.ellipsoid,
                scene.screen,
                scene.style,
                scene.tables,
                self.canvases,
                self.painted.tally,
            )

    def covered(self, blocks: Indices, bounds: Doubles) -> NDArray[np.bool_]:
        """Which of the blocks (K,) lie behind opaque sub-pixels only."""
        from resample.engine.culling import fill_pyramid, mark_covered

        fill_pyramid(self.canvases.light, self.size, self.columns, self.pyramid)
        covered = np.zeros(blocks.size, bool)
        mark_covered(blocks, bounds, self.margin, self.pyramid, self.scene.style, covered)
        return covered

    def resolved(self) -> Painted:
        """The picture."""
        from resample.engine.culling import resolve_tiles

        scene = self.scene
        resolve_tiles(
            self.spacing,
            self.size,
            self.columns,
            scene.screen,
            scene.style,
            scene.tables,
            self.canvases,
            self.painted.film,
        )
        return self.painted


class _Queue:
    """Samples that were projected and may still have to be painted."""

    def __init__(self, stage: _Stage, most: int) -> None:
        self.stage = stage
        self.records = np.zeros(most, FOOTPRINT)
        self.key, self.sheet = np.zeros(most, np.float32), np.zeros(most, np.int32)
        self.begin = np.zeros(1, np.int64)  # of each block's records, and the end of all
        self.back = np.zeros(0, np.int32)  # each block's last sheet

    def take(self, blocks: Indices) -> None:
        """Project the samples of blocks."""
        if blocks.size == 0:
            return
        stage, start = self.stage, self.stage.given.blocks.start
        scene, samples = stage.scene, stage.gathered(blocks)
        end = self.begin[-1] + np.cumsum(start[blocks + 1] - start[blocks])
        part = slice(self.begin[-1], end[-1])
        records = self.records[part]
        scene.project(samples, records)
        self.key[part], self.sheet[part] = _sheets(stage.order, samples, scene.view)
        shown = np.where(records["left"] <= records["right"], self.sheet[part], -int(LAST_SHEET))
        self.begin = np.append(self.begin, end)
        blocks_begin = self.begin[self.back.size : -1] - part.start
        self.back = np.append(self.back, np.maximum.reduceat(shown, blocks_begin))

    def waiting(self, first: int) -> tuple[Records, Sheets]:
        """All samples from the first block on that reaches a sheet not yet painted."""
        behind = np.flatnonzero(self.back >= first)
        part = slice(self.begin[behind[0]] if behind.size else self.begin[-1], self.begin[-1])
        return self.records[part], Sheets(self.key[part], self.sheet[part])


def _passes(front: Indices, count: Indices) -> list[tuple[int, int]]:
    """Sheets from which on, and before which, each pass paints.

    `front` is the first sheet of blocks, ascending, and `count` how many samples they have.
    """
    done = np.cumsum(count)
    passes = min(PASSES, 1 + int(done[-1]) // SAMPLES_PER_PASS)
    share = (np.arange(1, passes) / passes) ** EARLIER * done[-1]
    between = np.unique(front[np.searchsorted(done, share)])
    between = between[between > front[0]]
    last = int(LAST_SHEET) + 1
    edges = [-last, *(int(edge) for edge in between), last]
    return list(pairwise(edges))


def _front_to_back(
    stage: _Stage, inside: Indices, clock: Clock, progress: Progress | None
) -> tuple[Painted, Indices]:
    """Paint blocks in passes; gives the picture and the blocks that were skipped as occluded."""
    scene, outlines = stage.scene, stage.outlines
    count = np.diff(stage.given.blocks.start)[inside]
    layer = np.floor(outlines.front[inside] / scene.style.layer)
    front = np.clip(layer, -LAST_SHEET, LAST_SHEET).astype(np.int64)
    canvases = _Canvases(scene, *stage.grids(inside))
    if not canvases.fit:
        return _at_once(stage, inside, clock, progress), inside[:0]
    queue = _Queue(stage, int(count.sum()))
    skipped, begin = [], 0
    clock.lap("cull")
    for first, last in _passes(front, count):
        end = int(np.searchsorted(front, last))
        due = inside[begin:end]
        covered = np.zeros(due.size, bool)
        if begin:
            covered = canvases.covered(due, outlines.bounds)
        skipped.append(due[covered])
        clock.lap("cull")
        queue.take(np.sort(due[~covered]))
        clock.lap("project")
        canvases.paint(*queue.waiting(first), first, last)
        clock.lap("paint")
        begin = end
        if progress is not None:
            progress(end / inside.size)
    painted = canvases.resolved()
    clock.lap("paint")
    return painted, np.concatenate(skipped)


def _at_once(stage: _Stage, inside: Indices, clock: Clock, progress: Progress | None) -> Painted:
    """Paint all blocks without looking at what they hide."""
    samples = stage.gathered(np.sort(inside))
    scene = replace(stage.scene, footprints=stage.scene.project(samples))
    clock.lap("project")
    sheets = _sheets(stage.order, samples, scene.view)
    tiles = dealt_to_tiles(scene.footprints, scene.screen, tile_size(scene.footprints, scene.style))
    clock.lap("bin")
    painted = scene.paint(sheets, tiles, progress)
    clock.lap("paint")
    return painted


def _sheets(order: EverySample, samples: Samples, view: View) -> Sheets:
    layers = layers_of(order, samples.position, view, samples.lattice)
    return sheets_of(layers, order.summing, samples.position, view)
