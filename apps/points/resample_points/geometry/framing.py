"""Cameras that frame point clouds."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import UpAxis, orbit
from resample.cameras.viewpoints import Sphere
from resample.messages import number, shape_of
from resample.outofcore.passes import memoized
from resample.types import Doubles, Floats
from resample_points.data.cloud import Cloud, check_cloud, places
from resample_points.data.parts import STEP, rows_of, zeros_beside
from resample_points.geometry.spacing import Surfels

FIELD = 40.0  # degrees along the frame's shorter side, by default
FILLED = 0.95  # share of the frame's width or height that the cloud fills
DIRECTIONS = 25  # view directions of a film that determine its distance
LEAST = 1e-12  # scene units, least distance from the camera to the cloud
STRAY = 0.01  # of all points; separate clumps that hold less are ignored
TINY, TINY_STRAY = 0.001, 0.05  # the same for clumps that hold at most so few each
PER_CELL = 8  # points per cell, if spread evenly over the bounding box
ROUNDING = 1e-12  # relative; above the rounding of sums of three products
LEAST_CELLS, MOST_CELLS = 3, 32  # along the longest side of the box

Flags = NDArray[np.bool_]


class Framing(NamedTuple):
    """Points of a cloud to frame: N points, and bounding boxes of M parts."""

    position: Floats | Doubles  # (N, 3)
    origin: Doubles  # (3,) added to the positions
    axes: Floats  # (N, 2, 3) half axes of the discs; or (0, 2, 3)
    kept: Flags  # (N,) points to frame
    part: NDArray[np.int64]  # (M,) indices of parts of `STEP` points
    low: Doubles  # (M, 3) least coordinates of parts, without the origin
    high: Doubles  # (M, 3) (M, 3) greatest
    reach: float  # scene units, radius of the largest disc
    middle: Doubles  # (3,) reference point of directions, scene units

    def farthest(self, along: Doubles) -> float:
        """Return the greatest product of a direction (3,) and a position on a disc.

        Parts are visited while their boxes may contain a greater one.
        """
        x, y, z = (float(part) for part in along)
        corner = np.maximum(self._placed(self.low) * along, self._placed(self.high) * along)
        bound = corner.sum(axis=1) + self.reach * math.sqrt(x * x + y * y + z * z)
        slack = ROUNDING * (np.abs(corner).sum(axis=1) + np.abs(bound))
        bound, most = bound + slack, -np.inf
        for n in np.argsort(-bound, kind="stable"):
            if bound[n] < most:
                break
            rows = slice(int(self.part[n]) * STEP, (int(self.part[n]) + 1) * STEP)
            kept = self.kept[rows]
            place = self._placed(self.position[rows][kept])
            value = place[:, 0] * x + place[:, 1] * y + place[:, 2] * z
            if len(self.axes):
                axes = self.axes[rows][kept].astype(np.float64)
                sides = axes[..., 0] * x + axes[..., 1] * y + axes[..., 2] * z
                value += np.sqrt(sides[:, 0] * sides[:, 0] + sides[:, 1] * sides[:, 1])
            most = max(most, float(value.max()))
        return most

    def _placed(self, position: Floats | Doubles) -> Doubles:
        return np.asarray(position + self.origin - self.middle, np.float64)

    def box_middle(self) -> Doubles:
        """Return the center (3,) of the points' bounding box, scene units."""
        low, high = self._placed(self.low.min(axis=0)), self._placed(self.high.max(axis=0))
        return np.asarray(0.5 * (low + high), np.float64)

    def farthest_from(self, middle: Doubles) -> float:
        """Return the distance of the farthest point from a place, scene units."""
        most, about = 0.0, self._replace(middle=middle)
        for rows in rows_of(self.position):
            place = about._placed(self.position[rows][self.kept[rows]])
            most = max(most, float((place * place).sum(axis=1).max(initial=0.0)))
        return math.sqrt(most)


