"""Pictures under a pixel filter, by plain sums of sub-pixels."""

import math

import numpy as np

from resample import registry

FINE = 16  # sub-pixels of the truth, per side of a pixel
FILTERS = [name for name in registry.names("filters") if name not in ("area", "box")]


def window(pixel_filter, n=FINE):
    """Weights of a filter at n parts of a pixel, and the px around it."""
    margin = math.ceil(pixel_filter.radius - 0.5)
    distance = np.abs((np.arange((2 * margin + 1) * n) + 0.5) / n - margin - 0.5)
    within = np.minimum(distance, pixel_filter.radius)
    weight = np.where(distance <= pixel_filter.radius, pixel_filter(within), 0.0)
    return weight / weight.sum(), margin


def plain_filtered(fine, weight, shape, n=FINE):
    """Sub-pixels ((H + 2 m) n, (W + 2 m) n, C) under a filter, by plain sums in float64."""
    height, width = shape[0] * n, shape[1] * n
    down = sum(share * fine[k : k + height : n] for k, share in enumerate(weight))
    return sum(share * down[:, k : k + width : n] for k, share in enumerate(weight))
