"""Interpolation in float64: coefficients of a picture, kernels as polynomials, Gauss points."""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from resample.profiles.interpolation import Interpolation, prefilter
from resample.registry import once
from resample.types import Doubles
from resample_texture.arguments import REFLECT_101
from resample_texture.texels.forward import texels_at
from resample_texture.types import Edge

HIGHEST = 15  # degree of polynomials
TRUE = 1e-11  # error of polynomials at which the degree suffices
WORST = 1e-6  # error above which a kernel is not piecewise polynomial
PLACES = 65  # of a piece at which a kernel is evaluated


def ring_of(interpolation: Interpolation, edge: str) -> int:
    """Return the number of texels beyond a clamped edge after which values are constant."""
    reach = prefilter(interpolation).size // 2 + math.ceil(interpolation.radius) + 1
    return reach if edge == Edge.CLAMP else 0


def margin_of(interpolation: Interpolation, edge: str) -> int:
    """Return the margin of coefficients that interpolation in source and ring needs."""
    return ring_of(interpolation, edge) + math.ceil(interpolation.radius) + 1


def coefficients(image: Doubles, interpolation: Interpolation, edge: str) -> Doubles:
    """Return coefficients (rows, columns, C) of a picture (H, W, C), with a margin."""
    weights, margin = prefilter(interpolation).astype(np.float64), margin_of(interpolation, edge)
    reach = weights.size // 2
    for axis in (0, 1):
        index = _indices(image.shape[axis], margin + reach, edge)
        image = _filtered(image.take(index, axis), weights, axis)
        image = np.moveaxis(np.moveaxis(image, axis, 0)[reach : image.shape[axis] - reach], 0, axis)
    return np.ascontiguousarray(image)


def transposed(gradient: Doubles, interpolation: Interpolation, edge: str) -> Doubles:
    """Apply the transpose of `coefficients`: gradients by coefficients to those by texels."""
    weights, margin = prefilter(interpolation).astype(np.float64), margin_of(interpolation, edge)
    reach = weights.size // 2
    for axis in (1, 0):
        size = gradient.shape[axis] - 2 * margin
        sides = [(0, 0)] * 3
        sides[axis] = reach, reach
        spread = _filtered(np.pad(gradient, sides), weights, axis)
        lines = np.moveaxis(spread, axis, 0)
        around = margin + reach
        kept = lines[around : around + size].copy()
        index = _indices(size, around, edge)
        beyond = np.ones(index.size, bool)
        beyond[around : around + size] = False
        np.add.at(kept, index[beyond], lines[beyond])
        gradient = np.moveaxis(kept, 0, axis)
    return np.ascontiguousarray(gradient)


def _indices(size: int, margin: int, edge: str) -> Any:
    """Return the texel index at every position of an axis with margins on both sides."""
    index = np.arange(-margin, size + margin)
    if edge != REFLECT_101:
        return texels_at(index, size, Edge(edge))
    if size == 1:
        return np.zeros_like(index)
    index = index % (2 * size - 2)
    return np.minimum(index, 2 * size - 2 - index)


def _filtered(lines: Doubles, weights: Doubles, axis: int) -> Doubles:
    """Apply a symmetric filter along an axis, with zeros beyond the ends."""
    if weights.size == 1:
        return lines
    from scipy.ndimage import correlate1d

    return np.asarray(correlate1d(lines, weights, axis, mode="constant"))


@once
def pieces(interpolation: Interpolation) -> tuple[Doubles, Doubles, float]:
    """Return the weights of the samples around a place as polynomials of the place.

    Result: (D, K) coefficients, the constants first, for K samples from the first to the last; (D −
    1, K) those of the derivatives; and a shift. With s the place − shift, a polynomial's argument
    is s − ⌊s⌋ − 0.5 and sample k is ⌊s⌋ − ⌊(K − 1) / 2⌋ + k. Weights sum to 1 everywhere.
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
