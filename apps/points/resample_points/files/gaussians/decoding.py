"""Shared decoding of Gaussians: quaternions, logarithms, logits, harmonics."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_free
from resample.types import Floats
from resample_points.data.harmonics import rounded_to, step_of

ROOT = np.float32(np.sqrt(0.5))  # largest size of a component that is not the largest
PER_GAUSSIAN = 146 + 100  # most bytes in memory: the result, and temporary arrays


def check_count(what: str, count: int) -> int:
    """Return a number of Gaussians; reject 0, and more than the free memory holds."""
    if count < 1:
        raise ValueError("has no Gaussians")
    check_free(what, count * PER_GAUSSIAN)
    return count


def quaternions_of(three: Floats, largest: NDArray[Any]) -> Floats:
    """Return quaternions (N, 4) from three components (N, 3) and the place of the largest.

    The largest component is not stored and is positive; the others keep their order.
    """
    rest = np.maximum(1 - np.einsum("nk,nk->n", three, three), 0, dtype=np.float32)
    np.sqrt(rest, out=rest)
    made = np.zeros((len(three), 4), np.float32)
    for place in range(4):
        rows = np.flatnonzero(largest == place)
        made[rows, place] = rest[rows]
        others = [n for n in range(4) if n != place]
        for n, other in enumerate(others):
            made[rows, other] = three[rows, n]
    return made


def three_of(quaternions: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return components (N, 3) without the largest, and its place: `quaternions_of`'s inverse."""
    rows, largest = np.arange(len(quaternions)), np.abs(quaternions).argmax(axis=1)
    signed = np.where(quaternions[rows, largest] < 0, np.float32(-1), np.float32(1))
    others = np.ones(quaternions.shape, np.bool_)
    others[rows, largest] = False
    return (quaternions * signed[:, None])[others].reshape(-1, 3), largest


def exponentials(logarithms: NDArray[Any]) -> Floats:
    """Return scales from their natural logarithms; too large ones become infinite."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.exp(logarithms.astype(np.float32, copy=False))


def sigmoids(logits: NDArray[Any]) -> Floats:
    """Return opacities from their logits."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        opacities: Floats = (1 / (1 + np.exp(-logits.astype(np.float64)))).astype(np.float32)
    return opacities


def palette_of(values: NDArray[Any]) -> tuple[NDArray[np.int16], float]:
    """Return a palette of coefficients as whole numbers, and their step."""
    step = step_of(float(np.abs(values).max(initial=0.0)))
    return rounded_to(values.astype(np.float32), step), step
