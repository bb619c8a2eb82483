"""Cameras of reconstructions: COLMAP's models, text and binary, and NeRF's transforms.json."""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from resample.cameras.models import Camera, LensModel
from resample.cameras.poses import from_opengl, from_quaternion, rigid
from resample.cameras.trajectories import Entry, PosedPicture, Refused, entry_of, facts_of, lines_of
from resample.messages import naming
from resample.reading.pictures import opened
from resample.reading.texts import text_of
from resample.types import Doubles

# Models by number, each with its number of parameters.
NUMBERED = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)

COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<IiQQ")  # number, model, width, height; then parameters in float64
PICTURE = struct.Struct("<I7dI")  # number, qw, qx, qy, qz, tx, ty, tz, camera; then a name
POINT_BYTES = 24  # of a picture's point: x, y, and the number of a scene point
LONGEST = 4096  # bytes of a name
# Positions of fx, fy, cx, cy and OpenCV's coefficients in the parameters; −1: 0.
MODELS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2),
    "PINHOLE": (0, 1, 2, 3),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, -1, -1, -1),
    "RADIAL": (0, 0, 1, 2, 3, 4, -1, -1),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
    "FULL_OPENCV": (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11),
    "SIMPLE_RADIAL_FISHEYE": (0, 0, 1, 2, 3, -1, -1, -1),
    "RADIAL_FISHEYE": (0, 0, 1, 2, 3, 4, -1, -1),
    "OPENCV_FISHEYE": (0, 1, 2, 3, 4, 5, 6, 7),
}


class Posed(NamedTuple):
    """Pose and camera number of a picture."""

    name: str
    numbers: Sequence[float]  # qw, qx, qy, qz, tx, ty, tz of world to camera
    camera: int


class CameraRecord(NamedTuple):
    """A camera as stored in the file."""

    number: int
    model: str  # "number N" if the model is unknown
    width: int
    height: int
    parameters: Sequence[float]


