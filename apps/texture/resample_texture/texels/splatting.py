"""Texel splats, and points where texels are far smaller than a pixel.

Every texel is an elliptical Gaussian on screen (Chen, Dachille and Kaufman, Forward Perspective
Image Warping, 1999), or a point under the pixel filter. Both have the texel's area on screen as
their mass. Texels are neither cut nor joined.
"""

import math
from dataclasses import dataclass

import numpy as np

from resample.engine.cells.bands import collect
from resample.engine.cells.parts import batches, parts_of
from resample.engine.cells.taps import FilterTaps
from resample.engine.surfaces import RIM
from resample.profiles.filters import Gaussian, PixelFilter, profile_table
from resample.profiles.interpolation import InterpolatingGaussian, Nearest, prefilter
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography, Size
from resample_texture.texels import forward
from resample_texture.texels.kernels.blocks import view_bounds_of
from resample_texture.texels.kernels.splats import (
    Shape,
    Splatted,
    blocks_on_map,
    blocks_on_plane,
    splat_blocks,
)
from resample_texture.types import Edge, Warped

Forward = Homography | ForwardMap

LEAST_FULL = 0.5  # weight of a pixel that counts as filled where edges are not known
LEAST, MOST = 0.01, 16.0  # texels and px, of a deviation


@dataclass(frozen=True)
class Splatting:
    """Width of splats, and threshold for splats."""

    sigma: float = 0.5  # standard deviation of a splat, texels
    filter_sigma: float = 0.5  # and of the pixel filter that splats are spread by, px
    threshold: float = 0.0  # px; texels that no direction stretches by more are points
    interpolating: bool = False  # whether the splats' sum passes through the texels
    is_sum: bool = False  # whether a texel's value is a total, not a density

    def __post_init__(self) -> None:
        check_deviations(self.sigma, self.filter_sigma)
        if not 0.0 <= self.threshold < math.inf:
            raise ValueError(f"a threshold is 0 px or more, not {self.threshold}")
        if self.interpolating:
            InterpolatingGaussian(self.sigma)

    @property
    def filter_of_points(self) -> PixelFilter:
        return Gaussian(self.filter_sigma, radius=4.0 * self.filter_sigma)

    @property
    def radius(self) -> float:
        """Radius of a splat in the source, texels."""
        return math.sqrt(RIM) * self.sigma

    def shape(self, matrix: Doubles) -> Shape:
        """The options as numbers, for a matrix (3, 3) from source to target."""
        taps = max(1, math.ceil(2.0 * self.filter_of_points.radius))
        # Numbers may be given as integers.
        widths = float(self.sigma**2), float(self.filter_sigma**2), float(self.threshold)
        return Shape(*widths, nearest_drawn(matrix, self.radius), taps)


def check_deviations(sigma: float, filter_sigma: float) -> None:
    """Reject standard deviations, texels and px, that are out of range."""
    for name, value in (("sigma", sigma), ("filter_sigma", filter_sigma)):
        if not LEAST <= value <= MOST:
            raise ValueError(f"{name} lies between {LEAST} and {MOST:g}, not at {value}")


def nearest_drawn(matrix: Doubles, radius: float) -> float:
    """Third coordinate from which on texels are drawn as splats of this radius, texels."""
    # Twice its radius from the plane of the eye J may be half of its value at the center.
    return max(2.0 * radius, 0.5) * math.hypot(matrix[2, 0], matrix[2, 1])


def forward_of(geometry: Geometry, source_shape: Size) -> Forward:
    """Geometry that leads from a source (height, width) to the target."""
    if isinstance(geometry, BackwardMap):
        raise ValueError("a backward map cannot be followed forward")
    if isinstance(geometry, ForwardMap) and geometry.x.shape != source_shape:
        raise ValueError(f"a map of {geometry.x.shape} places no source of {source_shape}")
    return geometry


