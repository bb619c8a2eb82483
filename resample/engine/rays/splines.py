"""Cubic B-spline interpolation of a field between samples on a lattice: values and gradients.

Positions count samples along x, y and z; the first sample is at (1, 1, 1), since an array of
coefficients begins `PAD` samples before it. So the integer part of a position, its cell, is also
where the 4 × 4 × 4 coefficients begin that the position depends on. Samples stand for cells of a
volume: the field reaches half a sample beyond the outermost ones, where it is mirrored.

The four coefficients of a row are contiguous, and every operation acts on the four at once.
"""

import numpy as np

from resample.engine.jit import inner_step
from resample.engine.vectors import Vector
from resample.types import Single, SplineField

PAD = 2  # samples by which an array of coefficients is extended on each side

Four = tuple[Single, Single, Single, Single]

_SIXTH, _HALF, _TWO_THIRDS = np.float32(1 / 6), np.float32(0.5), np.float32(2 / 3)
_NONE = np.float32(0)
# Weights of the four coefficients at the second sample of four, and at the third.
_BEFORE = (_SIXTH, _TWO_THIRDS, _SIXTH, _NONE)
_BEHIND = (_NONE, _SIXTH, _TWO_THIRDS, _SIXTH)
_ONE, _TWO, _THREE, _FOUR = (np.float32(number) for number in (1, 2, 3, 4))


@inner_step
def _weights(f: Single) -> Four:
    """Weights of four coefficients at a fraction 0..1 between the second and the third."""
    g = _ONE - f
    first, last = _SIXTH * g * g * g, _SIXTH * f * f * f
    second = _TWO_THIRDS - _HALF * f * f * (_TWO - f)
    return first, second, _ONE - first - second - last, last


@inner_step
def _slopes(f: Single) -> Four:
    """Derivatives of the weights."""
    g = _ONE - f
    first, last = -_HALF * g * g, _HALF * f * f
    second = _HALF * f * (_THREE * f - _FOUR)
    return first, second, -first - second - last, last


@inner_step
def _row(flat: SplineField, p: np.uint64) -> Four:
    # Load four contiguous coefficients.
    c = flat.coefficient
    return (
        np.float32(c[p]),
        np.float32(c[p + np.uint64(1)]),
        np.float32(c[p + np.uint64(2)]),
        np.float32(c[p + np.uint64(3)]),
    )


@inner_step
def _mixed(w: Four, r: Four, s: Four, t: Four, u: Four) -> Four:
    """Weighted sum of four rows."""
    return (
        w[0] * r[0] + w[1] * s[0] + w[2] * t[0] + w[3] * u[0],
        w[0] * r[1] + w[1] * s[1] + w[2] * t[1] + w[3] * u[1],
        w[0] * r[2] + w[1] * s[2] + w[2] * t[2] + w[3] * u[2],
        w[0] * r[3] + w[1] * s[3] + w[2] * t[3] + w[3] * u[3],
    )


@inner_step
def _plane(flat: SplineField, p: np.uint64, w: Four) -> Four:
    """Sum of a plane's four rows of coefficients, under one set of weights."""
    step = np.uint64(flat.row)
    q = p + step
    r = q + step
    return _mixed(w, _row(flat, p), _row(flat, q), _row(flat, r), _row(flat, r + step))


@inner_step
def _two_planes(flat: SplineField, p: np.uint64, w: Four, d: Four) -> tuple[Four, Four]:
    """Sums of a plane's four rows of coefficients, under two sets of weights."""
    # Load each row once, for both sums.
    step = np.uint64(flat.row)
    q = p + step
    r = q + step
    one, two, three, four = _row(flat, p), _row(flat, q), _row(flat, r), _row(flat, r + step)
    return _mixed(w, one, two, three, four), _mixed(d, one, two, three, four)


