"""Layers of a compositing order: the layer of a sample, and its sort key."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.vectors import Vector, combine, dot
from resample.types import LAST_SHEET, Doubles, Floats, Layers, Single


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


@parallel_kernel
def find_first_places(counter: Counter, layers: Layers, position: Floats, first: Doubles) -> None:
    """Find the least place along the axis in each part of the samples at a position (N, 3)."""
    flat, (x, y, z) = position.reshape(-1), layers.axis
    samples, chunks = position.shape[0], first.size
    for chunk in tasks(counter, chunks):
        least = np.inf
        # Reduce over the part, by flat indices.
        for n in range(samples * chunk // chunks, samples * (chunk + 1) // chunks):
            k = np.uint64(3) * np.uint64(n)
            place = x * flat[k] + y * flat[k + np.uint64(1)] + z * flat[k + np.uint64(2)]
            least = min(least, place)
        first[chunk] = least + layers.offset


@kernel
def fill_layers(
    layers: Layers,
    by_sheets: bool,
    position: Floats,
    eye: Vector,
    key: Floats,
    sheet: NDArray[np.int32],
) -> None:
    """Fill in keys and sheets (N,) of samples at a position (N, 3); `eye` in scene units."""
    for n in range(key.size):
        # Find the place, then the sheet and the key of the sample or of its sheet.
        world = (float(position[n, 0]), float(position[n, 1]), float(position[n, 2]))
        place = place_of(layers, world, combine(world, -1.0, eye))
        sheet[n] = sheet_of(layers, place)
        key[n] = key_of_sheet(layers, sheet[n]) if by_sheets else key_of(layers, place)
