"""Cameras that look at clouds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.cameras.viewpoints import Sphere
from resample.resampler import shape_of
from resample.types import Doubles, Floats
from resample_warp3d.clouds.cloud import Cloud, places
from resample_warp3d.clouds.spacing import Surfels

FIELD = 40.0  # degrees that `framed` sees along the frame's shorter side
FILLED = 0.95  # of the frame's width or height, by what is visible
DIRECTIONS = 25  # of all that a film looks along, which its distance is made for
LEAST = 1e-12  # scene units from the eye to what it looks at
STRAY = 0.01  # of all points: clumps that stand apart and hold less than this are not framed
PER_CELL = 8  # points, on average, if they were spread evenly in the box around them
LEAST_CELLS, MOST_CELLS = 3, 32  # along the longest side of the box

Flags = NDArray[np.bool_]


class Framing(NamedTuple):
    """What of a cloud a frame should hold."""

    position: Doubles  # (N, 3)
    axes: Floats  # (N, 2, 3) half axes of the discs; or (0, 2, 3)
    reach: float  # scene units, how far the largest disc reaches

    def farthest(self, along: Doubles) -> float:
        """Greatest product of a direction (3,) and a place on a disc."""
        center = self.position @ along
        if not len(self.axes):
            return float(center.max())
        near = center >= center.max() - self.reach * np.linalg.norm(along)
        return float((center[near] + np.linalg.norm(self.axes[near] @ along, axis=1)).max())


def framed(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    azimuth: float = 0.0,
    elevation: float = 0.0,
    distance: float | None = None,
    up: str = "z",
    fov: float = FIELD,
) -> Camera:
    """Camera that looks at a cloud.

    Clumps of points that stand apart from all others are not waited for, if they hold less than a
    hundredth of the points together.

    Parameters
    ----------
    cloud
        What is looked at.
    size
        Width and height of the picture, px.
    azimuth, elevation, up
        Where the camera stands, degrees, and which axis points upward, as
        `resample.cameras.poses.orbit` takes them.
    distance
        From the middle of the box around the points, scene units. Left out, the camera stands
        where what it sees of the points fills the frame and is in its middle.
    fov
        Degrees along the frame's shorter side.

    Raises
    ------
    ValueError
        The cloud has no points, or a number is none.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Cloud, framed
    >>> place = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    >>> cloud = Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    >>> camera = framed(cloud, size=(64, 48), azimuth=30, elevation=20)
    >>> pose = camera.world_to_camera
    >>> x, y, z = camera.matrix @ (pose[:3, :3] @ place.T + pose[:3, 3:])
    >>> round(np.ptp(y / z).item() / 48, 2)  # of the picture's height
    0.95
    """
    seen = _visible(cloud)
    camera = _camera(size, fov)
    if distance is None:
        pose = orbit(np.zeros(3), 1.0, azimuth, elevation, up)
        pose[:3, 3] = -_eye(seen, pose[:3, :3], _slopes(camera, size))
        return camera.moved(pose)
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"a distance of {distance}; give a length above 0")
    return camera.moved(orbit(_middle(seen.position), distance, azimuth, elevation, up))


def framed_together(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    angles: Sequence[tuple[float, float]],
    up: str = "z",
    fov: float = FIELD,
) -> list[Camera]:
    """Cameras at one distance from the middle of a cloud, from which all of them see all of it.

    Parameters
    ----------
    cloud, size, up, fov
        As `framed` takes them.
    angles
        Azimuth and elevation of each, degrees.

    Raises
    ------
    ValueError
        As of `framed`.
    """
    seen = _visible(cloud)
    middle, camera = _middle(seen.position), _camera(size, fov)
    slope = _slopes(camera, size)
    around = seen._replace(position=seen.position - middle)
    away = LEAST
    for pair in _some(angles):
        sides = _sides(around, orbit(np.zeros(3), 1.0, *pair, up)[:3, :3], slope)
        away = max(away, float((sides / slope).max()))
    return [camera.moved(orbit(middle, away, *pair, up)) for pair in angles]


def ball_around(cloud: Cloud | Surfels) -> Sphere:
    """Middle of what is visible of a cloud and how far it reaches, scene units.

    Raises
    ------
    ValueError
        The cloud has no points.
    """
    seen = _visible(cloud)
    middle = _middle(seen.position)
    away = float(np.linalg.norm(seen.position - middle, axis=1).max())
    return Sphere(middle, max(away + seen.reach, LEAST))


def _some(angles: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Angles that stand for all: of an orbit, cosines between two change by under a hundredth."""
    each = sorted(set(angles))
    return [each[n] for n in np.linspace(0, len(each) - 1, min(len(each), DIRECTIONS)).astype(int)]


