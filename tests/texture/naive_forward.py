"""The obvious slow way to project a texture, in float64, one cell and one pixel at a time.

Only how a source is split is taken from the real thing, see `blocks_of`; it says which cells there
are. Where they fall, what they are worth and which pixels they reach is worked out here.
"""

import math
from itertools import product

import numpy as np

from resample.profiles.filters import Area
from resample.profiles.interpolation import prefilter
from resample_texture.geometry.mappings import Homography
from resample_texture.texels.forward import blocks_of, moved, widened
from resample_texture.types import Edge


def projected(source, geometry, shape, edge, cells):
    """Image (h, w, C) and coverage (h, w) of a source (H, W, C)."""
    if isinstance(geometry, Homography):  # its cells are those of a source with a margin
        source, margin = widened(source, edge, cells.interpolation)
        geometry = moved(geometry, margin)
    height, width, channels = source.shape
    sums = np.zeros((*shape, channels + 1))
    place = placed_on_plane(geometry, (height, width))
    if not isinstance(geometry, Homography):
        place = placed_on_map(geometry.x, geometry.y)
    for block in blocks_of(geometry, (height, width), shape, edge, cells).axes:
        columns = cells_along(block[0], width, edge, cells.interpolation)
        rows = cells_along(block[1], height, edge, cells.interpolation)
        for (u, size_u, weight_u), (v, size_v, weight_v) in product(columns, rows):
            x, y, side_u, side_v = place(u, v)
            mass = size_u * size_v * abs(side_u[0] * side_v[1] - side_u[1] * side_v[0])
            value = np.einsum("v,vuc,u->c", weight_v, source, weight_u)
            if cells.is_sum and mass > 0:
                value = value * size_u * size_v / mass
            across = math.hypot(side_u[0] * size_u, side_v[0] * size_v)
            down = math.hypot(side_u[1] * size_u, side_v[1] * size_v)
            share_y = pixel_shares(y, down, shape[0], cells.pixel_filter)
            share_x = pixel_shares(x, across, shape[1], cells.pixel_filter)
            for row, column in product(share_y, share_x):
                weight = mass * share_y[row] * share_x[column]
                sums[row, column] += weight * np.append(value, 1.0)
    return finished(sums, geometry, (height, width), edge, cells)


def placed_on_plane(geometry, source_shape):
    """Function that gives a source point's place and how far one texel along u and v reaches."""

    def place(u, v):
        matrix = geometry.normalized(source_shape)
        x, y, d = matrix @ [u, v, 1.0]
        x, y = x / d, y / d
        steps = [
            ((matrix[0, n] - x * matrix[2, n]) / d, (matrix[1, n] - y * matrix[2, n]) / d)
            for n in range(2)
        ]
        return x, y, *steps

    return place


def placed_on_map(map_x, map_y):
    """As `placed_on_plane`: straight from texel to texel, and on beyond the last ones."""
    height, width = map_x.shape
    step = 1e-6  # texels; across a texel's center, where the slope jumps, its mean is meant

    def at(u, v):
        column = min(max(math.floor(u - 0.5), 0), width - 2)
        row = min(max(math.floor(v - 0.5), 0), height - 2)
        a, b = u - 0.5 - column, v - 0.5 - row
        (p, q), (r, s) = (
            [np.array([m[k] for m in (map_x, map_y)]) for k in ((line, column), (line, column + 1))]
            for line in (row, row + 1)
        )
        return (1 - b) * ((1 - a) * p + a * q) + b * ((1 - a) * r + a * s)

    def place(u, v):
        along_u = (at(u + step, v) - at(u - step, v)) / (2 * step)
        along_v = (at(u, v + step) - at(u, v - step)) / (2 * step)
        return *at(u, v), along_u, along_v

    return place


