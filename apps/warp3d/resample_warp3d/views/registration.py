"""Refine the poses of several views until their colors and depths agree where they overlap."""

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from resample.types import Doubles, Floats, Indices
from resample_warp3d.depth.equation import places
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Source

BLURS = (4.0, 2.0, 1.0, 0.0)  # px, deviations of the blur of colors, one after another
STEPS = 6  # of Gauss-Newton for each
COMPARED = 4_000  # approximate number of points per view, for fitting and for checking
CLOSE = 0.08  # relative nearness within which a point belongs to a surface
FEWEST = 200  # points that two views must share to be compared
DARK = 0.02  # of the brightest color, added to all before their logarithm is taken
TOLERANT = 2.0  # deviations at which an error counts half
HOLD = 1e-4  # of a view's mean weight: what holds it where it is
SLIGHT = 1e-5  # rad, or of the median depth: shorter steps are the last
BETTER = 1.03  # times the agreement of points that are not fitted: with less, poses stay
ALL = RIGHT | DOWN | LEFT | UP


class Sampled(NamedTuple):
    """Data of a view that are compared with others."""

    matrix: Doubles  # (3, 3) of its camera
    bright: Floats  # (H, W) log of the color
    near: Floats  # (H, W) nearness; nan where unknown
    slope: Floats  # (H, W, 2) of the nearness
    chosen: tuple[tuple[Indices, Indices], ...]  # samples, for fitting and for checking
    points: tuple[Doubles, ...]  # (N, 3) of both, in the camera


# Errors of the colors and depths (2, N) of points of a view in another one, and their slopes
# (2, N, 12) by translation and rotation of the first and the second view.
Pairs = dict[tuple[int, int], tuple[Doubles, Doubles]]


def refined_poses(
    sources: Sequence[Source], matrices: Sequence[Doubles], poses: Sequence[Doubles]
) -> list[Doubles]:
    """Return poses (4, 4) world-to-camera of views at which their colors and depths agree best.

    Gauss-Newton on log color and log nearness at points of each view in each other one, with colors
    blurred less and less (Steinbruecker, Sturm, Cremers 2011). No view is known to be right, so
    their mean stays. All stay unless points that are not fitted agree better afterwards.
    """
    views = [_sampled(s, m) for s, m in zip(sources, matrices, strict=True)]
    depth = np.median(np.concatenate([view.points[0][:, 2] for view in views]))
    unit = np.repeat([depth, 1.0], 3)
    given = [np.asarray(pose, np.float64) for pose in poses]
    found, moved, soft = given, np.zeros((len(views), 6)), []
    for blur in BLURS:
        soft = [_blurred(view.bright, blur) for view in views]
        for _ in range(STEPS):
            pairs = _compared(views, soft, found, 0)
            if not pairs:
                return given
            step = _step(pairs, moved, unit)
            moved = moved + step
            turns = Rotation.from_rotvec((step * unit)[:, 3:]).as_matrix()
            motion = np.tile(np.eye(4), (len(found), 1, 1))  # of each camera, in its coordinates
            motion[:, :3] = np.concatenate([turns, (step * unit)[:, :3, None]], axis=2)
            found = [move @ pose for move, pose in zip(motion, found, strict=True)]
            if np.abs(step).max() < SLIGHT:
                break
    before, after = (_compared(views, soft, each, 1) for each in (given, found))
    deviations = _deviations(before or after)
    is_better = _agreement(after, deviations) > BETTER * _agreement(before, deviations)
    return found if is_better else given


