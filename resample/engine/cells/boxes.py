"""Cells as axis-aligned boxes on the screen, their overlaps with pixels, and batches of them."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, kernel
from resample.types import Floats, Single

Number = Any  # float32 or float64; results have the type of the arguments
Pixel = Any  # a number kept in int32
Places = NDArray[np.int32]


@inner_kernel
def pixel_of(place: Single) -> Pixel:
    """Pixel that a position lies in; `math.floor` of a float32 is a function call."""
    # Truncate, and correct negative numbers.
    whole = np.int32(place)
    return np.int32(whole - np.int32(place < np.float32(whole)))


@inner_kernel
def length(a: Single, b: Single) -> Single:
    """Length of (a, b): extent of a box along an axis, from the extents of its two sides."""
    return np.float32(math.sqrt(a * a + b * b))


@inner_kernel
def beyond(start: Number, extent: Number, pixel: Number) -> Number:
    """Share of a box, along an axis, beyond the pixel in which it starts."""
    return max(np.float32(0), (start + extent - pixel - np.float32(1)) / extent)


@inner_kernel
def within(start: Number, end: Number, pixel: Number) -> tuple[Number, Number]:
    """Where a box begins and ends within a pixel along an axis; in reverse order if it misses."""
    return max(start, pixel), min(end, pixel + np.float32(1))


class Batch(NamedTuple):
    """Columns of N cells, of which the first few may be in use."""

    pixel: Places  # (N,) first pixel that a cell meets: row × width + column in its part's pixels
    # (N,) share of the second pixel (area filter), or the distance from the first tap to where the
    # filter starts, 0..1 px.
    along_x: Floats
    along_y: Floats
    mass: Floats  # (N,) px² that a cell covers; 0 if it meets no pixel
    values: NDArray[Any]  # (channels, N)


@kernel
def new_batch(channels: int, count: int) -> Batch:
    """Allocate a batch of `count` cells."""
    return Batch(
        np.empty(count, np.int32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty((channels, count), np.float32),
    )
