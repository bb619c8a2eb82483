"""Move 3D Gaussians by poses, and join several scenes."""

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles, Floats
from resample_points.data.gaussians import SHAPES, Gaussians
from resample_points.data.harmonics import (
    WIDEST,
    parts_of,
    rounded_to,
    step_of,
    turned_harmonics,
)

LOG = logging.getLogger("resample")
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
DOWN = "-y"  # what is up in scenes that say nothing, as in photographs
SIMILAR = 1e-4  # relative error of a pose's axes, as float32 and text have


def placed_gaussians(gaussians: Gaussians, pose: ArrayLike) -> Gaussians:
    """Return Gaussians moved by a pose: a rotation, one scale of all axes and a shift.

    Parameters
    ----------
    pose
        (3, 4) or (4, 4), old to new positions.

    Returns
    -------
    Positions, scales, rotations and harmonics are turned with the pose. `up` is kept if the pose
    does not turn.

    Raises
    ------
    ValueError
        The pose is none, or it mirrors or shears.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians
    >>> from resample_points.data.joining import placed_gaussians
    >>> parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    >>> one = Gaussians(*parts, np.ones(1), np.zeros((1, 3)))
    >>> double = np.diag([2.0, 2.0, 2.0, 1.0])
    >>> placed_gaussians(one, double).scale.tolist()
    [[2.0, 2.0, 2.0]]
    """
    turn, size, shift = _similarity(pose)
    position = (size * np.asarray(gaussians.position, np.float64)) @ turn.T + shift
    moved = gaussians._replace(
        position=position.astype(np.float32),
        scale=(size * np.asarray(gaussians.scale, np.float64)).astype(np.float32),
        training=None,
    )
    if np.array_equal(turn, np.eye(3)):
        return moved
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    rotation = (np.asarray(gaussians.rotation, np.float64) @ product.T).astype(np.float32)
    return _with_turned_harmonics(moved, turn)._replace(rotation=rotation, up=None)


def with_up(gaussians: Gaussians, up: str) -> Gaussians:
    """Return a scene turned so that another axis is up; one that says nothing has y down."""
    have, wanted = (
        np.array(AXES[name[-1]]) * (-1 if name[0] == "-" else 1)
        for name in (gaussians.up or DOWN, up)
    )
    if (have == wanted).all():
        return gaussians
    axis = np.cross(have, wanted)
    if not axis.any():  # half a turn
        axis = np.array(AXES["y" if have[0] else "x"])
        turn = 2 * np.outer(axis, axis) - np.eye(3)
    else:  # a quarter
        across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turn = np.outer(axis, axis) + across
    pose = np.column_stack([turn, np.zeros(3)])
    return placed_gaussians(gaussians, pose)._replace(up=up)


def _similarity(pose: ArrayLike) -> tuple[Doubles, float, Doubles]:
    """Return rotation (3, 3), scale and shift (3,) of a pose."""
    matrix = np.asarray(pose, np.float64)
    is_affine = matrix.shape in {(3, 4), (4, 4)} and np.isfinite(matrix).all()
    if not is_affine or (len(matrix) == 4 and not np.allclose(matrix[3], (0, 0, 0, 1))):
        raise ValueError(
            f"a pose of shape {matrix.shape}; give finite numbers (3, 4), or (4, 4) with the last "
            "row 0 0 0 1"
        )
    linear = matrix[:3, :3]
    volume = float(np.linalg.det(linear))
    size = volume ** (1 / 3) if volume > 0 else 0.0
    if size == 0 or np.abs(linear.T @ linear - size * size * np.eye(3)).max() > SIMILAR * size**2:
        raise ValueError(
            "a pose that mirrors or shears; give a rotation times one positive scale, and a shift"
        )
    left, _, right = np.linalg.svd(linear)  # the closest rotation
    turn = linear / size if np.array_equal(linear, size * np.eye(3)) else left @ right
    return turn, size, matrix[:3, 3]


