"""Rigid poses that map world to camera, and conversions from other conventions.

A camera looks along +z with x to the right and y down.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from resample.messages import doubles_of, number
from resample.types import Doubles

ROUNDED = 2e-4  # largest error of R Rᵀ from rounding to four decimals
QUATERNION = 1e-3  # largest error of a quaternion's length from rounding to three decimals
OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Doubles:
    """Pose (4, 4) of a camera at `eye` that looks at `target`, with `up` upwards in the picture.

    Raises
    ------
    ValueError
        Eye and target coincide, or a vector is not finite. (An `up` along the view is replaced by
        the axis farthest from it.)

    Examples
    --------
    >>> from resample import look_at
    >>> right, down, ahead, _ = look_at((0, -4, 0), (0, 0, 0)) @ [1, 0, 0, 1]
    >>> round(float(right), 3), round(float(ahead), 3)  # a point at x = 1, from 4 units away
    (1.0, 4.0)
    """
    place = doubles_of("eye", eye, "3 numbers")
    forward = doubles_of("target", target, "3 numbers") - place
    upward = doubles_of("up", up, "3 numbers")
    length = np.linalg.norm(forward)
    if not (np.isfinite(length) and length > 0 and np.isfinite(upward).all()):
        raise ValueError(f"a camera at {eye!r} cannot look at {target!r}")
    forward /= length
    right = np.cross(forward, upward)
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(upward))):
        right = np.cross(forward, np.eye(3)[np.argmin(np.abs(forward))])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ place
    return pose


def orbit(
    target: ArrayLike, distance: float, azimuth: float, elevation: float, up: UpAxis = "z"
) -> Doubles:
    """Pose (4, 4) of a camera on a sphere around `target`.

    Parameters
    ----------
    target
        (3,) point at the center of the picture, scene units.
    distance
        Radius of the sphere, scene units, above 0.
    azimuth, elevation
        Degrees. At 0, 0 with `up` z the camera is on the −y side with x to the right; increasing
        azimuth moves it toward +x, increasing elevation raises it.
    up
        Axis that points upwards in the picture: x, y, z, −x, −y or −z.

    Examples
    --------
    >>> from resample import orbit
    >>> pose = orbit((1, 2, 3), distance=10, azimuth=30, elevation=20)
    >>> round(float((pose @ [1, 2, 3, 1])[2]), 3)  # the target is so far ahead
    10.0
    """
    upward, aside, front = _axes(up)
    a, e = np.radians(azimuth), np.radians(elevation)
    outward = np.cos(e) * (np.sin(a) * aside + np.cos(a) * front) + np.sin(e) * upward
    if abs(elevation) % 180 == 90:  # at a pole: what lies beyond it is up
        upward = -np.sign(np.sin(e)) * (np.sin(a) * aside + np.cos(a) * front)
    elif np.cos(e) < 0:  # past the pole
        upward = -upward
    place = doubles_of("target", target, "3 numbers") + number("distance", distance) * outward
    return look_at(place, target, upward)


def pose_of(given: ArrayLike) -> Doubles:
    """Return a user's pose as an array; `rigid` checks it further."""
    return doubles_of("pose", given, "numbers of the shape (3, 4) or (4, 4)")


def rigid(pose: ArrayLike) -> Doubles:
    """Check that a pose is a rotation and a shift; return it (4, 4), rounding errors corrected.

    `pose`: (3, 4) or (4, 4).
    """
    given = np.array(pose, np.float64)
    if given.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a pose has shape (3, 4) or (4, 4), not {given.shape}")
    if not np.isfinite(given).all():
        raise ValueError(f"a pose has finite numbers, not {given.tolist()}")
    if len(given) == 4 and not np.array_equal(given[3], [0.0, 0.0, 0.0, 1.0]):
        raise ValueError(
            f"a pose's last row is 0 0 0 1, not {' '.join(f'{number:g}' for number in given[3])};"
            " is it transposed?"
        )
    full = np.eye(4)
    full[:3, 3] = given[:3, 3]
    full[:3, :3] = _rotation(given[:3, :3], "the pose's rotation")
    return full


def turned_by(rotation: ArrayLike) -> Doubles:
    """Check a rotation (3, 3) and return it with rounding errors corrected."""
    given = np.array(rotation, np.float64)
    if given.shape != (3, 3) or not np.isfinite(given).all():
        raise ValueError(f"a rotation is a matrix (3, 3) of finite numbers, not {given.tolist()}")
    return _rotation(given, "the rotation")


def camera_to_world(pose: ArrayLike) -> Doubles:
    """Invert a pose (4, 4): camera-to-world from world-to-camera, and vice versa."""
    given = rigid(pose)
    back = np.eye(4)
    back[:3, :3] = given[:3, :3].T
    back[:3, 3] = -given[:3, :3].T @ given[:3, 3]
    return back


def from_opengl(pose: ArrayLike) -> Doubles:
    """Convert a camera-to-world pose with y up and view along −z (OpenGL, NeRF)."""
    return OPENGL_AXES @ camera_to_world(pose)


def from_quaternion(numbers: Sequence[float]) -> Doubles:
    """Rotation (3, 3) from a quaternion x, y, z, w."""
    given = np.array(numbers, np.float64)
    length = float(np.linalg.norm(given))
    if not abs(length - 1.0) <= QUATERNION:
        raise ValueError(f"the quaternion {given.tolist()} has length {length:.4g} instead of 1")
    x, y, z, w = given / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _axes(up: str) -> tuple[Doubles, Doubles, Doubles]:
    """Unit vectors up, right and toward the camera at azimuth 0; right-handed."""
    name = up.replace("−", "-")
    if name.removeprefix("-") not in ("x", "y", "z"):
        raise ValueError(f"up is {up!r}; it can be x, y, z, -x, -y or -z")
    axis = "xyz".index(name[-1])
    sign = -1.0 if name.startswith("-") else 1.0
    upward = sign * np.eye(3)[axis]
    aside = np.eye(3)[(axis + 1) % 3]
    return upward, aside, np.cross(aside, upward)


def _rotation(given: Doubles, name: str) -> Doubles:
    """Nearest rotation to a matrix (3, 3) that is one up to rounding."""
    deviation = float(np.abs(given @ given.T - np.eye(3)).max())
    if deviation > ROUNDED:
        raise ValueError(
            f"{name} is not orthonormal: R Rᵀ is off by up to {deviation:.3g}, allowed"
            f" is {ROUNDED:g}; take out scale and shear"
        )
    if np.linalg.det(given) < 0:
        raise ValueError(f"{name} mirrors the scene (determinant −1); flip one axis of the camera")
    if deviation < 1e-14:
        return given
    left, _, right = np.linalg.svd(given)
    return np.asarray(left @ right, np.float64)
