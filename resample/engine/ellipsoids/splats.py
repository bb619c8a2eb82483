"""Bounds of splats in sub-pixels, and line integrals of spheres that planes cut."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import (
    partial_integral,
)
from resample.engine.vectors import Vector
from resample.types import (
    Doubles,
    Ellipsoid,
    Floats,
    View,
)


@kernel
def first_inside(bound: float, origin: float, subpixels: int) -> int:
    """First sub-pixel whose center is at or after `bound` px."""
    return max(0, math.ceil((bound - origin) * subpixels - 0.5))


@kernel
def last_inside(bound: float, origin: float, subpixels: int, count: int) -> int:
    """One past the last sub-pixel whose center is at or before `bound` px."""
    return min(count, math.floor((bound - origin) * subpixels - 0.5) + 1)


@kernel
def clipped_span(x: float, y: float, view: View, planes: Doubles) -> tuple[float, float]:
    """Depths between which a ray is not clipped, by the near plane and by planes (M, 5).

    x and y are the ray's position at depth 1, or at any depth where rays are parallel.
    """
    # Each plane bounds the interval from one side, by the sign of its slope.
    start, end = view.near, np.inf
    for n in range(planes.shape[0]):
        across = planes[n, 0] * x + planes[n, 1] * y
        rise, offset = planes[n, 2], planes[n, 3]
        if view.perspective:
            rise += across
        else:
            offset += across
        if rise > 0.0:
            start = max(start, -offset / rise)
        elif rise < 0.0:
            end = min(end, -offset / rise)
        elif offset < 0.0:
            end = -np.inf
    return start, end


@kernel
def cut_integral(
    center: Vector,
    x: float,
    y: float,
    span: tuple[float, float],
    view: View,
    ellipsoid: Ellipsoid,
    partial: Floats,
) -> float:
    """Line integral of a cut sphere along a ray, between two depths; x and y as in `clipped_span`.

    `center` is in the space where the ellipsoid is the unit sphere. All models agree here: the
    ray's distance and the visible part of its chord are computed directly.
    """
    unit = ellipsoid.to_unit
    shift = x if view.perspective else 0.0
    drop = y if view.perspective else 0.0
    # The ray's direction per unit of depth, and the vector from its origin to the center.
    wx = unit[0, 0] * shift + unit[0, 1] * drop + unit[0, 2]
    wy = unit[1, 0] * shift + unit[1, 1] * drop + unit[1, 2]
    wz = unit[2, 0] * shift + unit[2, 1] * drop + unit[2, 2]
    px = center[0] - unit[0, 0] * (x - shift) - unit[0, 1] * (y - drop)
    py = center[1] - unit[1, 0] * (x - shift) - unit[1, 1] * (y - drop)
    pz = center[2] - unit[2, 0] * (x - shift) - unit[2, 1] * (y - drop)
    # Find the point of the ray that is nearest to the center.
    squared_length = wx * wx + wy * wy + wz * wz
    foot = (px * wx + py * wy + pz * wz) / squared_length  # depth of the nearest point
    px, py, pz = px - foot * wx, py - foot * wy, pz - foot * wz
    # Integrate between the depths, as positions in radii from that point.
    length = math.sqrt(squared_length)
    share = partial_integral(
        partial,
        np.float32(px * px + py * py + pz * pz),
        np.float32((span[0] - foot) * length),
        np.float32((span[1] - foot) * length),
    )
    # Convert radii along the ray to scene units.
    along = math.sqrt(1.0 + shift * shift + drop * drop) / length
    return float(ellipsoid.scale * along * share)
