"""Light on surfaces, after Blinn and Phong."""

import math

from resample.engine.jit import kernel
from resample.engine.vectors import Vector, combine, dot, scaled
from resample.types import Lamp


@kernel
def _unit(v: Vector) -> Vector:
    """Vector of length 1; zero stays zero."""
    square = dot(v, v)
    return scaled(1.0 / math.sqrt(square), v) if square > 0.0 else v


@kernel
def _reflect(normal: Vector, place: Vector, lamp: Lamp) -> tuple[float, float]:
    """Factor of the sample's own color and white highlight, after Blinn and Phong.

    Both sides of a surface are lit alike, since a gradient may point in or out.
    """
    viewer = (lamp.viewer[0], lamp.viewer[1], lamp.viewer[2])
    eye = _unit(combine(viewer, -lamp.viewer[3], place))
    light = (lamp.toward[0], lamp.toward[1], lamp.toward[2])
    if dot(light, light) == 0.0:
        light = eye
    halfway = _unit(combine(eye, 1.0, light))
    own = lamp.ambient + lamp.diffuse * abs(dot(normal, light))
    return own, lamp.specular * abs(dot(normal, halfway)) ** lamp.shininess


@kernel
def lit(color: Vector, slope: Vector, place: Vector, lamp: Lamp) -> Vector:
    """Light that a surface sends to the viewer; a place without a slope shows its color.

    `slope` is the gradient whose direction is the surface's normal, `place` in scene axes.
    """
    length = math.sqrt(dot(slope, slope))
    own, highlight = lamp.ambient + lamp.diffuse, 0.0
    if length > lamp.flat:
        own, highlight = _reflect(scaled(1.0 / length, slope), place, lamp)
    return (
        max(own * color[0] + highlight, 0.0),
        max(own * color[1] + highlight, 0.0),
        max(own * color[2] + highlight, 0.0),
    )
