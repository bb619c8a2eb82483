"""Project texels of a source larger than memory, part by part.

Blocks of texels are added in the same order as for the whole source, each from the texels that it
reads, so that sums are bit-identical to those in memory.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.engine.windows.boxes import SPARE
from resample.engine.windows.filtering import Filters, filter_plate
from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Floats
from resample_texture.geometry.mappings import Homography
from resample_texture.texels.forward import (
    Bounds,
    CellGrid,
    PointSums,
    SourceBlocks,
    blocks_of,
    borders,
    kinds_of,
    margin_of,
    meeting,
    moved,
    needs_totals,
    sums_of,
)
from resample_texture.texels.kernels.blocks import CUT, LENGTH, LEVEL, START
from resample_texture.texels.kernels.painting import Texels
from resample_texture.texels.kernels.texels import Extract
from resample_texture.texels.plates import texels_at
from resample_texture.types import Edge, Warped

MOST_VALUES = 1 << 20  # of a source in memory at a time
MOST_OF_BLOCK = 4  # times `MOST_VALUES` for a single block
NO_TOTALS = np.zeros((0, 1, 1, 1))
ONE = np.ones(1, np.float32)

Integers = NDArray[np.int64]


class TexelReader(Protocol):
    """A source whose texels are read on demand."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels."""

    def texels(self, rows: Integers, columns: Integers) -> Floats:
        """Read texels (R, K, C) of rows (R,) and columns (K,), in any order."""


