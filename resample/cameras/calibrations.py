"""Calibrated cameras as programs that reconstruct scenes write them: COLMAP and NeRF.

Their pixel centers are at + 0.5: COLMAP's are, and NeRF's, which are made from them.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import from_opengl, from_quaternion, rigid
from resample.cameras.trajectories import Shot, lines_of
from resample.types import Doubles
from resample.words import naming, text_of

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

Sized = tuple[Camera, tuple[int, int]]  # without a pose; height and width of its pictures, px


# NeRF.


def read_nerf(path: Path) -> list[Shot]:
    """Camera-to-world in OpenGL's axes, and intrinsics (transforms.json of NeRF)."""
    text = text_of(path)
    with naming(str(path)):
        facts = json.loads(text)
    frames = facts.get("frames") if isinstance(facts, dict) else None
    if not isinstance(frames, list):
        raise ValueError(f"{path} has no list of frames as NeRF's transforms.json has")
    common = {key: value for key, value in facts.items() if key != "frames"}
    shots = []
    for n, frame in enumerate(frames):
        with naming(f"{path}: frame {n}"):
            shots.append(_nerf_shot(path.parent, {**common, **frame}))
    return shots


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
    for number, line in _colmap_images(text_of(images)):
        with naming(f"{images}: line {number}"):
            shots.append(_colmap_shot(line, cameras))
    return shots


def _colmap_images(text: str) -> Iterator[tuple[int, str]]:
    """Lines of pictures, numbered from 1; each is followed by one of points, which may be empty."""
    is_points = False
    for number, line in enumerate(text.splitlines(), 1):
        if is_points:
            is_points = False
        elif line.strip() and not line.startswith("#"):
            yield number, line
            is_points = True


def _colmap_shot(line: str, cameras: Mapping[str, Sized]) -> Shot:
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


def _colmap_cameras(path: Path) -> dict[str, Sized]:
    """Cameras by number, of: number, model, width, height, parameters."""
    cameras = {}
    for line in lines_of(path):
        with naming(f"{path}: line {line.number}"):
            number, model = [*line.words, ""][:2]
            cameras[number] = _colmap_camera(model, [float(word) for word in line.words[2:]])
    return cameras


def _colmap_camera(model: str, numbers: Sequence[float]) -> Sized:
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
