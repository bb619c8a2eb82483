"""Read tables of radial functions."""

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single


@kernel
def radial(values: Floats, extent: float, argument: Single) -> Single:
    """Table `values` (K + 1,) over 0..extent, between its two nearest entries; 0 beyond the end."""
    if not 0.0 <= argument < extent:
        return 0.0
    position = argument * ((values.size - 1) / extent)
    entry = min(int(position), values.size - 2)
    below = values[entry]
    return below + (position - entry) * (values[entry + 1] - below)


# exp(-x) in steps of 1/64; between them two terms of the series err by under 7e-7.
STEPS_PER_UNIT = 64
OPAQUE_DEPTH = 16
DEPTHS = np.arange(OPAQUE_DEPTH * STEPS_PER_UNIT) / STEPS_PER_UNIT
FALL, RISE = np.exp(-DEPTHS).astype(np.float32), -np.expm1(-DEPTHS).astype(np.float32)


@kernel
def absorbed(optical_depth: Single) -> Single:
    """Share 1 - exp(-x) of the light that does not pass; exact to 7e-7 of itself when small too."""
    x = max(np.float32(0.0), np.float32(optical_depth))  # which is 0 of what is no number
    if x >= np.float32(OPAQUE_DEPTH):
        return np.float32(1.0)
    entry = np.uint32(x * np.float32(STEPS_PER_UNIT))
    rest = x - np.float32(entry) * np.float32(1.0 / STEPS_PER_UNIT)
    return RISE[entry] + FALL[entry] * (rest * (np.float32(1.0) - np.float32(0.5) * rest))


@kernel
def unit_lookup(values: Floats, argument: Single) -> Single:
    """Like `radial` over 0..1, in float32 throughout: the innermost look-up of all."""
    if not argument < np.float32(1.0):
        return np.float32(0.0)
    position = argument * np.float32(values.size - 1)
    entry = np.uint32(position)
    below = values[entry]
    return below + (position - np.float32(entry)) * (values[entry + np.uint32(1)] - below)


@kernel
def partial_integral(values: Floats, squared: Single, start: Single, end: Single) -> Single:
    """Integral of the unit kernel along a line, between two places of it.

    Parameters
    ----------
    values
        (K + 1, J + 1) integrals up to a place, over `squared` 0..1 and the place -1..1.
    squared
        Of the line's distance from the center, radii².
    start, end
        Places along the line, radii from where it is nearest to the center; may be infinite.
    """
    if not (squared < np.float32(1.0) and start < end):
        return np.float32(0.0)
    line = squared * np.float32(values.shape[0] - 1)
    row = int(line)
    down = line - np.float32(row)
    return _up_to(values, row, down, end) - _up_to(values, row, down, start)


@kernel
def _up_to(values: Floats, row: int, down: Single, along: Single) -> Single:
    """Integral up to a place of a line that lies by `down` between two rows of the table."""
    one = np.float32(1.0)
    inside = max(-one, min(one, along))
    position = (inside + one) * np.float32(0.5 * (values.shape[1] - 1))
    column = min(np.uint32(position), np.uint32(values.shape[1] - 2))
    right, next_row, after = position - np.float32(column), row + 1, column + np.uint32(1)
    upper = values[row, column] + right * (values[row, after] - values[row, column])
    lower = values[next_row, column] + right * (values[next_row, after] - values[next_row, column])
    return upper + down * (lower - upper)
