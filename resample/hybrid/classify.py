"""Section 2, Figure 1: minified samples are points, magnified ones are splats.

How large a sample is on the screen is said by J, px per step to its neighbours: the longest axis of
the ellipse J Jᵀ is compared with a threshold. For a voxel of size s at Q it is f s |Q| / z².
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step, kernel
from resample.engine.lookup import absorbed
from resample.engine.vectors import Matrix, Vector, column, dot, matrix_of, multiply, scaled
from resample.hybrid.ellipse import cone_section
from resample.hybrid.points import point_at
from resample.hybrid.record import NOTHING, SPLAT, place_box
from resample.types import Ellipsoid, Floats, Record, Single, View

THRESHOLD = 1.0  # px; the paper's "minified"

Covariance = tuple[float, float, float]  # px²: xx, xy, yy
Jacobian = tuple[float, float, float, float]  # px per step: xu, xv, yu, yv


class Widths(NamedTuple):
    """Sizes of footprints."""

    threshold: float  # px; samples that are no larger are points. 0: none, inf: all
    filter: float  # px, radius of the pixel filter
    table: Floats  # of the pixel filter, see `footprint.flat_table`
    kernel: float = 1.0  # steps, radius of a flat sample's kernel
    largest: float = math.inf  # px, radius of a flat sample's splat; longer axes shrink
    is_projected: bool = False  # put voxels' ellipses around C' instead of the midpoint of A'B'
    is_affine: bool = False  # leave out the index correction of voxels


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

    Parameters
    ----------
    place
        Its center on the screen, px.
    depth
        For the order of samples and for surfaces.
    shape
        Height and width of the frame, px.
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
    V = held((reach * size[0], reach * size[1], reach * size[2]), widths.filter, widths.largest)
    record["kind"] = SPLAT
    whole = ellipse_at(record, place, V, shape)
    record["weight"] = area / whole if whole > 0.0 else 0.0


@inner_step
def held(size: Covariance, least: float, most: float) -> Covariance:
    """Ellipse whose half axes are `least` to `most` px long, in the directions that it has."""
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


class Projector(NamedTuple):
    """A camera as numbers."""

    fx: float  # px; px per scene unit where rays are parallel
    fy: float
    cx: float  # px
    cy: float
    perspective: bool


class UnitBall(NamedTuple):
    """The kernel's ellipsoid around each voxel of a lattice, in camera axes, as a unit sphere."""

    to_unit: Matrix  # maps it to the unit sphere
    from_unit: Matrix  # the inverse
    covariance: Matrix  # from_unit from_unitᵀ
    P: Vector  # foot of the perpendicular to the viewing plane z = 1, in the unit sphere's space
    volume: float  # scene units³ of a voxel
    scale: float  # of line integrals, 1 / radius³ in voxels
    radius: float  # voxels


@kernel
def projector_of(camera: View) -> Projector:
    """Projector of a camera."""
    focal, principal = camera.focal, camera.principal
    return Projector(focal[0], focal[1], principal[0], principal[1], camera.perspective)


@kernel
def ball_of(ellipsoid: Ellipsoid) -> UnitBall:
    """UnitBall of a lattice."""
    back = matrix_of(ellipsoid.from_unit)
    # The plane z = 1 is back[2] · x = 1 there.
    P = scaled(1.0 / dot(back[2], back[2]), back[2])
    return UnitBall(
        matrix_of(ellipsoid.to_unit),
        back,
        matrix_of(ellipsoid.covariance),
        P,
        ellipsoid.volume,
        ellipsoid.scale,
        ellipsoid.radius,
    )


@inner_step
def _size_of_voxel(
    place: tuple[float, float], focal: tuple[float, float], covariance: Matrix
) -> Covariance:
    """V = J Jᵀ of a kernel of this covariance, where J is the projection's Jacobian.

    Parameters
    ----------
    place
        x / z and y / z of its center; 0 where rays are parallel.
    focal
        px per scene unit there.
    """
    (x, y), (fx, fy), v = place, focal, covariance
    return (
        fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2]),
        fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2]),
        fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2]),
    )


