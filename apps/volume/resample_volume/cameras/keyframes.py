"""Cameras at certain times, and those in between."""

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field

from resample.cameras.models import Pinhole
from resample.files.animations import check_count
from resample.types import Doubles
from resample_volume.cameras.files import camera_of
from resample_volume.cameras.framing import Orbit, Spot, Viewpoint

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

FORMS = {Orbit: "angles", Spot: "eye and target", Pinhole: "a calibrated camera"}


class Keyframes(NamedTuple):
    """Cameras of one form, two or more."""

    time: Doubles  # (K,) ascending; seconds, where the number of frames is not given
    camera: Sequence[Any]  # K of `Orbit`, of `Spot` or of `Pinhole`

    @property
    def duration(self) -> float:
        """From the first to the last."""
        return float(self.time[-1] - self.time[0])

    def between(self, count: int) -> list[Viewpoint]:
        """So many cameras at even times from the first keyframe to the last.

        Numbers follow smooth curves that do not go beyond the keyframes to either side (Fritsch
        and Butland 1984); zooms and focal lengths do so by their logarithms. Angles are taken as
        they are: from 350 to 370 degrees is a short way, from 350 to 10 a long one. Eyes, targets
        and upward directions move each on its own, and calibrated cameras turn at a rate without
        jumps.

        Raises
        ------
        ValueError
            The count is not allowed, or an eye meets its target on the way.
        """
        check_count(count)
        wanted = np.linspace(self.time[0], self.time[-1], count)
        return _BETWEEN[type(self.camera[0])](self, wanted)

    def curve(self, values: ArrayLike, wanted: Doubles) -> Doubles:
        """Numbers (K, ...) of the keyframes at the times wanted."""
        from scipy.interpolate import PchipInterpolator

        given = np.asarray(values, np.float64)
        curve: Doubles = PchipInterpolator(self.time, given)(wanted)
        curve.clip(given.min(axis=0), given.max(axis=0), out=curve)  # against rounding alone
        return curve


class _Timed(BaseModel):
    """A keyframe; what is not its time is its camera."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    time: float


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    camera: Annotated[list[_Timed], Field(min_length=2)]


def read_keyframes(path: Path) -> Keyframes:
    """Keyframes from a TOML file.

    It has a table `[[camera]]` for each: its `time`, and a camera as
    `resample_volume.cameras.files.read_camera` takes it::

        [[camera]]
        time = 0
        azimuth = 30

        [[camera]]
        time = 4
        azimuth = 120
        zoom = 3

    Raises
    ------
    ValueError
        The content is something else, times do not ascend, or the cameras are not of one form,
        with one axis upwards and all in perspective or all parallel; says which and why.
    OSError
        The file cannot be read.
    """
    from resample.command.options import one_line

    try:
        content = _File.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        cameras = [_camera(n, keyframe) for n, keyframe in enumerate(content.camera)]
        time = [keyframe.time for keyframe in content.camera]
        _check_times(time)
        _check_alike(cameras)
    except ValueError as error:
        raise ValueError(f"{path}: {one_line(error)}") from None
    return Keyframes(np.array(time), cameras)


def _camera(n: int, keyframe: _Timed) -> Viewpoint:
    from resample.command.options import one_line

    content = keyframe.model_extra or {}
    try:
        return camera_of(content)
    except ValueError as error:
        raise ValueError(f"camera.{n}: {one_line(error)}") from None


def _check_times(time: Sequence[float]) -> None:
    for n in range(1, len(time)):
        if not time[n - 1] < time[n]:
            raise ValueError(
                f"camera.{n}.time: must be after camera.{n - 1}'s {time[n - 1]:g} (got {time[n]:g})"
            )


def _check_alike(cameras: Sequence[Any]) -> None:
    """Refuse cameras of which one cannot become the other by and by."""
    first = cameras[0]
    for n, camera in enumerate(cameras):
        if type(camera) is not type(first):
            raise ValueError(
                f"camera.{n} is given by {FORMS[type(camera)]} and camera.0 by "
                f"{FORMS[type(first)]}; give all in one form"
            )
        if isinstance(first, Orbit) and camera.up != first.up:
            raise ValueError(f"camera.{n}.up: must be camera.0's {first.up!r} (got {camera.up!r})")
        if isinstance(first, Orbit) and (camera.fov == 0) != (first.fov == 0):
            raise ValueError(
                f"camera.{n}.fov: parallel projection (0) and perspective do not mix "
                f"(got {camera.fov:g} after {first.fov:g})"
            )


def _orbits(keyframes: Keyframes, wanted: Doubles) -> list[Viewpoint]:
    cameras = keyframes.camera
    numbers = [
        (camera.azimuth, camera.elevation, np.log(camera.zoom), camera.fov) for camera in cameras
    ]
    zooms = [camera.zoom for camera in cameras]
    azimuth, elevation, scale, fov = keyframes.curve(numbers, wanted).T
    zoom = np.clip(np.exp(scale), min(zooms), max(zooms))  # against rounding alone
    return [
        Orbit(float(azimuth[n]), float(elevation[n]), float(zoom[n]), float(fov[n]), cameras[0].up)
        for n in range(wanted.size)
    ]


def _spots(keyframes: Keyframes, wanted: Doubles) -> list[Viewpoint]:
    cameras = keyframes.camera
    places = [(camera.eye, camera.target, camera.up) for camera in cameras]
    lenses = [(camera.fov, camera.near) for camera in cameras]
    place, lens = keyframes.curve(places, wanted), keyframes.curve(lenses, wanted)
    spots = [Spot(*place[n].tolist(), *lens[n].tolist()) for n in range(wanted.size)]
    for spot in spots:
        spot.sized(1, 1)  # raises where an eye meets its target
    return list(spots)


def _pinholes(keyframes: Keyframes, wanted: Doubles) -> list[Viewpoint]:
    cameras = keyframes.camera
    back = np.linalg.inv([camera.world_to_camera for camera in cameras])
    eye = keyframes.curve(back[:, :3, 3], wanted)
    turned = _turned(keyframes.time, back[:, :3, :3])(wanted).as_matrix()
    focal = np.exp(keyframes.curve(np.log([(camera.fx, camera.fy) for camera in cameras]), wanted))
    others = keyframes.curve([(camera.cx, camera.cy, camera.near) for camera in cameras], wanted)
    pose = np.tile(np.eye(4), (wanted.size, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = turned, eye
    there = np.linalg.inv(pose)
    made: list[Viewpoint] = []
    for n in range(wanted.size):
        (fx, fy), (cx, cy, near) = focal[n].tolist(), others[n].tolist()
        made.append(Pinhole(fx, fy, cx, cy, there[n], near))
    return made


def _turned(time: Doubles, rotation: Doubles) -> "Callable[[Doubles], Rotation]":
    """Rotations (K, 3, 3) as a function of time, whose angular rate has no jumps."""
    from scipy.spatial.transform import Rotation, RotationSpline

    spline: Callable[[Doubles], Rotation] = RotationSpline(time, Rotation.from_matrix(rotation))
    return spline


_BETWEEN: dict[type, Callable[[Keyframes, Doubles], list[Viewpoint]]] = {
    Orbit: _orbits,
    Spot: _spots,
    Pinhole: _pinholes,
}
