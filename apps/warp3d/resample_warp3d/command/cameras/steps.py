"""Poses of cameras that moved and turned."""

import math
from collections.abc import Sequence

import numpy as np

from resample.types import Doubles


def stepped(move: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Doubles:
    """Return the pose (4, 4) of a camera after a move and a turn, in its previous axes.

    Parameters
    ----------
    move
        To the right, down and forward, scene units.
    turn
        To the right, up and clockwise, degrees; in this order, each about the camera's new axes.
    """
    yaw, pitch, roll = np.radians(np.asarray(turn, np.float64))
    axes = _about(1, yaw) @ _about(0, pitch) @ _about(2, roll)  # columns: the new axes in the old
    pose = np.eye(4)
    pose[:3, :3] = axes.T
    pose[:3, 3] = -axes.T @ np.asarray(move, np.float64)
    return pose


def _about(axis: int, angle: float) -> Doubles:
    """Return the rotation (3, 3) about a camera's axis; 0 is x."""
    cosine, sine = math.cos(angle), math.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[[first, second], [first, second]] = cosine
    turned[first, second], turned[second, first] = -sine, sine
    return turned
