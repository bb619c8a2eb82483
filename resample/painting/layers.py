"""Layers of samples in a compositing order."""

import numpy as np

from resample.profiles.orders import CompositingOrder, Summing
from resample.types import LAST_SHEET, Doubles, Floats, Layers, Sheets, View


def layers_of(order: CompositingOrder, position: Floats, view: View, lattice: Doubles) -> Layers:
    """Layers of an order, of which the first begins at the first of the samples (N, 3)."""
    layers = order(view, lattice)
    if not layers.begins_at_first:
        return layers
    begin = float(_places(layers, position, view).min(initial=np.inf)) if len(position) else 0.0
    begin -= 0.5 * layers.thickness
    return layers._replace(
        offset=float(layers.offset - begin),
        eye=float(layers.eye - begin),
        begins_at_first=False,
    )


def sheets_of(layers: Layers, summing: Summing, position: Floats, view: View) -> Sheets:
    """Keys and sheets of samples (N, 3), as painters compute them (`resample.engine.layers`)."""
    place = _places(layers, position, view)
    number = np.floor(place.astype(np.float32) / np.float32(layers.thickness))
    sheet = np.clip(number.astype(np.float64), -LAST_SHEET, LAST_SHEET).astype(np.int32)
    if summing is not Summing.SHEETS:
        key = np.abs(place - layers.eye) if layers.eye > -np.inf else place
        return Sheets(key.astype(np.float32), sheet)
    if layers.eye == -np.inf:
        return Sheets(sheet.astype(np.float32), sheet)
    # No two sheets have the same key: an eye between sheets has some on both sides.
    ahead = sheet + 0.5 - layers.eye / layers.thickness
    away = np.abs(ahead).astype(np.float32)
    return Sheets(np.where(ahead < 0.0, np.nextafter(away, np.float32(np.inf)), away), sheet)


def _places(layers: Layers, position: Floats, view: View) -> Doubles:
    """Places (N,) of samples (N, 3), by which layers are numbered."""
    x, y, z = position.T.astype(np.float64)
    if layers.is_around:
        eye = -view.rotation.T @ view.translation
        x, y, z = x - eye[0], y - eye[1], z - eye[2]
        return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)
    a, b, c = layers.axis
    return np.asarray(layers.offset + (a * x + b * y + c * z), np.float64)