class Widened(NamedTuple):
    """A source padded with its outermost texels; see `forward.widened`."""

    reader: TexelReader
    margin: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels, with the margins."""
        height, width, channels = self.reader.shape
        return height + 2 * self.margin, width + 2 * self.margin, channels

    def texels(self, rows: Integers, columns: Integers) -> Floats:
        """Read texels (R, K, C), see `TexelReader`."""
        height, width, _ = self.reader.shape
        rows, columns = rows - self.margin, columns - self.margin
        return self.reader.texels(np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1))


class Run(NamedTuple):
    """Consecutive blocks, and the texels that they read: first and last + 1 of each axis."""

    blocks: slice
    across: tuple[int, int]
    down: tuple[int, int]


def can_be_projected_partly(
    source_shape: tuple[int, int, int], geometry: Homography, shape: tuple[int, int], edge: Edge,
    cells: CellGrid,
) -> bool:  # fmt: skip
    """Whether all blocks of a source (height, width, channels) read few enough texels."""
    margin = margin_of(edge, cells.interpolation)
    height, width = source_shape[0] + 2 * margin, source_shape[1] + 2 * margin
    axes = blocks_of(moved(geometry, margin), (height, width), shape, edge, cells).axes
    if needs_totals(axes, (height, width), edge):
        return False
    reach = cells.taps_reach
    across, down = (_read(axes[:, n], (width, height)[n], edge, reach) for n in (0, 1))
    values = np.ptp(across, axis=1) * np.ptp(down, axis=1) * source_shape[2]
    large = np.flatnonzero(values > MOST_OF_BLOCK * MOST_VALUES)
    return all(_is_joinable(axes[n], (height, width)) for n in large)


def _is_joinable(block: Integers, size: tuple[int, int]) -> bool:
    """Whether a block lies within a source (height, width) and sums rows first."""
    start, end = block[:, START], block[:, START] + block[:, LENGTH]
    is_inside = bool((start >= 0).all() and end[0] <= size[1] and end[1] <= size[0])
    return is_inside and block[0, CUT] == block[1, CUT] == 1 and block[1, LEVEL] > 0


def project_partly(
    reader: TexelReader,
    geometry: Homography,
    shape: tuple[int, int],
    edge: Edge,
    cells: CellGrid,
    wanted: Bounds,
) -> Warped:
    """Project a source whose texels are read on demand, as `forward.project` does.

    `can_be_projected_partly` must be true.
    """
    margin = margin_of(edge, cells.interpolation)
    source: TexelReader = Widened(reader, margin) if margin else reader
    geometry = moved(geometry, margin) if margin else geometry
    height, width, channels = source.shape
    sums = sums_of(wanted, channels, cells)
    blocks = meeting(blocks_of(geometry, (height, width), shape, edge, cells), wanted)
    for run in _runs(blocks.axes, source.shape, edge, sums.taps.shape[0] // 2):
        some = blocks._replace(axes=blocks.axes[run.blocks], bounds=blocks.bounds[run.blocks])
        _add(sums, source, some, run, edge)
    return sums.warped(*borders(geometry, (height, width), edge))


def _add(sums: PointSums, source: TexelReader, blocks: SourceBlocks, run: Run, edge: Edge) -> None:
    """Add the blocks of a run to the sums."""
    height, width, channels = source.shape
    kinds, interpolation = kinds_of(blocks.axes), sums.cells.interpolation
    values = (run.across[1] - run.across[0]) * (run.down[1] - run.down[0]) * channels
    if values > MOST_VALUES and _is_joinable(blocks.axes[0], (height, width)):
        step = 1 << int(blocks.axes[0, 1, LEVEL])
        ready = _joined_rows(source, run, step)
        held = Texels(ready, ready, ready, ready)
        extract = Extract(height, width, run.down[0], run.across[0], step)
    else:
        held = _texels(source, run, kinds, interpolation, edge)
        extract = Extract(height, width, run.down[0], run.across[0])
    sums.paint(held, extract, NO_TOTALS, blocks, edge)


def _joined_rows(source: TexelReader, run: Run, step: int) -> Floats:
    """Sum every `step` rows of a part of a source, read strip by strip."""
    columns, channels = np.arange(*run.across), source.shape[2]
    several = max(1, MOST_VALUES // (columns.size * channels * step)) * step
    joined = []
    for first in range(*run.down, several):
        rows = source.texels(np.arange(first, min(first + several, run.down[1])), columns)
        total = rows[::step].copy()
        for n in range(1, step):
            total += rows[n::step]
        joined.append(total)
    return np.concatenate(joined)


def _texels(
    source: TexelReader, run: Run, kinds: frozenset[int], interpolation: Interpolation, edge: Edge
) -> Texels:
    """Return a part of a source, prefiltered as `forward.texels` does for the whole."""
    weights = prefilter(interpolation)
    filters = (ONE, ONE), (weights, ONE), (ONE, weights), (weights, weights)
    needed = {kind if prefilter(interpolation).size > 1 else 0 for kind in kinds}
    made = {n: _coefficients(source, run.across, run.down, filters[n], edge) for n in needed}
    some = next(iter(made.values()))
    plain = made.get(0, some)
    return Texels(*(made.get(kind, plain) for kind in range(4)))


def _coefficients(
    source: TexelReader,
    across: tuple[int, int],
    down: tuple[int, int],
    filters: tuple[Floats, Floats],
    edge: Edge,
) -> Floats:
    """Apply a separable filter to a part of a source (H, W, C); see `plates.filtered`."""
    along_u, along_v = filters
    left, above = along_u.size // 2, along_v.size // 2
    height, width, channels = source.shape
    rows = texels_at(np.arange(down[0] - above, down[1] + above), height, edge)
    columns = texels_at(np.arange(across[0] - left, across[1] + left), width, edge)
    texels = source.texels(rows, columns)
    if left == above == 0:
        return np.ascontiguousarray(texels)
    flat = np.concatenate([texels.ravel(), np.zeros(SPARE, np.float32)])
    made = np.empty((down[1] - down[0], across[1] - across[0], channels), np.float32)
    filter_plate(flat, texels.shape, Filters(along_u, along_v), channels, made.reshape(-1))
    return made


def _runs(
    axes: Integers, source_shape: tuple[int, int, int], edge: Edge, reach: int
) -> Iterator[Run]:
    """Yield runs of consecutive blocks that read few enough texels together."""
    across, down = (_read(axes[:, n], source_shape[1 - n], edge, reach) for n in (0, 1))
    most = MOST_VALUES // source_shape[2]
    first, sides = 0, None
    for n, (columns, rows) in enumerate(zip(across.tolist(), down.tolist(), strict=True)):
        here = *columns, *rows
        both = here if sides is None else _around(sides, here)
        if sides is not None and (both[1] - both[0]) * (both[3] - both[2]) > most:
            yield Run(slice(first, n), sides[:2], sides[2:])
            first, both = n, here
        sides = both
    if sides is not None:
        yield Run(slice(first, len(axes)), sides[:2], sides[2:])


def _around(one: Bounds, other: Bounds) -> Bounds:
    """Return the bounds around two bounds."""
    return (
        min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), max(one[3], other[3]),
    )  # fmt: skip


def _read(axis: Integers, size: int, edge: Edge, reach: int) -> Integers:
    """Return the first and last + 1 texel (B, 2) that blocks read along an axis."""
    pad = reach * (axis[:, CUT] > 1) << axis[:, LEVEL]
    ends = np.stack([axis[:, START] - pad, axis[:, START] + axis[:, LENGTH] + pad], axis=1)
    for n in np.flatnonzero((ends[:, 0] < 0) | (ends[:, 1] > size)):
        first, last = ends[n]
        if last - first >= size:
            ends[n] = 0, size
        else:
            there = texels_at(np.arange(first, last), size, edge)
            ends[n] = there.min(), there.max() + 1
    return ends