def framed(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    azimuth: float = 0.0,
    elevation: float = 0.0,
    distance: float | None = None,
    up: UpAxis = "z",
    fov: float = FIELD,
) -> Camera | Orthographic:
    """Return a camera that frames a cloud.

    Separate clumps of points are ignored if they hold less than a hundredth of all points together.

    Parameters
    ----------
    cloud
        The cloud to look at.
    size
        Width and height of the picture, px.
    azimuth, elevation, up
        Direction of the camera, degrees, and the axis that points upward, as
        `resample.cameras.poses.orbit` takes them.
    distance
        Distance from the center of the points' bounding box, scene units. By default the visible
        points fill the frame and are centered in it.
    fov
        Degrees along the frame's shorter side; 0: a parallel camera.

    Raises
    ------
    ValueError
        The cloud has no points, or a number is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, framed
    >>> place = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    >>> cloud = Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    >>> camera = framed(cloud, size=(64, 48), azimuth=30, elevation=20)
    >>> pose = camera.world_to_camera
    >>> x, y, z = camera.matrix @ (pose[:3, :3] @ place.T + pose[:3, 3:])
    >>> round(np.ptp(y / z).item() / 48, 2)  # of the picture's height
    0.95
    """
    check_cloud(cloud, Cloud | Surfels)
    if distance is not None:
        number("distance", distance)
    seen, pose = _visible(cloud), orbit(np.zeros(3), 1.0, azimuth, elevation, up)
    axes = pose[:3, :3]
    if fov == 0:
        # A parallel camera's picture is filled, from just before the cloud.
        least, most = (
            np.array([sign * seen.farthest(sign * axis) for axis in axes]) for sign in (-1, 1)
        )
        extent = np.maximum(most - least, LEAST)
        scale = float((FILLED * np.array(size) / extent[:2]).min())
        pose[:3, 3] = *(-0.5 * (least + most)[:2]), extent[2] - least[2]
        return Orthographic(scale, scale, size[0] / 2, size[1] / 2, pose)
    camera = _camera(size, fov)
    if distance is None:
        # Take the nearest center from which all points are seen.
        slope = _slopes(camera, size)
        right, left = _sides(seen, axes, slope)
        depth = float((-(right + left) / (2.0 * slope)).min())
        depth = min(depth, -seen.farthest(-axes[2]) - LEAST)
        pose[:3, 3] = -np.array([*(0.5 * (right - left)), depth])
        return camera.moved(pose)
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"a distance of {distance}; give a length above 0")
    return camera.moved(orbit(seen.box_middle(), distance, azimuth, elevation, up))


def framed_together(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    angles: Sequence[tuple[float, float]],
    up: UpAxis = "z",
    fov: float = FIELD,
) -> list[Camera]:
    """Return cameras at one distance from a cloud's center that all show the whole cloud.

    `angles`: azimuth and elevation of each, degrees.
    """
    seen = _visible(cloud)
    middle, camera = seen.box_middle(), _camera(size, fov)
    slope = _slopes(camera, size)
    around = seen._replace(middle=middle)
    away = LEAST
    each = sorted(set(angles))
    # On an orbit cosines change by under 1 % between two of so many.
    for n in np.linspace(0, len(each) - 1, min(len(each), DIRECTIONS)).astype(int):
        sides = _sides(around, orbit(np.zeros(3), 1.0, *each[int(n)], up)[:3, :3], slope)
        away = max(away, float((sides / slope).max()))
    return [camera.moved(orbit(middle, away, *pair, up)) for pair in angles]


def ball_around(cloud: Cloud | Surfels) -> Sphere:
    """Return a bounding sphere of a cloud's framed points, scene units."""
    seen = _visible(cloud)
    middle = seen.box_middle()
    return Sphere(middle, max(seen.farthest_from(middle) + seen.reach, LEAST))


def _camera(size: tuple[int, int], fov: float) -> Camera:
    if not 0 < fov < 180:
        raise ValueError(f"a field of view of {fov:g} degrees; 0 to below 180 are allowed")
    return Camera.from_fov(fov, *shape_of(size))


def _slopes(camera: Camera, size: tuple[int, int]) -> Doubles:
    """Return the tangents (2,) of the half angles, x and y, for points to fill."""
    return 0.5 * FILLED * np.array([size[0] / camera.fx, size[1] / camera.fy], np.float64)


def _sides(seen: Framing, axes: Doubles, slope: Doubles) -> Doubles:
    """Return the cloud's extent against the frame's sides: right, bottom; left, top; (2, 2).

    `axes` (3, 3) holds the camera's axes in its rows. For a camera at the origin a point p is
    within a side of the frame if ± x − slope z ≤ 0; for one at e, if that is at most ± x − slope z
    of e.
    """
    touched = np.zeros((2, 2))
    for k in range(2):
        for n, sign in enumerate((1.0, -1.0)):
            touched[n, k] = seen.farthest(sign * axes[k] - slope[k] * axes[2])
    return touched


