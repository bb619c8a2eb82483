"""A batch of cells on the screen: the pixels that they meet, their shares, their values."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.types import Floats

Places = NDArray[np.int32]


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
