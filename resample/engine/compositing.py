"""Compositing orders: what covers a pixel, the layer of a sample, and its sort key."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.engine.vectors import Vector, dot
from resample.types import LAST_SHEET, Layers, Single

VISIBLE = 1.0 / 255.0  # opacity from which on a pixel counts as covered, for its nearest depth

# Straight red, green, blue, and their depth.
Light = tuple[Single, Single, Single, Single]


@kernel
def place_of(layers: Layers, world: Vector, center: Vector) -> float:
    """Place of a sample in the order; its position is given in scene and in camera axes."""
    # Place along the axis, or distance from the eye.
    along = layers.offset + dot(layers.axis, world)
    return math.sqrt(dot(center, center)) if layers.is_around else along


@kernel
def key_of(layers: Layers, place: float) -> Single:
    """Sort key of a sample, ascending in painting order, from its place."""
    return np.float32(abs(place - layers.eye) if layers.eye > -np.inf else place)


@kernel
def sheet_of(layers: Layers, place: float) -> int:
    """Number of the sheet that a place lies in."""
    # Clamp, as sheets are numbered by 32 bits.
    number = math.floor(np.float32(place) / np.float32(layers.thickness))
    return int(max(-LAST_SHEET, min(LAST_SHEET, number)))


@kernel
def key_of_sheet(layers: Layers, sheet: int) -> Single:
    """Sort key of a whole sheet: the distance of its middle from the eye, in sheets.

    No two sheets of one order have the same key, although an eye between sheets has some on both
    sides.
    """
    if layers.eye == -np.inf:
        return np.float32(sheet)
    # Of two sheets as far from the eye, the one ahead comes first.
    ahead = sheet + 0.5 - layers.eye / layers.thickness
    away = np.float32(abs(ahead))
    return np.nextafter(away, np.float32(np.inf)) if ahead < 0.0 else away
