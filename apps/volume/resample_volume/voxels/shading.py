"""Shade voxels, with gradients as surface normals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from resample.types import Doubles, Floats, Lamp, Samples
from resample_volume.voxels.visible import Voxels

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera
    from resample.cameras.viewpoints import Sphere

FLAT = 1e-6  # of the steepest gradient: smaller ones are rounding and give no normal


@dataclass(frozen=True)
class Light:
    """A distant white light, and Blinn-Phong shading.

    Raises
    ------
    ValueError
        A direction of no length, or a number outside its range.

    Examples
    --------
    >>> from resample_volume import Appearance, Light
    >>> Light((1, -1, 2), shadows=True).ambient
    0.3
    >>> Appearance("bone", light=None).light is None  # colors as they are
    True
    """

    direction: tuple[float, float, float] | None = None  # toward the light; None: at the eye
    ambient: float = 0.3  # ambient share of the voxel's color, >= 0
    diffuse: float = 0.7  # diffuse share, which depends on the angle to the light, >= 0
    specular: float = 0.2  # strength of the specular highlight, white, >= 0
    shininess: float = 32.0  # the greater, the smaller the highlight, > 0
    shadows: bool = False  # whether voxels cast shadows; needs a direction
    occlusion: bool = False  # whether ambient light is dimmed where the surroundings are dense

    def __post_init__(self) -> None:
        if self.direction is not None:
            _unit("light direction", self.direction)
        for name in ("ambient", "diffuse", "specular"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be 0 or more (got {getattr(self, name)})")
        if not 0 < self.shininess < math.inf:
            raise ValueError(f"shininess must be greater than 0 (got {self.shininess})")
        if self.shadows and self.direction is None:
            raise ValueError(
                "a light at the eye casts no visible shadows; give it a direction, such as "
                "1/-1/2, or leave shadows out"
            )

    @property
    def is_blocked(self) -> bool:
        """Whether there are shadows or ambient occlusion."""
        return self.shadows or self.occlusion


@dataclass(frozen=True)
class DepthCue:
    """Fading of light with depth, which makes near parts stand out.

    Raises
    ------
    ValueError
        The fraction is not between 0 and 1.
    """

    share: float = 0.5  # fraction of light lost at the far end of what is visible, 0..1

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise ValueError(f"a depth cue takes a share from 0 to 1 (got {self.share})")


def cue_range(camera: "AnyCamera", sphere: "Sphere") -> tuple[float, float]:
    """Return the depths where cueing begins and ends, scene units: those of a sphere.

    Cueing begins at the near plane at the earliest.
    """
    view = camera.view()
    depth = float(view.rotation[2] @ sphere.center + view.translation[2])
    near = max(depth - sphere.radius, view.near)
    return near, max(depth, near) + sphere.radius


def along(position: Floats, axis: Floats | Doubles) -> Floats | Doubles:
    """Return products (N,) of positions (N, 3) and an axis, with rounding independent of N."""
    x, y, z = position.T
    return np.asarray(x * axis[0] + y * axis[1] + z * axis[2])


def cued(samples: Samples, camera: "AnyCamera", cue: DepthCue, near: float, far: float) -> Samples:
    """Fade samples linearly with depth.

    Parameters
    ----------
    samples
        Shaded; colors are multiplied by 1 up to `near` and by 1 - share from `far` on.
    """
    view = camera.view()
    forward, ahead = view.rotation[2].astype(np.float32), np.float32(view.translation[2] - near)
    depth = (along(samples.position, forward) + ahead) / np.float32(far - near)
    light = 1 - np.float32(cue.share) * np.clip(depth, 0, 1)
    return samples._replace(color=samples.color * light[:, np.newaxis])


def shade(
    voxels: Voxels,
    light: Light | None,
    eye: Sequence[float] | Doubles | None = None,
    *,
    view: Sequence[float] | Doubles | None = None,
    steepest: Floats | None = None,
) -> Samples:
    """Shade voxels: return samples with the light that they send to the viewer.

    Parameters
    ----------
    voxels
        With gradients, unless `light` is None. Shading is two-sided; a voxel without gradient is
        shaded as if it faced the light.
    light
        None leaves the colors as they are.
    eye
        (3,) scene position of a perspective camera.
    view
        (3,) scene direction of view of a parallel camera, instead of `eye`.
    steepest
        (N, 3) extreme components of all gradients, if these voxels are a part; see `lamp_of`.
    """
    color = voxels.color
    if light is not None and len(voxels.reached):
        color = _lit_with_shadows(voxels, light, viewer_of(eye, view), steepest)
    elif light is not None:
        color = _lit(voxels, light, viewer_of(eye, view), steepest)
    return Samples(voxels.position, color, voxels.extinction, voxels.lattice)


def viewer_of(
    eye: Sequence[float] | Doubles | None = None, view: Sequence[float] | Doubles | None = None
) -> Doubles:
    """Return the viewer for a `Lamp`, (4,): position and 1, or direction to the viewer and 0.

    Parameters and errors as of `shade`.
    """
    if eye is not None and view is None:
        return np.append(_finite("eye", eye), 1.0)
    if view is not None and eye is None:
        return np.append(-_unit("view", view), 0.0)
    raise ValueError("light needs the eye of a perspective or the view of a parallel camera")


def _lit(voxels: Voxels, light: Light, viewer: Doubles, steepest: Floats | None = None) -> Floats:
    from resample_volume.voxels.kernels.shading import shade_voxels

    if len(voxels.gradient) != len(voxels.position):
        raise ValueError("light needs gradients; classify with gradient='central' or 'sobel'")
    shaded = np.empty(voxels.color.shape, np.float32)
    lamp = lamp_of(light, viewer, voxels.gradient if steepest is None else steepest)
    shade_voxels(
        voxels.position.reshape(-1),
        voxels.color.reshape(-1),
        voxels.gradient.reshape(-1),
        lamp,
        shaded.reshape(-1),
    )
    return shaded


def _lit_with_shadows(
    voxels: Voxels, light: Light, viewer: Doubles, steepest: Floats | None = None
) -> Floats:
    """Do as `_lit`, with shadows and ambient occlusion."""
    of_lamp = _lit(voxels, replace(light, ambient=0.0), viewer, steepest)
    everywhere = np.float32(light.ambient) * voxels.color
    return voxels.reached[:, :1] * of_lamp + voxels.reached[:, 1:] * everywhere


def lamp_of(light: Light, viewer: Doubles, gradient: Floats) -> Lamp:
    """Convert a light for kernels.

    Parameters
    ----------
    viewer
        (4,) from `viewer_of`.
    gradient
        (N, 3) of all shaded voxels: gradients far below the steepest give no normal.
    """
    flat = FLAT * _steepest(gradient)
    toward = np.zeros(3) if light.direction is None else _unit("light direction", light.direction)
    numbers = (light.ambient, light.diffuse, light.specular, light.shininess, flat)
    return Lamp(toward, viewer, *map(float, numbers))


def _steepest(gradient: Floats) -> float:
    """Return the greatest component, which is at least 1 / √3 of the greatest length."""
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
