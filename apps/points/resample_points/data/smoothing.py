"""Smoothing kernels of particles, and smoothing lengths found from neighbours.

A kernel of a support radius H is 0 from H on. Smoothing lengths are h = 2 σ, twice the standard
deviation of the kernel along an axis (Dehnen & Aly 2012), which is the same resolution for every
kernel; H / h depends on the kernel. SWIFT stores h, GADGET stores H of the cubic spline.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles

NEIGHBOURS = 48  # within H of a cubic spline: h is 1.2348 times the mean spacing


@dataclass(frozen=True)
class SmoothingKernel:
    """A kernel of smoothed particles in space, of mass 1 and support radius 1."""

    name: str
    gamma: float  # H / h
    density: Callable[[Doubles], Doubles]  # per volume, at distances from 0 to 1


def _spline(q: Doubles) -> Doubles:
    inner = 1.0 - 6.0 * q * q * (1.0 - q)
    return np.asarray(8.0 / np.pi * np.where(q < 0.5, inner, 2.0 * (1.0 - q) ** 3))


def _wendland(q: Doubles) -> Doubles:
    return np.asarray(21.0 / (2.0 * np.pi) * (1.0 - q) ** 4 * (1.0 + 4.0 * q))


CUT = 4.0  # standard deviations from which the Gaussian kernel is 0
WITHIN = 0.9988660157102147  # share of a Gaussian's mass within these, in space
RIM = np.exp(-0.5 * CUT * CUT)  # of the Gaussian there, which is taken off with its slope
HEIGHT = 1.0 / (
    WITHIN * (2.0 * np.pi) ** 1.5 / CUT**3 - RIM * np.pi * (4.0 / 3.0 + 4.0 * CUT**2 / 15.0)
)


def _gaussian(q: Doubles) -> Doubles:
    square = 0.5 * CUT * CUT * q * q
    return np.asarray(HEIGHT * (np.exp(-square) - RIM * (1.0 + 0.5 * CUT * CUT - square)))


KernelName = Literal["cubic", "wendland", "gaussian"]
KERNELS = {
    kernel.name: kernel
    for kernel in (
        SmoothingKernel("cubic", (10.0 / 3.0) ** 0.5, _spline),
        SmoothingKernel("wendland", (15.0 / 4.0) ** 0.5, _wendland),
        SmoothingKernel("gaussian", 2.0442688318779556, _gaussian),
    )
}


def kernel_of(name: str) -> SmoothingKernel:
    """Return a kernel by its name: `cubic`, `wendland` or `gaussian`.

    Examples
    --------
    >>> from resample_points.data.smoothing import kernel_of
    >>> round(kernel_of("cubic").gamma, 4)
    1.8257
    """
    if name not in KERNELS:
        raise ValueError(f"kernel {name!r}; known: {', '.join(KERNELS)}")
    return KERNELS[name]


def found_smoothing(position: ArrayLike, box: ArrayLike | None = None) -> Doubles:
    """Return the smoothing lengths (N,) at which a cubic spline reaches 48 neighbours.

    Parameters
    ----------
    position
        (N, 3).
    box
        (3,) size of a periodic box.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.smoothing import found_smoothing
    >>> lattice = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    >>> found_smoothing(lattice, (8, 8, 8)).round(2).tolist()[:2]
    [1.22, 1.22]
    """
    from scipy.spatial import cKDTree

    from resample.engine.jit import workers

    place = np.asarray(position, np.float64)
    most = min(NEIGHBOURS, len(place) - 1)
    if most < 1:
        return np.zeros(len(place))
    size = None if box is None else np.asarray(box, np.float64)
    tree = cKDTree(place if size is None else wrapped(place, size), boxsize=size)
    away, _ = tree.query(tree.data, k=[most + 1], workers=workers())
    within = np.cbrt(NEIGHBOURS / most) / KERNELS["cubic"].gamma
    return np.asarray(away[:, 0] * within)


def wrapped(position: Doubles, box: Doubles) -> Doubles:
    """Return positions (N, 3) moved into a periodic box, from 0 up to below its size."""
    inside = np.mod(position, box)
    return np.where(inside < box, inside, 0.0)
