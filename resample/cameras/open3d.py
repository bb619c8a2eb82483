"""Cameras of Open3D trajectories; pixel centers are at + 0."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.poses import rigid
from resample.cameras.trajectories import Entry, PosedPicture, entry_of
from resample.reading.texts import json_of, text_of
from resample.words import naming

Facts = Mapping[str, Any]


def is_open3d(path: Path) -> bool:
    """Whether a JSON file is a trajectory or a single camera of Open3D."""
    facts = _facts(path)
    return isinstance(facts, dict) and ("parameters" in facts or "extrinsic" in facts)


def read_open3d(path: Path) -> list[Entry]:
    """Read world-to-camera poses and intrinsics (`PinholeCameraTrajectory` and -`Parameters`).

    Matrices are column-major.
    """
    facts = _facts(path)
    if not isinstance(facts, dict) or not {"parameters", "extrinsic"} & set(facts):
        raise ValueError(f"{path} has neither parameters nor an extrinsic as Open3D's files have")
    given = facts.get("parameters", [facts])
    if not isinstance(given, list):
        raise ValueError(f"{path} has no list of parameters as Open3D's trajectories have")
    return [entry_of(f"{path}: camera {n}", "", _shot, each) for n, each in enumerate(given)]


def _facts(path: Path) -> Any:
    """Parse a JSON file."""
    text = text_of(path)
    with naming(str(path)):
        return json_of(text)


def _shot(facts: Facts) -> PosedPicture:
    """Parse one camera."""
    pose = rigid(_columns(facts, "extrinsic", 4))
    inner = facts.get("intrinsic")
    if not inner:
        return PosedPicture("", pose)
    camera = Camera.from_opencv(_columns(inner, "intrinsic_matrix", 3)).moved(pose)
    height, width = int(inner.get("height", 0)), int(inner.get("width", 0))
    return PosedPicture("", pose, camera, (height, width) if min(height, width) > 0 else None)


def _columns(facts: Facts, name: str, side: int) -> Any:
    """Matrix from a flat list in column order, or from a list of rows."""
    given = np.asarray(facts[name], np.float64)
    if given.shape not in ((side * side,), (side, side)):
        raise ValueError(f"its {name} has {given.size} numbers, not {side * side}")
    return given.reshape(side, side).T if given.ndim == 1 else given
