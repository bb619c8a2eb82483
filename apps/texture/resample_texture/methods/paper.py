"""The paper's hybrid for textures (section 3): texels as records of `resample.hybrid`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resample.engine.jit import Counter, parallel_kernel, tasks
from resample.hybrid.blend import WeightedSum, mean_of
from resample.hybrid.classify import THRESHOLD, Widths, flat_sample, gaussian_widths
from resample.hybrid.paint import paint
from resample.hybrid.points import FILTER_SIGMA
from resample.hybrid.record import NOTHING, RECORD
from resample.hybrid.splats import FLAT_TABLES
from resample.messages import number
from resample.types import Doubles, Floats, Records
from resample_texture.geometry.mappings import ForwardMap, Geometry, Size
from resample_texture.geometry.regions import texels_at
from resample_texture.texels.forward import FARTHEST, check_texels, visible_polygon, with_margins
from resample_texture.texels.kernels.splats import slope
from resample_texture.texels.splatting import (
    Forward,
    borders_of_splats,
    check_deviations,
    forward_of,
    nearest_drawn,
    splat_view_bounds,
)
from resample_texture.types import Edge, Warped

MOST_AT_ONCE = 1 << 18  # texels with records in memory together


@dataclass(frozen=True)
class Paper:
    """The hybrid as published: points up to a threshold, Gaussian splats above it (section 3).

    Parameters
    ----------
    threshold
        Longest that a texel may be on screen to be a point, px.
    sigma
        Standard deviation of a splat, texels; it ends at three of them.
    filter_sigma
        Standard deviation of the pixel filter, px, at least 0.25; it ends at three of them, and no
        axis of a splat is shorter than that.
    total
        A texel's value is a total, such as a flux: sums are kept, not means.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Paper, warp
    >>> larger = warp(np.ones((8, 8)), np.diag([8, 8, 1]), (64, 64), method=Paper())
    >>> int((larger.coverage == 0).sum())  # splats leave no holes
    0
    >>> larger = warp(np.ones((8, 8)), np.diag([8, 8, 1]), (64, 64), method=Paper(threshold=9))
    >>> round(float((larger.coverage == 0).mean()), 2)  # points do
    0.94
    """

    threshold: float = THRESHOLD
    sigma: float = 0.45
    filter_sigma: float = FILTER_SIGMA
    total: bool = False

    def __post_init__(self) -> None:
        for name in ("threshold", "sigma", "filter_sigma"):
            if not 0.0 < number(name, getattr(self, name)) < math.inf:
                raise ValueError(f"{name} is a positive number, not {getattr(self, name)}")
        check_deviations(self.sigma, self.filter_sigma)

    @property
    def widths(self) -> Widths:
        """Sizes of footprints."""
        return gaussian_widths(self.threshold, self.sigma, self.filter_sigma)

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        size = source.shape[0], source.shape[1]
        geometry = forward_of(geometry, size)
        image, weight = np.zeros((*shape, source.shape[2]), np.float32), np.zeros(shape, np.float32)
        for color, records, area in _batches(source, geometry, shape, edge, self.widths):
            share = np.divide(1.0, area, out=np.zeros_like(area), where=area > 0.0)
            values = color * share[:, None] if self.total else color
            paint(records, FLAT_TABLES, WeightedSum(values, image, weight), shape)
        lines, full = borders_of_splats(geometry, size, edge, self.sigma, self.widths.kernel)
        # Pixels farther inside the lines than the filter reaches are full.
        column, row = np.arange(shape[1]) + 0.5, np.arange(shape[0])[:, None] + 0.5
        within = np.ones(shape, np.bool_)
        for a, b, c in lines:
            within &= a * column + b * row + c > self.widths.filter * (abs(a) + abs(b))
        is_full = (weight >= full) | within
        mean, coverage = mean_of(WeightedSum(image, image, weight), is_full)
        return Warped(image if self.total else mean, coverage)


def _batches(
    source: Floats, geometry: Forward, shape: Size, edge: Edge, widths: Widths
) -> Iterator[tuple[Floats, Records, Floats]]:
    """Colors (N, C), records and areas (N,), px², of some rows of texels after the other."""
    height, width = source.shape[:2]
    if isinstance(geometry, ForwardMap):
        (left, top), (right, bottom), matrix = (0, 0), (width, height), np.eye(3)
        x, y = with_margins(geometry.x, geometry.y)
    else:
        matrix, x, y = geometry.normalized((height, width)), np.zeros((0, 0)), np.zeros((0, 0))
        # Find the texels that a frame sees.
        lines = splat_view_bounds(matrix, shape, widths.filter, widths.kernel)
        polygon, ends = visible_polygon(lines, max(FARTHEST, height, width)), np.zeros((2, 2))
        if polygon.size:
            ends = np.stack([np.floor(polygon.min(axis=0)) - 1, np.ceil(polygon.max(axis=0)) + 1])
        if edge is Edge.TRANSPARENT:
            ends = np.clip(ends, 0, (width, height))
        elif polygon.size:
            check_texels(polygon, (height, width))
        (left, top), (right, bottom) = ends.astype(np.int64).tolist()
    places = (matrix, x, y, nearest_drawn(matrix, widths.kernel))
    step = max(1, MOST_AT_ONCE // max(1, right - left))
    across, _ = texels_at(np.arange(left, right), width, edge)
    for row in range(top, bottom, step):
        down = np.arange(row, min(row + step, bottom))
        records = np.zeros(down.size * across.size, RECORD)
        area = np.zeros(records.size, np.float32)
        place_texels(records, area, (left, row, across.size), places, widths, shape)
        texels = source[texels_at(down, height, edge)[0][:, None], across]
        yield texels.reshape(-1, source.shape[2]), records, area


@parallel_kernel
def place_texels(
    counter: Counter,
    records: Records,
    area: Floats,
    first: tuple[int, int, int],
    places: tuple[Doubles, Doubles, Doubles, float],
    widths: Widths,
    shape: Size,
) -> None:
    """Fill the records and areas (N,), px², of rows of texels, by a map if there is one."""
    (left, top, columns), (matrix, x, y, nearest) = first, places  # x, y: (H + 2, W + 2)
    for row in tasks(counter, records.size // max(columns, 1)):
        for column in range(columns):
            n = row * columns + column
            records[n]["kind"] = NOTHING
            # The place of the texel's center, and J there: by differences of the map, or exactly.
            r, c = row + top + 1, column + left + 1
            if x.size > 0:
                px, py = x[r, c], y[r, c]
                xu, yu = slope(x[r, c - 1], px, x[r, c + 1]), slope(y[r, c - 1], py, y[r, c + 1])
                xv, yv = slope(x[r - 1, c], px, x[r + 1, c]), slope(y[r - 1, c], py, y[r + 1, c])
                is_placed = math.isfinite(px + py + xu + xv + yu + yv)
            else:
                u, v, m = c - 0.5, r - 0.5, matrix
                w = m[2, 0] * u + m[2, 1] * v + m[2, 2]
                is_placed = w > 0.0 and w >= nearest
                near = 1.0 / w if is_placed else 0.0
                px = (m[0, 0] * u + m[0, 1] * v + m[0, 2]) * near
                py = (m[1, 0] * u + m[1, 1] * v + m[1, 2]) * near
                xu, xv = (m[0, 0] - px * m[2, 0]) * near, (m[0, 1] - px * m[2, 1]) * near
                yu, yv = (m[1, 0] - py * m[2, 0]) * near, (m[1, 1] - py * m[2, 1]) * near
            if is_placed:
                flat_sample(records[n], (px, py), (xu, xv, yu, yv), 1.0, widths, shape)
                area[n] = abs(xu * yv - xv * yu)
