"""The paper's own way to warp depth images, and its two halves alone: splats and points.

Yuan et al. 2003, section 3, read literally: each sample is a Gaussian ellipse on screen, as large
as its surroundings say, and never smaller than the pixel filter, where it is one of the points that
a pixel accumulates. Visibility is decided once per pixel; samples seen from the back are left out.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from resample.painting.scenes.scene import dealt_to_tiles
from resample.types import Doubles, Screen
from resample_warp3d.types import Equation, Rendered, Source

if TYPE_CHECKING:
    from resample_warp3d.methods.kernels.jacobian import Footprint, Placed

SIGMA = 0.45  # px of the source; sharper leaves gaps where surfaces curve, wider blurs
FILTER_SIGMA = 0.29  # px; a Gaussian as wide as a pixel, 1 / √12
CORE = 0.75  # px of the source; half a cell, and as much again as closes gaps where depth is noisy
TOLERANCE = 0.01  # of the nearness

CUT = 3.3  # standard deviations; a Gaussian's weight is 0.4 % there
LARGEST_RADIUS = 64.0  # px; splats that would be larger leave gaps, or a few cost as much as all
TILE = 128  # px
STEPS = 2048  # of the table of weights
LEAST, MOST = 0.1, 2.0  # px, of a deviation


@dataclass(frozen=True)
class Paper:
    """Splats where the target magnifies, points where it minifies, both at once where it does both.

    Parameters
    ----------
    sigma
        Standard deviation of a splat, px of the source, 0.1 to 2.
    filter_sigma
        Standard deviation of the pixel filter, px, 0.1 to 2; no axis of a splat is smaller.
    tolerance
        What is further behind the nearest surface than this part of its nearness is hidden by it.
    core
        How far from itself a sample hides what is behind, px of the source along its grid, 0.1 to
        2; toward a boundary, half a px at most.

    Raises
    ------
    ValueError
        A choice is out of its range.
    """

    sigma: float = SIGMA
    filter_sigma: float = FILTER_SIGMA
    tolerance: float = TOLERANCE
    core: float = CORE

    def __post_init__(self) -> None:
        _check_deviation("sigma", self.sigma)
        _check_deviation("filter_sigma", self.filter_sigma)
        _check_visibility(self.tolerance, self.core)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        size = self.filter_sigma / self.sigma, math.inf
        return _Gaussians(self.sigma, size, self.tolerance, self.core)(source, equation, shape)


@dataclass(frozen=True)
class Splat:
    """Every sample a splat, however small: no pixel filter, so that minified pictures alias.

    Parameters are those of `Paper`. A splat is never too small to reach the center of a pixel.
    """

    sigma: float = SIGMA
    tolerance: float = TOLERANCE
    core: float = CORE

    def __post_init__(self) -> None:
        _check_deviation("sigma", self.sigma)
        _check_visibility(self.tolerance, self.core)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        size = math.sqrt(0.5) / _radius(self.sigma, self.core), math.inf
        return _Gaussians(self.sigma, size, self.tolerance, self.core)(source, equation, shape)


@dataclass(frozen=True)
class Point:
    """Every sample a point under the pixel filter, which leaves holes where the target magnifies.

    Parameters are those of `Paper`. Under a filter, points are what it weighs.
    """

    is_whole: ClassVar[bool] = True  # covers pixels wholly, wherever a filter meets a point
    filter_sigma: float = FILTER_SIGMA
    tolerance: float = TOLERANCE
    core: float = CORE

    def __post_init__(self) -> None:
        _check_deviation("filter_sigma", self.filter_sigma)
        _check_visibility(self.tolerance, self.core)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        gaussians = _Gaussians(self.filter_sigma, (1.0, 1.0), self.tolerance, self.core)
        return gaussians(source, equation, shape)


@dataclass(frozen=True)
class _Gaussians:
    """Samples as Gaussians of `sigma` px of the source, of limited size in the target."""

    sigma: float
    size: tuple[float, float]  # least and most px of the target per px of the source
    tolerance: float
    core: float

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        from resample_warp3d.methods.kernels.jacobian import Footprint
        from resample_warp3d.methods.kernels.splatting import Brush, Samples, paint_samples

        radius, (least, most) = _radius(self.sigma, self.core), self.size
        largest = LARGEST_RADIUS / radius
        squares = (np.arange(STEPS) + 0.5) * (radius**2 / STEPS)
        profile = np.exp(squares / (-2.0 * self.sigma**2)).astype(np.float32)
        picture = blank(shape, source.color.shape[2])
        placed = place(source, equation, Footprint(radius, least, largest), shape)
        size = radius, least, min(most, largest)
        brush = Brush(self.core, self.tolerance, *size, LARGEST_RADIUS, profile)
        screen = Screen(shape[1], shape[0], 0.0, np.zeros((4, 4)))
        tiles = dealt_to_tiles(placed.touched, screen, TILE)
        samples = Samples(source.color, source.links, placed.sample, brush)
        paint_samples(samples, tiles, picture)
        return picture


def blank(shape: tuple[int, int], channels: int) -> Rendered:
    """A rendered picture (height, width) of nothing."""
    coverage, nearness, magnification = (np.zeros(shape, np.float32) for _ in range(3))
    image = np.zeros((*shape, channels), np.float32)
    return Rendered(image, coverage, nearness, magnification, np.zeros(shape, np.bool_))


def place(
    source: Source, equation: Equation, footprint: "Footprint", shape: tuple[int, int]
) -> "Placed":
    """Place all samples of a source in a frame (height, width).

    Raises
    ------
    ValueError
        The equation's matrix is singular.
    """
    from resample_warp3d.methods.kernels.jacobian import (
        BOUNDS,
        FIELDS,
        SEGMENT,
        Placed,
        project_rows,
    )

    height, width = source.nearness.shape
    touched = np.zeros(height * -(-width // SEGMENT), BOUNDS)
    placed = Placed(np.empty((height, FIELDS, width), np.float32), touched)
    project_rows(source, equation, _backward(equation), footprint, shape, placed)
    return placed


def _backward(equation: Equation) -> Doubles:
    """M⁻¹ and M⁻¹ e of an equation, (3, 4)."""
    try:
        inverse = np.linalg.inv(equation.matrix)
    except np.linalg.LinAlgError:
        raise ValueError("the warping equation's matrix is singular; check both cameras") from None
    return np.column_stack([inverse, inverse @ equation.epipole])


def _radius(sigma: float, core: float) -> float:
    """How far a splat reaches, px of the source: as far as its cell at least."""
    return max(CUT * sigma, math.sqrt(2.0) * core)


def _check_deviation(name: str, value: float) -> None:
    if not LEAST <= value <= MOST:
        raise ValueError(f"{name} lies between {LEAST} and {MOST:g} px, not at {value}")


def _check_visibility(tolerance: float, core: float) -> None:
    if not 0.0 <= tolerance < 1.0:
        raise ValueError(f"a tolerance is part of the nearness, 0 to 1, not {tolerance}")
    if not LEAST <= core <= MOST:
        raise ValueError(f"core lies between {LEAST} and {MOST:g} px, not at {core}")
