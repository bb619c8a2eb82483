"""Interpolation between the samples of a grid: separable kernels, and tables of their taps.

An interpolation is a symmetric 1-D profile, applied along each axis in turn. If it is not 1 at
distance 0 and 0 at the other integer distances, it does not interpolate by itself; `prefilter` then
turns the samples into coefficients for which it does.

A sample of a picture is not a value at a point but a mean over a pixel's area. If `is_mean` is
true, an interpolation reproduces the samples as its means over their areas, not as its values at
their centers. Averaging it over pixels of another picture then blurs only once.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.messages import number
from resample.registry import once
from resample.types import Doubles, Floats

if TYPE_CHECKING:
    from resample.engine.windows.boxes import Integral

R = TypeVar("R")

LARGEST_RADIUS = 8
NEGLIGIBLE = 1e-7  # fraction of the middle tap of a prefilter below which taps are dropped
LONGEST = 512  # samples over which a prefilter is computed
FINE = 4096  # integration steps per sample
# Overshoot, share of a peak.
LIMITS = {"none": -1.0, "range": 0.0, "levels": 0.0, "peaks": 1.0, "usual": 1.0}
FAINT = 4 / 255  # of levels from 0 to 1, an edge along which no ringing is visible
ROUNDING = 1e-12  # weights at points below which they are errors of rounding
SHORTEST = 1e-3  # samples; shorter sides are widened to it
RAYS = 8  # quadrature points in half a part of a sample


class Interpolation(Protocol):
    """Interface of an interpolation; a plugin is a class with these two.

    Two are optional: `is_mean` (samples are means over their extents, see above; default false)
    and `limit` (a name of `LIMITS`; default `none`). `resample.testing.check_interpolation` checks
    the rest.
    """

    @property
    def radius(self) -> float:
        """Largest distance with a weight, samples; at most `LARGEST_RADIUS`."""

    def __call__(self, distance: Doubles) -> Doubles:
        """Weights at distances 0..`radius` samples; same shape, any scale."""


@dataclass(frozen=True)
class Nearest:
    """Nearest neighbour."""

    radius: ClassVar[float] = 0.5

    def __call__(self, distance: Doubles) -> Doubles:
        return np.where(distance < 0.5, 1.0, np.where(distance == 0.5, 0.5, 0.0))


@dataclass(frozen=True)
class Bilinear:
    """Linear interpolation along each axis."""

    radius: ClassVar[float] = 1.0

    def __call__(self, distance: Doubles) -> Doubles:
        return np.maximum(1.0 - distance, 0.0)


@dataclass(frozen=True)
class InterpolatingCatmullRom:
    """Cubic with slope a = −1/2: reproduces lines and parabolas.

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
class InterpolatingCubic:
    """Cubic convolution with a slope of choice; −3/4 is OpenCV's INTER_CUBIC and PyTorch's bicubic.

    Keys, Cubic Convolution Interpolation for Digital Image Processing, 1981. Only with −1/2, as
    `InterpolatingCatmullRom` has it, parabolas are reproduced.

    Parameters
    ----------
    a
        Slope at a distance of one sample, −1 to 0.
    """

    a: float = -0.75
    radius: ClassVar[float] = 2.0

    def __post_init__(self) -> None:
        if not -1.0 <= number("a", self.a) <= 0.0:
            raise ValueError(f"a is a slope between -1 and 0, not {self.a}")

    def __call__(self, distance: Doubles) -> Doubles:
        t, a = distance, self.a
        near = ((a + 2.0) * t - (a + 3.0)) * t * t + 1.0
        far = a * (((t - 5.0) * t + 8.0) * t - 4.0)
        return np.where(t < 1.0, near, np.where(t < 2.0, far, 0.0))


@dataclass(frozen=True)
class Spline:
    """Interpolating spline: of degree 3 twice continuously differentiable, of 5 four times.

    Unser, Splines: A Perfect Fit for Signal and Image Processing, 1999.
    """

    degree: int = 3
    limit: str = "none"  # as in `AreaSpline`

    def __post_init__(self) -> None:
        if self.degree not in (2, 3, 4, 5):
            raise ValueError(f"a spline's degree is one of 2, 3, 4, 5, not {self.degree}")
        _check_limit(self.limit)

    @property
    def radius(self) -> float:
        return 0.5 * (self.degree + 1)

    def __call__(self, distance: Doubles) -> Doubles:
        return b_spline(self.degree, distance)