def _sampled(source: Source, matrix: Doubles) -> Sampled:
    """Extract the points to compare from a source."""
    bright = source.color.mean(axis=2)
    bright = np.log(bright / np.float32(max(float(bright.max()), 1e-9)) + np.float32(DARK))
    place = places(DepthImage(source.color, source.nearness, source.place))
    row, column = np.nonzero((source.nearness > 0) & ((source.links & ALL) == ALL))
    every = max(1, row.size // (2 * COMPARED))
    chosen = tuple((row[n :: 2 * every], column[n :: 2 * every]) for n in (0, every))
    back = np.linalg.inv(matrix)
    points = tuple(
        np.c_[place[at], np.ones(at[0].size)] @ back.T / source.nearness[at].astype(float)[:, None]
        for at in chosen
    )
    near = np.where(source.nearness > 0, source.nearness, np.float32(np.nan))
    return Sampled(matrix, np.asarray(bright, np.float32), near, source.slope, chosen, points)


def _blurred(values: Floats, sigma: float) -> list[Floats]:
    """Blur a map; also return its slopes."""
    import cv2

    soft = np.asarray(cv2.GaussianBlur(values, (0, 0), sigma)) if sigma else values
    down, across = np.gradient(soft)
    return [soft, across, down]


def _compared(
    views: Sequence[Sampled], soft: Sequence[Sequence[Floats]], poses: Sequence[Doubles], which: int
) -> Pairs:
    """Compare the points of each view with each other view."""
    found = {}
    for first, second in permutations(range(len(views)), 2):
        color = soft[first][0][views[first].chosen[which]].astype(np.float64)
        turn = poses[second] @ np.linalg.inv(poses[first])
        errors = _errors(views[second], soft[second], turn, views[first].points[which], color)
        if errors[0].shape[1] >= FEWEST:
            found[first, second] = errors
    return found


def _errors(
    view: Sampled, soft: Sequence[Floats], turn: Doubles, point: Doubles, color: Doubles
) -> tuple[Doubles, Doubles]:
    """Compare points (N, 3) of another camera, and their colors, with a view."""
    there = point @ turn[:3, :3].T + turn[:3, 3]
    there[:, 2] = np.where(there[:, 2] > 0, there[:, 2], np.nan)
    flat = there[:, :2] / there[:, 2:]
    at = flat @ view.matrix[:2, :2].T + view.matrix[:2, 2] - 0.5
    seen = _interpolated([*soft, view.near, view.slope[..., 0], view.slope[..., 1]], at)
    depth = np.log(seen[3] * there[:, 2])
    shared = np.abs(depth) < CLOSE
    point, there, depth = point[shared], there[shared], depth[shared]
    change = (seen[0] - color)[shared]
    change -= np.median(change) if change.size else 0.0  # exposures may differ
    # How both errors change as the point moves in the view's camera.
    across = np.zeros((len(there), 2, 3))
    across[:, [0, 1], [0, 1]], across[:, :, 2] = 1.0, -flat[shared]
    across = view.matrix[:2, :2] @ across / there[:, 2, None, None]
    slope = seen[1:3], seen[4:] / seen[3]
    toward = [np.einsum("kn,nkx->nx", each[:, shared], across) for each in slope]
    toward[1][:, 2] += 1.0 / there[:, 2]
    slopes = []
    for by in toward:
        back = by @ turn[:3, :3]
        slopes.append(np.c_[-back, -np.cross(point, back), by, np.cross(there, by)])
    return np.stack([change, depth]), np.stack(slopes)


def _interpolated(maps: Sequence[Floats], at: Doubles) -> Doubles:
    """Interpolate maps (H, W) at places (N, 2), (K, N); nan outside."""
    low = np.floor(np.nan_to_num(at, nan=-1.0))
    column, row = np.clip(low, -1, np.array(maps[0].shape[::-1])).astype(np.int64).T
    inside = (column >= 0) & (row >= 0)
    inside &= (column < maps[0].shape[1] - 1) & (row < maps[0].shape[0] - 1)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    x, y = (at - low).T
    parts = [(0, 0, (1 - x) * (1 - y)), (0, 1, x * (1 - y)), (1, 0, (1 - x) * y), (1, 1, x * y)]
    found = [sum(w * each[row + r, column + c] for r, c, w in parts) for each in maps]
    return np.where(inside, np.stack(found), np.nan)


def _deviations(pairs: Pairs) -> Doubles:
    """Return the median absolute errors of colors and depths."""
    errors = np.abs(np.concatenate([error for error, _ in pairs.values()], axis=1))
    return np.asarray(np.maximum(np.median(errors, axis=1), 1e-6))


def _agreement(pairs: Pairs, deviations: Doubles) -> float:
    """Count the points that agree, those that are off by two deviations half."""
    errors = (error / (TOLERANT * deviations[:, None]) for error, _ in pairs.values())
    return sum(float(np.sum(1.0 / (1.0 + np.square(each)))) for each in errors)


def _step(pairs: Pairs, moved: Doubles, unit: Doubles) -> Doubles:
    """Return the step (V, 6) of all views, in median depths and rad, by weighted least squares."""
    count = len(moved)
    normal, right = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    deviations = _deviations(pairs)[:, None]
    for pair, (off, by) in pairs.items():
        error, slope = off / deviations, by * np.tile(unit, 2) / deviations[..., None]
        weight = 1.0 / (1.0 + np.square(error / TOLERANT))
        square = np.einsum("kn,kni,knj->ij", weight, slope, slope, optimize=False)
        toward = np.einsum("kn,kni->i", weight * error, slope).reshape(2, 6)
        for n, view in enumerate(pair):
            right[view] -= toward[n]
            for m, other in enumerate(pair):
                normal[view, :, other] += square[6 * n : 6 * n + 6, 6 * m : 6 * m + 6]
    flat = normal.reshape(6 * count, 6 * count)
    hold = HOLD * np.trace(flat) / len(flat)
    step = np.linalg.solve(flat + hold * np.eye(len(flat)), right.ravel() - hold * moved.ravel())
    return np.asarray(step.reshape(count, 6))
