"""Blocks of texels as parts of a source, painted by the engine's loop over parts."""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import Batch, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel
from resample.engine.roles import plays
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import CUT, Integers
from resample_texture.texels.kernels.placing import TexelMapping, place
from resample_texture.texels.kernels.texels import (
    Extract,
    cell_offsets,
    extents,
    fetch,
    filter_row,
    filter_rows,
    kind_of,
    line_at,
    line_count,
    parts_along,
    texels_along,
)


class Texels(NamedTuple):
    """A source, ready to be interpolated along u, along v or both."""

    plain: Floats  # (H, W, C)
    along_u: Floats
    along_v: Floats
    both: Floats


class Texture(NamedTuple):
    """A source in blocks."""

    texels: Texels
    extract: Extract
    totals: Doubles  # (K, H + 1, W + 1, C) sums of texels, see `fetch`
    edge: int
    channels: tuple[int, int]  # first of them and how many: 1 or 3
    taps: Floats  # (K, R) of the interpolation; see `kernels.texels`
    axes: Integers  # (B, 2, 6) blocks
    geometry: TexelMapping


class CellRows(NamedTuple):
    """Scratch for the rows of a block's cells."""

    batch: Batch
    offset: Floats  # (N,) of the cells, see `cell_offsets`
    patch: Floats  # (channels, rows, columns) of texels
    line: Floats  # (channels, columns)


@kernel
def _chosen(block: Integers, texels: Texels) -> Floats:
    """Texels to interpolate between: prefiltered along the axes that are cut."""
    kind = kind_of(block)
    if kind > 1:
        return texels.both if kind == 3 else texels.along_v
    return texels.along_u if kind == 1 else texels.plain


@inner_kernel
def _as_densities(batch: Batch, count: int, texels: float) -> None:
    """Turn totals per texel into densities, values per px²."""
    mass, values = batch.mass, batch.values
    for n in range(count):
        density = np.float32(texels) / mass[n] if mass[n] > np.float32(0) else np.float32(0)
        for c in range(values.shape[0]):
            values[c, n] *= density


@plays(begun, Texture)
def _begun(source: Texture, part: int) -> CellRows:
    """Fetch the texels of a block, and allocate scratch for its rows."""
    # Size the patch: the block's texels, padded along the axes that are interpolated.
    block, (first, count) = source.axes[part], source.channels
    reach = source.taps.shape[0] // 2
    pad = reach * (block[0, CUT] > 1), reach * (block[1, CUT] > 1)
    rows, columns = texels_along(block, 1) + 2 * pad[1], texels_along(block, 0) + 2 * pad[0]
    patch = np.empty((count, rows, columns), np.float32)
    # Fetch the texels, prefiltered as the interpolation needs them.
    chosen = _chosen(block, source.texels)
    fetch(chosen, source.extract, source.totals, block, pad, source.edge, patch, first)
    # Allocate the batch for one row of cells.
    offset = cell_offsets(block)
    line = np.empty((count, columns), np.float32)
    return CellRows(new_batch(count, offset.size), offset, patch, line)


@plays(lines, Texture)
def _lines(source: Texture, part: int) -> int:
    """Count the rows of cells of a block."""
    return line_count(source.axes[part])


@plays(fill, Texture)
def _fill(
    source: Texture, part: int, line: int, box: Integers, spread: FilterTaps, work: CellRows
) -> int:
    """Fill the batch with one row of cells; count them."""
    block, batch, offset = source.axes[part], work.batch, work.offset
    # Interpolate the values, first along v, then along u.
    row, cell, v = line_at(block, line)
    filter_rows(work.patch, row, cell, block[1, CUT], source.taps, work.line)
    filter_row(work.line, block, parts_along(block, 0), source.taps, batch.values)
    # Place the cells on screen.
    place(source.geometry, block, box, v, offset, spread.taps, batch)
    # Spread totals as densities over the area that each cell covers.
    if spread.is_sum:
        (size_u, _), (size_v, _) = extents(block, 0), extents(block, 1)
        _as_densities(batch, offset.size, size_u * size_v)
    return int(offset.size)


@parallel_kernel
def paint_blocks(counter: Counter, source: Texture, spread: FilterTaps, parts: SourceParts) -> None:
    """Paint every block to pixels of its own."""
    paint_parts(counter, source, spread, parts)
