"""Poses, and cameras where files have them, as the usual programs write them.

Whatever a file's convention, what comes out maps world to camera, with x to the right, y down and
the view along +z. Where intrinsics come along, their pixel centers are at + 0.5, as COLMAP's are
and NeRF's, which are made from them.
"""

import errno
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.types import Doubles
from resample_warp3d.cameras.models import Camera, camera_to_world, from_opengl, rigid

SEPARATOR = re.compile(r"[\s,;\[\]()]+")
QUATERNION = 1e-3  # error of the length that three decimals leave
PINHOLES = ("", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "FULL_OPENCV", "RADIAL", "SIMPLE_RADIAL")

# COLMAP's models: where fx, fy, cx, cy and then OpenCV's coefficients stand; −1 is 0.
COLMAP_MODELS = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2),
    "PINHOLE": (0, 1, 2, 3),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3, -1, -1, -1),
    "RADIAL": (0, 0, 1, 2, 3, 4, -1, -1),
    "OPENCV": (0, 1, 2, 3, 4, 5, 6, 7),
    "FULL_OPENCV": (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11),
}


class Shot(NamedTuple):
    """One picture of a file of poses."""

    name: str  # the picture's file or time; empty where a file has none
    pose: Doubles  # (4, 4) world to camera
    camera: Camera | None = None  # with that pose; None where the file has no intrinsics
    shape: tuple[int, int] | None = None  # height and width that the intrinsics are for, px


Eye = tuple[Camera, tuple[int, int]]  # without a pose; height and width of its pictures, px


class Line(NamedTuple):
    """Words of a line of text."""

    number: int  # from 1
    words: list[str]


def read_shots(path: str | Path, kind: str | None = None) -> list[Shot]:
    """All poses of a file.

    Parameters
    ----------
    path
        File, or the folder of a COLMAP model.
    kind
        One of `KINDS`; None recognises it by name and content.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It holds something else, or what it is cannot be told.
    """
    file = Path(path)
    if not file.exists():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    if kind is not None and kind not in KINDS:
        raise ValueError(f"unknown kind of poses {kind!r}; known: {', '.join(KINDS)}")
    shots = KINDS[kind or _recognised(file)](file)
    if not shots:
        raise ValueError(f"{path} holds no poses")
    return shots


def from_quaternion(numbers: Sequence[float]) -> Doubles:
    """Rotation (3, 3) of x, y, z, w.

    Raises
    ------
    ValueError
        Its length is not 1.
    """
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


# One reader per kind.


def read_matrices(path: Path) -> list[Shot]:
    """World-to-camera matrices: NPY of (..., 3 or 4, 4), or text, one of 3 × 4 or many of 4 × 4."""
    is_npy = path.suffix.lower() == ".npy"
    shots = []
    for n, matrix in enumerate(_npy_matrices(path) if is_npy else _text_matrices(path)):
        with _naming(f"{path}: pose {n}"):
            shots.append(Shot("", rigid(matrix)))
    return shots


def read_tum(path: Path) -> list[Shot]:
    """Camera-to-world: time, tx, ty, tz, qx, qy, qz, qw in each line (TUM RGB-D)."""
    lines = _lines(path)
    poses = _quaternion_poses(path, lines, _table(path, lines, 8)[:, 1:])
    return [Shot(line.words[0], pose) for line, pose in zip(lines, poses, strict=True)]


def read_icl(path: Path) -> list[Shot]:
    """Camera-to-world: tx, ty, tz, qx, qy, qz, qw in each line (as ICL-NUIM's in slambook)."""
    lines = _lines(path)
    return [Shot("", pose) for pose in _quaternion_poses(path, lines, _table(path, lines, 7))]