@inner_step
def voxel(
    record: Record,
    Q: Vector,
    extinction: float,
    layer: float,
    projector: Projector,
    ball: UnitBall,
    widths: Widths,
    shape: tuple[int, int],
) -> Single:
    """Fill the record of a voxel around Q, camera axes, before the camera.

    Parameters
    ----------
    extinction
        Per scene unit.
    layer
        Thickness of the layer in which points are summed, scene units.

    Returns
    -------
    A splat's extinction, whose amounts are lengths; a point's opacity, whose amounts are parts of a
    pixel.
    """
    record["depth"] = Q[2]
    near = 1.0 / Q[2] if projector.perspective else 1.0
    x, y, fx, fy = Q[0] * near, Q[1] * near, projector.fx * near, projector.fy * near
    size = _size_of_voxel(
        (x, y) if projector.perspective else (0.0, 0.0), (fx, fy), ball.covariance
    )
    if is_minified(size, widths.threshold * ball.radius):
        # So much of the screen, seen under this angle, is what a layer holds of the voxel.
        slant = math.sqrt(1.0 + x * x + y * y) if projector.perspective else 1.0
        place = (projector.cx + projector.fx * x, projector.cy + projector.fy * y)
        mass = ball.volume * fx * fy / layer
        point_at(record, place, mass, widths.filter, widths.table, shape)
        return absorbed(np.float32(extinction * layer * slant))
    record["kind"] = SPLAT
    if projector.perspective:
        _round_splat(record, Q, projector, ball, widths, shape)
    else:
        _parallel_splat(record, Q, projector, ball, size, shape)
    return np.float32(extinction)


@inner_step
def _round_splat(
    record: Record,
    Q: Vector,
    projector: Projector,
    ball: UnitBall,
    widths: Widths,
    shape: tuple[int, int],
) -> None:
    """Fill in the ellipse and the weight of a splat in perspective."""
    unit = multiply(ball.to_unit, Q)
    is_ellipse, ellipse, alpha = cone_section(ball.P, unit, widths.is_projected)
    if not is_ellipse:
        record["kind"] = NOTHING
        return

    # Back on the screen R1 and R2 are conjugate half axes of the ellipse.
    center = multiply(ball.from_unit, ellipse[0])
    R1, R2 = multiply(ball.from_unit, ellipse[1]), multiply(ball.from_unit, ellipse[2])
    V = (
        projector.fx * projector.fx * (R1[0] * R1[0] + R2[0] * R2[0]),
        projector.fx * projector.fy * (R1[0] * R1[1] + R2[0] * R2[1]),
        projector.fy * projector.fy * (R1[1] * R1[1] + R2[1] * R2[1]),
    )
    ellipse_at(
        record,
        (projector.cx + projector.fx * center[0], projector.cy + projector.fy * center[1]),
        V,
        shape,
    )
    record["alpha"] = 0.0 if widths.is_affine else alpha
    # Scene units along the ray per unit of the sphere's space.
    record["weight"] = ball.scale * math.sqrt(dot(Q, Q) / dot(unit, unit))


@inner_step
def _parallel_splat(
    record: Record,
    Q: Vector,
    projector: Projector,
    ball: UnitBall,
    size: Covariance,
    shape: tuple[int, int],
) -> None:
    """Fill in the ellipse and the weight of a splat under parallel rays, for which i is d."""
    ellipse_at(
        record,
        (projector.cx + projector.fx * Q[0], projector.cy + projector.fy * Q[1]),
        size,
        shape,
    )
    ray = column(ball.to_unit, 2)
    record["alpha"] = 0.0
    record["weight"] = ball.scale / math.sqrt(dot(ray, ray))
