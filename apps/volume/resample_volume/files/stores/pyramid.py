"""Coarser levels: exact means of two voxels along each axis."""

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.bricks import Step

SMALLEST = 64  # voxels along the longest axis of the last level


def sizes(shape: Step) -> list[Step]:
    """Return the shapes of all levels, the finest first; each halves the last, rounded up."""
    found = [shape]
    while max(found[-1]) > SMALLEST:
        z, y, x = (
            -(-size // per) for size, per in zip(found[-1], per_axis(found[-1]), strict=True)
        )
        found.append((z, y, x))
    return found


def per_axis(shape: Step) -> Step:
    """Return the voxels along each axis that become one; a volume keeps at least two."""
    z, y, x = (2 if size > 2 else 1 for size in shape)
    return z, y, x


def halved(values: NDArray[Any], per: Step) -> NDArray[Any]:
    """Average blocks of voxels along z, y and x, smaller at the ends; of the same type.

    Integers are rounded to nearest, halves to even; missing and infinite values take no part, and a
    block without others is missing.
    """
    shape = tuple(-(-size // step) for size, step in zip(values.shape, per, strict=True))
    is_whole = values.dtype.kind in "iu"
    total = np.zeros(shape, np.int64 if is_whole else np.float64)
    count = np.zeros(shape, np.uint8)
    for start in product(*map(range, per)):
        part = values[tuple(slice(n, None, step) for n, step in zip(start, per, strict=True))]
        inside = tuple(map(slice, part.shape))
        known = True if is_whole else np.isfinite(part)
        total[inside] += part if is_whole else np.where(known, part, 0.0)
        count[inside] += known
    if is_whole:
        return np.rint(total / count).astype(values.dtype)
    with np.errstate(invalid="ignore"):
        return (total / count).astype(values.dtype)
