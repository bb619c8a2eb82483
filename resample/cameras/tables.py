"""Read cameras from TOML files."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from resample.cameras.models import Camera
from resample.cameras.trajectories import Entry, PosedPicture, entry_of
from resample.cameras.viewpoints import Calibrated, Orbit, Spot, Viewpoint
from resample.messages import naming
from resample.reading.texts import text_of, toml_of

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Row = Annotated[list[float], Field(min_length=4, max_length=4)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _Angles(_Strict):
    """A camera that orbits the scene."""

    azimuth: float = Orbit.azimuth
    elevation: float = Orbit.elevation
    zoom: float = Orbit.zoom
    fov: float = Orbit.fov
    up: str = Orbit.up
    pan: tuple[float, float] = Orbit.pan

    def camera(self) -> Orbit:
        return Orbit(**self.model_dump())


class _PlacedCamera(_Strict):
    """A camera at a position in the scene; `fov` refers to its own size, if given."""

    eye: Vector
    target: Vector
    up: Vector = [0.0, 0.0, 1.0]
    fov: float = 30.0
    near: float = 0.0
    width: Annotated[int, Field(gt=0)] | None = None
    height: Annotated[int, Field(gt=0)] | None = None

    def camera(self) -> Viewpoint:
        spot = Spot(self.eye, self.target, self.up, self.fov, self.near)
        camera = spot.sized(self.height or 1, self.width or 1)  # raises if it is invalid
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
    skew: float = 0.0
    distortion: list[float] | None = None
    width: Annotated[int, Field(gt=0)] | None = None
    height: Annotated[int, Field(gt=0)] | None = None

    def camera(self) -> Viewpoint:
        camera = Camera.from_intrinsics(
            *(self.fx, self.fy, self.cx, self.cy),
            np.array(self.world_to_camera, np.float64),
            self.near,
            skew=self.skew,
            distortion=self.distortion,
        )
        if (self.width is None) != (self.height is None):
            raise ValueError("give width and height, or neither to take the picture's")
        if self.width is None or self.height is None:
            return camera
        return Calibrated(camera, (self.height, self.width))


def read_viewpoint(path: Path) -> Viewpoint:
    """Read a camera from a TOML file.

    It has either `azimuth`, `elevation`, `zoom`, `fov`, `up` and `pan` (see `Orbit`), or `eye`,
    `target`, `up`, `fov`, `near`, `width` and `height` (without the last two `fov` is that of the
    picture, whatever its size), or `fx`, `fy`, `cx`, `cy`, `skew`, `distortion`, `near`, the rows
    of `world_to_camera`, and the `width` and `height` that these are for (without them, the
    picture's).
    """
    with naming(str(path)):
        return viewpoint_of(toml_of(text_of(path)))


def read_toml(path: Path) -> list[Entry]:
    """Read cameras with a position of their own: one as in `read_viewpoint`, or `[[camera]]`."""
    with naming(str(path)):
        content = toml_of(text_of(path))
    if not isinstance(content.get("camera"), list):
        return [entry_of(str(path), "", _shot, content)]
    tables = content["camera"]
    return [
        entry_of(f"{path}: camera.{n}", _name(table), _shot, table)
        for n, table in enumerate(tables)
    ]


def viewpoint_of(content: dict[str, Any]) -> Viewpoint:
    """Camera from the content of a TOML file or one of its tables; see `read_viewpoint`."""
    form = _PlacedCamera if "eye" in content else _Intrinsics if "fx" in content else _Angles
    return form.model_validate(content).camera()


def _name(table: Any) -> str:
    """Time of a table; empty if not given."""
    return str(table.get("time", "")) if isinstance(table, dict) else ""


def _shot(table: dict[str, Any]) -> PosedPicture:
    content = dict(table)
    name = str(content.pop("time", ""))
    viewpoint = viewpoint_of(content)
    if isinstance(viewpoint, Spot):
        return PosedPicture(name, viewpoint.sized(1, 1).world_to_camera)
    if isinstance(viewpoint, Calibrated):
        return PosedPicture(name, viewpoint.camera.world_to_camera, *viewpoint)
    if not isinstance(viewpoint, Camera):
        raise ValueError("angles go around something; give eye and target, or intrinsics")
    has_size = "width" in content and "height" in content
    shape = (content["height"], content["width"]) if has_size else None
    return PosedPicture(name, viewpoint.world_to_camera, viewpoint, shape)
