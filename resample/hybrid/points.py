"""Section 2: points, weighted by the circular filter at each pixel."""

import math

import numpy as np

from resample.engine.jit import inner_step
from resample.hybrid.footprint import interpolate
from resample.hybrid.occlusion import OpenBlocks, TileBox, close
from resample.hybrid.record import NOTHING, POINT, place_box
from resample.hybrid.roles import Blend, is_open, sample_of, touch
from resample.types import Floats, Record

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)

# The pixel filter of all applications: a Gaussian of this deviation, px. Narrower ones are sharper
# and leave gaps between points a pixel apart, wider ones blur: 0.4 lies between the best for
# flat samples, 0.29, and for voxels, 0.5 (docs/theory/paper.md has the figures).
FILTER_SIGMA = 0.4
WIDEST_SUM = 12.0  # px, radius of filters with summed weights
LEAST_RADIUS = 0.75  # px, of the filter; under a narrower one a point may meet no pixel's center


@inner_step
def point_at(
    record: Record,
    place: tuple[float, float],
    mass: float,
    radius: float,
    table: Floats,
    shape: tuple[int, int],
) -> None:
    """Fill the record of a point of a mass, px²: the disc of the pixels with filters that reach it.

    Its weights in all pixels sum to the mass. Weights of a filter of integral 1 sum to 0.84 to
    1.19 at the default width, by where in a pixel the point lies: points that move would twinkle.
    """
    x, y = place
    a = 1.0 / (radius * radius)
    record["kind"], record["alpha"] = POINT, 0.0
    record["a"], record["b"], record["c"] = a, 0.0, a
    place_box(record, x, y, radius, radius, shape)
    if record["kind"] == NOTHING:
        return
    if radius > WIDEST_SUM:  # the sum is the integral, which is 1 over the unit disc
        record["weight"] = mass * a
        return
    # The sum of its weights, beyond the frame as well; the same numbers as `filter_point` has.
    total, scale, px, py = ZERO, record["a"], record["x"], record["y"]
    taps = int(2.0 * radius) + 1
    left, top = math.ceil(x - radius - 0.5), math.ceil(y - radius - 0.5)
    for row in range(top, top + taps):
        dy = np.float32(row) + HALF - py
        above = scale * dy * dy
        for column in range(left, left + taps):
            dx = np.float32(column) + HALF - px
            d2 = above + scale * dx * dx
            if d2 < ONE:
                total += interpolate(table, d2)
    record["weight"] = mass / total if total > ZERO else 0.0


@inner_step
def filter_point(
    s: Record,
    n: np.uint64,
    box: TileBox,
    blocks: OpenBlocks,
    table: Floats,
    blend: Blend,
    sweep: int,
) -> bool:
    """Add point n to the pixels of a box with filters that reach it.

    Result: whether it found one open.
    """
    met = False
    x, y, a, weight = s["x"], s["y"], s["a"], s["weight"]
    sample = sample_of(blend, s, n)
    left, right = max(box.left, s["left"]), min(box.right, s["right"])
    for row in range(max(box.top, s["top"]), min(box.bottom, s["bottom"])):
        r, dy = np.uint64(row), np.float32(row) + HALF - y
        above = a * dy * dy
        for column in range(left, right):
            # d² of the point in the pixel's filter.
            dx = np.float32(column) + HALF - x
            d2 = above + a * dx * dx
            c = np.uint64(column)
            if d2 < ONE and is_open(blend, r, c):
                met = True
                amount = weight * interpolate(table, d2)
                if touch(blend, sweep, r, c, n, sample, d2, amount):
                    close(blocks, row, column, box)
    return met
