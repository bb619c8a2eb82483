"""Blending: the applications differ here, not in painting.

    WeightedSum     section 3, texture mapping: everything is added, and divided by its weights
    NearestSurface  section 3, depth images: what lies on the nearest surface is added
    OverBlend       section 4.1, volumes: splats one by one, points as sums of a layer

A blend is a bundle of pictures (H, W, ...) that start empty, and of data of samples
(N, ...), in the order of their records. A pixel belongs to one thread.
"""

from typing import Any

import numpy as np

from resample.engine.jit import role
from resample.types import Record, Single

Blend = Any  # one of `WeightedSum`, `NearestSurface`, `OverBlend`


@role
def sweeps(blend: Blend) -> int:
    """Number of passes over all samples of a tile."""
    raise NotImplementedError


@role
def is_open(blend: Blend, row: np.uint64, column: np.uint64) -> bool:
    """Whether later samples can change the pixel."""
    raise NotImplementedError


@role
def sample_of(blend: Blend, s: Record, n: np.uint64) -> Any:
    """Data of sample n, with the record s, for `touch`: read once for all pixels."""
    raise NotImplementedError


@role
def touch(
    blend: Blend,
    sweep: int,
    row: np.uint64,
    column: np.uint64,
    n: np.uint64,
    sample: Any,
    index2: Single,
    amount: Single,
) -> int:
    """Add sample n to the pixel; return 1 if this closes it, else 0.

    `index2`: squared index i² of the pixel in the footprint, 0 center, 1 rim. `amount`: weight
    times F(d).
    """
    raise NotImplementedError


@role
def finish(blend: Blend, row: np.uint64, column: np.uint64) -> None:
    """Finish the pixel after its last sample."""
    raise NotImplementedError
