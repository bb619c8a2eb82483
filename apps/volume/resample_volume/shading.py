"""Light on voxels: their gradients are the normals of the surfaces that they lie on."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resample.types import Doubles, Floats, Lamp, Samples
from resample_volume.voxels import Voxels

FLAT = 1e-6  # of the steepest gradient: what is less steep is rounding and has no normal


@dataclass(frozen=True)
class Light:
    """A white light far away and what voxels do with it, after Blinn and Phong.

    Raises
    ------
    ValueError
        A direction of no length, or a number outside its range.
    """

    direction: tuple[float, float, float] | None = None  # toward the light; None: at the eye
    ambient: float = 0.3  # share of the voxel's color that is always seen, >= 0
    diffuse: float = 0.7  # share that depends on the angle to the light, >= 0
    specular: float = 0.2  # strength of the white highlight, >= 0
    shininess: float = 32.0  # the greater, the smaller the highlight, > 0

    def __post_init__(self) -> None:
        if self.direction is not None:
            _unit("light direction", self.direction)
        for name in ("ambient", "diffuse", "specular"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be 0 or more (got {getattr(self, name)})")
        if not 0 < self.shininess < math.inf:
            raise ValueError(f"shininess must be greater than 0 (got {self.shininess})")


def shade(
    voxels: Voxels,
    light: Light | None,
    eye: Sequence[float] | Doubles | None = None,
    *,
    view: Sequence[float] | Doubles | None = None,
) -> Samples:
    """Voxels as samples that carry the light which they send to the viewer.

    Parameters
    ----------
    voxels
        With gradients, unless `light` is None. Both sides of a surface are lit alike; a voxel
        without a gradient has no surface and shows its color as if it faced the light.
    light
        None leaves the colors as they are.
    eye
        (3,) scene position of a perspective camera.
    view
        (3,) scene direction in which a parallel camera looks; takes the place of `eye`.

    Raises
    ------
    ValueError
        There are no gradients, or not exactly one of `eye` and `view`.
    """
    color = voxels.color if light is None else _lit(voxels, light, _viewer(eye, view))
    return Samples(voxels.position, color, voxels.extinction, voxels.lattice)


def _viewer(
    eye: Sequence[float] | Doubles | None, view: Sequence[float] | Doubles | None
) -> Doubles:
    """Position and 1, or direction to the viewer and 0."""
    if eye is not None and view is None:
        return np.append(_finite("eye", eye), 1.0)
    if view is not None and eye is None:
        return np.append(-_unit("view", view), 0.0)
    raise ValueError("light needs the eye of a perspective or the view of a parallel camera")


def _lit(voxels: Voxels, light: Light, viewer: Doubles) -> Floats:
    from resample.kernels.lighting import shade_samples

    if len(voxels.gradient) != len(voxels.position):
        raise ValueError("light needs gradients; classify with gradient='central' or 'sobel'")
    shaded = np.empty_like(voxels.color)
    lamp = _lamp(light, viewer, FLAT * _steepest(voxels.gradient))
    shade_samples(voxels.position, voxels.color, voxels.gradient, lamp, shaded)
    return shaded


def _lamp(light: Light, viewer: Doubles, flat: float) -> Lamp:
    toward = np.zeros(3) if light.direction is None else _unit("light direction", light.direction)
    numbers = (light.ambient, light.diffuse, light.specular, light.shininess, flat)
    return Lamp(toward, viewer, *map(float, numbers))


def _steepest(gradient: Floats) -> float:
    """Greatest component, which is at least 1 / √3 of the greatest length."""
    return max(float(gradient.max()), -float(gradient.min())) if gradient.size else 0.0


def _finite(name: str, vector: Sequence[float] | Doubles) -> Doubles:
    array = np.asarray(vector, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers (got {vector})")
    return array


def _unit(name: str, vector: Sequence[float] | Doubles) -> Doubles:
    array = _finite(name, vector)
    length = np.linalg.norm(array)
    if not length:
        raise ValueError(f"{name} must not be of length 0")
    return np.asarray(array / length)