@inner_step
def _dot(a: Four, b: Four) -> Single:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inner_step
def value_at(flat: SplineField, place: Vector) -> float:
    """Value of a field at a position within it, data units."""
    # Split the position into its cell and the fraction within it, and weigh each axis.
    i, j, k = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    x, y, z = (
        _weights(np.float32(place[0] - i)),
        _weights(np.float32(place[1] - j)),
        _weights(np.float32(place[2] - k)),
    )
    # Find the first coefficient of each of the four planes.
    step = np.uint64(flat.plane)
    p = k * step + j * np.uint64(flat.row) + i
    q = p + step
    r = q + step
    # Sum along y within the planes, then along z, then along x.
    one, two = _plane(flat, p, y), _plane(flat, q, y)
    three, four = _plane(flat, r, y), _plane(flat, r + step, y)
    return flat.zero + flat.scale * float(_dot(x, _mixed(z, one, two, three, four)))


@inner_step
def value_and_slope_at(flat: SplineField, place: Vector) -> tuple[float, Vector]:
    """Value of a field at a position within it, and its gradient, data units per sample."""
    # Weights and their derivatives along each axis.
    i, j, k = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    f, g, h = np.float32(place[0] - i), np.float32(place[1] - j), np.float32(place[2] - k)
    x, y, z = _weights(f), _weights(g), _weights(h)
    across, down = _slopes(f), _slopes(g)
    # Sum the planes along y, under weights and under their derivatives.
    step = np.uint64(flat.plane)
    p = k * step + j * np.uint64(flat.row) + i
    q = p + step
    r = q + step
    (one, one_down), (two, two_down) = (
        _two_planes(flat, p, y, down),
        _two_planes(flat, q, y, down),
    )
    (three, three_down), (four, four_down) = (
        _two_planes(flat, r, y, down),
        _two_planes(flat, r + step, y, down),
    )
    # Sum along z, then along x: a derivative takes derived weights along its own axis only.
    level = _mixed(z, one, two, three, four)
    along_y = _dot(x, _mixed(z, one_down, two_down, three_down, four_down))
    along_z = _dot(x, _mixed(_slopes(h), one, two, three, four))
    scale = flat.scale
    slope = (
        scale * float(_dot(across, level)),
        scale * float(along_y),
        scale * float(along_z),
    )
    return flat.zero + scale * float(_dot(x, level)), slope


@inner_step
def _ends_of(a: Four, b: Four) -> tuple[Single, Single]:
    """Least and greatest of four samples on a plane, from its rows summed about two lines."""
    one, two = _dot(_BEFORE, a), _dot(_BEHIND, a)
    three, four = _dot(_BEFORE, b), _dot(_BEHIND, b)
    return min(one, two, three, four), max(one, two, three, four)


@inner_step
def samples_around(flat: SplineField, place: Vector) -> tuple[float, float]:
    """Least and greatest of the eight samples around a position, data units."""
    # At a sample, only three coefficients along each axis have weight.
    i, j, k = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    step = np.uint64(flat.plane)
    p = k * step + j * np.uint64(flat.row) + i
    q = p + step
    r = q + step
    # Sum each plane along y at the two lines of samples.
    one, one_behind = _two_planes(flat, p, _BEFORE, _BEHIND)
    two, two_behind = _two_planes(flat, q, _BEFORE, _BEHIND)
    three, three_behind = _two_planes(flat, r, _BEFORE, _BEHIND)
    four, four_behind = _two_planes(flat, r + step, _BEFORE, _BEHIND)
    # Sum along z at the samples' two planes, then along x.
    least, greatest = _ends_of(
        _mixed(_BEFORE, one, two, three, four),
        _mixed(_BEFORE, one_behind, two_behind, three_behind, four_behind),
    )
    under, over = _ends_of(
        _mixed(_BEHIND, one, two, three, four),
        _mixed(_BEHIND, one_behind, two_behind, three_behind, four_behind),
    )
    least, greatest = min(least, under), max(greatest, over)
    return flat.zero + flat.scale * float(least), flat.zero + flat.scale * float(greatest)
