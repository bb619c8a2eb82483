"""Cameras from TOML files."""

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from resample_volume.cameras.framing import Orbit, Spot, Viewpoint

if TYPE_CHECKING:
    from resample.cameras.models import Camera

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

        from resample.cameras.models import Pinhole

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
    from resample.command.options import one_line

    try:
        return camera_of(tomllib.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise ValueError(f"{path}: {one_line(error)}") from None


def camera_of(content: dict[str, Any]) -> Viewpoint:
    """Camera from what a TOML file or a table of one holds; see `read_camera`."""
    form = _Look if "eye" in content else _Intrinsics if "fx" in content else _Angles
    return form.model_validate(content).camera()