class _Bytes:
    """Byte stream that raises an error where the file is truncated."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self.file, self.path = file, path
        self.size = path.stat().st_size

    def take(self, layout: struct.Struct, place: str) -> tuple[float, ...]:
        """Read the numbers of a struct layout."""
        content = self.file.read(layout.size)
        if len(content) < layout.size:
            raise ValueError(f"{self.path} is cut off in {place}, after {self.size} bytes")
        return layout.unpack(content)

    def count(self, what: str, least: int) -> int:
        """Read a count of items; each takes at least `least` bytes."""
        count = int(self.take(COUNT, "its first number")[0])
        if count * least > self.size:
            raise ValueError(
                f"{self.path} is cut off or not a COLMAP file: it claims {count}"
                f" {what}, and has {self.size} bytes"
            )
        return count

    def name(self, place: str) -> str:
        """Read a zero-terminated text."""
        start = self.file.tell()
        content, end, _ = self.file.read(LONGEST).partition(b"\0")
        if not end:
            raise ValueError(
                f"{self.path} is cut off or damaged: the name of {place} is not terminated"
            )
        self.file.seek(start + len(content) + 1)
        return content.decode("utf-8", "replace")

    def skip(self, count: int, place: str) -> None:
        """Skip bytes."""
        if self.file.tell() + count > self.size:
            raise ValueError(f"{self.path} is cut off in {place}, after {self.size} bytes")
        self.file.seek(count, 1)


def cameras_of(path: Path) -> Iterator[CameraRecord]:
    """Cameras of cameras.bin; those after an unknown model cannot be read and are omitted."""
    with path.open("rb") as file:
        content = _Bytes(file, path)
        for n in range(content.count("cameras", CAMERA.size)):
            number, model, width, height = map(int, content.take(CAMERA, f"camera {n}"))
            if not 0 <= model < len(NUMBERED):
                yield CameraRecord(number, f"number {model}", width, height, [])
                return
            name, count = NUMBERED[model]
            parameters = content.take(struct.Struct(f"<{count}d"), f"camera {n}")
            yield CameraRecord(number, name, width, height, parameters)


def pictures_of(path: Path) -> Iterator[Posed]:
    """Pictures of images.bin, without their points; errors as in `cameras_of`."""
    with path.open("rb") as file:
        content = _Bytes(file, path)
        for n in range(content.count("pictures", PICTURE.size + 1 + COUNT.size)):
            _, *numbers, camera = content.take(PICTURE, f"picture {n}")
            name = content.name(f"picture {n}")
            points = int(content.take(COUNT, f"picture {n}")[0])
            content.skip(POINT_BYTES * points, f"picture {n}")
            yield Posed(name, numbers, int(camera))


# Camera without a pose, and the height and width of its pictures, px.
Sized = tuple[Camera, tuple[int, int]]
OTHERS = -1  # key of the message for all cameras after an unreadable one
Cameras = Mapping[int, Sized | str]  # by number; a text says why one is unavailable


def read_colmap(path: Path) -> list[Entry]:
    """World-to-camera poses of images.bin or images.txt, with the cameras of the file beside it.

    `path` is the folder, where binary files are preferred, as in COLMAP, or the file.
    """
    images = path
    if path.is_dir():
        held = [path / name for name in ("images.bin", "images.txt") if (path / name).is_file()]
        if not held:
            raise ValueError(
                f"{path} holds no images.bin and no images.txt; give the folder of COLMAP's model,"
                " such as sparse/0"
            )
        images = held[0]
    is_binary = images.suffix.lower() == ".bin"
    cameras = images.with_name("cameras.bin" if is_binary else "cameras.txt")
    known = (_binary_cameras if is_binary else _text_cameras)(cameras) if cameras.is_file() else {}
    if is_binary:
        pictures = pictures_of(images)
        return [
            entry_of(f"{images}: picture {n}", picture.name, _entry, picture, cameras, known)
            for n, picture in enumerate(pictures)
        ]

    def of_words(words: list[str]) -> Entry:
        """Entry of: number, qw, qx, qy, qz, tx, ty, tz, number of the camera, name."""
        if len(words) != 10:
            raise ValueError(f"a picture has 10 words, not {len(words)}")
        numbers = [float(word) for word in words[1:8]]
        return _entry(Posed(words[9].strip(), numbers, int(words[8])), cameras, known)

    entries, is_points = [], False
    for n, line in enumerate(text_of(images).splitlines(), 1):
        if is_points:  # each picture is followed by a line of points, maybe empty
            is_points = False
        elif line.strip() and not line.startswith("#"):
            words = line.split(maxsplit=9)
            name = words[9].strip() if len(words) == 10 else ""
            entries.append(entry_of(f"{images}: line {n}", name, of_words, words))
            is_points = True
    return entries


def _entry(picture: Posed, path: Path, cameras: Cameras) -> Entry:
    """Entry of a picture of the file `path`, with its camera if available."""
    w, x, y, z, *shift = picture.numbers
    pose = rigid(np.column_stack([from_quaternion([x, y, z, w]), shift]))
    if not cameras:
        return PosedPicture(picture.name, pose)
    unknown = f"{path.name} has no camera {picture.camera}"
    found = cameras.get(picture.camera, cameras.get(OTHERS, unknown))
    if isinstance(found, str):
        return Refused(picture.name, found, pose)
    camera, shape = found
    return PosedPicture(picture.name, pose, camera.moved(pose), shape)


def _camera(model: str, width: float, height: float, given: Sequence[float]) -> Sized:
    """Camera with the parameters of a COLMAP model."""
    if model not in MODELS:
        raise ValueError(
            f"COLMAP's model {model!r} is not known; known: {', '.join(MODELS)}; undistort the"
            " pictures first"
        )
    order = MODELS[model]
    if len(given) != max(order) + 1:
        raise ValueError(
            f"{model} has a width, a height and {max(order) + 1} numbers, not {len(given) + 2}"
        )
    if not (width >= 1 and height >= 1):
        raise ValueError(f"a camera cannot have pictures of {width:g} x {height:g} pixels")
    fx, fy, cx, cy, *coefficients = [given[n] if n >= 0 else 0.0 for n in order]
    camera = Camera.from_intrinsics(fx, fy, cx, cy)
    if coefficients:
        is_fisheye = model.endswith("FISHEYE")
        camera = camera.with_lens(
            coefficients, LensModel.FISHEYE if is_fisheye else LensModel.PINHOLE
        )
    return camera, (int(height), int(width))


# Text.


def _text_cameras(path: Path) -> Cameras:
    """Cameras, one line each: number, model, width, height, parameters."""
    cameras: dict[int, Sized | str] = {}
    for n, words in lines_of(path):
        place = f"{path}: line {n}"
        number, model = [*words, ""][:2]
        with naming(place):
            key = int(number)
        try:
            with naming(place):
                width, height, *given = [*map(float, words[2:])] or [0.0, 0.0]
                cameras[key] = _camera(model, width, height, given)
        except ValueError as error:
            cameras[key] = str(error)
    return cameras


def _binary_cameras(path: Path) -> Cameras:
    cameras: dict[int, Sized | str] = {}
    for number, model, width, height, given in cameras_of(path):
        try:
            with naming(f"{path}: camera {number}"):
                cameras[number] = _camera(model, width, height, given)
        except ValueError as error:
            cameras[number] = str(error)
        if model not in dict(NUMBERED):
            cameras[OTHERS] = (
                f"{path}: cameras after camera {number} cannot be read, as its model, {model},"
                " is not known"
            )
    return cameras


# NeRF's transforms.json.

PINHOLES = ("", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "FULL_OPENCV", "RADIAL", "SIMPLE_RADIAL")

Facts = Mapping[str, Any]


def read_nerf(path: Path) -> list[Entry]:
    """Read camera-to-world poses in OpenGL's axes, and intrinsics (transforms.json of NeRF)."""
    facts = facts_of(path)
    frames = facts.get("frames") if isinstance(facts, dict) else None
    if not isinstance(frames, list):
        raise ValueError(f"{path} has no list of frames as NeRF's transforms.json has")
    common = {key: value for key, value in facts.items() if key != "frames"}
    entries = []
    for n, frame in enumerate(frames):
        name = str(frame.get("file_path", "")) if isinstance(frame, dict) else ""
        place = f"{path}: frame {n}"
        entries.append(entry_of(place, name, _frame_entry, place, path.parent, common, frame))
    return entries


