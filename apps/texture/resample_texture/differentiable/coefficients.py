"""Interpolation coefficients of a picture in float64, and the transposed operation."""

import math
from typing import Any

import numpy as np

from resample.profiles.interpolation import Interpolation, prefilter
from resample.types import Doubles
from resample_texture.arguments import REFLECT_101
from resample_texture.texels.plates import texels_at
from resample_texture.types import Edge


def ring_of(interpolation: Interpolation, edge: str) -> int:
    """Return the number of texels beyond a clamped edge after which values are constant."""
    reach = prefilter(interpolation).size // 2 + math.ceil(interpolation.radius) + 1
    return reach if edge == Edge.CLAMP else 0


def margin_of(interpolation: Interpolation, edge: str) -> int:
    """Return the margin of coefficients that interpolation in source and ring needs."""
    return ring_of(interpolation, edge) + math.ceil(interpolation.radius) + 1


def coefficients(image: Doubles, interpolation: Interpolation, edge: str) -> Doubles:
    """Return coefficients (rows, columns, C) of a picture (H, W, C), with a margin."""
    weights, margin = prefilter(interpolation).astype(np.float64), margin_of(interpolation, edge)
    reach = weights.size // 2
    for axis in (0, 1):
        index = _indices(image.shape[axis], margin + reach, edge)
        image = _filtered(image.take(index, axis), weights, axis)
        image = _inner(image, reach, axis)
    return np.ascontiguousarray(image)


def transposed(gradient: Doubles, interpolation: Interpolation, edge: str) -> Doubles:
    """Apply the transpose of `coefficients`: gradients by coefficients to those by texels."""
    weights, margin = prefilter(interpolation).astype(np.float64), margin_of(interpolation, edge)
    reach = weights.size // 2
    for axis in (1, 0):
        size = gradient.shape[axis] - 2 * margin
        sides = [(0, 0)] * 3
        sides[axis] = reach, reach
        spread = _filtered(np.pad(gradient, sides), weights, axis)
        lines = np.moveaxis(spread, axis, 0)
        around = margin + reach
        kept = lines[around : around + size].copy()
        index = _indices(size, around, edge)
        beyond = np.ones(index.size, bool)
        beyond[around : around + size] = False
        np.add.at(kept, index[beyond], lines[beyond])
        gradient = np.moveaxis(kept, 0, axis)
    return np.ascontiguousarray(gradient)


def _indices(size: int, margin: int, edge: str) -> Any:
    """Return the texel index at every position of an axis with margins on both sides."""
    index = np.arange(-margin, size + margin)
    if edge != REFLECT_101:
        return texels_at(index, size, Edge(edge))
    if size == 1:
        return np.zeros_like(index)
    index = index % (2 * size - 2)
    return np.minimum(index, 2 * size - 2 - index)


def _filtered(lines: Doubles, weights: Doubles, axis: int) -> Doubles:
    """Apply a symmetric filter along an axis, with zeros beyond the ends."""
    if weights.size == 1:
        return lines
    from scipy.ndimage import correlate1d

    return np.asarray(correlate1d(lines, weights, axis, mode="constant"))


def _inner(lines: Doubles, margin: int, axis: int) -> Doubles:
    """Remove a margin from both ends of an axis."""
    return np.moveaxis(np.moveaxis(lines, axis, 0)[margin : lines.shape[axis] - margin], 0, axis)
