"""Compositing orders: what covers a pixel, the layer of a sample, and its sort key."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.engine.vectors import Vector, dot
from resample.types import Layers, Single

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