@dataclass(frozen=True)
class AreaSpline(Spline):
    """Spline with means over the samples' extents equal to the samples.

    A shift then acts like an interpolating spline one degree higher, means over whole samples are
    exact, and sums are preserved.

    Parameters
    ----------
    degree
        2 to 5. A higher degree preserves more fine detail under repeated resampling, and rings
        farther around hard edges.
    limit
        Limit on ringing: `range` keeps pixels that cover at most two samples within the range of
        the surrounding samples; `peaks` lets a sample that stands out from its neighbours, but not
        from flat ground, stand out twice as far, as the signal it is the mean of may; `none` is
        linear; `levels` is `range` for values from 0 to 1 that are seen, where faint edges may
        ring. `usual` is `levels` for levels that people see, and `peaks` for all else.
    """

    degree: int = 4
    limit: str = "usual"
    is_mean: ClassVar[bool] = True


@dataclass(frozen=True)
class InterpolatingLanczos:
    """Sinc windowed by the main lobe of a sinc `a` times as wide; interpolating."""

    a: int = 3
    limit: str = "none"  # as in `AreaSpline`

    def __post_init__(self) -> None:
        if self.a not in (2, 3, 4, 5):
            raise ValueError(f"a is 2, 3, 4 or 5 samples, not {self.a}")
        _check_limit(self.limit)

    @property
    def radius(self) -> float:
        return float(self.a)

    def __call__(self, distance: Doubles) -> Doubles:
        return np.where(distance < self.a, np.sinc(distance) * np.sinc(distance / self.a), 0.0)


@dataclass(frozen=True)
class InterpolatingGaussian:
    """Gaussians with weights such that their sum interpolates the samples.

    Parameters
    ----------
    sigma
        Standard deviation, samples. 0.55 to 0.58 suits photographs, 0.65 band-limited data.
    """

    sigma: float = 0.577

    def __post_init__(self) -> None:
        if not 0.3 <= number("sigma", self.sigma) <= 1.0:
            raise ValueError(f"sigma must be between 0.3 and 1 samples, not {self.sigma}")

    @property
    def radius(self) -> float:
        return math.ceil(3.3 * self.sigma * 2.0) / 2.0

    def __call__(self, distance: Doubles) -> Doubles:
        return np.exp(-0.5 * (distance / self.sigma) ** 2)


