"""Interpolation between the samples of a grid: separable kernels, and tables of their taps.

An interpolation is a symmetric profile of one distance, applied along each axis in turn. One that
is not 1 at distance 0 and 0 at the other whole distances does not pass through the samples by
itself; `prefilter` turns the samples into coefficients for which it does.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from resample.types import Doubles, Floats

LARGEST_RADIUS = 8
NEGLIGIBLE = 1e-7  # taps of a prefilter below this share of the middle one are left out
LONGEST = 512  # samples over which a prefilter is worked out


class Interpolation(Protocol):
    """What an interpolation has; a plugin is a class with these two.

    `resample.testing.check_interpolation` checks the rest.
    """

    @property
    def radius(self) -> float:
        """Largest distance with a weight, samples; at most `LARGEST_RADIUS`."""

    def __call__(self, distance: Doubles) -> Doubles:
        """Weight at each distance, 0..`radius` samples; same shape, any scale."""


@dataclass(frozen=True)
class Nearest:
    """The nearest sample: squares."""

    radius: ClassVar[float] = 0.5

    def __call__(self, distance: Doubles) -> Doubles:
        return np.where(distance < 0.5, 1.0, np.where(distance == 0.5, 0.5, 0.0))


@dataclass(frozen=True)
class Bilinear:
    """Straight lines from sample to sample."""

    radius: ClassVar[float] = 1.0

    def __call__(self, distance: Doubles) -> Doubles:
        return np.maximum(1.0 - distance, 0.0)


@dataclass(frozen=True)
class CatmullRom:
    """Cubic with a slope of a = −1/2: reproduces straight lines and parabolas.

    Keys, Cubic Convolution Interpolation for Digital Image Processing, 1981. (OpenCV's INTER_CUBIC
    has a = −3/4 and does not.)
    """

    radius: ClassVar[float] = 2.0

    def __call__(self, distance: Doubles) -> Doubles:
        t = distance
        near = (1.5 * t - 2.5) * t * t + 1.0
        far = ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0
        return np.where(t < 1.0, near, np.where(t < 2.0, far, 0.0))


@dataclass(frozen=True)
class Spline:
    """Cubic spline: twice continuously differentiable, closest to the ideal of those here.

    Unser, Splines: A Perfect Fit for Signal and Image Processing, 1999.
    """

    radius: ClassVar[float] = 2.0

    def __call__(self, distance: Doubles) -> Doubles:
        t = distance
        near = 2.0 / 3.0 + t * t * (0.5 * t - 1.0)
        far = np.maximum(2.0 - t, 0.0) ** 3 / 6.0
        return np.where(t < 1.0, near, far)


@dataclass(frozen=True)
class InterpolatingGaussian:
    """Gaussians of such heights that their sum passes through the samples.

    Parameters
    ----------
    sigma
        Standard deviation, samples. 0.55 to 0.58 suits photographs, 0.65 band-limited data.
    """

    sigma: float = 0.577

    def __post_init__(self) -> None:
        if not 0.3 <= self.sigma <= 1.0:
            raise ValueError(f"sigma lies between 0.3 and 1 samples, not at {self.sigma}")

    @property
    def radius(self) -> float:
        return math.ceil(3.3 * self.sigma * 2.0) / 2.0

    def __call__(self, distance: Doubles) -> Doubles:
        return np.exp(-0.5 * (distance / self.sigma) ** 2)


def taps(interpolation: Interpolation, offset: Doubles) -> Floats:
    """Weights of the samples around places.

    Parameters
    ----------
    interpolation
        Any `Interpolation`.
    offset
        (N,) how far each place is from its nearest sample, −0.5..0.5 samples.

    Returns
    -------
    (K, N) weights that sum to 1, K odd; the middle one belongs to the nearest sample, the one
    before it to the sample at −1.
    """
    reach = math.ceil(interpolation.radius)
    step = np.arange(-reach, reach + 1)[:, None]
    distance = np.abs(offset - step)
    weight = np.where(distance <= interpolation.radius, interpolation(distance), 0.0)
    return np.asarray(weight / weight.sum(axis=0), np.float32)


def prefilter(interpolation: Interpolation) -> Floats:
    """Symmetric filter that turns samples into an interpolation's coefficients.

    Returns
    -------
    (K,) taps, K odd, that sum to 1; a single 1 where samples are coefficients already.

    Raises
    ------
    ValueError
        No coefficients make this kernel pass through the samples.
    """
    at_samples = taps(interpolation, np.zeros(1))[:, 0].astype(np.float64)
    reach = at_samples.size // 2
    if not np.abs(np.delete(at_samples, reach)).max(initial=0.0) > 1e-6:
        return np.ones(1, np.float32)
    ring = np.zeros(LONGEST)
    ring[np.arange(-reach, reach + 1)] = at_samples
    response = np.fft.rfft(ring).real
    if response.min() < 1e-3:
        raise ValueError(f"{interpolation} blurs too much to pass through samples")
    inverse = np.fft.fftshift(np.fft.irfft(1.0 / response, LONGEST))
    middle = LONGEST // 2
    length = int(np.flatnonzero(np.abs(inverse) > NEGLIGIBLE * inverse[middle]).max()) - middle
    kept = inverse[middle - length : middle + length + 1]
    return np.asarray(kept / kept.sum(), np.float32)
