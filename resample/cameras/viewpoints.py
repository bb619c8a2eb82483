"""Viewpoints: cameras that do not depend on the size of the picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias, cast

import numpy as np

from resample.calling import choice_meant
from resample.cameras.models import AnyCamera, Camera, Orthographic
from resample.cameras.poses import UpAxis, look_at, orbit
from resample.messages import check_numbers, parts_of, shortly
from resample.types import Doubles

AXES = ("x", "y", "z", "-x", "-y", "-z")
NAMED = {
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
    "corner": (45.0, 35.264389682754654),  # equal angles to all axes
}
MARGIN = 1.0  # px left free on either side of the sphere, along the picture's shorter side
FORM = (
    "a camera; azimuth and elevation, with or without a zoom and a pan, such as (30, 20), "
    f"(30, 20, 1.5) or (30, 20, 1.5, 0.1, -0.2); or one of {', '.join(NAMED)}"
)


class Sphere(NamedTuple):
    """Bounding sphere of the scene."""

    center: Doubles  # (3,) scene units
    radius: float  # scene units, > 0


@dataclass(frozen=True)
class Orbit:
    """A camera on a sphere around the center of the scene.

    Parameters
    ----------
    azimuth, elevation
        Degrees; see `resample.cameras.poses.orbit`.
    zoom
        At 1 the bounding sphere of the scene just fits the picture, with a margin of one pixel; at
        2 the camera is at half the distance, and a parallel one shows everything at twice the size.
    fov
        Field of view along the picture's shorter side in degrees; 0: parallel projection.
    up
        Axis that points up: x, y, z, -x, -y or -z.
    pan
        Shift of the picture's content to the right and up, as fractions of the picture's shorter
        side.

    Raises
    ------
    ValueError
        The zoom is not between 1e-6 and 1e6, the field of view is not in 0 to 180, an angle is not
        finite, `up` is not an axis, or the pan is not two numbers up to 1e6.

    Examples
    --------
    >>> from resample import Orbit
    >>> import numpy as np
    >>> import resample_volume
    >>> ball = np.full((8, 8, 8), 255, np.uint8)
    >>> resample_volume.render(ball, "100..300", Orbit(30, 20, zoom=1.5), size=(32, 24))
    Frame(32 × 24 px, 59.4 % covered, depth from 16.3)
    """

    azimuth: float = 30.0
    elevation: float = 20.0
    zoom: float = 1.0
    fov: float = 30.0
    up: UpAxis = "z"
    pan: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_numbers(self, "azimuth", "elevation", "zoom", "fov")
        if not 1e-6 <= self.zoom <= 1e6:  # beyond these float32 loses all digits
            raise ValueError(f"a zoom of {self.zoom:g}; it must be above 0, 1e-06 to 1e+06")
        if not 0 <= self.fov < 180:
            raise ValueError(f"a field of view of {self.fov} degrees; 0 to below 180 are allowed")
        if not abs(self.azimuth) + abs(self.elevation) < float("inf"):
            raise ValueError(
                f"azimuth {self.azimuth}, elevation {self.elevation}; both must be finite"
            )
        if self.up not in AXES:
            raise ValueError(f"up is {self.up!r}; it can be {', '.join(AXES)}")
        if len(self.pan) != 2 or not max(map(abs, self.pan)) <= 1e6:
            raise ValueError(f"a pan of {self.pan}; it must be two numbers up to 1e+06")

    def around(self, sphere: Sphere, height: int, width: int) -> Camera | Orthographic:
        """Camera for a picture of a size in px."""
        center, radius = sphere
        shorter = min(height, width)
        filled = max(shorter - 2 * MARGIN, shorter / 2) / shorter
        if self.fov == 0:
            side = 2 * radius / filled / self.zoom
            pose = self._pose(center, 2 * radius, side)
            return Orthographic(shorter / side, shorter / side, width / 2, height / 2, pose)
        half = np.radians(self.fov) / 2
        distance = radius / np.sin(np.arctan(filled * np.tan(half))) / self.zoom
        pose = self._pose(center, distance, 2 * distance * np.tan(half))
        return Camera.from_fov(self.fov, height, width, pose)

    def _pose(self, center: Doubles, distance: float, side: float) -> Doubles:
        """Pose (4, 4) at a distance from the center, where the picture is `side` wide."""
        pose = orbit(center, distance, self.azimuth, self.elevation, self.up)
        right, up = self.pan
        pose[:2, 3] += side * right, -side * up
        return pose


@dataclass(frozen=True)
class Spot:
    """A camera at a position in the scene, for a picture of any size."""

    eye: Sequence[float]  # (3,) scene units
    target: Sequence[float]  # (3,) scene units
    up: Sequence[float] = (0.0, 0.0, 1.0)  # (3,)
    fov: float = 30.0  # degrees along the picture's shorter side
    near: float = 0.0  # scene units

    def sized(self, height: int, width: int) -> Camera:
        """Camera for a picture of a size in px."""
        pose = look_at(self.eye, self.target, self.up)
        return Camera.from_fov(self.fov, height, width, pose, self.near)

    @classmethod
    def of(cls, world_to_camera: Doubles, fov: float) -> "Spot":
        """Camera with a pose (4, 4) and a field of view in degrees."""
        rotation, shift = world_to_camera[:3, :3], world_to_camera[:3, 3]
        eye = -rotation.T @ shift
        return cls(eye.tolist(), (eye + rotation[2]).tolist(), (-rotation[1]).tolist(), fov, 0.0)


class Calibrated(NamedTuple):
    """A camera with intrinsics for pictures of one size."""

    camera: Camera
    shape: tuple[int, int]  # height and width, px

    def sized(self, height: int, width: int) -> Camera:
        """Camera of the same view for a picture of another size in px."""
        return self.camera.resized(self.shape, (height, width))


Viewpoint: TypeAlias = Orbit | Spot | Calibrated | AnyCamera
Spelled: TypeAlias = Viewpoint | Sequence[float] | Sequence[Sequence[float]] | str | None


def camera_from(viewpoint: Viewpoint, sphere: Sphere, height: int, width: int) -> AnyCamera:
    """Camera of a viewpoint for a picture of a size in px.

    `height`, `width`: size of the picture, px.
    """
    if isinstance(viewpoint, Orbit):
        return viewpoint.around(sphere, height, width)
    if isinstance(viewpoint, Spot | Calibrated):
        return viewpoint.sized(height, width)
    return viewpoint


def viewpoint_of(given: Spelled) -> Viewpoint:
    """Convert a user's argument to a viewpoint.

    Parameters
    ----------
    given
        A camera or viewpoint, returned as it is; (azimuth, elevation) in degrees, optionally with a
        zoom and a pan to the right and up, also as a text `30,20,1.5`; a name of `NAMED`; an eye, a
        target and an up vector, scene units; None: `Orbit()`.

    Examples
    --------
    >>> viewpoint_of((30, 20)) == viewpoint_of("30,20")
    True
    >>> viewpoint_of("top").elevation
    90.0
    """
    if given is None:
        return Orbit()
    if isinstance(given, Orbit | Spot | Calibrated):
        return given
    if hasattr(given, "view") and not hasattr(given, "dtype"):
        return given
    if isinstance(given, str):
        if (name := choice_meant(given, NAMED)) in NAMED:
            return Orbit(*NAMED[name])
        return _orbit(parts_of(given), given)
    if isinstance(given, tuple) and given and np.shape(given[0]) == (3, 3):  # a matrix and a pose
        return Camera(np.asarray(given[0], np.float64), np.asarray(given[1], np.float64))
    if np.shape(given) == (3, 3):  # type: ignore[arg-type]
        eye, target, up = cast("Sequence[Sequence[float]]", given)
        return Spot(eye, target, up)
    if isinstance(given, Sequence) or hasattr(given, "__array__"):
        return _orbit(cast("Sequence[float]", given), given)
    raise TypeError(f"a camera of {type(given).__name__}; give {FORM}")


def orbit_of(text: str, fov: float = Orbit.fov, up: UpAxis = Orbit.up) -> Orbit | None:
    """Parse angles of the command line; None if the text holds none, but perhaps names a file.

    `fov`: field of view along the picture's shorter side in degrees, unless a file has it; 0:
    parallel projection, for angles only.
    """
    try:
        azimuth, elevation, *others = NAMED.get(text) or map(float, parts_of(text))
        zoom, right, above = {0: (1.0, 0.0, 0.0), 1: (*others, 0.0, 0.0)}.get(len(others), others)
    except ValueError:
        return None
    return Orbit(azimuth, elevation, zoom, fov, up, (right, above))


def is_file(text: str) -> bool:
    """Whether a text of the command line has no angles, and may name a file of cameras."""
    try:
        return orbit_of(text) is None
    except ValueError:  # angles, but wrong ones
        return False


def _orbit(parts: Sequence[object], given: object) -> Orbit:
    try:
        numbers = [float(part) for part in parts]  # type: ignore[arg-type]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) not in (2, 3, 5):
        raise ValueError(f"the camera {shortly(given)}; give {FORM}")
    azimuth, elevation, zoom = (*numbers, 1.0)[:3]
    right, up = numbers[3:] or (0.0, 0.0)
    return Orbit(azimuth, elevation, zoom, pan=(right, up))
