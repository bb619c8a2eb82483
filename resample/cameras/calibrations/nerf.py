"""Cameras of NeRF's transforms.json; pixel centers are at + 0.5."""

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera, LensModel
from resample.cameras.poses import from_opengl
from resample.cameras.trajectories import Entry, PosedPicture, Refused, entry_of, facts_of
from resample.messages import naming
from resample.reading.pictures import opened
from resample.types import Doubles

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
        entries.append(entry_of(place, name, _entry, place, path.parent, common, frame))
    return entries


def _entry(place: str, folder: Path, common: Facts, frame: Facts) -> Entry:
    """Entry of a frame and the values common to all; without its camera if that is invalid."""
    facts = {**common, **frame}
    name, pose = str(facts.get("file_path", "")), from_opengl(facts["transform_matrix"])
    try:
        with naming(place):
            return _shot(folder, name, pose, facts)
    except ValueError as error:
        return Refused(name, str(error), pose)


def _shot(folder: Path, name: str, pose: Doubles, facts: Facts) -> PosedPicture:
    """Frame with its camera, if the file has one."""
    model, names = _lens(facts)
    if "h" in facts and "w" in facts:
        shape: tuple[int, int] | None = (int(facts["h"]), int(facts["w"]))
    else:
        shape = _size(folder / name) if name else None
    matrix = _matrix(facts, shape)
    if matrix is None:
        return PosedPicture(name, pose)
    coefficients = [float(facts.get(key, 0.0)) for key in names]
    return PosedPicture(
        name, pose, Camera(matrix, pose, np.array(coefficients), model=model), shape
    )


def _lens(facts: Facts) -> tuple[LensModel, tuple[str, ...]]:
    """Lens model and the names of its coefficients."""
    model = facts.get("camera_model", "")
    if model == "OPENCV_FISHEYE" or (not model and facts.get("is_fisheye")):
        return LensModel.FISHEYE, ("k1", "k2", "k3", "k4")
    if model not in PINHOLES or facts.get("is_fisheye") or facts.get("k4"):
        raise ValueError("its lens is not a model of OpenCV's; undistort the pictures first")
    return LensModel.PINHOLE, ("k1", "k2", "p1", "p2", "k3")


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


def _size(path: Path) -> tuple[int, int] | None:
    """Height and width of a picture, whose suffix NeRF may omit; None if there is none."""
    for file in (path, path.with_name(path.name + ".png")):
        if not file.is_file():
            continue
        with suppress(OSError):
            source = opened(file)
            spec = source.spec()
            source.close()
            return spec.height, spec.width
    return None
