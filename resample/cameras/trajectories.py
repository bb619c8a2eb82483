"""Readers of pose files without cameras: matrices, TUM, ICL-NUIM, Open3D.

The result follows one convention: poses map world to camera, with x to the right, y down and the
view along +z.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from resample.cameras.models import Camera
from resample.cameras.poses import camera_to_world, from_quaternion, rigid
from resample.cameras.viewpoints import Calibrated, Orbit, Spot, Viewpoint
from resample.messages import naming
from resample.reading.arrays import read_npy
from resample.reading.texts import json_of, text_of, toml_of
from resample.types import Doubles

SEPARATOR = re.compile(r"[\s,;\[\]()]+")
Facts = Mapping[str, Any]


class PosedPicture(NamedTuple):
    """One picture of a file of poses."""

    name: str  # the picture's file or time; empty if the file has none
    pose: Doubles  # (4, 4) world to camera
    camera: Camera | None = None  # with that pose; None if the file has no intrinsics
    shape: tuple[int, int] | None = None  # height and width that the intrinsics are for, px


class Refused(NamedTuple):
    """One invalid picture of a file of poses; its pose may be valid."""

    name: str  # as in `PosedPicture`
    complaint: str  # one line
    pose: Doubles | None = None  # (4, 4) world to camera, if valid


Entry = PosedPicture | Refused


TextLine = tuple[int, list[str]]  # number, from 1, and words


def entry_of(place: str, name: str, read: Callable[..., Entry], *given: Any) -> Entry:
    """Call a reader and return its entry, or an entry with its error."""
    try:
        with naming(place):
            return read(*given)
    except ValueError as error:
        return Refused(name, str(error))


def read_matrices(path: Path) -> list[Entry]:
    """Read world-to-camera matrices: NPY (..., 3 or 4, 4), or text, one 3 × 4 or many 4 × 4."""
    if path.suffix.lower() == ".npy":
        given = read_npy(path)
        if given.ndim < 2 or given.dtype.kind not in "uif" or not given.size:
            raise ValueError(
                f"{path} holds {given.dtype} of shape {given.shape}, not (3, 4) or (4, 4)"
            )
        matrices = given.reshape(-1, *given.shape[-2:]).astype(np.float64)
    else:
        lines = lines_of(path)
        numbers = table_of(path, lines, 4)
        if len(lines) != 3 and (len(lines) % 4 or not lines):
            raise ValueError(f"{path} has {len(lines)} rows of 4 numbers; a pose has 3 or 4")
        matrices = numbers.reshape(-1, 3 if len(lines) == 3 else 4, 4)
    return [
        entry_of(f"{path}: pose {n}", "", lambda given: PosedPicture("", rigid(given)), matrix)
        for n, matrix in enumerate(matrices)
    ]


def read_tum(path: Path, before: int = 1) -> list[Entry]:
    """Read camera-to-world lines: time, tx, ty, tz, qx, qy, qz, qw (TUM RGB-D).

    `before`: words before tx; 0: lines of ICL-NUIM in slambook, which have no time.
    """

    def posed(words: list[str]) -> PosedPicture:
        if len(words) != before + 7:
            raise ValueError(f"{len(words)} numbers instead of {before + 7}")
        x, y, z, *quaternion = [float(word) for word in words[before:]]
        pose = camera_to_world(np.column_stack([from_quaternion(quaternion), [x, y, z]]))
        return PosedPicture(words[0] if before else "", pose)

    return [
        entry_of(f"{path}: line {number}", words[0] if before else "", posed, words)
        for number, words in lines_of(path)
    ]


def read_log(path: Path) -> list[Entry]:
    """Read camera-to-world poses: a line of three numbers and a 4 × 4 matrix each (Open3D)."""
    lines = lines_of(path)
    if [len(words) for _, words in lines] != [3, 4, 4, 4, 4] * (len(lines) // 5):
        raise ValueError(
            f"{path} is not a trajectory: each pose has a line of 3 numbers and 4 of 4"
        )

    def posed(rows: Sequence[TextLine]) -> PosedPicture:
        pose = camera_to_world([[float(word) for word in words] for _, words in rows])
        return PosedPicture("", pose)

    return [
        entry_of(f"{path}: pose {n}", "", posed, lines[5 * n + 1 : 5 * n + 5])
        for n in range(len(lines) // 5)
    ]


def lines_of(path: Path) -> list[TextLine]:
    """Lines that are neither empty nor comments."""
    lines = []
    for number, line in enumerate(text_of(path).splitlines(), 1):
        words = [word for word in SEPARATOR.split(line.partition("#")[0]) if word]
        if words:
            lines.append((number, words))
    return lines


def table_of(path: Path, lines: Sequence[TextLine], count: int) -> Doubles:
    """Numbers of lines as an array (lines, count)."""
    rows = np.empty((len(lines), count))
    for n, (number, words) in enumerate(lines):
        if len(words) != count:
            raise ValueError(f"{path}: line {number} has {len(words)} numbers instead of {count}")
        with naming(f"{path}: line {number}"):
            rows[n] = [float(word) for word in words]
    return rows


def is_trained(facts: Any) -> bool:
    """Whether JSON values are a list of cameras of training."""
    first = facts[0] if isinstance(facts, list) and facts else None
    return isinstance(first, dict) and {"rotation", "position", "fx"} <= set(first)


def read_trained(path: Path) -> list[Entry]:
    """Read camera-to-world rotations, positions and intrinsics (cameras.json, Kerbl et al. 2023).

    It is written beside trained 3D Gaussians; the principal point is the picture's middle.
    """
    facts = facts_of(path)
    if not is_trained(facts):
        raise ValueError(f"{path} is not a list of cameras with rotation, position and fx")

    def camera_of(name: str, facts: Facts) -> PosedPicture:
        turn, place = np.array(facts["rotation"], float), np.array(facts["position"], float)
        if turn.shape != (3, 3) or place.shape != (3,):
            raise ValueError(f"a rotation of {turn.shape} and a position of {place.shape}")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ place
        width, height = int(facts["width"]), int(facts["height"])
        fx, fy = float(facts["fx"]), float(facts.get("fy", facts["fx"]))
        camera = Camera.from_intrinsics(fx, fy, width / 2, height / 2, pose)
        return PosedPicture(name, camera.world_to_camera, camera, (height, width))

    names = [str(each.get("img_name", "")) if isinstance(each, dict) else "" for each in facts]
    return [
        entry_of(f"{path}: camera {n}", name, camera_of, name, each)
        for n, (name, each) in enumerate(zip(names, facts, strict=True))
    ]


def read_open3d(path: Path) -> list[Entry]:
    """Read world-to-camera poses and intrinsics (`PinholeCameraTrajectory` and -`Parameters`).

    Matrices are column-major.
    """
    facts = facts_of(path)
    if not isinstance(facts, dict) or not {"parameters", "extrinsic"} & set(facts):
        raise ValueError(f"{path} has neither parameters nor an extrinsic as Open3D's files have")
    given = facts.get("parameters", [facts])
    if not isinstance(given, list):
        raise ValueError(f"{path} has no list of parameters as Open3D's trajectories have")

    def shot(facts: Facts) -> PosedPicture:
        pose, inner = rigid(columns_of(facts, "extrinsic", 4)), facts.get("intrinsic")
        if not inner:
            return PosedPicture("", pose)
        camera = Camera.from_opencv(columns_of(inner, "intrinsic_matrix", 3)).moved(pose)
        height, width = int(inner.get("height", 0)), int(inner.get("width", 0))
        return PosedPicture("", pose, camera, (height, width) if min(height, width) > 0 else None)

    return [entry_of(f"{path}: camera {n}", "", shot, each) for n, each in enumerate(given)]


def facts_of(path: Path) -> Any:
    """Parse a JSON file."""
    text = text_of(path)
    with naming(str(path)):
        return json_of(text)


def columns_of(facts: Facts, name: str, side: int) -> Any:
    """Matrix from a flat list in column order, or from a list of rows."""
    given = np.asarray(facts[name], np.float64)
    if given.shape not in ((side * side,), (side, side)):
        raise ValueError(f"its {name} has {given.size} numbers, not {side * side}")
    return given.reshape(side, side).T if given.ndim == 1 else given


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
    `target`, `up`, `fov`, `near`, `width` and `height` (without the last two `fov` applies to the
    picture, whatever its size), or `fx`, `fy`, `cx`, `cy`, `skew`, `distortion`, `near`, the rows
    of `world_to_camera`, and the `width` and `height` that these are for (without them, the
    picture's).
    """
    with naming(str(path)):
        return viewpoint_of(toml_of(text_of(path)))


def read_toml(path: Path) -> list[Entry]:
    """Read cameras that have their own position: one as in `read_viewpoint`, or `[[camera]]`."""
    with naming(str(path)):
        content = toml_of(text_of(path))
    if not isinstance(content.get("camera"), list):
        return [entry_of(str(path), "", _placed_shot, content)]
    tables = content["camera"]
    return [
        entry_of(
            f"{path}: camera.{n}",
            str(table.get("time", "")) if isinstance(table, dict) else "",
            _placed_shot,
            table,
        )
        for n, table in enumerate(tables)
    ]


def viewpoint_of(content: dict[str, Any]) -> Viewpoint:
    """Camera from the content of a TOML file or one of its tables; see `read_viewpoint`."""
    form = _PlacedCamera if "eye" in content else _Intrinsics if "fx" in content else _Angles
    return form.model_validate(content).camera()


def _placed_shot(table: dict[str, Any]) -> PosedPicture:
    """Picture of a table that names a position."""
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
