"""What a texel's splat looks like on screen: its center, its reach, its ridge and its peak."""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import LEFT, TOP
from resample.engine.jit import kernel
from resample.engine.surfaces.stamps import (
    CURVE,
    HIGH,
    MASS,
    PEAK,
    REST,
    RIM,
    SLOPE,
    UNIT,
    WIDE,
    X,
    Y,
    blurred_ellipse,
    longest_stretch,
)
from resample.types import Doubles, Floats, Single
from resample_texture.texels.kernels.blocks import LENGTH, START, Integers
from resample_texture.texels.kernels.placing import determinant


class Shape(NamedTuple):
    """How wide splats are, and which texels are points."""

    variance: float  # texels², of V_r along an axis
    filter_variance: float  # px², of V_h
    threshold: float  # px; a texel stretched by no more than this along any direction is a point
    nearest: float  # third homogeneous coordinate; texels nearer to the eye are left out
    taps: int  # px per side that a point meets


@kernel
def _form(
    line: Floats,
    n: int,
    place: tuple[Single, Single],
    along_u: tuple[Single, Single],
    along_v: tuple[Single, Single],
    mass: Single,
    shape: tuple[Single, Single, Single],
) -> None:
    """Fill in a splat by its place, the columns of J, |det J| and the first three of `Shape`."""
    variance, filter_variance, threshold = shape
    ellipse, both = blurred_ellipse(along_u, along_v, mass, variance, filter_variance)
    peak = np.float32(UNIT) * mass / math.sqrt(both)
    is_splat = longest_stretch(along_u, along_v) > threshold
    line[X, n], line[Y, n] = place
    line[WIDE, n] = math.sqrt(np.float32(RIM) * ellipse.wide)
    line[HIGH, n] = math.sqrt(np.float32(RIM) * ellipse.high)
    line[SLOPE, n], line[CURVE, n] = ellipse.slope, ellipse.curve
    line[REST, n] = np.float32(1) / ellipse.high
    line[PEAK, n] = peak if is_splat else np.float32(0)
    line[MASS, n] = mass


@kernel
def _widths(shape: Shape) -> tuple[Single, Single, Single]:
    return (
        np.float32(shape.variance),
        np.float32(shape.filter_variance),
        np.float32(shape.threshold),
    )


@kernel
def splat_on_plane(
    matrix: Doubles, block: Integers, bounds: Integers, row: int, shape: Shape, line: Floats
) -> None:
    """Place a row of a block's texels by a homography."""
    left, top = float(bounds[LEFT]), float(bounds[TOP])
    u, v = block[0, START] + 0.5, block[1, START] + row + 0.5
    # Rows of the matrix with the block's corner as origin: float32 then tells small fractions.
    xu, xv = matrix[0, 0] - left * matrix[2, 0], matrix[0, 1] - left * matrix[2, 1]
    yu, yv = matrix[1, 0] - top * matrix[2, 0], matrix[1, 1] - top * matrix[2, 1]
    x0 = np.float32(xu * u + xv * v + matrix[0, 2] - left * matrix[2, 2])
    y0 = np.float32(yu * u + yv * v + matrix[1, 2] - top * matrix[2, 2])
    d0 = np.float32(matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2])
    a, b, c, d = np.float32(xu), np.float32(xv), np.float32(yu), np.float32(yv)
    du, dv = np.float32(matrix[2, 0]), np.float32(matrix[2, 1])
    area, nearest = np.float32(abs(determinant(matrix))), np.float32(shape.nearest)
    widths = _widths(shape)
    for n in range(block[0, LENGTH]):
        along = np.float32(n)
        depth = d0 + along * du
        inverse = np.float32(1) / depth
        x, y = (x0 + along * a) * inverse, (y0 + along * c) * inverse
        mass = area * inverse * inverse * inverse if depth >= nearest else np.float32(0)
        along_u = (a - x * du) * inverse, (c - y * du) * inverse
        along_v = (b - x * dv) * inverse, (d - y * dv) * inverse
        _form(line, n, (x, y), along_u, along_v, mass, widths)


@kernel
def slope(before: float, here: float, after: float) -> float:
    """Central difference, or that on one side where the other has no place."""
    if math.isfinite(before):
        return 0.5 * (after - before) if math.isfinite(after) else here - before
    return after - here


@kernel
def splat_on_map(
    x: Doubles, y: Doubles, block: Integers, bounds: Integers, row: int, shape: Shape, line: Floats
) -> None:
    """Place a row of a block's texels by a map (H + 2, W + 2), which has one more on each side."""
    r = block[1, START] + row + 1
    widths = _widths(shape)
    for n in range(block[0, LENGTH]):
        c = block[0, START] + n + 1
        px, py = x[r, c], y[r, c]
        xu, yu = slope(x[r, c - 1], px, x[r, c + 1]), slope(y[r, c - 1], py, y[r, c + 1])
        xv, yv = slope(x[r - 1, c], px, x[r + 1, c]), slope(y[r - 1, c], py, y[r + 1, c])
        mass = abs(xu * yv - xv * yu)
        if math.isfinite(px + py + mass):
            place = np.float32(px - bounds[LEFT]), np.float32(py - bounds[TOP])
            along_u = np.float32(xu), np.float32(yu)
            along_v = np.float32(xv), np.float32(yv)
            _form(line, n, place, along_u, along_v, np.float32(mass), widths)
        else:
            line[PEAK, n], line[MASS, n] = np.float32(0), np.float32(0)
