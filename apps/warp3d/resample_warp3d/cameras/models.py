"""Calibrated cameras: any 3 × 3 matrix of intrinsics, a pose, and a lens.

Cameras look along +z, x to the right and y down; poses map world to camera, scene units. Other
conventions are turned into this one where they come in.
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles
from resample_warp3d.cameras.lens import COUNTS, bend, fold, unbend

ROUNDED = 2e-4  # largest error of R Rᵀ that four decimals in a text file leave
TOLERANCE = 1e-7  # px, of a place put through the lens again
OPENGL_AXES = np.diag([1.0, -1.0, -1.0, 1.0])


class Convention(StrEnum):
    """Where the first pixel's center lies."""

    CORNER = "corner"  # at (0.5, 0.5): coordinates count from the corner of the picture
    OPENCV = "opencv"  # at (0, 0): they count from the center of its first pixel


def _identity() -> Doubles:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class Camera:
    """Pinhole with any matrix of intrinsics, and the lens before it.

    Parameters
    ----------
    matrix
        (3, 3) intrinsics that take camera axes to px (x, y, 1), pixel centers at + 0.5: upper
        triangular with 1 last; fx and fy may be negative, skew may be there.
    world_to_camera
        (4, 4) or (3, 4) rigid pose. Errors of rounding, as text files have them, are taken out.
    distortion
        (4,), (5,), (8,), (12,) or (14,) OpenCV's k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3,
        s4 [, τx, τy]]]]; None, or all 0, is none.

    Raises
    ------
    ValueError
        The matrix is singular or no intrinsics, a number is not finite, the pose is not rigid (the
        message says how far it is), or the count of coefficients is another.
    """

    matrix: Doubles
    world_to_camera: Doubles = field(default_factory=_identity)
    distortion: Doubles | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", _intrinsics(self.matrix))
        object.__setattr__(self, "world_to_camera", rigid(self.world_to_camera))
        object.__setattr__(self, "distortion", _coefficients(self.distortion))

    @classmethod
    def from_intrinsics(  # noqa: PLR0913 - the numbers are one camera's, as its file lists them
        cls,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        *,
        skew: float = 0.0,
        world_to_camera: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        convention: Convention | str = Convention.CORNER,
    ) -> "Camera":
        """Camera of focal lengths, principal point and skew, px.

        Parameters
        ----------
        fx, fy, cx, cy, skew
            Entries of the matrix.
        world_to_camera, distortion
            As the class takes them.
        convention
            Where cx and cy count from.

        Raises
        ------
        ValueError
            As of the class; or the convention is unknown.
        """
        if convention not in tuple(Convention):
            raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
        offset = 0.5 if convention == Convention.OPENCV else 0.0
        matrix = np.array([[fx, skew, cx + offset], [0.0, fy, cy + offset], [0.0, 0.0, 1.0]])
        pose = _identity() if world_to_camera is None else np.asarray(world_to_camera, np.float64)
        given = None if distortion is None else np.asarray(distortion, np.float64)
        return cls(matrix, pose, given)

    @classmethod
    def from_fov(
        cls, fov: float, height: int, width: int, world_to_camera: ArrayLike | None = None
    ) -> "Camera":
        """Camera with square pixels that sees `fov` degrees along the frame's shorter side."""
        if not 0 < fov < 180:
            raise ValueError(f"a field of view of {fov} degrees is not between 0 and 180")
        focal = min(height, width) / (2 * math.tan(math.radians(fov) / 2))
        return cls.from_intrinsics(
            focal, focal, width / 2, height / 2, world_to_camera=world_to_camera
        )

    def moved(self, world_to_camera: ArrayLike) -> "Camera":
        """Camera with another pose."""
        return replace(self, world_to_camera=np.asarray(world_to_camera, np.float64))

    def resized(self, old_shape: tuple[int, int], new_shape: tuple[int, int]) -> "Camera":
        """Camera of the same view in a frame of another (height, width), px."""
        (old_height, old_width), (height, width) = old_shape, new_shape
        if min(old_height, old_width, height, width) < 1:
            raise ValueError(f"a camera cannot be resized from {old_shape} to {new_shape} px")
        scale = np.diag([width / old_width, height / old_height, 1.0])
        return replace(self, matrix=scale @ self.matrix)


