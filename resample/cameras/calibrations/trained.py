"""Cameras of trained scenes: the cameras.json that is written beside 3D Gaussians."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.trajectories import Entry, PosedPicture, entry_of, is_trained
from resample.reading.texts import json_of, text_of
from resample.words import naming


def read_trained(path: Path) -> list[Entry]:
    """Read camera-to-world rotations, positions and intrinsics (cameras.json, Kerbl et al. 2023).

    The principal point is the picture's middle.
    """
    text = text_of(path)
    with naming(str(path)):
        facts = json_of(text)
    if not is_trained(facts):
        raise ValueError(f"{path} is no list of cameras with rotation, position and fx")
    return [
        entry_of(f"{path}: camera {n}", _name(each), _shot, each) for n, each in enumerate(facts)
    ]


def _name(facts: Any) -> str:
    return str(facts.get("img_name", "")) if isinstance(facts, dict) else ""


def _shot(facts: Mapping[str, Any]) -> PosedPicture:
    """One camera of the list."""
    turn, place = np.array(facts["rotation"], float), np.array(facts["position"], float)
    if turn.shape != (3, 3) or place.shape != (3,):
        raise ValueError(f"a rotation of {turn.shape} and a position of {place.shape}")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ place
    width, height = int(facts["width"]), int(facts["height"])
    fx, fy = float(facts["fx"]), float(facts.get("fy", facts["fx"]))
    camera = Camera.from_intrinsics(fx, fy, width / 2, height / 2, pose)
    return PosedPicture(_name(facts), camera.world_to_camera, camera, (height, width))