def splat(
    source: Floats, geometry: Geometry, shape: Size, edge: Edge, splatting: Splatting
) -> Warped:
    """Picture (height, width) of a source (H, W, C) with texels as splats or points."""
    geometry = forward_of(geometry, (source.shape[0], source.shape[1]))
    coefficient = source
    if splatting.interpolating:
        gaussian = InterpolatingGaussian(splatting.sigma)
        weights = prefilter(gaussian)
        if edge is Edge.CLAMP and isinstance(geometry, Homography):
            source, margin = forward.widened(source, edge, gaussian)
            geometry = forward.moved(geometry, margin)
        coefficient = forward.filtered(source, weights, weights, edge)
    height, width = source_shape = source.shape[0], source.shape[1]
    if isinstance(geometry, ForwardMap):
        matrix, numbers = np.eye(3), splatting.shape(np.eye(3))
        x, y = forward.with_margins(geometry.x, geometry.y)
        axes, bounds = blocks_on_map(x, y, shape, numbers)
    else:
        matrix = geometry.normalized(source_shape)
        numbers, x, y = splatting.shape(matrix), forward.NOTHING, forward.NOTHING
        reach = max(float(numbers.taps), math.sqrt(RIM * numbers.filter_variance))
        around = splat_view_bounds(matrix, shape, reach, splatting.radius)
        # Draw the source, or the visible part of its continuation.
        root = np.array([0, 0, width, height])
        if edge is not Edge.TRANSPARENT:
            polygon, root = forward.visible_polygon(around, forward.FARTHEST), np.zeros(4, np.int64)
            if polygon.size:
                forward.check_texels(polygon, source_shape)
                low, high = np.floor(polygon.min(axis=0)) - 1, np.ceil(polygon.max(axis=0)) + 1
                root = np.array([*low, *(high - low)], np.int64)
        axes, bounds = blocks_on_plane(matrix, root, around, shape, numbers)
    cells = forward.CellGrid(splatting.filter_of_points, Nearest(), is_sum=splatting.is_sum)
    sums = forward.PointSums(shape, source.shape[2], cells)
    profile = profile_table(splatting.filter_of_points, numbers.taps)
    spread = FilterTaps(numbers.taps, bool(splatting.is_sum), profile)
    for (first, count), picture in zip(sums.groups, sums.pictures, strict=True):
        for batch in batches(bounds, count + 1):
            splatted = Splatted(
                source, coefficient, forward.EDGES[edge], (first, count), matrix, x, y, axes[batch],
                numbers,
            )  # fmt: skip
            parts = parts_of(bounds[batch], count + 1)
            splat_blocks(splatted, spread, parts)
            collect(*parts, picture)
    lines, full = borders_of_splats(geometry, source_shape, edge, splatting.sigma, splatting.radius)
    return sums.warped(lines, full)


def splat_view_bounds(matrix: Doubles, shape: Size, reach: float, radius: float) -> Doubles:
    """Lines (5, 3) that bound the centers of texels with visible splats; see `view_bounds`."""
    lines = view_bounds_of(matrix, shape, reach)
    # With J as at its center, a splat reaches no farther on screen than the source does within
    # radius / (1 − radius |∇d| / d), which is twice the radius at most where texels are drawn.
    lines[:4, 2] += 2.0 * radius * np.hypot(lines[:4, 0], lines[:4, 1])
    lines[4, 2] -= nearest_drawn(matrix, radius)
    return lines


def borders_of_splats(
    geometry: Forward, source_shape: Size, edge: Edge, sigma: float, radius: float
) -> tuple[Doubles, float]:
    """Return `borders`, moved inward by a splat's radius and away from texels left out."""
    lines, full = forward.borders(geometry, source_shape, edge)
    if not isinstance(geometry, Homography):
        ripple = 4.0 * math.exp(-2.0 * (math.pi * sigma) ** 2)
        return lines, max(LEAST_FULL, full - ripple)
    front = lines[-1]
    nearest = nearest_drawn(geometry.normalized(source_shape), radius)
    lines[:-1] -= radius * front
    return np.vstack([lines, np.array([0.0, 0.0, 1.0]) - 2.0 * nearest * front]), full
