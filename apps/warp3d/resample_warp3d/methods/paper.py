"""The paper's own way to warp depth images, and its two halves alone: splats and points.

Yuan et al. 2003, section 3, on `resample.hybrid`: each sample is a Gaussian ellipse on screen, as
large as its surroundings say, or a point where it is small. Visibility is decided once per pixel,
by depth, normals and boundaries; samples seen from the back are left out.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from resample.hybrid.blend import NearestSurface, SurfaceRule
from resample.hybrid.classify import THRESHOLD, Widths, gaussian_widths
from resample.hybrid.paint import paint
from resample.hybrid.points import FILTER_SIGMA
from resample.hybrid.record import RECORD
from resample.hybrid.splats import FLAT_TABLES
from resample.messages import number
from resample_warp3d.types import DOWN, RIGHT, Equation, Rendered, Source

SIGMA = 0.45  # px of the source; sharper leaves gaps where surfaces curve, wider blurs
CORE = 0.75  # px of the source; half a cell, and as much again as closes gaps where depth is noisy
EDGE = 0.5  # px of the source, likewise at boundaries
TOLERANCE = 0.01  # of the nearness
LOOSE, TURN = 5.0, 0.9  # tolerances, and least cosine, on one side of all boundaries
LARGEST_RADIUS = 64.0  # px; splats that would be larger leave gaps, or a few cost as much as all
LEAST, MOST = 0.1, 2.0  # px, of a deviation


@dataclass(frozen=True)
class Paper:
    """Splats where the target magnifies, points where it minifies.

    Parameters
    ----------
    sigma
        Standard deviation of a splat, px of the source, 0.1 to 2; it ends at three of them.
    filter_sigma
        Standard deviation of the pixel filter, px, 0.1 to 2, below 0.25 taken for that; it ends at
        three of them, and no axis of a splat is shorter than that.
    tolerance
        Samples further behind the nearest surface than this part of its nearness are hidden by it;
        five times as much where no boundary and no turn of the surface lies between them.
    core
        How far from itself a sample hides others, px of the source along its grid, 0.1 to
        2; beside a boundary, half a px at most.

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
        widths = gaussian_widths(THRESHOLD, self.sigma, self.filter_sigma, LARGEST_RADIUS)
        return _painted(source, equation, shape, widths, (self.tolerance, self.core))


@dataclass(frozen=True)
class Splat:
    """Every sample a splat, however small: no pixel filter, so that minified pictures alias.

    Parameters as in `Paper`. A splat is never too small to reach the center of a pixel.
    """

    sigma: float = SIGMA
    tolerance: float = TOLERANCE
    core: float = CORE

    def __post_init__(self) -> None:
        _check_deviation("sigma", self.sigma)
        _check_visibility(self.tolerance, self.core)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        widths = gaussian_widths(0.0, self.sigma, 0.0, LARGEST_RADIUS)
        return _painted(source, equation, shape, widths, (self.tolerance, self.core))


@dataclass(frozen=True)
class Point:
    """Every sample a point under the pixel filter, which leaves holes where the target magnifies.

    Parameters as in `Paper`. A filter weighs points.
    """

    is_whole: ClassVar[bool] = True  # covers pixels wholly, wherever a filter meets a point
    filter_sigma: float = FILTER_SIGMA
    tolerance: float = TOLERANCE
    core: float = CORE

    def __post_init__(self) -> None:
        _check_deviation("filter_sigma", self.filter_sigma)
        _check_visibility(self.tolerance, self.core)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        widths = gaussian_widths(math.inf, SIGMA, self.filter_sigma, LARGEST_RADIUS)
        return _painted(source, equation, shape, widths, (self.tolerance, self.core))


def _painted(
    source: Source,
    equation: Equation,
    shape: tuple[int, int],
    widths: Widths,
    visibility: tuple[float, float],
) -> Rendered:
    """Picture (height, width) of a source, by a tolerance and a core."""
    from resample_warp3d.methods.kernels.placing import Placed, place_samples

    tolerance, core = visibility
    count = source.nearness.size
    placed = Placed(
        np.zeros(count, RECORD),
        np.zeros((count, 2), np.float32),
        np.zeros(count, np.float32),
        np.zeros((count, 3), np.float32),
        np.zeros(count, np.float32),
    )
    cores = (core / widths.kernel, min(core, EDGE) / widths.kernel)
    try:
        inverse = np.linalg.inv(equation.matrix)
    except np.linalg.LinAlgError:
        raise ValueError("the warping equation's matrix is singular; check both cameras") from None
    backward = np.column_stack([inverse, inverse @ equation.epipole])  # M⁻¹ and M⁻¹ e
    place_samples(source, equation, backward, widths, cores, shape, placed)
    # Number the surface that each sample is on: what links lead to.
    index, links = np.arange(count, dtype=np.int32).reshape(source.links.shape), source.links
    right, down = links[:, :-1] & RIGHT > 0, links[:-1] & DOWN > 0
    one = np.concatenate([index[:, :-1][right], index[:-1][down]])
    other = np.concatenate([index[:, 1:][right], index[1:][down]])
    graph = coo_matrix((np.ones(one.size, np.int8), (one, other)), (count, count))
    blend = NearestSurface(
        source.color.reshape(count, source.color.shape[2]),
        placed.slope,
        placed.core,
        np.asarray(connected_components(graph, directed=False)[1], np.int32),
        placed.normal,
        SurfaceRule(np.float32(tolerance), np.float32(LOOSE * tolerance), np.float32(TURN)),
        np.zeros((*shape, source.color.shape[2]), np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.int32),
    )
    paint(placed.record, FLAT_TABLES, blend, shape)
    covered = blend.weight > 0.0
    return Rendered(
        blend.image,
        covered.astype(np.float32),
        np.abs(blend.nearness) * covered,
        np.where(covered, placed.area[blend.found], np.float32(0.0)),
        covered & (blend.nearness <= 0.0),
    )


def _check_deviation(name: str, value: float) -> None:
    if not LEAST <= number(name, value) <= MOST:
        raise ValueError(f"{name} lies between {LEAST} and {MOST:g} px, not at {value}")


def _check_visibility(tolerance: float, core: float) -> None:
    if not 0.0 <= number("tolerance", tolerance) < 1.0:
        raise ValueError(f"a tolerance is part of the nearness, 0 to 1, not {tolerance}")
    if not LEAST <= number("core", core) <= MOST:
        raise ValueError(f"core lies between {LEAST} and {MOST:g} px, not at {core}")
