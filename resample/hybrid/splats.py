"""Section 4.2: scan conversion of a splat's ellipse, with its footprint at the corrected index."""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step
from resample.hybrid.correction import (
    EQUATION,
    LARGEST,
    by_equation,
    correction_table,
    from_table,
    row_of,
)
from resample.hybrid.footprint import GAUSSIAN, interpolate
from resample.hybrid.occlusion import OpenBlocks, TileBox, close
from resample.hybrid.roles import Blend, is_open, sample_of, touch
from resample.types import Floats, Record

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


class LookupTables(NamedTuple):
    """All lookup tables."""

    splat: Floats  # footprint of the samples' kernel
    point: Floats  # the pixel filter
    correction: Floats = correction_table()  # of the index
    largest: np.float32 = np.float32(LARGEST)  # rad; the equation serves beyond it; −1: always


FLAT_TABLES = LookupTables(GAUSSIAN, GAUSSIAN)  # of texels and of depth pixels


@inner_step
def scan_splat(
    s: Record,
    n: np.uint64,
    box: TileBox,
    blocks: OpenBlocks,
    tables: LookupTables,
    blend: Blend,
    sweep: int,
) -> bool:
    """Add splat n to the pixels of a box that lie in its ellipse.

    Result: whether it found one open.
    """
    met = False
    x, y, a, weight = s["x"], s["y"], s["a"], s["weight"]
    # The table has no row for flat samples (d = i), nor beyond its largest angle.
    alpha, entry, sine2 = s["alpha"], EQUATION, ZERO
    if ZERO < alpha <= tables.largest:
        entry = row_of(alpha)
    elif alpha > ZERO:
        sine2 = np.float32(math.sin(alpha) ** 2)

    sample, narrow = sample_of(blend, s, n), ONE / a
    lean, rest = -s["b"] * narrow, s["c"] - s["b"] * s["b"] * narrow
    for row in range(max(box.top, s["top"]), min(box.bottom, s["bottom"])):
        # The row's part of the ellipse: i² = rest dy² + a (dx − lean dy)² is 1 at its ends.
        r, dy = np.uint64(row), np.float32(row) + HALF - y
        beside = rest * dy * dy
        if beside >= ONE:
            continue
        middle, half = x + lean * dy, math.sqrt((ONE - beside) * narrow)
        left, right = int(max(middle - half + HALF, ZERO)), int(middle + half + HALF)
        for column in range(max(box.left, left), min(box.right, right)):
            c = np.uint64(column)
            if not is_open(blend, r, c):
                continue
            met = True
            across = np.float32(column) + HALF - middle
            i2 = min(beside + a * across * across, ONE)
            # From the index in the circle to the ray's distance from the center.
            if entry == EQUATION:
                d2 = min(by_equation(i2, sine2), ONE)
            else:
                d2 = from_table(tables.correction, entry, i2)
            amount = weight * interpolate(tables.splat, d2)
            if touch(blend, sweep, r, c, n, sample, i2, amount):
                close(blocks, row, column, box)
    return met
