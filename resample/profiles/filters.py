"""Pixel filters: the weight of a point of the picture in a pixel, by distance.

A filter is a symmetric 1-D profile, applied along x and y and multiplied, and 0 beyond its radius.
Kernels never call it: they read its table.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, cast

import numpy as np

from resample.messages import number
from resample.registry import once
from resample.types import Doubles, Floats, RadialTable

PROFILE_ERROR = 1e-5  # of the peak
WIDEST = 64.0  # px, radius of a filter


class PixelFilter(Protocol):
    """Interface of a pixel filter; NumPy is enough to write one.

    A plugin is a class with these two. Its constructor takes the user's parameters by name and
    rejects invalid ones with a `ValueError`; `resample.testing.check_filter` checks the rest.
    """

    @property
    def radius(self) -> float:
        """Largest distance with a weight, px."""

    def __call__(self, distance: Doubles) -> Doubles:
        """Weights at distances 0..`radius` px; same shape, any scale, as `table` normalises."""


@dataclass(frozen=True)
class Box:
    """Constant weight: the mean over a square of the pixel's size."""

    radius: float = 0.5  # px

    def __post_init__(self) -> None:
        _positive("radius", self.radius)

    def __call__(self, distance: Doubles) -> Doubles:
        return np.ones_like(distance)


@dataclass(frozen=True)
class Area:
    """Area of overlap with the pixel, for samples that have an extent.

    Where only points can be weighted, it acts as a `Box`.
    """

    radius: ClassVar[float] = 0.5  # px

    def __call__(self, distance: Doubles) -> Doubles:
        return np.ones_like(distance)


@dataclass(frozen=True)
class Tent:
    """Weight that decreases linearly to 0; radius 1 interpolates linearly."""

    radius: float = 1.0  # px

    def __post_init__(self) -> None:
        _positive("radius", self.radius)

    def __call__(self, distance: Doubles) -> Doubles:
        return np.maximum(1.0 - distance / self.radius, 0.0)


@dataclass(frozen=True)
class Gaussian:
    """Gaussian weight, truncated.

    Parameters
    ----------
    sigma
        Standard deviation, px.
    radius
        Radius of truncation, px. Default: 4 σ, where the weight is 0.03 % of the peak.
    lowered
        Subtract the value at the radius, so that truncation leaves no step, whatever the radius
        (Pharr, Jakob and Humphreys, Physically Based Rendering, 4th ed., section 8.8.1).
    """

    sigma: float = 0.5
    radius: float = cast(float, None)
    lowered: bool = False

    def __post_init__(self) -> None:
        _positive("sigma", self.sigma)
        if self.radius is None:
            object.__setattr__(self, "radius", 4.0 * self.sigma)
        _positive("radius", self.radius)

    def __call__(self, distance: Doubles) -> Doubles:
        rim = math.exp(-0.5 * (self.radius / self.sigma) ** 2) if self.lowered else 0.0
        return np.maximum(np.exp(-0.5 * (distance / self.sigma) ** 2) - rim, 0.0)


@dataclass(frozen=True)
class Mitchell:
    """Two cubic pieces that balance blur against ringing; some weights are negative.

    Mitchell and Netravali, Reconstruction Filters in Computer Graphics, SIGGRAPH 1988, equation 8.
    They recommend 2c + b = 1; b = 1, c = 0 is the cubic B-spline.
    """

    b: float = 1 / 3
    c: float = 1 / 3

    radius: ClassVar[float] = 2.0  # px

    def __post_init__(self) -> None:
        _finite("b", self.b)
        _finite("c", self.c)

    def __call__(self, distance: Doubles) -> Doubles:
        b, c, x = self.b, self.c, distance
        near = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
        far = -(b + 6 * c) * x**3 + (6 * b + 30 * c) * x**2 - (12 * b + 48 * c) * x + 8 * b + 24 * c
        return np.where(x < 1, near, far) / 6


@dataclass(frozen=True)
class CatmullRom:
    """The interpolating cubic: sharp, with some negative weights.

    Catmull and Rom, A Class of Local Interpolating Splines, 1974; Mitchell's with b = 0, c = 1/2.
    """

    radius: ClassVar[float] = 2.0  # px

    def __call__(self, distance: Doubles) -> Doubles:
        return Mitchell(b=0.0, c=0.5)(distance)


@dataclass(frozen=True)
class Lanczos:
    """Windowed sinc, the window a sinc too: sharpest, with ringing.

    Duchon, Lanczos Filtering in One and Two Dimensions, Journal of Applied Meteorology 18, 1979.
    """

    a: int = 3  # px; lobes on each side

    def __post_init__(self) -> None:
        if self.a not in range(1, 17):
            raise ValueError(f"a is a whole number of lobes from 1 to 16, not {self.a}")

    @property
    def radius(self) -> float:
        return float(self.a)

    def __call__(self, distance: Doubles) -> Doubles:
        return np.sinc(distance) * np.sinc(distance / self.a)


def table(pixel_filter: PixelFilter, steps: int = 1024) -> RadialTable:
    """Tabulate a filter at equal steps, normalised to integral 1.

    Returns
    -------
    Table of `steps + 1` values; interpolated linearly, it integrates to 1 over −extent..extent.
    `extent` is the filter's radius, and the value there is 0. If a filter ends in a step, as a box
    does, its last interval is centered on the radius, so that a point exactly on the border of
    two pixels is divided between them, neither lost nor counted twice; `extent` is then larger
    than the radius by half an interval.
    """
    if steps < 2:
        raise ValueError(f"a table needs at least 2 steps, not {steps}")
    check_reach(pixel_filter)
    rim, peak = np.abs(pixel_filter(np.array([pixel_filter.radius, 0.0])))
    steps_to_rim = steps - 0.5 if rim > 1e-4 * peak else steps
    extent = pixel_filter.radius * (steps / steps_to_rim)
    distance = np.linspace(0.0, extent, steps + 1)
    values = np.zeros(steps + 1)
    values[:-1] = pixel_filter(distance[:-1])
    mass = 2.0 * np.trapezoid(values, distance)
    if not mass > 0.0:
        raise ValueError(f"{pixel_filter} has the integral {mass}, which cannot be scaled to 1")
    return RadialTable((values / mass).astype(np.float32), extent)


filter_table = once(table)


def profile_table(pixel_filter: PixelFilter, count: int) -> Floats:
    """Weights (PHASES, count) of the pixels around a point, by its phase; rows sum to 1."""
    from resample.engine.cells.taps import PHASES

    check_reach(pixel_filter)
    if count == 0:
        return np.zeros((1, 1), np.float32)
    phase = (np.arange(PHASES)[:, None] + 0.5) / PHASES
    distance = np.abs(np.arange(count) - 0.5 * count + 1.0 - phase)
    inside = distance <= pixel_filter.radius
    weight = np.where(inside, pixel_filter(np.minimum(distance, pixel_filter.radius)), 0.0)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True), np.float32)


def check_reach(pixel_filter: PixelFilter) -> None:
    """Reject a filter with too large a radius."""
    if not 0.0 < pixel_filter.radius <= WIDEST:
        raise ValueError(
            f"{pixel_filter} reaches {pixel_filter.radius} px; above 0 to {WIDEST:g} are allowed"
        )


def _positive(name: str, value: float) -> None:
    if not 0.0 < number(name, value) < math.inf:
        raise ValueError(f"{name} is a positive number of pixels, not {value}")


def _finite(name: str, value: float) -> None:
    if not math.isfinite(number(name, value)):
        raise ValueError(f"{name} is a finite number, not {value}")
