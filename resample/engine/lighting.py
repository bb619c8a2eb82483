"""Transfer functions and Blinn-Phong lighting."""

import math

from resample.engine.jit import kernel
from resample.engine.vectors import Vector, combine, dot, scaled
from resample.types import Classifier, Floats, Lamp


@kernel
def _unit(v: Vector) -> Vector:
    """Normalize a vector; zero stays zero."""
    square = dot(v, v)
    return scaled(1.0 / math.sqrt(square), v) if square > 0.0 else v


@kernel
def _reflect(normal: Vector, place: Vector, lamp: Lamp) -> tuple[float, float]:
    """Factor of the sample's own color, and white highlight (Blinn-Phong).

    Both sides of a surface are lit alike, since a gradient may point in or out.
    """
    # Direction to the viewer: from a position, or the same everywhere for parallel rays.
    viewer = (lamp.viewer[0], lamp.viewer[1], lamp.viewer[2])
    eye = _unit(combine(viewer, -lamp.viewer[3], place))
    # A lamp without a direction is a headlight.
    light = (lamp.toward[0], lamp.toward[1], lamp.toward[2])
    if dot(light, light) == 0.0:
        light = eye
    halfway = _unit(combine(eye, 1.0, light))
    # Ambient and diffuse light take the sample's color; the highlight is white.
    own = lamp.ambient + lamp.diffuse * abs(dot(normal, light))
    return own, lamp.specular * abs(dot(normal, halfway)) ** lamp.shininess


@kernel
def lit(color: Vector, slope: Vector, place: Vector, lamp: Lamp) -> Vector:
    """Light of a surface toward the viewer; without a gradient, the fully lit color.

    `slope` is the gradient, whose direction is the surface's normal; `place` is in scene axes.
    """
    length = math.sqrt(dot(slope, slope))
    # Shade by the normal where the gradient is steep enough for a surface.
    own, highlight = lamp.ambient + lamp.diffuse, 0.0
    if length > lamp.flat:
        own, highlight = _reflect(scaled(1.0 / length, slope), place, lamp)
    return (
        max(own * color[0] + highlight, 0.0),
        max(own * color[1] + highlight, 0.0),
        max(own * color[2] + highlight, 0.0),
    )


@kernel
def length_of(v: Vector) -> float:
    """Length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _between(
    table: Floats,
    rows: tuple[int, int],
    columns: tuple[int, int],
    share: tuple[float, float, float, float],
    channel: int,
) -> float:
    """Weighted sum of four neighbouring entries of a table."""
    return float(
        share[0] * table[rows[0], columns[0], channel]
        + share[1] * table[rows[0], columns[1], channel]
        + share[2] * table[rows[1], columns[0], channel]
        + share[3] * table[rows[1], columns[1], channel]
    )


@kernel
def classified(
    classifier: Classifier, value: float, gradient: float
) -> tuple[float, float, float, float]:
    """Color and extinction, by a value 0..1 between low and high and a gradient; bilinear."""
    # Locate the cell of the table, clamped to its edges.
    table = classifier.table
    row = max(0.0, min(1.0, gradient / classifier.steep)) * (table.shape[0] - 1)
    column = max(0.0, min(1.0, value)) * (table.shape[1] - 1)
    r = min(int(row), max(0, table.shape[0] - 2))
    c = min(int(column), max(0, table.shape[1] - 2))
    down, right = row - r, column - c
    rows = (r, min(r + 1, table.shape[0] - 1))
    columns = (c, min(c + 1, table.shape[1] - 1))
    # Bilinear weights.
    share = (
        (1.0 - down) * (1.0 - right),
        (1.0 - down) * right,
        down * (1.0 - right),
        down * right,
    )
    return (
        _between(table, rows, columns, share, 0),
        _between(table, rows, columns, share, 1),
        _between(table, rows, columns, share, 2),
        _between(table, rows, columns, share, 3),
    )