def _camera(size: tuple[int, int], fov: float) -> Camera:
    if not 0 < fov < 180:
        raise ValueError(f"a field of view of {fov:g} degrees; clouds are seen in perspective")
    return Camera.from_fov(fov, *shape_of(size))


def _slopes(camera: Camera, size: tuple[int, int]) -> Doubles:
    """Tangents (2,) of half the angles, across and down, that points should be seen within."""
    return 0.5 * FILLED * np.array([size[0] / camera.fx, size[1] / camera.fy], np.float64)


def _sides(seen: Framing, axes: Doubles, slope: Doubles) -> Doubles:
    """Where sides of the frame touch a cloud: right and bottom, left and top; (2, 2).

    `axes` (3, 3) holds the camera's in its rows. A place p is within a side of a frame that the
    origin sees if ± x − slope z ≤ 0 and, seen by an eye e, if that is at most ± x − slope z of e.
    """
    touched = np.zeros((2, 2))
    for k in range(2):
        for n, sign in enumerate((1.0, -1.0)):
            touched[n, k] = seen.farthest(sign * axes[k] - slope[k] * axes[2])
    return touched


def _eye(seen: Framing, axes: Doubles, slope: Doubles) -> Doubles:
    """Nearest place (3,) of an eye, along its own axes, that has all points within its sides."""
    right, left = _sides(seen, axes, slope)
    depth = float((-(right + left) / (2.0 * slope)).min())
    depth = min(depth, -seen.farthest(-axes[2]) - LEAST)
    return np.array([*(0.5 * (right - left)), depth])


def _middle(points: Doubles) -> Doubles:
    """Middle of the box around points."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)), np.float64)


def _visible(cloud: Cloud | Surfels) -> Framing:
    """Points of a cloud without those that stand apart."""
    position = cloud.position if isinstance(cloud, Surfels) else places(cloud)
    if not len(position):
        raise ValueError("a cloud without points cannot be looked at")
    kept = np.arange(len(position))
    stray = int(STRAY * len(position))  # how many may be left out in all
    while stray > 0:
        is_near = _together(position[kept], stray)
        if is_near.all():
            break
        stray -= len(kept) - int(is_near.sum())
        kept = kept[is_near]
    if isinstance(cloud, Surfels):
        reach = np.linalg.norm(cloud.axes[kept], axis=(1, 2)).max()
        return Framing(cloud.position[kept] + cloud.origin, cloud.axes[kept], float(reach))
    return Framing(np.asarray(position[kept], np.float64), np.zeros((0, 2, 3), np.float32), 0.0)


def _together(position: Floats | Doubles, most: int) -> Flags:
    """Which points are not in one of the smallest clumps, which hold at most so many together.

    Clumps are points in cells that touch, of a lattice over the box around all points.
    """
    from scipy import ndimage

    count = round((len(position) / PER_CELL) ** (1 / 3))
    cells = min(max(count, LEAST_CELLS), MOST_CELLS)
    low = position.min(axis=0).astype(np.float64)
    side = float((position.max(axis=0) - low).max()) / cells or 1.0
    cell = np.minimum((position - low) / side, cells - 1).astype(np.int64)
    where = np.ravel_multi_index(tuple(cell.T), (cells,) * 3)
    held = np.bincount(where, minlength=cells**3)
    clump, _ = ndimage.label(held.reshape((cells,) * 3) > 0, np.ones((3, 3, 3)))
    holds = np.bincount(clump.ravel(), held).astype(np.int64)
    order = np.argsort(holds, kind="stable")
    is_stray = np.zeros(len(holds), np.bool_)
    is_stray[order] = np.cumsum(holds[order]) <= most
    kept: Flags = ~is_stray[clump.ravel()[where]]
    return kept
