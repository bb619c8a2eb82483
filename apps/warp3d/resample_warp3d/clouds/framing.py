"""Cameras that look at clouds."""

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.types import Doubles
from resample_warp3d.clouds.cloud import Cloud, places
from resample_warp3d.clouds.spacing import Surfels

FIELD = 40.0  # degrees that `framed` sees along the frame's shorter side


def framed(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    azimuth: float = 0.0,
    elevation: float = 0.0,
    distance: float | None = None,
    up: str = "z",
) -> Camera:
    """Camera that looks at the middle of a cloud.

    Parameters
    ----------
    cloud
        What is looked at.
    size
        (height, width) px.
    azimuth, elevation, up
        Where the camera stands, degrees, and which axis points upward, as
        `resample.cameras.poses.orbit` takes them.
    distance
        From the middle, scene units. Left out, all of the cloud is within the frame.

    Raises
    ------
    ValueError
        The cloud has no points, or a number is none.
    """
    low, high = _box(cloud)
    radius = max(0.5 * float(np.linalg.norm(high - low)), 1e-12)
    height, width = size
    fov = np.radians(FIELD)
    away = radius / np.sin(0.5 * fov) if distance is None else distance
    if not (np.isfinite(away) and away > 0):
        raise ValueError(f"a distance of {distance}; give a length above 0")
    focal = min(height, width) / (2.0 * np.tan(0.5 * fov))
    matrix = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    return Camera(matrix, orbit(0.5 * (low + high), away, azimuth, elevation, up))


def _box(cloud: Cloud | Surfels) -> tuple[Doubles, Doubles]:
    """Least and greatest coordinates of all points."""
    position = cloud.position if isinstance(cloud, Surfels) else places(cloud)
    if not len(position):
        raise ValueError("a cloud without points cannot be looked at")
    origin = cloud.origin if isinstance(cloud, Surfels) else np.zeros(3)
    low, high = position.min(axis=0).astype(np.float64), position.max(axis=0).astype(np.float64)
    return low + origin, high + origin
