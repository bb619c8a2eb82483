"""Composite slabs of samples that have colors."""

import numpy as np

from resample.engine.compositing import VISIBLE
from resample.engine.ellipsoids.lanes import expm1_of, of_16_times
from resample.engine.ellipsoids.rows import (
    ALPHA,
    BLUE,
    COLUMNS,
    DEEPEST,
    GREEN,
    LANES,
    PAIR,
    PER_DEEPEST,
    RED,
)
from resample.engine.ellipsoids.rows import DEPTH as FAR
from resample.engine.ellipsoids.rows import FIRST as NEAREST
from resample.engine.jit import lane_kernel, lane_step
from resample.types import Floats, Single
from resample_comparisons.volume.kernels.slabs.sums import Canvas, Ring, clean, stride_of, sum_at

LEAST = np.float32(1e-30)  # optical depth that is divided by, at least


@lane_step
def _composite(
    rows: Floats,
    sums: Floats,
    first_k: np.uint64,
    first: np.uint64,
    ring: Ring,
    opaque: Single,
    linear: bool,
) -> None:
    """Composite the sums of sixteen sub-pixels under what is painted, and clear them.

    Splats of a slab overlap, so their optical depths add up.
    """
    zero, one, far = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
    visible, stride = np.float32(VISIBLE), stride_of(ring)
    for n in range(LANES):
        # Index the sub-pixel and its five sums.
        k, s = first_k + np.uint64(n), first + np.uint64(n)
        one_k, two_k = s + stride, s + np.uint64(2) * stride
        three_k, four_k = s + np.uint64(3) * stride, s + np.uint64(4) * stride
        # Opacity of the slab: 1 - exp(-depth), or the sum itself by the classic model.
        depth, alpha = sums[s], rows[k + ALPHA]
        before = one - alpha
        is_open = (before > opaque) & (depth > zero)
        fall = of_16_times(expm1_of(max(DEEPEST, -depth) * PER_DEEPEST))
        part = min(depth, one) if linear else -fall
        share = before * part if is_open else zero
        # Normalize the sums by the weight, and add them by the transmittance in front.
        per_depth = one / max(depth, LEAST)
        of_sums = share * per_depth
        after = alpha + share
        rows[k + RED] += max(zero, of_sums * sums[one_k])
        rows[k + GREEN] += max(zero, of_sums * sums[two_k])
        rows[k + BLUE] += max(zero, of_sums * sums[three_k])
        rows[k + ALPHA] = after
        rows[k + FAR] += of_sums * sums[four_k]
        # Note the depth where the sub-pixel first becomes visible.
        known, near = rows[k + NEAREST], sums[four_k] * per_depth
        rows[k + NEAREST] = near if (known == far) & is_open & (after > visible) else known
        # Clear the sums for the next slab of this slot.
        sums[s] = zero
        sums[one_k] = zero
        sums[two_k] = zero
        sums[three_k] = zero
        sums[four_k] = zero


@lane_kernel
def composite_colors(canvas: Canvas, ring: Ring, slot: int, opaque: Single, linear: bool) -> None:
    """Composite a slab of the tile, and clear it."""
    # Visit only what was touched.
    rows, sums, dirty = canvas.rows, canvas.sums, canvas.dirty
    first, last, left, right = clean(dirty, slot)
    for pair in range(first, last):
        for start in range(left, right, COLUMNS):
            first_k = np.uint64(pair * PAIR + 2 * start)
            _composite(rows, sums, first_k, sum_at(ring, slot, pair, start), ring, opaque, linear)
