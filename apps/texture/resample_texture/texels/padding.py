"""Prepare a source for gathering: crop, continue beyond edges, prefilter."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.windows.boxes import FEW, SPARE, Plate
from resample.engine.windows.separable import Filters, filter_plate
from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Floats
from resample_texture.geometry import shifts
from resample_texture.types import Edge

Integers = NDArray[np.int64]
Range = tuple[int, int]  # first texel and last + 1


def texels_at(index: Integers, size: int, edge: Edge) -> Integers:
    """Return the texels that filters read at indices within and beyond the source."""
    continued = Edge.MIRROR if edge is Edge.TRANSPARENT else edge
    return shifts.texels_at(index, size, continued)[0]


class SourcePart(NamedTuple):
    """A source, or a part of one."""

    texels: Floats  # (H, W, C)
    size: tuple[int, int]  # of the whole source: height, width
    first: tuple[int, int] = (0, 0)  # column and row at which the part begins


class Sides(NamedTuple):
    """A rectangle of the continued plane of a source."""

    across: Range
    down: Range

    def wider(self, margin: int) -> "Sides":
        """Return the rectangle with a margin on each side."""
        (left, right), (top, bottom) = self
        return Sides((left - margin, right + margin), (top - margin, bottom + margin))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.down[1] - self.down[0], self.across[1] - self.across[0]

    def plate(self, flat: Floats, part: "Sides", channels: int) -> Plate:
        """Return a plate of the rectangle, of which only a part is stored."""
        (left, _), (top, _) = self
        columns = part.shape[1]
        before = ((part.down[0] - top) * columns + part.across[0] - left) * channels
        return Plate(flat, float(left), float(top), *self.shape, channels, columns, before)


def plates_of(
    source: SourcePart, whole: Sides, part: Sides, edge: Edge, interpolation: Interpolation
) -> tuple[Plate, Plate]:
    """Return coefficients and texels of a rectangle of a source's continued plane.

    Coefficients of two to four channels have four numbers. Only a part of the whole rectangle is
    stored. If coefficients differ from texels, the texels have a margin.
    """
    weights, channels = prefilter(interpolation), source.texels.shape[2]
    lanes, margin = 4 if 2 <= channels <= 4 else channels, weights.size // 2
    outer = part.wider(margin)
    flat = _continued(source, outer, edge, FEW - 1)
    plain = whole.wider(margin).plate(flat, outer, channels)
    if margin == 0 and lanes == channels:
        return plain, plain
    smooth = _empty_flat(part.shape, lanes, FEW - 1)
    filter_plate(flat, (*outer.shape, channels), Filters(weights, weights), lanes, smooth)
    return whole.plate(smooth, part, lanes), plain


def _empty_flat(shape: tuple[int, int], channels: int, rows: int) -> Floats:
    """Space for the numbers of a rectangle, and zeros that are read beyond its last texel.

    `rows`: how many rows may be read beyond the last.
    """
    height, width = max(shape[0], 0), max(shape[1], 0)
    count, spare = height * width * channels, (SPARE + rows * width) * channels
    flat = np.empty(count + spare, np.float32)
    flat[count:] = 0.0
    return flat


def filtered(source: Floats, along_u: Floats, along_v: Floats, edge: Edge) -> Floats:
    """Apply a separable filter to a source (H, W, C), continued beyond its edges by `edge`."""
    height, width, channels = source.shape
    whole = SourcePart(source, (height, width)), Sides((0, width), (0, height))
    return filtered_grid(*whole, edge, along_u, along_v).reshape(height, width, channels)


def filtered_grid(
    source: SourcePart, sides: Sides, edge: Edge, along_u: Floats, along_v: Floats
) -> Floats:
    """Return a rectangle of a source's continued plane, filtered, row by row."""
    height, width, channels = source.texels.shape
    left, above = along_u.size // 2, along_v.size // 2
    is_whole = source.first == (0, 0) and sides == Sides((0, width), (0, height))
    if is_whole and left == above == 0:
        return source.texels.reshape(-1)
    (first, last), (top, bottom) = sides
    outer = Sides((first - left, last + left), (top - above, bottom + above))
    flat = _continued(source, outer, edge)
    if left == above == 0:
        return flat
    result = np.empty(sides.shape[0] * sides.shape[1] * channels, np.float32)
    filter_plate(flat, (*outer.shape, channels), Filters(along_u, along_v), channels, result)
    return result


def _continued(source: SourcePart, sides: Sides, edge: Edge, spare: int = 0) -> Floats:
    """Return the texels of a rectangle of the continued plane, row by row, with rows to spare.

    Texels outside the stored part are never shown; they copy the nearest one.
    """
    height, width, channels = source.texels.shape
    rows = texels_at(np.arange(*sides.down), source.size[0], edge) - source.first[1]
    columns = texels_at(np.arange(*sides.across), source.size[1], edge) - source.first[0]
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    flat = _empty_flat((rows.size, columns.size), channels, spare)
    if not (rows.size and columns.size):  # nothing of it is shown
        return flat
    count = rows.size * columns.size * channels
    plane = flat[:count].reshape(rows.size, columns.size, channels)
    # Copy what is stored as it is, and texel by texel what continues it.
    down, across = _straight(rows), _straight(columns)
    plane[down, across] = source.texels[_of(rows, down), _of(columns, across)]
    for part in (slice(0, down.start), slice(down.stop, rows.size)):
        plane[part] = source.texels[rows[part]][:, columns]
    for part in (slice(0, across.start), slice(across.stop, columns.size)):
        plane[down, part] = source.texels[_of(rows, down)][:, columns[part]]
    return flat


def _straight(index: Integers) -> slice:
    """Return the longest run of indices that count up by one."""
    ends = np.flatnonzero(np.diff(index) != 1) + 1
    starts = np.concatenate([[0], ends])
    count = np.diff(np.concatenate([starts, [index.size]]))
    first = int(starts[count.argmax()])
    return slice(first, first + int(count.max()))


def _of(index: Integers, part: slice) -> slice:
    """Return the texels of a run of indices."""
    return slice(int(index[part.start]), int(index[part.stop - 1]) + 1)
