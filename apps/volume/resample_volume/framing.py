"""Cameras around a volume: by angles, or from a TOML file."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from resample_volume.types import Volume

if TYPE_CHECKING:
    from resample.cameras import Camera
    from resample.types import Doubles, View
    from resample_volume.fields import FieldVoxels
    from resample_volume.voxels import Voxels


FARTHEST = 1e15  # scene units from the origin; its square, in px, is still a float32
AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Orbit:
    """A camera on a sphere around the middle of what is visible.

    Parameters
    ----------
    azimuth, elevation
        Degrees; see `resample.cameras.orbit`.
    zoom
        At 1 the sphere around all visible voxels just fits the picture; at 2 the camera is at half
        the distance, and a parallel one shows everything at twice the size.
    fov
        Degrees along the picture's shorter side; 0 is parallel projection.
    up
        Axis that points upwards: x, y, z, -x, -y or -z.

    Raises
    ------
    ValueError
        The zoom is not between 1e-6 and 1e6, the field of view is not in 0 to 180, an angle is not
        finite, or `up` is no axis.
    """

    azimuth: float = 30.0
    elevation: float = 20.0
    zoom: float = 1.0
    fov: float = 30.0
    up: str = "z"

    def __post_init__(self) -> None:
        if not 1e-6 <= self.zoom <= 1e6:  # beyond, float32 has no digits left
            raise ValueError(f"a zoom of {self.zoom:g}; it must be above 0, 1e-06 to 1e+06")
        if not 0 <= self.fov < 180:
            raise ValueError(f"a field of view of {self.fov} degrees; 0 to below 180 are allowed")
        if not abs(self.azimuth) + abs(self.elevation) < float("inf"):
            raise ValueError(
                f"azimuth {self.azimuth}, elevation {self.elevation}; both must be finite"
            )
        if self.up not in AXES:
            raise ValueError(f"up is {self.up!r}; it can be {', '.join(AXES)}")

    def around(self, sphere: "Sphere", height: int, width: int) -> "Camera":
        """Camera for a picture of that size in px."""
        import numpy as np

        from resample.cameras import Orthographic, Pinhole, orbit

        center, radius = sphere
        if self.fov == 0:
            scale = min(height, width) / (2 * radius) * self.zoom
            pose = orbit(center, 2 * radius, self.azimuth, self.elevation, self.up)
            return Orthographic(scale, scale, width / 2, height / 2, pose)
        distance = radius / np.sin(np.radians(self.fov) / 2) / self.zoom
        pose = orbit(center, distance, self.azimuth, self.elevation, self.up)
        return Pinhole.from_fov(self.fov, height=height, width=width, world_to_camera=pose)


class Sphere(NamedTuple):
    """A ball that holds what is to be seen."""

    center: "Doubles"  # (3,) scene units
    radius: float  # scene units, > 0


def sphere_around(voxels: "Voxels | FieldVoxels", volume: Volume) -> Sphere:
    """Ball around all visible voxels, or around the volume where none is visible.

    Raises
    ------
    ValueError
        It is larger than float32 can reckon with.
    """
    import numpy as np

    voxel = float(np.linalg.norm(voxels.lattice, axis=0).max())
    position = voxels.position
    if not position.size:
        last = np.array(volume.values.shape[::-1]) - 1
        ends = volume.origin + np.stack([last * 0, last]) @ voxels.lattice.T
        position = ends.astype(np.float32)
    low, high = position.min(axis=0).astype(np.float64), position.max(axis=0).astype(np.float64)
    if not np.abs([low, high]).max() < FARTHEST:
        raise ValueError(
            f"the volume reaches from {low} to {high} scene units; {FARTHEST:g} is the most, so "
            "give another spacing"
        )
    center = (low + high) / 2
    away = position - center.astype(np.float32)
    farthest = float(np.sqrt(np.einsum("nd,nd->n", away, away).max()))
    return Sphere(center, farthest + voxel)


@dataclass(frozen=True)
class Spot:
    """A camera at a place in the scene, for a picture of any size."""

    eye: Sequence[float]  # (3,) scene units
    target: Sequence[float]  # (3,) scene units
    up: Sequence[float]  # (3,)
    fov: float  # degrees along the picture's shorter side
    near: float  # scene units

    def sized(self, height: int, width: int) -> "Camera":
        """Camera for a picture of that size in px."""
        from resample.cameras import Pinhole, look_at

        pose = look_at(self.eye, self.target, self.up)
        return Pinhole.from_fov(
            self.fov, height=height, width=width, world_to_camera=pose, near=self.near
        )


Viewpoint: TypeAlias = "Orbit | Spot | Camera"


@dataclass(frozen=True, eq=False)
class Shifted:
    """A camera in a scene whose origin was moved to `origin`, (3,) in the camera's own scene."""

    camera: "Camera"
    origin: "Doubles"

    def view(self) -> "View":
        view = self.camera.view()
        return view._replace(translation=view.translation + view.rotation @ self.origin)


