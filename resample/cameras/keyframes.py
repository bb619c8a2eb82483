"""Keyframes: cameras at given times, and interpolation between them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field

from resample.cameras.files import read_shots
from resample.cameras.models import Camera
from resample.cameras.trajectories import viewpoint_of
from resample.cameras.viewpoints import Calibrated, Orbit, Spot, Viewpoint
from resample.messages import naming
from resample.reading.texts import text_of, toml_of
from resample.types import Doubles

FORMS = {
    Orbit: "angles",
    Spot: "eye and target",
    Camera: "a calibrated camera",
    Calibrated: "a calibrated camera of one size",
}


class Keyframes(NamedTuple):
    """Two or more cameras of the same form, with times."""

    time: Doubles  # (K,) ascending; seconds, unless the number of frames is given
    camera: Sequence[Any]  # K of `Orbit`, `Spot`, `Calibrated` or `Camera`

    @property
    def duration(self) -> float:
        """Time from the first to the last keyframe."""
        return float(self.time[-1] - self.time[0])

    def between(self, count: int) -> list[Viewpoint]:
        """Interpolate `count` cameras at equal time steps from the first keyframe to the last.

        Numbers follow smooth curves without overshoot (Fritsch and Butland 1984); zooms and focal
        lengths are interpolated by their logarithms. Angles are taken literally: from 350 to 370
        degrees is a short rotation, from 350 to 10 a long one. Eyes, targets and up vectors are
        interpolated independently, and calibrated cameras turn with a continuous angular velocity.

        Raises ValueError: the eye meets its target on the way.
        """
        wanted = np.linspace(self.time[0], self.time[-1], count)
        return list(_BETWEEN[type(self.camera[0])](self, wanted))

    def curve(self, values: ArrayLike, wanted: Doubles) -> Doubles:
        """Interpolate numbers (K, ...) of the keyframes at given times."""
        from scipy.interpolate import PchipInterpolator

        given = np.asarray(values, np.float64)
        curve: Doubles = PchipInterpolator(self.time, given)(wanted)
        curve.clip(given.min(axis=0), given.max(axis=0), out=curve)  # rounding only
        return curve


class _Timed(BaseModel):
    """A keyframe: its time, and the fields of a camera."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)

    time: float


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    camera: Annotated[list[_Timed], Field(min_length=2)]


def read_keyframes(path: Path) -> Keyframes:
    """Read keyframes from a TOML file.

    Each has a table `[[camera]]` with its `time` and a camera as in
    `resample.cameras.trajectories.read_viewpoint`::

        [[camera]]
        time = 0
        azimuth = 30

        [[camera]]
        time = 4
        azimuth = 120
        zoom = 3
    """
    with naming(str(path)):
        content = _File.model_validate(toml_of(text_of(path)))
        cameras = []
        for n, keyframe in enumerate(content.camera):
            with naming(f"camera.{n}"):
                cameras.append(viewpoint_of(keyframe.model_extra or {}))
        time = [keyframe.time for keyframe in content.camera]
        for n in range(1, len(time)):
            if not time[n - 1] < time[n]:
                raise ValueError(
                    f"camera.{n}.time: must be after camera.{n - 1}'s {time[n - 1]:g} (got"
                    f" {time[n]:g})"
                )
        _check_interpolable(cameras)
    return Keyframes(np.array(time), cameras)


def keyframes_of(path: Path, fov: float) -> Keyframes:
    """Read keyframes from any file of cameras or poses; without times they are 1 s apart.

    Invalid pictures are skipped; `resample.cameras.files.left_out` reports them.

    `fov`: field of view along the picture's shorter side in degrees, if the file has poses only.
    """
    if path.suffix.lower() == ".toml":
        return read_keyframes(path)
    shots, cameras = read_shots(path), []
    if len(shots) < 2:
        raise ValueError(f"{path} has one pose; a camera path needs two or more")
    for shot in shots:
        made: Viewpoint = Spot.of(shot.pose, fov) if shot.camera is None else shot.camera
        if shot.camera is not None and shot.shape is not None:
            made = Calibrated(shot.camera, shot.shape)
        cameras.append(made)
    with naming(str(path)):
        _check_interpolable(cameras)
    return Keyframes(np.arange(float(len(shots))), cameras)