def read_log(path: Path) -> list[Shot]:
    """Camera-to-world: a line of three numbers and a 4 × 4 matrix for each (Open3D)."""
    lines = _lines(path)
    if [len(line.words) for line in lines] != [3, 4, 4, 4, 4] * (len(lines) // 5):
        raise ValueError(f"{path} is no trajectory: each pose has a line of 3 numbers and 4 of 4")
    rows = [line for n, line in enumerate(lines) if n % 5]
    shots = []
    for n, matrix in enumerate(_table(path, rows, 4).reshape(-1, 4, 4)):
        with _naming(f"{path}: pose {n}"):
            shots.append(Shot("", camera_to_world(matrix)))
    return shots


def read_nerf(path: Path) -> list[Shot]:
    """Camera-to-world in OpenGL's axes, and intrinsics (transforms.json of NeRF)."""
    text = _text(path)
    with _naming(str(path)):
        facts = json.loads(text)
    frames = facts.get("frames") if isinstance(facts, dict) else None
    if not isinstance(frames, list):
        raise ValueError(f"{path} has no list of frames as NeRF's transforms.json has")
    common = {key: value for key, value in facts.items() if key != "frames"}
    shots = []
    for n, frame in enumerate(frames):
        with _naming(f"{path}: frame {n}"):
            shots.append(_nerf_shot(path.parent, {**common, **frame}))
    return shots


def read_colmap(path: Path) -> list[Shot]:
    """World-to-camera poses of images.txt, and the cameras of cameras.txt beside it (COLMAP).

    `path` is the folder or its images.txt.
    """
    images = path / "images.txt" if path.is_dir() else path
    if not images.is_file():
        raise ValueError(
            f"{path} holds no images.txt; write COLMAP's model as text (colmap model_converter "
            "--output_type TXT)"
        )
    file = images.with_name("cameras.txt")
    cameras = _colmap_cameras(file) if file.is_file() else {}
    shots = []
    for number, line in _colmap_images(_text(images)):
        with _naming(f"{images}: line {number}"):
            shots.append(_colmap_shot(line, cameras))
    return shots


KINDS: Mapping[str, Callable[[Path], list[Shot]]] = {
    "matrix": read_matrices,
    "tum": read_tum,
    "icl": read_icl,
    "log": read_log,
    "nerf": read_nerf,
    "colmap": read_colmap,
}


def _recognised(path: Path) -> str:
    """Kind of a file, by its name or else by how many numbers its lines have."""
    if path.is_dir() or path.name.lower() == "images.txt":
        return "colmap"
    known = {".npy": "matrix", ".json": "nerf", ".log": "log"}.get(path.suffix.lower())
    if known is not None:
        return known
    counts = [len(line.words) for line in _lines(path)]
    if counts and (counts == [4] * 3 or (set(counts) == {4} and len(counts) % 4 == 0)):
        return "matrix"
    if counts and counts == [3, 4, 4, 4, 4] * (len(counts) // 5):
        return "log"
    of_all = {8: "tum", 7: "icl"}.get(counts[0]) if len(set(counts)) == 1 else None
    if of_all is None:
        raise ValueError(
            f"{path} is not recognised as a file of poses; say which it is: {', '.join(KINDS)}"
        )
    return of_all


def _npy_matrices(path: Path) -> Doubles:
    """Matrices (N, rows, columns) of an NPY."""
    with _naming(str(path)), path.open("rb") as file:
        given = np.lib.format.read_array(file, allow_pickle=False)
    if given.ndim < 2 or given.dtype.kind not in "uif" or not given.size:
        raise ValueError(f"{path} holds {given.dtype} of shape {given.shape}, not (3, 4) or (4, 4)")
    return given.reshape(-1, *given.shape[-2:]).astype(np.float64)


# Text.


def _text_matrices(path: Path) -> Doubles:
    """Matrices (N, 3 or 4, 4) of a text."""
    lines = _lines(path)
    numbers = _table(path, lines, 4)
    if len(lines) != 3 and (len(lines) % 4 or not lines):
        raise ValueError(f"{path} has {len(lines)} rows of 4 numbers; a pose has 3 or 4")
    return numbers.reshape(-1, 3 if len(lines) == 3 else 4, 4)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text") from None


def _lines(path: Path) -> list[Line]:
    """Lines that are neither empty nor comments."""
    lines = []
    for number, line in enumerate(_text(path).splitlines(), 1):
        words = [word for word in SEPARATOR.split(line.partition("#")[0]) if word]
        if words:
            lines.append(Line(number, words))
    return lines


def _table(path: Path, lines: Sequence[Line], count: int) -> Doubles:
    """Numbers of lines, (lines, count)."""
    rows = np.empty((len(lines), count))
    for n, line in enumerate(lines):
        if len(line.words) != count:
            raise ValueError(
                f"{path}: line {line.number} has {len(line.words)} numbers instead of {count}"
            )
        with _naming(f"{path}: line {line.number}"):
            rows[n] = [float(word) for word in line.words]
    return rows


@contextmanager
def _naming(place: str) -> Iterator[None]:
    """Say where a mistake is."""
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{place} has no {error.args[0]}") from None
    except (ValueError, TypeError, ArithmeticError, RecursionError) as error:
        raise ValueError(f"{place}: {error}") from None


def _quaternion_poses(path: Path, lines: Sequence[Line], numbers: Doubles) -> list[Doubles]:
    """Poses of camera-to-world tx, ty, tz, qx, qy, qz, qw."""
    poses = []
    for line, row in zip(lines, numbers, strict=True):
        with _naming(f"{path}: line {line.number}"):
            poses.append(camera_to_world(np.column_stack([from_quaternion(row[3:]), row[:3]])))
    return poses


# NeRF.


def _nerf_shot(folder: Path, facts: Mapping[str, Any]) -> Shot:
    pose = from_opengl(facts["transform_matrix"])
    name = str(facts.get("file_path", ""))
    if facts.get("camera_model", "") not in PINHOLES or facts.get("is_fisheye") or facts.get("k4"):
        raise ValueError("its lens is none of OpenCV's; undistort the pictures first")
    if "h" in facts and "w" in facts:
        shape: tuple[int, int] | None = (int(facts["h"]), int(facts["w"]))
    else:
        shape = _size(folder / name) if name else None
    matrix = _nerf_matrix(facts, shape)
    if matrix is None:
        return Shot(name, pose)
    coefficients = [float(facts.get(key, 0.0)) for key in ("k1", "k2", "p1", "p2", "k3")]
    return Shot(name, pose, Camera(matrix, pose, np.array(coefficients)), shape)


def _nerf_matrix(facts: Mapping[str, Any], shape: tuple[int, int] | None) -> Doubles | None:
    """Intrinsics of focal lengths or angles, the principal point by default in the middle."""
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
    """Focal length that sees an angle, rad, across a frame; not a number if one is unknown."""
    if angle <= 0 or angle >= math.pi:
        raise ValueError(f"a camera cannot see an angle of {angle:g}")
    return 0.5 * size / math.tan(0.5 * angle)


def _size(path: Path) -> tuple[int, int] | None:
    """Height and width of a picture, which NeRF names without its suffix; None if there is none."""
    import OpenImageIO

    for file in (path, path.with_name(path.name + ".png")):
        source = OpenImageIO.ImageInput.open(str(file)) if file.is_file() else None
        if source is not None:
            spec = source.spec()
            source.close()
            return spec.height, spec.width
    OpenImageIO.geterror()  # which it would print at the end of the process
    return None


# COLMAP.


def _colmap_images(text: str) -> Iterator[tuple[int, str]]:
    """Lines of pictures, numbered from 1; each is followed by one of points, which may be empty."""
    is_points = False
    for number, line in enumerate(text.splitlines(), 1):
        if is_points:
            is_points = False
        elif line.strip() and not line.startswith("#"):
            yield number, line
            is_points = True


def _colmap_shot(line: str, cameras: Mapping[str, Eye]) -> Shot:
    """Shot of: number, qw, qx, qy, qz, tx, ty, tz, number of the camera, name."""
    words = line.split(maxsplit=9)
    if len(words) != 10:
        raise ValueError(f"a picture has 10 words, not {len(words)}")
    w, x, y, z, *shift = [float(word) for word in words[1:8]]
    pose = rigid(np.column_stack([from_quaternion([x, y, z, w]), shift]))
    name = words[9].strip()
    if not cameras:
        return Shot(name, pose)
    if words[8] not in cameras:
        raise ValueError(f"cameras.txt has no camera {words[8]}")
    camera, shape = cameras[words[8]]
    return Shot(name, pose, camera.moved(pose), shape)


def _colmap_cameras(path: Path) -> dict[str, Eye]:
    """Cameras by number, of: number, model, width, height, parameters."""
    cameras = {}
    for line in _lines(path):
        with _naming(f"{path}: line {line.number}"):
            number, model = [*line.words, ""][:2]
            cameras[number] = _colmap_camera(model, [float(word) for word in line.words[2:]])
    return cameras


def _colmap_camera(model: str, numbers: Sequence[float]) -> Eye:
    if model not in COLMAP_MODELS:
        raise ValueError(
            f"COLMAP's model {model!r} is not known; known: {', '.join(COLMAP_MODELS)}; undistort"
            " the pictures first"
        )
    order = COLMAP_MODELS[model]
    if len(numbers) != 2 + max(order) + 1:
        raise ValueError(
            f"{model} has a width, a height and {max(order) + 1} numbers, not {len(numbers)}"
        )
    width, height, *given = numbers
    fx, fy, cx, cy, *coefficients = [given[n] if n >= 0 else 0.0 for n in order]
    distortion = coefficients or None
    return Camera.from_intrinsics(fx, fy, cx, cy, distortion=distortion), (int(height), int(width))