def centered(volume: Volume) -> "tuple[Volume, Doubles]":
    """Volume around the scene's origin, and where its middle was, (3,) scene units.

    Far from the origin, float32 would not tell neighbouring voxels apart.
    """
    import numpy as np

    last = np.array(volume.values.shape[::-1]) - 1.0
    half = volume.direction @ (volume.spacing * last) / 2
    return volume._replace(origin=-half), volume.origin + half


def parse_camera(text: str, fov: float, up: str) -> Viewpoint:
    """Camera from `azimuth/elevation/zoom`, of which the last may be left out, or from a file.

    Raises
    ------
    ValueError
        The text is neither, or the file's content is no camera.
    OSError
        The file cannot be read.
    """
    if text.lower().endswith(".toml"):
        return read_camera(Path(text))
    parts = text.split("/")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise ValueError(
            f"camera {text!r}; give azimuth/elevation/zoom, such as 30/20/1.5, of which the zoom "
            "may be left out, or a .toml file"
        )
    return Orbit(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else Orbit.zoom, fov, up)


Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=4, max_length=4)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _Angles(_Strict):
    """A camera around the volume."""

    azimuth: float = Orbit.azimuth
    elevation: float = Orbit.elevation
    zoom: float = Orbit.zoom
    fov: float = Orbit.fov
    up: str = Orbit.up

    def camera(self) -> Orbit:
        return Orbit(**self.model_dump())


class _Look(_Strict):
    """A camera at a place in the scene; `fov` is meant for its own size, if it has one."""

    eye: Vector
    target: Vector
    up: Vector = [0.0, 0.0, 1.0]
    fov: float = 30.0
    near: float = 0.0
    width: Annotated[int, Field(gt=0)] | None = None
    height: Annotated[int, Field(gt=0)] | None = None

    def camera(self) -> Viewpoint:
        spot = Spot(self.eye, self.target, self.up, self.fov, self.near)
        camera = spot.sized(self.height or 1, self.width or 1)  # raises what is wrong with it
        if (self.width is None) != (self.height is None):
            raise ValueError("give width and height, or neither to take the picture's")
        return spot if self.width is None else camera


class _Intrinsics(_Strict):
    """A calibrated camera; pixel centers are at halves."""

    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: Annotated[list[Row], Field(min_length=3, max_length=4)]
    near: float = 0.0

    def camera(self) -> "Camera":
        import numpy as np

        from resample.cameras import Pinhole

        pose = np.array(self.world_to_camera, np.float64)
        return Pinhole(self.fx, self.fy, self.cx, self.cy, pose, self.near)


def read_camera(path: Path) -> Viewpoint:
    """Camera from a TOML file.

    It has either `azimuth`, `elevation`, `zoom`, `fov` and `up` (all may be left out), or `eye`,
    `target`, `up`, `fov`, `near`, `width` and `height` (without the last two `fov` is that of the
    picture, whatever its size), or `fx`, `fy`, `cx`, `cy`, `near` and the
    rows of `world_to_camera`.

    Raises
    ------
    ValueError
        The content is none of these; says which key and why.
    OSError
        The file cannot be read.
    """
    from resample.options import one_line

    try:
        return camera_of(tomllib.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ValueError(f"{path}: {one_line(error)}") from None


def camera_of(content: dict[str, Any]) -> Viewpoint:
    """Camera from what a TOML file or a table of one holds; see `read_camera`."""
    form = _Look if "eye" in content else _Intrinsics if "fx" in content else _Angles
    return form.model_validate(content).camera()