def _check_interpolable(cameras: Sequence[Any]) -> None:
    """Reject cameras that cannot be interpolated with each other."""
    first = cameras[0]
    for n, camera in enumerate(cameras):
        if type(camera) is not type(first):
            raise ValueError(
                f"camera.{n} is given by {FORMS[type(camera)]} and camera.0 by "
                f"{FORMS[type(first)]}; give all in one form"
            )
        if isinstance(first, Calibrated) and camera.shape != first.shape:
            raise ValueError(
                f"camera.{n} is for {camera.shape[1]} x {camera.shape[0]} pixels and camera.0 for "
                f"{first.shape[1]} x {first.shape[0]}; give all for one size"
            )
        calibrated = camera.camera if isinstance(camera, Calibrated) else camera
        if isinstance(calibrated, Camera):
            calibrated.view()  # raises if there is a lens, which cannot be interpolated
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
        (camera.azimuth, camera.elevation, np.log(camera.zoom), camera.fov, *camera.pan)
        for camera in cameras
    ]
    zooms = [camera.zoom for camera in cameras]
    course = keyframes.curve(numbers, wanted)
    scale = course[:, 2]
    zoom = np.clip(np.exp(scale), min(zooms), max(zooms))  # rounding only
    views = zip(course.tolist(), zoom.tolist(), strict=True)
    return [
        Orbit(azimuth, elevation, zoom, fov, cameras[0].up, (right, above))
        for (azimuth, elevation, _, fov, right, above), zoom in views
    ]


def _spots(keyframes: Keyframes, wanted: Doubles) -> list[Viewpoint]:
    cameras = keyframes.camera
    places = [(camera.eye, camera.target, camera.up) for camera in cameras]
    lenses = [(camera.fov, camera.near) for camera in cameras]
    place, lens = keyframes.curve(places, wanted), keyframes.curve(lenses, wanted)
    spots = [Spot(*place[n].tolist(), *lens[n].tolist()) for n in range(wanted.size)]
    for spot in spots:
        spot.sized(1, 1)  # raises where the eye meets its target
    return list(spots)


def _cameras(keyframes: Keyframes, wanted: Doubles) -> Sequence[Viewpoint]:
    from scipy.spatial.transform import Rotation, RotationSpline

    first = keyframes.camera[0]
    cameras = [one.camera if isinstance(one, Calibrated) else one for one in keyframes.camera]
    back = np.linalg.inv([camera.world_to_camera for camera in cameras])
    eye = keyframes.curve(back[:, :3, 3], wanted)
    course = RotationSpline(keyframes.time, Rotation.from_matrix(back[:, :3, :3]))
    turned = course(wanted).as_matrix()  # with a continuous angular velocity
    focal = np.exp(keyframes.curve(np.log([(camera.fx, camera.fy) for camera in cameras]), wanted))
    others = keyframes.curve([(camera.cx, camera.cy, camera.near) for camera in cameras], wanted)
    pose = np.tile(np.eye(4), (wanted.size, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = turned, eye
    there = np.linalg.inv(pose)
    made: list[Camera] = []
    for n in range(wanted.size):
        (fx, fy), (cx, cy, near) = focal[n].tolist(), others[n].tolist()
        made.append(Camera.from_intrinsics(fx, fy, cx, cy, there[n], near))
    return [Calibrated(one, first.shape) for one in made] if isinstance(first, Calibrated) else made


_BETWEEN: dict[type, Callable[[Keyframes, Doubles], Sequence[Viewpoint]]] = {
    Orbit: _orbits,
    Spot: _spots,
    Calibrated: _cameras,
    Camera: _cameras,
}
