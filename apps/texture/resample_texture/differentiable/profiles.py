"""Tables for the float64 kernels: interpolations as polynomials, and Gauss points."""

import math
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

from resample.profiles.interpolation import Interpolation, remembered
from resample.types import Doubles

HIGHEST = 15  # degree of polynomials
TRUE = 1e-11  # error of polynomials at which the degree suffices
WORST = 1e-6  # error above which a kernel is not piecewise polynomial
PLACES = 65  # of a piece at which a kernel is evaluated


@remembered
def pieces(interpolation: Interpolation) -> tuple[Doubles, Doubles, float]:
    """Return the weights of the samples around a place as polynomials of the place.

    Returns
    -------
    (D, K) coefficients, the constants first, for K samples from the first to the last; (D − 1, K)
    those of the derivatives; and a shift. With s the place − shift, a polynomial's argument is
    s − ⌊s⌋ − 0.5 and sample k is ⌊s⌋ − ⌊(K − 1) / 2⌋ + k. Weights sum to 1 everywhere.
    """
    if getattr(interpolation, "limit", "none") != "none":
        raise ValueError(
            f"gradients are those of a linear interpolation, not of {interpolation}; "
            "set limit=none, as in area-spline:limit=none"
        )
    radius = math.ceil(2.0 * interpolation.radius) / 2.0
    taps = int(2.0 * radius)
    t = 0.5 * np.cos(np.pi * (np.arange(PLACES) + 0.5) / PLACES)
    distance = np.abs(t + 0.5 + 0.5 * taps - 1.0 - np.arange(taps)[:, None])
    inside = np.minimum(distance, interpolation.radius)
    weight = np.where(distance <= interpolation.radius, interpolation(inside), 0.0)
    weight = weight / weight.sum(axis=0)
    found = _fitted(t, weight)
    if found is None:
        raise ValueError(f"{interpolation} has kinks between its knots, and no gradient there")
    if not np.abs(found[:, 1:]).max(initial=0.0) > WORST:
        raise ValueError(f"{interpolation} is made of steps, which have no slope; give bilinear")
    weight = np.ascontiguousarray(found.T)
    slope = weight[1:] * np.arange(1.0, len(weight))[:, None]
    return weight, slope, 0.5 if radius == int(radius) else 0.0


def _fitted(t: Doubles, weight: Doubles) -> Doubles | None:
    """Return polynomials (K, D) of the lowest degree that fits the weights (K, N), if any."""
    powers = np.empty((0, 0))
    error = math.inf
    for degree in range(1, HIGHEST + 1):
        fits = [Polynomial.fit(t, one, degree, domain=[-0.5, 0.5]) for one in weight]
        error = max(np.abs(fit(t) - one).max() for fit, one in zip(fits, weight, strict=True))
        powers = np.zeros((len(weight), degree + 1))
        for n, fit in enumerate(fits):
            bare = fit.convert(domain=[-1.0, 1.0]).coef
            powers[n, : bare.size] = bare
        if error < TRUE:
            break
    return powers if error < WORST else None


@cache
def rules() -> Doubles:
    """Return 2 and 4 Gauss points of 0..1: place, weight, and extent to both sides.

    Each point stands for an interval as long as its weight; the intervals tile 0..1.
    """
    table = np.empty((6, 4))
    for first, count in ((0, 2), (2, 4)):
        at, share = np.polynomial.legendre.leggauss(count)
        place, weight = 0.5 * (at + 1.0), 0.5 * share
        end = np.cumsum(weight)
        columns = [place, weight, place - (end - weight), end - place]
        table[first : first + count] = np.stack(columns, axis=1)
    return table
