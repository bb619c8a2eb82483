"""Map pixels between a camera with a lens and one without.

Positions are (..., 2) px, x and y, with the first pixel's center at (0.5, 0.5).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera, Distortion, Fisheye, LensModel, Points, fisheye, project
from resample.cameras.models import distortion as distorting
from resample.cameras.poses import pose_of, rigid
from resample.types import Doubles

TOLERANCE = 1e-7  # px, for the position distorted again
BLOCK = 1 << 15  # points at a time, so that their arrays fit into the CPU cache

Move = Callable[[Doubles, Doubles], Points]  # maps points of the plane at distance 1


def pixel_centers(shape: tuple[int, int]) -> Doubles:
    """Centers of all pixels, (H, W, 2) px."""
    height, width = shape
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    return np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=2)


def directions(camera: Camera, place: Doubles) -> Doubles:
    """Points (..., 2) of the plane at distance 1 that a pinhole sees at positions (..., 2)."""
    back = np.linalg.inv(camera.matrix)
    return np.asarray(place @ back[:2, :2].T + back[:2, 2], np.float64)


def undistorted_places(
    camera: Camera,
    place: Doubles,
    ideal: Camera | None = None,
    rotation: Doubles | None = None,
) -> Doubles:
    """Undistort positions: from the camera's picture to a pinhole's, (..., 2) px.

    `rotation`: (3, 3) from the camera's axes to the pinhole's, OpenCV's R. Default: the identity.
    Result: (..., 2) px, NaN where no light passes the lens or the point is behind the pinhole.
    """
    moves: list[Move] = []
    if camera.distortion is not None:
        tolerance = TOLERANCE / max(abs(camera.fx), abs(camera.fy))
        moves.append(partial(_lens(camera, camera.distortion).unbend, tolerance=tolerance))
    if rotation is not None:
        moves.append(partial(project, rotation))
    return _moved(moves, place, camera, camera if ideal is None else ideal)


def distorted_places(
    camera: Camera,
    place: Doubles,
    ideal: Camera | None = None,
    rotation: Doubles | None = None,
) -> Doubles:
    """Distort positions: from a pinhole's picture to the camera's, (..., 2) px.

    Result: (..., 2) px, NaN behind the camera and beyond the fold of the lens.
    """
    moves: list[Move] = []
    if rotation is not None:
        moves.append(partial(project, rotation.T))
    if camera.distortion is not None:
        moves.append(_lens(camera, camera.distortion).bend)
    return _moved(moves, place, camera if ideal is None else ideal, camera)


def _lens(camera: Camera, distortion: Doubles) -> Distortion | Fisheye:
    """Lens of a camera."""
    return (fisheye if camera.model == LensModel.FISHEYE else distorting)(distortion)


def _moved(moves: Sequence[Move], place: Doubles, before: Camera, after: Camera) -> Doubles:
    """Map positions from one camera to another, by mappings of the plane at distance 1."""
    given = np.asarray(place, np.float64).reshape(-1, 2)
    found = np.empty_like(given)
    back, matrix = np.linalg.inv(before.matrix), after.matrix
    for n in range(0, len(given), BLOCK):
        column, row = given[n : n + BLOCK].T
        x = back[0, 0] * column + back[0, 1] * row + back[0, 2]
        y = back[1, 1] * row + back[1, 2]
        with np.errstate(over="ignore"):
            for move in moves:
                x, y = move(x, y)
        found[n : n + BLOCK, 0] = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]
        found[n : n + BLOCK, 1] = matrix[1, 1] * y + matrix[1, 2]
    return found.reshape(np.shape(place))


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
    >>> turned = Equirectangular().turned(pi / 2)  # what was on its right is ahead now
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
