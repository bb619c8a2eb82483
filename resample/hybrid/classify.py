"""Section 2, Figure 1: minified samples are points, magnified ones are splats.

How large a sample is on the screen is said by J, px per step to its neighbours: the longest axis of
the ellipse J Jᵀ is compared with a threshold. For a voxel of size s at Q it is f s |Q| / z².
"""

import math
from typing import NamedTuple

from resample.engine.jit import inner_step
from resample.hybrid.footprint import DEVIATIONS, GAUSSIAN
from resample.hybrid.points import LEAST_RADIUS, point_at
from resample.hybrid.record import NOTHING, SPLAT, place_box
from resample.types import Floats, Record

THRESHOLD = 1.0  # px; the paper's "minified"

Covariance = tuple[float, float, float]  # px²: xx, xy, yy
Jacobian = tuple[float, float, float, float]  # px per step: xu, xv, yu, yv


class Widths(NamedTuple):
    """Sizes of footprints."""

    threshold: float  # px; samples up to this size are points. 0: none, inf: all
    filter: float  # px, radius of the pixel filter
    table: Floats  # of the pixel filter, see `footprint.flat_table`
    kernel: float = 1.0  # steps, radius of a flat sample's kernel
    largest: float = math.inf  # px, radius of a flat sample's splat; longer axes shrink
    is_projected: bool = False  # put voxels' ellipses around C' instead of the midpoint of A'B'
    is_affine: bool = False  # voxels are ellipses of the projection's linear part, as in EWA
    variance: float = 0.0  # steps², of kernels that points are as wide as, in units of their width


def gaussian_widths(
    threshold: float, sigma: float, filter_sigma: float, largest: float = math.inf
) -> Widths:
    """Sizes for flat samples with Gaussian kernel, steps, and pixel filter, px."""
    radius = max(DEVIATIONS * filter_sigma, LEAST_RADIUS)
    return Widths(float(threshold), radius, GAUSSIAN, DEVIATIONS * sigma, largest)


@inner_step
def is_minified(size: Covariance, threshold: float) -> bool:
    """Whether no axis of an ellipse is longer than the threshold, px."""
    limit = threshold * threshold
    xx, xy, yy = size
    return xx <= limit and yy <= limit and (limit - xx) * (limit - yy) >= xy * xy


@inner_step
def flat_sample(
    record: Record,
    place: tuple[float, float],
    J: Jacobian,
    depth: float,
    widths: Widths,
    shape: tuple[int, int],
) -> None:
    """Fill the record of a texel or of a depth pixel; its mass is its area on the screen.

    `place`: its center on the screen, px. `depth`: for the order of samples and for surfaces.
    `shape`: height and width of the frame, px.
    """
    xu, xv, yu, yv = J
    area = abs(xu * yv - xv * yu)
    size = (xu * xu + xv * xv, xu * yu + xv * yv, yu * yu + yv * yv)
    record["depth"], record["alpha"] = depth, 0.0
    if is_minified(size, widths.threshold):
        point_at(record, place, area, widths.filter, widths.table, shape)
        return

    # A sample that shrinks along one axis and grows along the other needs the pixel filter, too: no
    # axis of its ellipse is shorter than the filter's radius. (EWA adds the filter's covariance,
    # which blurs more: docs/theory/paper.md has both against the scene.)
    reach = widths.kernel * widths.kernel
    V = clamped((reach * size[0], reach * size[1], reach * size[2]), widths.filter, widths.largest)
    record["kind"] = SPLAT
    whole = ellipse_at(record, place, V, shape)
    record["weight"] = area / whole if whole > 0.0 else 0.0


@inner_step
def clamped(size: Covariance, least: float, most: float) -> Covariance:
    """Ellipse with half axes clamped to `least` to `most` px, in the same directions."""
    xx, xy, yy = size
    mean, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    long, short, least, most = mean + half, mean - half, least * least, most * most
    if short >= least and long <= most:
        return size
    grown, low = min(max(long, least), most), min(max(short, least), most)
    if half <= 1e-12 * mean:
        return low, 0.0, low
    # V = low + (grown - low) e eᵀ, with e along the longer axis.
    stretch = (grown - low) / (2.0 * half)
    return low + stretch * (xx - short), stretch * xy, low + stretch * (yy - short)


@inner_step
def ellipse_at(
    record: Record, place: tuple[float, float], V: Covariance, shape: tuple[int, int]
) -> float:
    """Fill in the ellipse p V⁻¹ p = 1 around a place; returns its area in units of π, px²."""
    xx, xy, yy = V
    det = xx * yy - xy * xy
    if not det > 0.0:
        record["kind"] = NOTHING
        return 0.0
    record["a"], record["b"], record["c"] = yy / det, -xy / det, xx / det
    place_box(record, place[0], place[1], math.sqrt(xx), math.sqrt(yy), shape)
    return math.sqrt(det)
