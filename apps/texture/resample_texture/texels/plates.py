"""A source as pixels read it: the part they see and what continues it, filtered for them."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.windows.boxes import SPARE, Plate
from resample.engine.windows.filtering import Filters, filter_plate, gather_plate
from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Floats
from resample_texture.geometry import shifts
from resample_texture.types import Edge

Integers = NDArray[np.int64]
Range = tuple[int, int]  # first texel and last + 1


def texels_at(index: Integers, size: int, edge: Edge) -> Integers:
    """Texels that stand at indices within and beyond the source's edges, as filters read them."""
    continued = Edge.MIRROR if edge is Edge.TRANSPARENT else edge
    return shifts.texels_at(index, size, continued)[0]


def plates_of(
    source: Floats, across: Range, down: Range, edge: Edge, interpolation: Interpolation
) -> tuple[Plate, Plate]:
    """Coefficients of a rectangle of the continued plane of a source (H, W, C), and its texels.

    Texels have a margin around them, if not all of them are coefficients.
    """
    weights = prefilter(interpolation)
    margin = weights.size // 2
    channels = source.shape[2]
    outer = (across[0] - margin, across[1] + margin), (down[0] - margin, down[1] + margin)
    flat = _continued(source, *outer, edge)
    rows, columns = down[1] - down[0], across[1] - across[0]
    shape = rows + 2 * margin, columns + 2 * margin, channels
    plain = Plate(flat, float(outer[0][0]), float(outer[1][0]), *shape)
    if margin == 0:
        return plain, plain
    smooth = np.empty(rows * columns * channels + SPARE, np.float32)
    filter_plate(flat, shape, Filters(weights, weights), smooth)
    smooth[-SPARE:] = 0.0
    return Plate(smooth, float(across[0]), float(down[0]), rows, columns, channels), plain


def filtered(source: Floats, along_u: Floats, along_v: Floats, edge: Edge) -> Floats:
    """Source (H, W, C) under a separable filter, continued beyond its edges as `edge` says."""
    height, width, channels = source.shape
    left, above = along_u.size // 2, along_v.size // 2
    flat = _continued(source, (-left, width + left), (-above, height + above), edge)
    result = np.empty(source.shape, np.float32)
    shape = height + 2 * above, width + 2 * left, channels
    filter_plate(flat, shape, Filters(along_u, along_v), result.reshape(-1))
    return result


def _continued(source: Floats, across: Range, down: Range, edge: Edge) -> Floats:
    """Numbers of a rectangle of the continued plane, row by row, and some to spare."""
    height, width, channels = source.shape
    rows = texels_at(np.arange(*down), height, edge)
    columns = texels_at(np.arange(*across), width, edge)
    flat = np.empty(rows.size * columns.size * channels + SPARE, np.float32)
    flat[-SPARE:] = 0.0
    gather_plate(source, rows, columns, flat)
    return flat
