"""Cameras and their poses.

A camera looks along +z with x to the right and y down; poses map world to camera. The pixel in
row i, column j has its center at (j + 0.5, i + 0.5), so the middle of a frame of W pixels is at
W / 2, not at (W − 1) / 2 as in OpenCV's matrices.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles, View


class Camera(Protocol):
    """Role of a camera: it can describe itself to the kernels."""

    def view(self) -> View:
        """Pose and projection as arrays and numbers."""


def _identity() -> Doubles:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class Pinhole:
    """Perspective camera.

    Parameters
    ----------
    fx, fy
        Focal lengths, px.
    cx, cy
        Principal point, px.
    world_to_camera
        (4, 4) or (3, 4) rigid pose.
    near
        Depth of the near plane, scene units, 0 or more. A sample's kernel that the plane cuts is
        integrated from the plane on.

    Raises
    ------
    ValueError
        A focal length is not above 0, a number is not finite, or the pose is not rigid.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: Doubles = field(default_factory=_identity)
    near: float = 0.0

    def __post_init__(self) -> None:
        _check_numbers(self.fx, self.fy, self.cx, self.cy, self.near)
        if self.near < 0:
            raise ValueError(f"the near plane at {self.near} must not lie behind the eye")
        object.__setattr__(self, "world_to_camera", _rigid(self.world_to_camera))

    @classmethod
    def from_fov(
        cls,
        fov: float,
        *,
        height: int,
        width: int,
        world_to_camera: ArrayLike | None = None,
        near: float = 0.0,
    ) -> "Pinhole":
        """Camera with square pixels that sees `fov` degrees along the frame's shorter side."""
        if not 0 < fov < 180:
            raise ValueError(f"a field of view of {fov} degrees is not between 0 and 180")
        focal = min(height, width) / (2 * np.tan(np.radians(fov) / 2))
        pose = _identity() if world_to_camera is None else np.asarray(world_to_camera, np.float64)
        return cls(focal, focal, width / 2, height / 2, pose, near)

    def view(self) -> View:
        focal, principal = _pair(self.fx, self.fy), _pair(self.cx, self.cy)
        return _view(self.world_to_camera, focal, principal, self.near, perspective=True)


@dataclass(frozen=True, eq=False)
class Orthographic:
    """Parallel projection along the camera's axis.

    Parameters
    ----------
    sx, sy
        Scale, px per scene unit.
    cx, cy
        Where the camera's axis meets the frame, px.
    world_to_camera
        (4, 4) or (3, 4) rigid pose.
    near
        Depth of the near plane, scene units; may be negative.

    Raises
    ------
    ValueError
        A scale is not above 0, a number is not finite, or the pose is not rigid.
    """

    sx: float
    sy: float
    cx: float
    cy: float
    world_to_camera: Doubles = field(default_factory=_identity)
    near: float = 0.0

    def __post_init__(self) -> None:
        _check_numbers(self.sx, self.sy, self.cx, self.cy, self.near)
        object.__setattr__(self, "world_to_camera", _rigid(self.world_to_camera))

    def view(self) -> View:
        focal, principal = _pair(self.sx, self.sy), _pair(self.cx, self.cy)
        return _view(self.world_to_camera, focal, principal, self.near, perspective=False)


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Doubles:
    """Pose (4, 4) of a camera at `eye` that looks at `target` with `up` upwards in the picture.

    Raises
    ------
    ValueError
        Eye and target coincide, or a vector is not finite. `up` along the view is replaced by the
        axis farthest from it.
    """
    place = np.asarray(eye, np.float64)
    forward = np.asarray(target, np.float64) - place
    upward = np.asarray(up, np.float64)
    length = np.linalg.norm(forward)
    if not (np.isfinite(length) and length > 0 and np.isfinite(upward).all()):
        raise ValueError(f"a camera at {eye!r} cannot look at {target!r}")
    forward /= length
    right = np.cross(forward, upward)
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(upward))):
        right = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = _identity()
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ place
    return pose


def orbit(
    target: ArrayLike, distance: float, azimuth: float, elevation: float, up: str = "z"
) -> Doubles:
    """Pose (4, 4) of a camera on a sphere around `target`.

    Parameters
    ----------
    target
        (3,) point in the middle of the picture, scene units.
    distance
        Radius of the sphere, scene units, above 0.
    azimuth, elevation
        Degrees. At 0, 0 with `up` z the camera stands on the −y side and sees x to the right;
        growing azimuth walks it toward +x, growing elevation lifts it.
    up
        Axis that points upwards in the picture: x, y, z, −x, −y or −z.
    """
    upward, aside, front = _axes(up)
    a, e = np.radians(azimuth), np.radians(elevation)
    outward = np.cos(e) * (np.sin(a) * aside + np.cos(a) * front) + np.sin(e) * upward
    if abs(elevation) % 180 == 90:  # straight above: what was beyond comes up
        upward = -np.sign(np.sin(e)) * (np.sin(a) * aside + np.cos(a) * front)
    elif np.cos(e) < 0:  # past the pole
        upward = -upward
    place = np.asarray(target, np.float64) + distance * outward
    return look_at(place, target, upward)


def _axes(up: str) -> tuple[Doubles, Doubles, Doubles]:
    """Unit vectors upward, to the right and toward the camera at azimuth 0; right-handed."""
    name = up.replace("−", "-")
    if name.removeprefix("-") not in ("x", "y", "z"):
        raise ValueError(f"up is {up!r}; it can be x, y, z, -x, -y or -z")
    axis = "xyz".index(name[-1])
    sign = -1.0 if name.startswith("-") else 1.0
    upward = sign * np.eye(3)[axis]
    aside = np.eye(3)[(axis + 1) % 3]
    return upward, aside, np.cross(aside, upward)


def _check_numbers(first: float, second: float, *others: float) -> None:
    if not np.isfinite([first, second, *others]).all():
        raise ValueError(f"a camera's numbers must be finite, not {(first, second, *others)}")
    if first <= 0 or second <= 0:
        raise ValueError(f"a camera's scales must be above 0 px, not {first}, {second}")


def _rigid(pose: ArrayLike) -> Doubles:
    """Pose as (4, 4), checked to be a rotation and a shift."""
    given = np.asarray(pose, np.float64)
    if given.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a pose has shape (3, 4) or (4, 4), not {given.shape}")
    full = _identity()
    full[:3] = given[:3]
    rotation = full[:3, :3]
    straight = np.isfinite(full).all() and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    if not straight or np.linalg.det(rotation) < 0:
        raise ValueError("a pose must be a finite rotation and shift; this one scales or mirrors")
    return full


def _pair(first: float, second: float) -> Doubles:
    """Two numbers as kernels are compiled for them, whole or not."""
    return np.array([first, second], np.float64)


def _view(
    pose: Doubles, focal: Doubles, principal: Doubles, near: float, *, perspective: bool
) -> View:
    rotation, shift = pose[:3, :3].copy(), pose[:3, 3].copy()
    return View(rotation, shift, focal, principal, float(near), perspective)
