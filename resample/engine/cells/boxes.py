"""Cells as upright boxes on the screen, and what of them lies in which pixel."""

import math
from typing import Any

import numpy as np

from resample.engine.jit import inner_kernel
from resample.types import Single

Number = Any  # float32 or float64: what is given is what comes out
Pixel = Any  # a number kept in int32


@inner_kernel
def pixel_of(place: Single) -> Pixel:
    """Pixel that a place of a screen lies in; `math.floor` of a float32 is a call of a function."""
    whole = np.int32(place)
    return np.int32(whole - np.int32(place < np.float32(whole)))


@inner_kernel
def length(a: Single, b: Single) -> Single:
    """Length of (a, b): how far a box reaches along an axis, of whose sides these are the parts."""
    return np.float32(math.sqrt(a * a + b * b))


@inner_kernel
def beyond(start: Number, extent: Number, pixel: Number) -> Number:
    """Share, along an axis, of a box that lies beyond the pixel in which it starts."""
    return max(np.float32(0), (start + extent - pixel - np.float32(1)) / extent)


@inner_kernel
def within(start: Number, end: Number, pixel: Number) -> tuple[Number, Number]:
    """Where a box begins and ends within a pixel along an axis; not in order if it misses it."""
    return max(start, pixel), min(end, pixel + np.float32(1))