def _with_turned_harmonics(gaussians: Gaussians, turn: Doubles) -> Gaussians:
    """Return Gaussians whose harmonics are turned, with a new step."""
    count = gaussians.harmonics.shape[1]
    if not count:
        return gaussians
    matrix = turned_harmonics(turn, count).astype(np.float32)
    harmonics, largest = gaussians.harmonics, 0.0
    for rows in parts_of(len(harmonics)):
        largest = max(largest, float(np.abs(_mixed(matrix, harmonics[rows])).max(initial=0.0)))
    ratio = max(1.0, largest / WIDEST)  # a coarser step only where the numbers grow
    turned = np.empty_like(harmonics)
    for rows in parts_of(len(harmonics)):
        turned[rows] = rounded_to(_mixed(matrix, harmonics[rows]), ratio)
    return gaussians._replace(harmonics=turned, harmonic_step=gaussians.harmonic_step * ratio)


def _mixed(matrix: Floats, harmonics: NDArray[np.int16]) -> Floats:
    """Apply a matrix (K, K) to coefficients (N, K, 3)."""
    mixed: Floats = np.matmul(matrix, harmonics.astype(np.float32))
    return mixed


def joined_gaussians(
    parts: Sequence[Gaussians], poses: Sequence[ArrayLike | None] | None = None
) -> Gaussians:
    """Join several scenes, each moved by a pose if there are poses.

    Harmonics that a scene lacks are 0. The scene is antialiased if all parts are; where some are
    and others are not, that is logged. `up` is kept if all agree.

    Raises
    ------
    ValueError
        There are no parts, a pose is none, or they are not as many.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points.data.gaussians import Gaussians
    >>> from resample_points.data.joining import joined_gaussians
    >>> parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    >>> one = Gaussians(*parts, np.ones(1), np.zeros((1, 3)))
    >>> aside = np.array([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0.0]])
    >>> joined_gaussians([one, one], [None, aside]).position.tolist()
    [[1.0, 1.0, 1.0], [6.0, 1.0, 1.0]]
    """
    if not parts or (poses is not None and len(poses) != len(parts)):
        given = "no poses" if poses is None else f"{len(poses)} poses"
        raise ValueError(f"{len(parts)} scenes and {given}; give one or more, and a pose for each")
    pairs = zip(parts, poses or [None] * len(parts), strict=True)
    moved = [part if pose is None else placed_gaussians(part, pose) for part, pose in pairs]
    if len(moved) == 1:
        return moved[0]
    modes = {part.is_antialiased for part in moved}
    if len(modes) > 1:
        LOG.warning(
            "some of the joined scenes were trained antialiased and others were not; all are "
            "treated as if they were not"
        )
    ups = {part.up for part in moved}
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in moved]) for name in SHAPES
    }
    harmonics, step = _joined_harmonics(moved)
    up = ups.pop() if len(ups) == 1 else None
    seen = [part.training for part in moved if part.training is not None]
    known = next((training for training in seen if not training.is_estimated), None)
    return Gaussians(**arrays, harmonics=harmonics, harmonic_step=step)._replace(
        is_antialiased=modes == {True}, up=up, training=known
    )


def _joined_harmonics(parts: Sequence[Gaussians]) -> tuple[NDArray[np.int16], float]:
    """Join coefficients of several degrees and steps."""
    width = max(part.harmonics.shape[1] for part in parts)
    joined = np.zeros((sum(len(part.position) for part in parts), width, 3), np.int16)
    with_any = [part for part in parts if part.harmonics.size]
    steps = {part.harmonic_step for part in with_any}
    step = steps.pop() if len(steps) == 1 else step_of(max(map(_largest, with_any), default=0.0))
    first = 0
    for part in parts:
        count = part.harmonics.shape[1]
        for rows in parts_of(len(part.position) if count else 0):
            some = part.harmonics[rows]
            if part.harmonic_step != step:
                some = rounded_to(some.astype(np.float32) * np.float32(part.harmonic_step), step)
            joined[first + rows.start : first + rows.stop, :count] = some
        first += len(part.position)
    return joined, step


def _largest(gaussians: Gaussians) -> float:
    """Return the largest size of a coefficient."""
    low, high = int(gaussians.harmonics.min()), int(gaussians.harmonics.max())
    return max(-low, high) * gaussians.harmonic_step