def undistorted_places(camera: Camera, shape: tuple[int, int]) -> Doubles:
    """Where the camera without its distortion would see what each pixel shows.

    Parameters
    ----------
    camera
        Camera that took the picture.
    shape
        Height and width of the picture, px.

    Returns
    -------
    (H, W, 2) px, not a number where no light comes through the lens; (0, 0, 2) if the camera has no
    distortion.
    """
    if camera.distortion is None:
        return np.empty((0, 0, 2))
    place = pixel_centers(shape)
    tolerance = TOLERANCE / np.abs(np.diag(camera.matrix)[:2]).max()
    point = unbend(camera.distortion, directions(camera, place).reshape(-1, 2), tolerance)
    return _to_px(camera, point).reshape(place.shape)


def distorted_places(camera: Camera, place: Doubles) -> Doubles:
    """Where the camera sees what it would see at `place` (..., 2) without distortion, px.

    Not a number beyond where the lens begins to turn points back.
    """
    if camera.distortion is None:
        return place
    point = directions(camera, place).reshape(-1, 2)
    is_seen = np.hypot(point[:, 0], point[:, 1]) < fold(camera.distortion)
    bent = np.where(is_seen[:, None], bend(camera.distortion, point).point, np.nan)
    return _to_px(camera, bent).reshape(place.shape)


def pixel_centers(shape: tuple[int, int]) -> Doubles:
    """Centers of all pixels, (H, W, 2) px."""
    height, width = shape
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    return np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=2)


def directions(camera: Camera, place: Doubles) -> Doubles:
    """Points of the plane at distance 1 (..., 2) that a pinhole sees at places (..., 2) px."""
    back = np.linalg.inv(camera.matrix)
    return np.asarray(place @ back[:2, :2].T + back[:2, 2], np.float64)


def camera_to_world(pose: ArrayLike) -> Doubles:
    """Pose (4, 4) the other way round; of a camera-to-world pose, the world-to-camera one."""
    given = rigid(pose)
    back = _identity()
    back[:3, :3] = given[:3, :3].T
    back[:3, 3] = -given[:3, :3].T @ given[:3, 3]
    return back


def from_opengl(pose: ArrayLike) -> Doubles:
    """Pose of a camera-to-world one whose camera has y up and looks along −z (OpenGL, NeRF)."""
    return OPENGL_AXES @ camera_to_world(pose)


def rigid(pose: ArrayLike) -> Doubles:
    """Pose (4, 4), checked to be a rotation and a shift, without its errors of rounding.

    Parameters
    ----------
    pose
        (3, 4) or (4, 4).

    Raises
    ------
    ValueError
        It is not rigid; the message says how far it is.
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
    full = _identity()
    full[:3, 3] = given[:3, 3]
    full[:3, :3] = _rotation(given[:3, :3])
    return full


def _rotation(given: Doubles) -> Doubles:
    """Rotation nearest to a matrix (3, 3) that is one but for rounding."""
    deviation = float(np.abs(given @ given.T - np.eye(3)).max())
    if deviation > ROUNDED:
        raise ValueError(
            f"the pose's rotation is not orthonormal: R Rᵀ is off by up to {deviation:.3g}, allowed"
            f" is {ROUNDED:g}; take out scale and shear"
        )
    if np.linalg.det(given) < 0:
        raise ValueError(
            "the pose mirrors the scene (determinant −1); turn one axis of the camera round"
        )
    if deviation < 1e-14:
        return given
    left, _, right = np.linalg.svd(given)
    return np.asarray(left @ right, np.float64)


def _intrinsics(given: ArrayLike) -> Doubles:
    """Matrix of intrinsics, checked."""
    matrix = np.array(given, np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f"intrinsics have shape (3, 3), not {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise ValueError(f"intrinsics are finite numbers, not {matrix.tolist()}")
    if matrix[1, 0] or not np.array_equal(matrix[2], [0.0, 0.0, 1.0]):
        raise ValueError(
            f"intrinsics are [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], not {matrix.tolist()}"
        )
    if matrix[0, 0] == 0 or matrix[1, 1] == 0:
        raise ValueError(
            f"intrinsics with fx {matrix[0, 0]:g} and fy {matrix[1, 1]:g} are singular; neither can"
            " be 0"
        )
    return matrix


def _coefficients(given: ArrayLike | None) -> Doubles | None:
    """Coefficients of a lens, checked; None if it does nothing."""
    if given is None:
        return None
    coefficients = np.array(given, np.float64).ravel()
    if coefficients.size not in COUNTS or not np.isfinite(coefficients).all():
        counts = ", ".join(str(count) for count in COUNTS)
        raise ValueError(f"a lens has {counts} finite coefficients, not {coefficients.tolist()}")
    return coefficients if coefficients.any() else None


def _to_px(camera: Camera, point: Doubles) -> Doubles:
    """Where a pinhole sees points (N, 2) of the plane at distance 1."""
    return point @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
