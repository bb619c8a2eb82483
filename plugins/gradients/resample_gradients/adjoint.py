"""Exact adjoint of forward projection: from gradients of pixels to gradients of texels.

With A the linear map from texels to the picture of `forward.project`, this is its transpose, so
that the backward pass of an optimization uses exactly the weights of the forward pass.
"""

from collections.abc import Iterator

import numpy as np

from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Doubles, Floats
from resample_gradients.kernels.adjoint import gather_blocks, patch_offsets, scatter_texels
from resample_texture.geometry.mappings import Geometry, Homography
from resample_texture.texels.forward import (
    EDGES,
    CellGrid,
    PointSums,
    SourceBlocks,
    blocks_of,
    borders,
    moved,
    needs_totals,
    spread_of,
    tap_table,
    texels_at,
    widened,
)
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.types import Edge

BATCH = 1 << 24  # most numbers in the patches of a batch


def adjoint(
    gradient: Floats, geometry: Geometry, source_shape: tuple[int, int], edge: Edge, cells: CellGrid
) -> Floats:
    """Return the gradient (H, W, C) by texels, given the one by the pixels of `project`.

    Parameters
    ----------
    gradient
        (height, width, C) derivatives by the image's pixels. Coverage does not depend on texels.
    geometry, edge, cells
        As `forward.project` takes them.
    source_shape
        Height and width of the source, texels.

    Raises
    ------
    ValueError
        The gradient is not (height, width, C), or as `forward.blocks_of` does.
    """
    if gradient.ndim != 3 or gradient.size == 0:
        raise ValueError(f"a gradient has the shape (height, width, C), not {gradient.shape}")
    margin = 0
    if isinstance(geometry, Homography):
        texels, margin = widened(
            np.zeros((*source_shape, 1), np.float32), edge, cells.interpolation
        )
        geometry = moved(geometry, margin) if margin else geometry
        source_shape = texels.shape[0], texels.shape[1]
    else:
        edge = Edge.TRANSPARENT  # as `project` does
    shape = gradient.shape[0], gradient.shape[1]
    blocks = blocks_of(geometry, source_shape, shape, edge, cells)
    factor = factors(blocks, geometry, source_shape, shape, edge, cells)
    weighted = np.ascontiguousarray(gradient * factor[..., None], np.float32)
    parts = _texel_gradients(weighted, blocks, source_shape, edge, cells)
    whole = _unprefiltered(parts, cells.interpolation, edge)
    return _folded(_folded(whole, margin, 0, edge), margin, 1, edge).astype(np.float32)


def factors(
    blocks: SourceBlocks,
    geometry: Geometry,
    source_shape: tuple[int, int],
    shape: tuple[int, int],
    edge: Edge,
    cells: CellGrid,
) -> Floats:
    """Return the factor (height, width) by which `project` multiplies each pixel's sums."""
    sums = PointSums(shape, 1, cells)
    sums.add(np.zeros((*source_shape, 1), np.float32), blocks, edge)
    for picture in sums.pictures:
        picture[..., 0] = 1.0
    return sums.warped(*borders(geometry, source_shape, edge)).image[..., 0]


def _texel_gradients(
    weighted: Floats,
    blocks: SourceBlocks,
    source_shape: tuple[int, int],
    edge: Edge,
    cells: CellGrid,
) -> Doubles:
    """Return gradients (K, H, W, C) by texels, for each kind of prefilter."""
    channels = weighted.shape[2]
    taps = tap_table(cells.interpolation)
    kinds = 1 if prefilter(cells.interpolation).size == 1 else 4
    texels = np.zeros((kinds, *source_shape, channels))
    height, width = source_shape
    sums = min(kinds, 3) if needs_totals(blocks.axes, source_shape, edge) else 0
    totals = np.zeros((sums, height + 1, width + 1, channels))
    spread = spread_of(cells)
    for batch in _batches(blocks.axes, taps.shape[0], channels):
        axes = blocks.axes[batch]
        start = patch_offsets(axes, taps.shape[0], channels)
        patches = np.empty(start[-1])
        bounds = blocks.bounds[batch]
        gather_blocks(weighted, blocks.places, axes, bounds, taps, spread, (start, patches))
        scatter_texels(patches, start, axes, EDGES[edge], taps.shape[0], totals, texels)
    for kind in range(sums):
        texels[kind] += _summed_back(totals[kind])
    return texels


def _summed_back(totals: Doubles) -> Doubles:
    """Apply the transpose of `forward._totals` for one kind."""
    backward = totals[::-1, ::-1].cumsum(axis=0).cumsum(axis=1)
    return np.asarray(backward[::-1, ::-1][1:, 1:])


def _batches(axes: Integers, taps: int, channels: int) -> Iterator[slice]:
    """Yield groups of consecutive blocks with patches that fit into memory together."""
    start = patch_offsets(axes, taps, channels)
    first = 0
    while first < len(axes):
        last = int(np.searchsorted(start, start[first] + BATCH, side="right")) - 1
        last = min(max(last, first + 1), len(axes))
        yield slice(first, last)
        first = last


def _unprefiltered(texels: Doubles, interpolation: Interpolation, edge: Edge) -> Doubles:
    """Apply the transpose of `forward.texels`: return the source's gradient (H, W, C)."""
    if len(texels) == 1:
        return np.asarray(texels[0])
    weights = prefilter(interpolation).astype(np.float64)
    plain, along_u, along_v, both = texels
    along_u = along_u + _filtered_back(both, weights, 0, edge)
    along_v = _filtered_back(along_v, weights, 0, edge)
    return np.asarray(plain + _filtered_back(along_u, weights, 1, edge) + along_v)


def _filtered_back(gradient: Doubles, weights: Doubles, axis: int, edge: Edge) -> Doubles:
    """Apply the transpose of `plates.filtered` along one axis of (H, W, C)."""
    lines = np.moveaxis(gradient, axis, 0)
    size = len(lines)
    spread = np.zeros((size + weights.size - 1, *lines.shape[1:]))
    for k, weight in enumerate(weights):
        spread[k : k + size] += weight * lines
    return _folded(np.moveaxis(spread, 0, axis), weights.size // 2, axis, edge)


def _folded(gradient: Doubles, margin: int, axis: int, edge: Edge) -> Doubles:
    """Remove the margins of an axis, adding their gradients to the texels they copy.

    These are the texels that the edge mode puts there.
    """
    if margin == 0:
        return gradient
    lines = np.moveaxis(gradient, axis, 0)
    size = len(lines) - 2 * margin
    result = lines[margin : margin + size].copy()
    index = np.arange(-margin, size + margin)
    beyond = (index < 0) | (index >= size)
    np.add.at(result, texels_at(index[beyond], size, edge), lines[beyond])
    return np.moveaxis(result, 0, axis)
