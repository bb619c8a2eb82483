"""The layer that a sample lies in by a compositing order, and when its turn comes."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.engine.vectors import Vector, combine, dot
from resample.types import LAST_SHEET, Floats, Layers, Single


@kernel
def place_of(layers: Layers, world: Vector, center: Vector) -> float:
    """Place of a sample, whose position is given in axes of the scene and of the camera."""
    along = layers.offset + dot(layers.axis, world)
    return math.sqrt(dot(center, center)) if layers.is_around else along


@kernel
def key_of(layers: Layers, place: float) -> Single:
    """What samples are painted in ascending order of, from a sample's place."""
    return np.float32(abs(place - layers.eye) if layers.eye > -np.inf else place)


@kernel
def sheet_of(layers: Layers, place: float) -> int:
    """Number of the layer that a place lies in."""
    number = math.floor(np.float32(place) / np.float32(layers.thickness))
    return int(max(-LAST_SHEET, min(LAST_SHEET, number)))


@kernel
def key_of_sheet(layers: Layers, sheet: int) -> Single:
    """Like `key_of`, of a whole sheet: how far its middle is from the eye, in sheets.

    No two sheets of one order have the same: an eye between sheets has some on both sides.
    """
    if layers.eye == -np.inf:
        return np.float32(sheet)
    ahead = sheet + 0.5 - layers.eye / layers.thickness
    away = np.float32(abs(ahead))
    return np.nextafter(away, np.float32(np.inf)) if ahead < 0.0 else away


@kernel
def fill_layers(
    layers: Layers,
    by_sheets: bool,
    position: Floats,
    eye: Vector,
    key: Floats,
    sheet: NDArray[np.int32],
) -> None:
    """Keys and sheets (N,) of samples at a position (N, 3); `eye` is the camera's, scene units."""
    for n in range(key.size):
        world = (float(position[n, 0]), float(position[n, 1]), float(position[n, 2]))
        place = place_of(layers, world, combine(world, -1.0, eye))
        sheet[n] = sheet_of(layers, place)
        key[n] = key_of_sheet(layers, sheet[n]) if by_sheets else key_of(layers, place)
