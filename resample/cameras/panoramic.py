"""Panoramic camera: an equirectangular picture of all directions."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.poses import pose_of, rigid
from resample.types import Doubles


@dataclass(frozen=True, eq=False)
class Equirectangular:
    """Camera with an equirectangular picture, twice as wide as high: longitude by latitude.

    The picture's center is ahead (+z), its left and right edges meet behind, and its top row is
    above (−y). Depth is the distance along the ray.

    Parameters
    ----------
    world_to_camera
        (4, 4) or (3, 4) rigid pose.

    Raises
    ------
    ValueError
        The pose is not rigid.

    Examples
    --------
    >>> from math import pi
    >>> from resample_warp3d import Equirectangular
    >>> turned = Equirectangular().turned(pi / 2)  # its right is ahead now
    >>> (turned.world_to_camera @ [1, 0, 0, 1])[2].round(3).item()
    1.0
    """

    world_to_camera: Doubles = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_to_camera", rigid(self.world_to_camera))

    def moved(self, world_to_camera: ArrayLike) -> "Equirectangular":
        """Camera with another pose."""
        return replace(self, world_to_camera=pose_of(world_to_camera))

    def turned(self, yaw: float, pitch: float = 0.0) -> "Equirectangular":
        """Rotated camera: to the right by `yaw`, or else up by `pitch`, rad."""
        return self.moved(turn(yaw, pitch) @ self.world_to_camera)


def check_panorama(shape: tuple[int, int]) -> None:
    """Reject frames (height, width) that are not twice as wide as high."""
    height, width = shape
    if width != 2 * height:
        raise ValueError(
            f"a panorama is twice as wide as high, not {width} x {height} px; give its size, such"
            f" as {2 * height}x{height}"
        )


def turn(yaw: float, pitch: float) -> Doubles:
    """Pose (4, 4) of a camera turned right by `yaw`, or up by `pitch` if that is not 0, rad."""
    pose = np.eye(4)
    cos, sin = math.cos(yaw), math.sin(yaw)
    pose[:3, :3] = [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]]
    if pitch:
        cos, sin = math.cos(pitch), math.sin(pitch)
        pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]]
    return pose


def rays_at(place: Doubles, shape: tuple[int, int]) -> Doubles:
    """Unit directions (..., 3) of positions (..., 2) in px; x right, y down, z ahead."""
    height, width = shape
    longitude = 2.0 * math.pi * (place[..., 0] / width - 0.5)
    latitude = math.pi * (0.5 - place[..., 1] / height)
    flat = np.cos(latitude)
    parts = flat * np.sin(longitude), -np.sin(latitude), flat * np.cos(longitude)
    return np.stack(parts, axis=-1)


def places_of(ray: Doubles, shape: tuple[int, int]) -> Doubles:
    """Positions (..., 2) in px where directions (..., 3) of any length are visible."""
    height, width = shape
    x, y, z = np.moveaxis(ray, -1, 0)
    longitude, latitude = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
    column = (longitude / (2.0 * math.pi) + 0.5) * width
    return np.stack([column, (0.5 - latitude / math.pi) * height], axis=-1)
