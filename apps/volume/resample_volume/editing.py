"""Transfer functions as a few control points, which a page lets its user move."""

from typing import Any

import numpy as np

from resample.colors import to_srgb
from resample_volume.classification.transfer import DataRange, Transfer, TransferFunction, spread

MOST = 14  # points
STEPS = 512  # samples of the range at which a transfer function is evaluated
CLOSE = 0.01  # of the full scale of colors and opacities
HIDDEN = 0.1  # weight of colors that are transparent
STEEP = 1e30  # any slope is less


def points_of(transfer: Transfer, data_range: DataRange) -> list[tuple[float, str, float]]:
    """Approximate a transfer function by ascending points: value, `#rrggbb` and opacity."""
    placed = spread(transfer, data_range)
    if isinstance(placed, TransferFunction) and placed.value.size <= MOST:
        value, curve = placed.value, np.column_stack([placed.color, placed.opacity])
    else:
        value = np.linspace(*data_range, STEPS)
        slope = np.full(STEPS, STEEP, np.float32)
        color, opacity = placed.classify(value, slope, data_range, 1.0)
        curve = np.column_stack([to_srgb(color), opacity])
        # Add the point farthest from the polyline of colors and opacities until all are close
        place, kept = np.arange(STEPS), [0, STEPS - 1]
        weight = np.maximum(HIDDEN, curve[:, 3:])
        while len(kept) < MOST:
            line = np.column_stack([np.interp(place, kept, curve[kept, c]) for c in range(4)])
            off = np.abs(line - curve)
            off[:, :3] *= weight
            worst = int(off.max(axis=1).argmax())
            if off[worst].max() < CLOSE:
                break
            kept = sorted([*kept, worst])
        value, curve = value[kept], curve[kept]
    levels = np.clip(np.rint(255 * curve[:, :3]), 0, 255).astype(int)
    rows: list[Any] = np.clip(curve[:, 3], 0, 1).tolist()
    return [
        (float(one), "#{:02x}{:02x}{:02x}".format(*level), float(opacity))
        for one, level, opacity in zip(value, levels, rows, strict=True)
    ]


def spelled(points: list[tuple[float, str, float]]) -> str:
    """Format control points for the option `transfer`."""
    return " ".join(f"{value:.6g},{color},{opacity:.4g}" for value, color, opacity in points)
