"""Section 4.2, Figure 4 (right): a radially symmetric kernel and its footprint table.

A ray that passes the center of a sphere of radius r at the distance d r sees the kernel's line
integral F(d), which depends on nothing but d: one table serves all samples and all views. Tables go
over d², 0 to 1, so that no root is taken, and integrate to 1 over the unit disc: a footprint of
radius R px has the mass 1 when it is divided by R².
"""

from collections.abc import Callable

import numpy as np

from resample.engine.jit import inner_step
from resample.types import Doubles, Floats, Single

ENTRIES = 1024
NODES = 64  # of a line integral
LAST = np.float32(ENTRIES)

DEVIATIONS = 3.0  # at which Gaussians end

Kernel = Callable[[Doubles], Doubles]  # density over the distance, in radii


def lowered_gaussian(distance: Doubles) -> Doubles:
    """Gaussian that ends at `DEVIATIONS`, lowered so that it ends there without a step."""
    steep = 0.5 * DEVIATIONS**2
    return np.asarray(np.exp(-steep * distance**2) - np.exp(-steep), np.float64)


def footprint_table(density: Kernel) -> Floats:
    """Line integrals (ENTRIES + 1,) of a kernel in space, along the chord at each d."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    squared = np.linspace(0.0, 1.0, ENTRIES + 1)[:, None]
    half = np.sqrt(1.0 - squared)
    integral = (density(np.sqrt(squared + (half * node) ** 2)) * weight).sum(axis=1) * half[:, 0]
    return _of_mass_one(integral)


def flat_table(density: Kernel) -> Floats:
    """Kernel in the plane (ENTRIES + 1,), a texel's or the pixel filter's, at each d."""
    return _of_mass_one(density(np.sqrt(np.linspace(0.0, 1.0, ENTRIES + 1))))


def _of_mass_one(values: Doubles) -> Floats:
    """Divide by the integral over the unit disc, ∫ F 2π d dd = π ∫ F d(d²)."""
    mass = np.pi * np.trapezoid(values, dx=1.0 / ENTRIES)
    return np.asarray(values / mass, np.float32)


GAUSSIAN = flat_table(lowered_gaussian)


@inner_step
def interpolate(table: Floats, squared: Single) -> Single:
    """F at d², 0 to 1, linear between entries."""
    place = squared * LAST
    entry = min(int(place), ENTRIES - 1)
    k = np.uint64(entry)
    return table[k] + (place - np.float32(entry)) * (table[k + np.uint64(1)] - table[k])
