"""Lookup in tables of radial functions, and of the opacity of an optical depth."""

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single

VISIBLE = 1.0 / 255.0  # opacity from which on a pixel counts as covered, for its nearest depth


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
