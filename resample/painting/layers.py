"""Layers of samples in a compositing order."""

import numpy as np

from resample.profiles.orders import CompositingOrder, Summing
from resample.types import Doubles, Floats, Layers, Sheets, View

CHUNKS = 64  # of samples per task


def layers_of(order: CompositingOrder, position: Floats, view: View, lattice: Doubles) -> Layers:
    """Layers of an order, of which the first begins at the first of the samples (N, 3)."""
    layers = order(view, lattice)
    if not layers.begins_at_first:
        return layers
    from resample.engine.layers import find_first_places

    first = np.full(CHUNKS, np.inf)
    find_first_places(layers, position, first)
    begin = (first.min() if len(position) else 0.0) - 0.5 * layers.thickness
    return layers._replace(
        offset=float(layers.offset - begin),
        eye=float(layers.eye - begin),
        begins_at_first=False,
    )


def sheets_of(layers: Layers, summing: Summing, position: Floats, view: View) -> Sheets:
    """Keys and sheets of samples (N, 3), as painters compute them."""
    from resample.engine.layers import fill_layers

    count = len(position)
    sheets = Sheets(np.zeros(count, np.float32), np.zeros(count, np.int32))
    eye = -view.rotation.T @ view.translation
    by_sheets = summing is Summing.SHEETS
    fill_layers(layers, by_sheets, position, (float(eye[0]), float(eye[1]), float(eye[2])), *sheets)
    return sheets