def _frame_entry(place: str, folder: Path, common: Facts, frame: Facts) -> Entry:
    """Entry of a frame and the values common to all; without its camera if that is invalid."""
    facts = {**common, **frame}
    name, pose = str(facts.get("file_path", "")), from_opengl(facts["transform_matrix"])
    shape: tuple[int, int] | None
    try:
        with naming(place):
            # Frame with its camera, if the file has one.
            said, is_fisheye = facts.get("camera_model", ""), facts.get("is_fisheye")
            model, names = LensModel.PINHOLE, "k1 k2 p1 p2 k3"
            if said == "OPENCV_FISHEYE" or (not said and is_fisheye):
                model, names = LensModel.FISHEYE, "k1 k2 k3 k4"
            elif said not in PINHOLES or is_fisheye or facts.get("k4"):
                raise ValueError(
                    "its lens is not a model of OpenCV's; undistort the pictures first"
                )
            if "h" in facts and "w" in facts:
                shape = (int(facts["h"]), int(facts["w"]))
            else:
                shape = None  # of the picture; NeRF may omit its suffix
                for file in (folder / name, folder / f"{name}.png") if name else ():
                    with suppress(OSError):
                        source = opened(file) if file.is_file() and shape is None else None
                        if source is not None:
                            shape = source.spec().height, source.spec().width
                            source.close()
            matrix = _matrix(facts, shape)
            if matrix is None:
                return PosedPicture(name, pose)
            coefficients = [float(facts.get(key, 0.0)) for key in names.split()]
            camera = Camera(matrix, pose, np.array(coefficients), model=model)
            return PosedPicture(name, pose, camera, shape)
    except ValueError as error:
        return Refused(name, str(error), pose)


def _matrix(facts: Facts, shape: tuple[int, int] | None) -> Doubles | None:
    """Intrinsics from focal lengths or angles; the principal point defaults to the center."""
    height, width = shape or (math.nan, math.nan)
    across, along = facts.get("camera_angle_x", math.nan), facts.get("camera_angle_y", math.nan)
    fx = float(facts["fl_x"] if "fl_x" in facts else _focal(width, across))
    fy = float(facts["fl_y"] if "fl_y" in facts else _focal(height, along))
    fy = fx if math.isnan(fy) else fy
    cx, cy = float(facts.get("cx", 0.5 * width)), float(facts.get("cy", 0.5 * height))
    if math.isnan(fx + cx + cy):
        return None
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _focal(size: float, angle: float) -> float:
    """Focal length for a field of view in rad; NaN if either argument is unknown."""
    if angle <= 0 or angle >= math.pi:
        raise ValueError(f"a camera cannot see an angle of {angle:g}")
    return 0.5 * size / math.tan(0.5 * angle)
