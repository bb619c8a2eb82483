"""Warp sources larger than memory, whose rows are read in strips."""

from collections.abc import Iterable, Iterator

import numpy as np

from resample.profiles.interpolation import prefilter
from resample.types import Floats
from resample_texture.geometry.mappings import Homography
from resample_texture.texels.forward import (
    CellGrid,
    PointSums,
    SourceBlocks,
    borders,
    oriented,
    split,
)
from resample_texture.types import Edge, Warped

STRIP = 256  # rows of a source projected at a time
NOTHING = np.zeros((0, 0))


def warp_rows(
    rows: Iterable[Floats],
    source_shape: tuple[int, int, int],
    geometry: Homography,
    shape: tuple[int, int],
    cells: CellGrid | None = None,
) -> Warped:
    """Warp a source whose rows come in order, keeping a few hundred rows at a time.

    Parameters
    ----------
    rows
        Strips (h, W, C) of the source from the top, of any heights; float32, linear light,
        premultiplied, as `resample.files.images.read_rows` yields them.
    source_shape
        Height, width and channels of the whole source.
    geometry
        Homography from source to target.
    shape
        Height and width of the target, px.
    cells
        How texels are projected.

    Returns
    -------
    The same as warping the whole source with a transparent edge, up to rounding.

    Raises
    ------
    ValueError
        The strips do not make up the source.
    """
    cells = cells or CellGrid()
    height, width, channels = source_shape
    matrix = oriented(geometry, (height, width))
    sums = PointSums(shape, channels, cells)
    margin = cells.taps_reach + prefilter(cells.interpolation).size // 2
    for first, last, start, strip in _with_context(rows, source_shape, margin):
        down = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, start], [0.0, 0.0, 1.0]])
        moved = np.ascontiguousarray(matrix @ down)
        roots = np.array([[0, first - start, width, last - first]])
        axes, bounds = split(moved, roots, shape, cells)
        sums.add(strip, SourceBlocks(axes, bounds, moved, NOTHING, NOTHING), Edge.TRANSPARENT)
    return sums.warped(*borders(geometry, (height, width), Edge.TRANSPARENT))


def _with_context(
    rows: Iterable[Floats], source_shape: tuple[int, int, int], margin: int
) -> Iterator[tuple[int, int, int, Floats]]:
    """Yield rows to project, `first` to `last`, with a strip that begins at row `start`.

    A strip holds up to `margin` more rows on both sides.
    """
    height = source_shape[0]
    held = np.empty((0, *source_shape[1:]), np.float32)
    start = done = arrived = 0
    for strip in rows:
        if strip.shape[1:] != source_shape[1:] or arrived + len(strip) > height:
            raise ValueError(f"a strip of {strip.shape} at row {arrived} of {source_shape}")
        held = np.concatenate([held, strip.astype(np.float32, copy=False)])
        arrived += len(strip)
        # Only whole strips, so that rows are summed in the same groups as for the whole source.
        last = arrived if arrived == height else max(0, arrived - margin) // STRIP * STRIP
        if last > done:
            yield done, last, start, held
            done = last
            kept = max(0, done - margin - start)
            held, start = held[kept:], start + kept
    if arrived != height:
        raise ValueError(f"only {arrived} of {height} rows came")
