"""Record of a sample on the screen: a point or an ellipse, for any kind of sample."""

import math

import numpy as np

from resample.engine.jit import inner_step, kernel
from resample.engine.tiles import Pairs, bits_of, paired, sort_pairs
from resample.types import Floats, Record

NOTHING, POINT, SPLAT = 0, 1, 2

RECORD = np.dtype(
    [
        ("kind", np.int32),  # NOTHING: the picture does not show it
        ("top", np.int32),  # pixels (top to bottom - 1, left to right - 1) whose centers
        ("bottom", np.int32),  # lie in the box around the sample
        ("left", np.int32),
        ("right", np.int32),
        ("layer", np.int32),  # unit of depth that it lies in, if points are summed by depth
        ("x", np.float32),  # px, a point's place or an ellipse's center
        ("y", np.float32),
        ("a", np.float32),  # i² = a dx² + 2 b dx dy + c dy²; i = 1 at the rim
        ("b", np.float32),
        ("c", np.float32),
        ("alpha", np.float32),  # rad, half angle of a sphere's tangent cone; 0 for flat samples
        ("weight", np.float32),  # of the filter or the footprint, with the integral 1 for i < 1
        ("depth", np.float32),  # along the viewing direction
    ],
    align=True,
)


@kernel
def depth_order(key: Floats) -> Pairs:
    """Keys and indices (N,) from near to far (section 4.1, strict depth order).

    Equal keys keep their order. `resample.engine.tiles.member_of` a pair is its index.
    """
    pair = np.empty(key.size, np.uint64)
    for n in range(key.size):
        pair[n] = paired(bits_of(key[n]), n)
    sort_pairs(pair, np.empty_like(pair))
    return pair


@inner_step
def place_box(
    record: Record, x: float, y: float, wide: float, high: float, size: tuple[int, int]
) -> None:
    """Set a record's place and the pixels within `wide`, `high` px of it in a frame of this size.

    Samples outside the frame, or with NaN, are NOTHING.
    """
    height, width = size
    if not (x + wide > 0.0 and x - wide < width and y + high > 0.0 and y - high < height):
        record["kind"] = NOTHING
        return
    record["x"], record["y"] = x, y
    record["left"] = math.ceil(max(x - wide - 0.5, 0.0))
    record["right"] = math.floor(min(x + wide - 0.5, width - 1.0)) + 1
    record["top"] = math.ceil(max(y - high - 0.5, 0.0))
    record["bottom"] = math.floor(min(y + high - 0.5, height - 1.0)) + 1
    if record["left"] >= record["right"] or record["top"] >= record["bottom"]:
        record["kind"] = NOTHING
