"""Lookup in tables of radial functions, and of the opacity of an optical depth."""

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single


@kernel
def radial(values: Floats, extent: float, argument: Single) -> Single:
    """Interpolate `values` (K + 1,) over 0..extent linearly; 0 beyond the end."""
    if not 0.0 <= argument < extent:
        return 0.0
    position = argument * ((values.size - 1) / extent)
    entry = min(int(position), values.size - 2)
    below = values[entry]
    return below + (position - entry) * (values[entry + 1] - below)


# exp(-x) in steps of 1/64; between them two terms of the series are exact to 7e-7.
STEPS_PER_UNIT = 64
OPAQUE_DEPTH = 16
DEPTHS = np.arange(OPAQUE_DEPTH * STEPS_PER_UNIT) / STEPS_PER_UNIT
FALL, RISE = np.exp(-DEPTHS).astype(np.float32), -np.expm1(-DEPTHS).astype(np.float32)


@kernel
def absorbed(optical_depth: Single) -> Single:
    """Opacity 1 - exp(-x) of an optical depth; relative error up to 7e-7, of small ones too."""
    # NaN becomes 0.
    x = max(np.float32(0.0), np.float32(optical_depth))
    if x >= np.float32(OPAQUE_DEPTH):
        return np.float32(1.0)
    # Nearest step below, and the series of the rest.
    entry = np.uint32(x * np.float32(STEPS_PER_UNIT))
    rest = x - np.float32(entry) * np.float32(1.0 / STEPS_PER_UNIT)
    return RISE[entry] + FALL[entry] * (rest * (np.float32(1.0) - np.float32(0.5) * rest))


@kernel
def unit_lookup(values: Floats, argument: Single) -> Single:
    """As `radial` over 0..1, in float32 throughout: the innermost lookup of all."""
    # NaN and arguments beyond the end give 0.
    if not argument < np.float32(1.0):
        return np.float32(0.0)
    position = argument * np.float32(values.size - 1)
    entry = np.uint32(position)
    below = values[entry]
    return below + (position - np.float32(entry)) * (values[entry + np.uint32(1)] - below)


@kernel
def partial_integral(values: Floats, squared: Single, start: Single, end: Single) -> Single:
    """Integral of the unit kernel along a line, between two positions on it.

    `values`: (K + 1, J + 1) integrals up to a position, over `squared` 0..1 and the position -1..1.
    `squared`: squared distance of the line from the center, radii². `start`, `end`: positions on
    the line, radii from the point nearest to the center; may be infinite.
    """
    # Lines beyond the rim, and empty intervals, have no integral.
    if not (squared < np.float32(1.0) and start < end):
        return np.float32(0.0)
    line = squared * np.float32(values.shape[0] - 1)
    row = int(line)
    down = line - np.float32(row)
    return _up_to(values, row, down, end) - _up_to(values, row, down, start)


@kernel
def _up_to(values: Floats, row: int, down: Single, along: Single) -> Single:
    """Integral up to a position on a line, which lies by `down` between two rows of the table."""
    # Clamp the position to the kernel's support, and find its column.
    one = np.float32(1.0)
    inside = max(-one, min(one, along))
    position = (inside + one) * np.float32(0.5 * (values.shape[1] - 1))
    column = min(np.uint32(position), np.uint32(values.shape[1] - 2))
    right, next_row, after = position - np.float32(column), row + 1, column + np.uint32(1)
    # Interpolate in both rows, then between them.
    upper = values[row, column] + right * (values[row, after] - values[row, column])
    lower = values[next_row, column] + right * (values[next_row, after] - values[next_row, column])
    return upper + down * (lower - upper)