def b_spline(degree: int, distance: Doubles) -> Doubles:
    """B-spline of a degree at distances from its center, in units of the knot spacing."""
    from_start = 0.5 * (degree + 1) - np.abs(distance)  # the half with few non-zero terms
    total = np.zeros_like(from_start)
    for knot in range(degree // 2 + 1):
        sign = (-1) ** knot * math.comb(degree + 1, knot)
        total += sign * np.maximum(from_start - knot, 0.0) ** degree
    return np.asarray(total / math.factorial(degree))


def _check_limit(limit: str) -> None:
    if limit not in LIMITS:
        raise ValueError(f"limit is one of {', '.join(LIMITS)}, not {limit!r}")


def excess(interpolation: Interpolation) -> float:
    """Allowed overshoot as a fraction of a sample's peak; below 0: no limit."""
    return LIMITS[getattr(interpolation, "limit", "none")]


def faint(interpolation: Interpolation) -> float:
    """Height of edges along which an interpolation may ring."""
    return FAINT if getattr(interpolation, "limit", "none") == "levels" else 0.0


def own_extent(interpolation: Interpolation) -> float:
    """Extent over which a sample is the mean of an interpolation; 0: it is the value at a point."""
    return 1.0 if getattr(interpolation, "is_mean", False) else 0.0


def taps(interpolation: Interpolation, offset: Doubles, extent: Doubles | float = 0.0) -> Floats:
    """Compute the weights of the samples around positions.

    Parameters
    ----------
    offset
        (N,) distance of each position from its nearest sample, −0.5..0.5 samples.
    extent
        Samples, (N,) or one for all: length around each position over which to average if the
        interpolation is one of means; others give the value at the position.

    Returns
    -------
    (K, N) weights that sum to 1, K odd; the middle one belongs to the nearest sample, the one
    before it to the sample at −1.
    """
    reach = max(1, math.ceil(interpolation.radius - 0.5))
    step = np.arange(-reach, reach + 1)[:, None]
    weight = _means(interpolation, offset - step, extent)
    return np.asarray(weight / weight.sum(axis=0), np.float32)


def _means(interpolation: Interpolation, place: Doubles, extent: Doubles | float) -> Doubles:
    """Weights at positions, or their means over extents around them."""
    if not getattr(interpolation, "is_mean", False):
        distance = np.abs(place)
        return np.where(distance <= interpolation.radius, interpolation(distance), 0.0)
    at, share = np.polynomial.legendre.leggauss(RAYS)
    total = np.zeros_like(place)
    for half in (-0.25, 0.25):  # knots of a kernel are at the centers of samples or at their ends
        for n in range(RAYS):
            distance = np.abs(place + extent * (half + 0.25 * at[n]))
            inside = np.minimum(distance, interpolation.radius)
            value = np.where(distance <= interpolation.radius, interpolation(inside), 0.0)
            total += 0.25 * share[n] * value
    return total


def _half_steps(interpolation: Interpolation) -> float:
    """Radius of an interpolation, rounded up to half samples."""
    return math.ceil(2.0 * interpolation.radius) / 2.0


@once
def cumulative(interpolation: Interpolation) -> tuple[Doubles, Doubles]:
    """Integral of an interpolation's kernel from its start: places, and its values there.

    Weights are normalised: all samples' weights sum to 1 at every place.
    """
    radius = _half_steps(interpolation)
    taps = int(2.0 * radius)
    fine = np.linspace(-radius, radius, taps * FINE + 1)
    inside = np.minimum(np.abs(fine), interpolation.radius)
    kernel = np.where(np.abs(fine) <= interpolation.radius, interpolation(inside), 0.0)
    sums = np.zeros(FINE + 1)
    for n in range(taps):
        sums += kernel[n * FINE : (n + 1) * FINE + 1]
    sums[[0, -1]] = sums[[0, -1]].max()
    kernel = kernel / np.append(np.tile(sums[:-1], taps), sums[0])
    integral = np.append(0.0, np.cumsum(0.5 * (kernel[1:] + kernel[:-1])))
    return fine, integral / integral[-1]


@once
def blur(interpolation: Interpolation) -> float:
    """Blur of an interpolation: 12 times its variance, samples², 0 or more.

    So much longer a box is, squared, after it. Kernels that reproduce parabolas widen nothing;
    linear interpolation widens a box of 1 to one of √3.
    """
    fine, integral = cumulative(interpolation)
    middle = 0.5 * (fine[1:] + fine[:-1])
    spread = float((middle * middle * np.diff(integral)).sum())
    taps = exact_prefilter(interpolation)
    place = np.arange(taps.size) - taps.size // 2
    spread += float((place * place * taps).sum())
    return max(0.0, 12.0 * spread)


def side_weights(
    interpolation: Interpolation, low: Doubles, high: Doubles
) -> tuple[NDArray[np.int64], Doubles]:
    """Weights of samples for means over sides (N,) from `low` to `high`.

    Sample n covers n..n + 1. Weights of a side sum to 1.

    Returns
    -------
    First sample of each side (N,), and weights (N, K).
    """
    radius, integral = _half_steps(interpolation), cumulative(interpolation)[1]
    extent = np.maximum(high - low, SHORTEST)
    middle = 0.5 * (low + high)
    low, high = middle - 0.5 * extent, middle + 0.5 * extent
    first = np.floor(low - radius - 0.5).astype(np.int64) + 1
    last = np.ceil(high + radius - 0.5).astype(np.int64)
    center = first[:, None] + np.arange(int((last - first).max(initial=1))) + 0.5
    ends = []  # of the integral, interpolated linearly
    for end in (low, high):
        at = np.clip((end[:, None] - center + radius) * FINE, 0.0, integral.size - 1.0)
        row = np.minimum(at.astype(np.int64), integral.size - 2)
        ends.append(integral[row] + (at - row) * (integral[row + 1] - integral[row]))
    weight = (ends[1] - ends[0]) / extent[:, None]
    return first, weight / weight.sum(axis=1, keepdims=True)


def point_weights(
    interpolation: Interpolation, place: Doubles
) -> tuple[NDArray[np.int64], Doubles]:
    """Weights of samples at places (N,), as `side_weights` for sides."""
    before = np.floor(place - 0.5)
    weight = _at_points(interpolation, place - 0.5 - before)
    return before.astype(np.int64) + 1 - weight.shape[1] // 2, weight


@once
def own_weights(interpolation: Interpolation) -> tuple[int, Doubles]:
    """Weights of the coefficients that make sample 0, and the first of these."""
    start = np.zeros(1)
    if own_extent(interpolation) > 0.0:
        first, weight = side_weights(interpolation, start, start + 1.0)
    else:
        first, weight = point_weights(interpolation, start + 0.5)
    return int(first[0]), weight[0]


def _at_points(interpolation: Interpolation, fraction: Doubles) -> Doubles:
    """Weights (N, K) of the samples around points, by distance beyond a sample's center."""
    reach = max(1, math.ceil(interpolation.radius))
    distance = np.abs(np.arange(1 - reach, reach + 1) - fraction[:, None])
    inside = np.minimum(distance, interpolation.radius)
    weight = np.where(distance <= interpolation.radius, interpolation(inside), 0.0)
    weight[np.abs(weight) < ROUNDING] = 0.0
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


@once
def integrals(interpolation: Interpolation, phases: int, ones: int) -> "Integral":
    """Integral of an interpolation's kernel, with weights normalised to sum 1 everywhere.

    Row p of the table is for positions with a distance to a sample's center, minus `shift`, of
    the fraction p / phases.
    """
    from resample.engine.windows.boxes import Integral

    radius = _half_steps(interpolation)
    is_whole = radius == int(radius)
    taps, before = int(2.0 * radius), math.ceil(radius - 0.5) - is_whole
    fine, integral = cumulative(interpolation)
    # A fraction may be rounded to 1; its row is read with the next one.
    phase = np.arange(phases + 2) / phases - (0.0 if is_whole else 0.5)
    table = np.zeros((phases + 2, taps + 2 * ones), np.float32)
    table[:, :ones] = 1.0
    for n in range(taps):
        table[:, ones + n] = np.interp(before - n + phase, fine, integral, 0.0, 1.0)
    stride = table.shape[1]
    flat = np.append(table, np.zeros(ones, np.float32))
    return Integral(flat, stride, taps, before, 0.5 if is_whole else 0.0)


@once
def point_taps(interpolation: Interpolation, phases: int) -> tuple[Floats, int, int]:
    """Weights of the samples around points, for fractions p / phases of a sample.

    Returns
    -------
    table
        ((phases + 2) × stride,); row p holds the weights, padded with zeros. Where a point is a
        sample's center, that sample alone has a weight if the kernel interpolates.
    stride, taps
        A multiple of eight, and the number of weights, from the sample `taps` / 2 − 1 before the
        point on.
    """
    reach = max(1, math.ceil(interpolation.radius))
    stride = 8 * math.ceil(2 * reach / 8)
    fraction = np.minimum(np.arange(phases + 2) / phases, 1.0)
    weight = _at_points(interpolation, fraction)
    table = np.zeros((phases + 2, stride), np.float32)
    table[:, : 2 * reach] = weight
    return table.reshape(-1), stride, 2 * reach


@once
def prefilter(interpolation: Interpolation) -> Floats:
    """Compute the symmetric filter that turns samples into an interpolation's coefficients.

    Returns
    -------
    (K,) taps, K odd, that sum to 1; a single 1 if samples are the coefficients.
    """
    return exact_prefilter(interpolation).astype(np.float32)


@once
def exact_prefilter(interpolation: Interpolation) -> Doubles:
    """Compute the taps of `prefilter` in float64."""
    reach = math.ceil(interpolation.radius)
    at_samples = _means(interpolation, np.arange(-reach, reach + 1.0), 1.0)
    at_samples = at_samples / at_samples.sum()
    if not np.abs(np.delete(at_samples, reach)).max(initial=0.0) > 1e-6:
        return np.ones(1)
    ring = np.zeros(LONGEST)
    ring[np.arange(-reach, reach + 1)] = at_samples
    response = np.fft.rfft(ring).real
    if response.min() < 1e-3:
        raise ValueError(f"{interpolation} blurs too much to pass through samples")
    inverse = np.fft.fftshift(np.fft.irfft(1.0 / response, LONGEST))
    middle = LONGEST // 2
    length = int(np.flatnonzero(np.abs(inverse) > NEGLIGIBLE * inverse[middle]).max()) - middle
    kept = inverse[middle - length : middle + length + 1]
    return np.asarray(kept / kept.sum())