@memoized(lambda cloud: cloud.position)
def _visible(cloud: Cloud | Surfels) -> Framing:
    """Return the points of a cloud without small separate clumps."""
    position = cloud.position if isinstance(cloud, Surfels) else places(cloud)
    if not len(position):
        raise ValueError("a cloud without points cannot be looked at")
    axes = cloud.axes if isinstance(cloud, Surfels) else np.zeros((0, 2, 3), np.float32)
    kept: Flags = zeros_beside(position, (len(position),), np.bool_)
    kept[:] = True
    before, left = 0, len(position)
    while left != before:
        before, left = left, _leave_out(position, kept, left)
    part, low, high = _boxes(position, kept)
    farthest = 0.0  # square of the largest disc's radius, at most
    for rows in rows_of(axes):
        some = axes[rows][kept[rows]].reshape(-1, 6).astype(np.float64)
        square = some[:, 0] * some[:, 0]
        for c in range(1, 6):
            square += some[:, c] * some[:, c]
        farthest = max(farthest, float(square.max(initial=0.0)))
    reach = math.sqrt(farthest)
    origin = cloud.origin if isinstance(cloud, Surfels) else np.zeros(3)
    return Framing(position, origin, axes, kept, part, low, high, reach, np.zeros(3))


def _boxes(position: Floats | Doubles, kept: Flags) -> tuple[NDArray[np.int64], Doubles, Doubles]:
    """Return the parts that hold kept points, with their least and greatest coordinates."""
    found = []
    for part, rows in enumerate(rows_of(position)):
        some = position[rows][kept[rows]]
        if len(some):
            found.append((part, some.min(axis=0), some.max(axis=0)))
    parts, lows, highs = zip(*found, strict=True)
    return np.array(parts), np.array(lows, np.float64), np.array(highs, np.float64)


def _leave_out(position: Floats | Doubles, kept: Flags, before: int) -> int:
    """Drop the smallest clumps of the points kept before; return how many points are left.

    Clumps are points in adjacent cells of a grid over the kept points' bounding box.
    """
    _, lows, highs = _boxes(position, kept)
    low, high = lows.min(axis=0), highs.max(axis=0)
    count = round((before / PER_CELL) ** (1 / 3))
    cells = min(max(count, LEAST_CELLS), MOST_CELLS)
    side = float((high - low).max()) / cells or 1.0

    def cell_of(rows: slice) -> NDArray[np.int64]:
        cell = np.minimum((position[rows][kept[rows]] - low) / side, cells - 1).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(cell.T), (cells,) * 3), np.int64)

    held = np.zeros(cells**3, np.int64)
    for rows in rows_of(position):
        held += np.bincount(cell_of(rows), minlength=cells**3)
    # Give all cells of a clump the same number. SciPy's `label` takes 0.3 s to be imported.
    is_held = held.reshape((cells,) * 3) > 0
    clump, before_it = (
        np.where(is_held, np.arange(1, held.size + 1).reshape(is_held.shape), 0),
        None,
    )
    while before_it is None or not np.array_equal(clump, before_it):
        before_it = clump
        for axis in range(3):
            ends = [(int(n == axis), int(n == axis)) for n in range(3)]
            windows = np.lib.stride_tricks.sliding_window_view(np.pad(clump, ends), 3, axis)
            clump = windows.max(axis=-1)
        clump = np.where(is_held, clump, 0)
    holds = np.bincount(clump.ravel(), held).astype(np.int64)
    order = np.argsort(holds, kind="stable")
    is_stray = np.zeros(len(holds), np.bool_)
    held, whole = holds[order], len(position)
    most = np.where(held <= TINY * whole, TINY_STRAY, STRAY) * whole
    is_stray[order] = whole - before + np.cumsum(held) <= most
    left = 0
    for rows in rows_of(position):
        together = ~is_stray[clump.ravel()[cell_of(rows)]]
        kept[rows][kept[rows]] = together
        left += int(np.count_nonzero(together))
    return left