def cells_along(axis, size, edge, interpolation):
    """Center, length and weights (size,) of the texels of each cell along an axis of a block."""
    start, length, cut, first, last, level = (int(n) for n in axis)
    if cut == 1:
        joined = 2**level
        for cell in range(start, start + length, joined):
            weight = np.zeros(size)
            for texel in range(cell, cell + joined):
                weight[settled(texel, size, edge)] += 1.0 / joined
            yield cell + 0.5 * joined, float(joined), weight
        return
    for part in range(first, last):
        at = start + (part + 0.5) / cut
        yield at, 1.0 / cut, interpolated(at, size, edge, interpolation, 1.0 / cut)


def interpolated(at, size, edge, interpolation, extent=0.0):
    """Weights (size,) of texels whose sum is the value at a place, or its mean around it.

    The mean over an extent is what interpolations of means are asked for.
    """
    reach = math.ceil(interpolation.radius)
    kernel = {}
    if not getattr(interpolation, "is_mean", False):
        extent = 0.0
    around = at + extent * ((np.arange(500) + 0.5) / 500 - 0.5)
    for texel in range(math.floor(at) - reach, math.floor(at) + reach + 1):
        distance = np.abs(around - texel - 0.5)
        value = np.where(distance <= interpolation.radius, interpolation(distance), 0.0)
        if (distance <= interpolation.radius).any():
            kernel[texel] = value.mean()
    filters = prefilter(interpolation).astype(float)
    weight = np.zeros(size)
    for texel, (k, share) in product(kernel, enumerate(filters)):
        weight[settled(texel + k - filters.size // 2, size, edge)] += share * kernel[texel]
    return weight / sum(kernel.values())


def settled(index, size, edge):
    """Texel that stands at an index; past a transparent edge that of the mirror image."""
    if edge is Edge.CLAMP:
        return min(max(index, 0), size - 1)
    if edge is Edge.WRAP:
        return index % size
    index %= 2 * size
    return min(index, 2 * size - 1 - index)


def pixel_shares(at, extent, size, pixel_filter):
    """Weights of pixels along an axis of the frame, by their number."""
    if isinstance(pixel_filter, Area):
        extent = min(max(extent, 1e-5), 1.0)
        low, high = at - 0.5 * extent, at + 0.5 * extent
        pixels = range(max(math.floor(low), 0), min(math.ceil(high), size))
        return {n: max(min(high, n + 1) - max(low, n), 0.0) / extent for n in pixels}
    radius = pixel_filter.radius
    reach = math.ceil(radius) + 1
    weight = {}
    for n in range(math.floor(at) - reach, math.floor(at) + reach + 1):
        distance = abs(n + 0.5 - at)
        if distance < radius:
            weight[n] = float(pixel_filter(np.array([distance]))[0])
    total = sum(weight.values())
    return {n: w / total for n, w in weight.items() if 0 <= n < size}


def finished(sums, geometry, source_shape, edge, cells):
    """Image and coverage: where the source fills a pixel, the mean."""
    image, coverage = np.zeros((*sums.shape[:2], sums.shape[2] - 1)), np.zeros(sums.shape[:2])
    for row, column in np.ndindex(*coverage.shape):
        weight = sums[row, column, -1]
        filled = weight > 0.97
        if isinstance(geometry, Homography):
            radius = cells.pixel_filter.radius
            corners = product((column + 0.5 - radius, column + 0.5 + radius),
                              (row + 0.5 - radius, row + 0.5 + radius))  # fmt: skip
            filled = all(shows(geometry, source_shape, edge, *corner) for corner in corners)
        filled = filled and weight > 0
        coverage[row, column] = 1.0 if filled else min(max(weight, 0.0), 1.0)
        divided = (filled or weight > 1) and not cells.is_sum
        image[row, column] = sums[row, column, :-1] / (weight if divided else 1.0)
    return image, coverage


def shows(geometry, source_shape, edge, x, y):
    """Whether a point of the screen sees the source, or what continues it."""
    u, v, front = np.linalg.inv(geometry.normalized(source_shape)) @ [x, y, 1.0]
    if front <= 0:
        return False
    inside = 0 < u < source_shape[1] * front and 0 < v < source_shape[0] * front
    return inside or edge is not Edge.TRANSPARENT
