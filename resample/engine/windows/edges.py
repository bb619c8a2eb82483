"""Boundary modes: which sample stands for a position beyond the edges of a grid."""

import math

from resample.engine.jit import inner_kernel

TRANSPARENT, CLAMP, WRAP, MIRROR = range(4)


@inner_kernel
def mapped(index: int, size: int, edge: int) -> int:
    """Index of the sample that stands for an index beyond the grid's edges."""
    if 0 <= index < size:
        return index
    if edge == CLAMP:
        return 0 if index < 0 else size - 1
    if edge == WRAP:
        return index % size
    # Mirror; at a transparent edge too, where it serves interpolation only, so that sums are kept.
    index %= 2 * size
    return index if index < size else 2 * size - 1 - index


@inner_kernel
def folded(place: float, size: float, edge: int, margin: float) -> tuple[float, float]:
    """Equivalent position in the grid or within `margin` of it; and −1 if mirrored, else 1."""
    if edge == WRAP:
        return place - math.floor(place / size) * size, 1.0
    if edge == MIRROR:
        place -= math.floor(place / (2.0 * size)) * (2.0 * size)
        return (place, 1.0) if place <= size else (2.0 * size - place, -1.0)
    return min(max(place, -margin), size + margin), 1.0
