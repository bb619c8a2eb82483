"""Section 4: a voxel on the screen, a point or the ellipse of its kernel's sphere."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_step, kernel, parallel_kernel, tasks
from resample.engine.lookup import absorbed
from resample.engine.vectors import Matrix, Vector, dot, matrix_of, multiply, scaled, vector_at
from resample.hybrid.classify import Covariance, Widths, ellipse_at, is_minified
from resample.hybrid.ellipse import cone_section
from resample.hybrid.points import point_at
from resample.hybrid.record import NOTHING, SPLAT
from resample.types import Ellipsoid, Floats, Record, Records, Single, Stage, View

CHUNK = 4096  # samples that a thread places at a time


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
    """The ball of a lattice."""
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

    `place`: x / z and y / z of its center; 0 where rays are parallel. `focal`: px per scene unit
    there.
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

    `extinction`: per scene unit. `layer`: thickness of the layer in which points are summed, scene
    units. Result: a splat's extinction (amounts are lengths); a point's opacity (amounts
    are parts of a pixel).
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
        radius = _filter_radius(size, ball, widths)
        point_at(record, place, mass, radius, widths.table, shape)
        return absorbed(np.float32(extinction * layer * slant))
    record["kind"] = SPLAT
    if projector.perspective and not widths.is_affine:
        _round_splat(record, Q, projector, ball, widths, shape)
    else:
        ray = Q if projector.perspective else (0.0, 0.0, 1.0)
        place = (projector.cx + projector.fx * x, projector.cy + projector.fy * y)
        _linear_splat(record, place, ray, ball, size, shape)
    return np.float32(extinction)


@inner_step
def _filter_radius(size: Covariance, ball: UnitBall, widths: Widths) -> float:
    """Radius, px, of the filter that a point is seen under."""
    if not widths.variance > 0.0:
        return widths.filter
    # As wide as the kernel's projection and a pixel, of variance 1 / 12.
    xx, xy, yy = size
    half = math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    spacing2 = (0.5 * (xx + yy) + half) / (ball.radius * ball.radius)
    return widths.filter * math.sqrt(widths.variance * spacing2 + 1.0 / 12.0)


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
    record["alpha"] = alpha
    # Scene units along the ray per unit of the sphere's space.
    record["weight"] = ball.scale * math.sqrt(dot(Q, Q) / dot(unit, unit))


@inner_step
def _linear_splat(
    record: Record,
    place: tuple[float, float],
    ray: Vector,
    ball: UnitBall,
    size: Covariance,
    shape: tuple[int, int],
) -> None:
    """Fill in a splat of a linear projection; exact for parallel rays, where i is d.

    `ray`: through its center, of any length.
    """
    ellipse_at(record, place, size, shape)
    unit = multiply(ball.to_unit, ray)
    record["alpha"] = 0.0
    record["weight"] = ball.scale * math.sqrt(dot(ray, ray) / dot(unit, unit))


class OrderedVoxels(NamedTuple):
    """Samples of a volume, in the order in which they are painted."""

    position: Floats  # (3 N,) x, y and z in turn, scene units
    extinction: Floats  # (N,) per scene unit
    layer: NDArray[np.int32]  # (N,) in which points are summed
    thickness: float  # of a layer, scene units


@parallel_kernel
def place_voxels(
    counter: Counter,
    records: Records,
    density: Floats,
    voxels: OrderedVoxels,
    stage: Stage,
    widths: Widths,
) -> None:
    """Fill the records and densities (N,) of voxels, in their order."""
    for task in tasks(counter, -(-records.size // CHUNK)):
        last = min((task + 1) * CHUNK, records.size)
        _place(records, density, voxels, stage, widths, range(task * CHUNK, last))


@inner_step
def _place(
    records: Records,
    density: Floats,
    voxels: OrderedVoxels,
    stage: Stage,
    widths: Widths,
    part: range,
) -> None:
    """Fill some of the records."""
    camera, screen = stage.camera, stage.screen
    projector, ball, shape = (
        projector_of(camera),
        ball_of(stage.ellipsoid),
        (screen.height, screen.width),
    )
    rotation, shift = matrix_of(camera.rotation), camera.translation
    for k in part:
        n, s = np.uint64(k), records[k]
        world = vector_at(voxels.position, n)
        turned = multiply(rotation, world)
        center = (turned[0] + shift[0], turned[1] + shift[1], turned[2] + shift[2])
        # Cull transparent voxels, and those behind the eye or beyond a clipping plane.
        is_seen = voxels.extinction[n] > 0.0 and center[2] > camera.near
        is_seen &= center[2] > 0.0 or not camera.perspective
        for plane in range(screen.planes.shape[0]):
            across = screen.planes[plane, 0] * center[0] + screen.planes[plane, 1] * center[1]
            is_seen &= across + screen.planes[plane, 2] * center[2] + screen.planes[plane, 3] > 0.0
        s["kind"], s["layer"] = NOTHING, voxels.layer[n]
        if is_seen:
            extinction = float(voxels.extinction[n])
            density[k] = voxel(
                s, center, extinction, voxels.thickness, projector, ball, widths, shape
            )
