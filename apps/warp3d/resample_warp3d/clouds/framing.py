"""Cameras that look at clouds."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera
from resample.cameras.poses import orbit
from resample.cameras.viewpoints import Sphere
from resample.painting.scenes.plans import shape_of
from resample.types import Doubles, Floats
from resample_warp3d.clouds.cloud import Cloud, places
from resample_warp3d.clouds.parts import STEP, room_beside, rows_of
from resample_warp3d.clouds.spacing import Surfels

FIELD = 40.0  # degrees that `framed` sees along the frame's shorter side
FILLED = 0.95  # of the frame's width or height, by what is visible
DIRECTIONS = 25  # of all that a film looks along, which its distance is made for
LEAST = 1e-12  # scene units from the eye to what it looks at
STRAY = 0.01  # of all points: clumps that stand apart and hold less than this are not framed
PER_CELL = 8  # points, on average, if they were spread evenly in the box around them
ROUNDING = 1e-12  # of what is compared, more than sums of three products are off
LEAST_CELLS, MOST_CELLS = 3, 32  # along the longest side of the box

Flags = NDArray[np.bool_]


class Framing(NamedTuple):
    """What of a cloud a frame should hold: N points, and boxes around M parts that hold some."""

    position: Floats | Doubles  # (N, 3)
    origin: Doubles  # (3,) which is added to them
    axes: Floats  # (N, 2, 3) half axes of the discs; or (0, 2, 3)
    kept: Flags  # (N,) which of them
    part: NDArray[np.int64]  # (M,) which parts of `STEP` points
    low: Doubles  # (M, 3) least coordinates of parts, without the origin
    high: Doubles  # (M, 3) greatest
    reach: float  # scene units, how far the largest disc reaches
    middle: Doubles  # (3,) what directions begin at, scene units

    def farthest(self, along: Doubles) -> float:
        """Greatest product of a direction (3,) and a place on a disc.

        Parts are looked at as long as their boxes may hold a greater one.
        """
        x, y, z = (float(part) for part in along)
        corner = np.maximum(self._placed(self.low) * along, self._placed(self.high) * along)
        bound = corner.sum(axis=1) + self.reach * math.sqrt(x * x + y * y + z * z)
        slack = ROUNDING * (np.abs(corner).sum(axis=1) + np.abs(bound))
        bound, most = bound + slack, -np.inf
        for n in np.argsort(-bound, kind="stable"):
            if bound[n] < most:
                break
            most = max(most, self._farthest_of(int(self.part[n]), (x, y, z)))
        return most

    def _placed(self, position: Floats | Doubles) -> Doubles:
        return np.asarray(position + self.origin - self.middle, np.float64)

    def _farthest_of(self, part: int, along: tuple[float, float, float]) -> float:
        """The same of a part alone."""
        x, y, z = along
        kept = self.kept[part * STEP : (part + 1) * STEP]
        place = self._placed(self.position[part * STEP : (part + 1) * STEP][kept])
        value = place[:, 0] * x + place[:, 1] * y + place[:, 2] * z
        if len(self.axes):
            axes = self.axes[part * STEP : (part + 1) * STEP][kept].astype(np.float64)
            sides = axes[..., 0] * x + axes[..., 1] * y + axes[..., 2] * z
            value += np.sqrt(sides[:, 0] * sides[:, 0] + sides[:, 1] * sides[:, 1])
        return float(value.max())

    def box_middle(self) -> Doubles:
        """Middle (3,) of the box around the points, scene units."""
        low, high = self._placed(self.low.min(axis=0)), self._placed(self.high.max(axis=0))
        return np.asarray(0.5 * (low + high), np.float64)

    def farthest_from(self, middle: Doubles) -> float:
        """Distance of the farthest point from a place, scene units."""
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
    up: str = "z",
    fov: float = FIELD,
) -> Camera:
    """Camera that looks at a cloud.

    Clumps of points that stand apart from all others are not waited for, if they hold less than a
    hundredth of the points together.

    Parameters
    ----------
    cloud
        What is looked at.
    size
        Width and height of the picture, px.
    azimuth, elevation, up
        Where the camera stands, degrees, and which axis points upward, as
        `resample.cameras.poses.orbit` takes them.
    distance
        From the middle of the box around the points, scene units. Left out, the camera stands
        where what it sees of the points fills the frame and is in its middle.
    fov
        Degrees along the frame's shorter side.

    Raises
    ------
    ValueError
        The cloud has no points, or a number is none.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Cloud, framed
    >>> place = np.random.default_rng(1).uniform(-1, 1, (500, 3))
    >>> cloud = Cloud(place, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    >>> camera = framed(cloud, size=(64, 48), azimuth=30, elevation=20)
    >>> pose = camera.world_to_camera
    >>> x, y, z = camera.matrix @ (pose[:3, :3] @ place.T + pose[:3, 3:])
    >>> round(np.ptp(y / z).item() / 48, 2)  # of the picture's height
    0.95
    """
    seen = _visible(cloud)
    camera = _camera(size, fov)
    if distance is None:
        pose = orbit(np.zeros(3), 1.0, azimuth, elevation, up)
        pose[:3, 3] = -_eye(seen, pose[:3, :3], _slopes(camera, size))
        return camera.moved(pose)
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"a distance of {distance}; give a length above 0")
    return camera.moved(orbit(seen.box_middle(), distance, azimuth, elevation, up))


def framed_together(
    cloud: Cloud | Surfels,
    *,
    size: tuple[int, int],
    angles: Sequence[tuple[float, float]],
    up: str = "z",
    fov: float = FIELD,
) -> list[Camera]:
    """Cameras at one distance from the middle of a cloud, from which all of them see all of it.

    Parameters
    ----------
    cloud, size, up, fov
        As `framed` takes them.
    angles
        Azimuth and elevation of each, degrees.

    Raises
    ------
    ValueError
        As of `framed`.
    """
    seen = _visible(cloud)
    middle, camera = seen.box_middle(), _camera(size, fov)
    slope = _slopes(camera, size)
    around = seen._replace(middle=middle)
    away = LEAST
    for pair in _some(angles):
        sides = _sides(around, orbit(np.zeros(3), 1.0, *pair, up)[:3, :3], slope)
        away = max(away, float((sides / slope).max()))
    return [camera.moved(orbit(middle, away, *pair, up)) for pair in angles]


def ball_around(cloud: Cloud | Surfels) -> Sphere:
    """Middle of what is visible of a cloud and how far it reaches, scene units.

    Raises
    ------
    ValueError
        The cloud has no points.
    """
    seen = _visible(cloud)
    middle = seen.box_middle()
    return Sphere(middle, max(seen.farthest_from(middle) + seen.reach, LEAST))


def _some(angles: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Angles that stand for all: of an orbit, cosines between two change by under a hundredth."""
    each = sorted(set(angles))
    return [each[n] for n in np.linspace(0, len(each) - 1, min(len(each), DIRECTIONS)).astype(int)]


def _camera(size: tuple[int, int], fov: float) -> Camera:
    if not 0 < fov < 180:
        raise ValueError(f"a field of view of {fov:g} degrees; clouds are seen in perspective")
    return Camera.from_fov(fov, *shape_of(size))


def _slopes(camera: Camera, size: tuple[int, int]) -> Doubles:
    """Tangents (2,) of half the angles, across and down, that points should be seen within."""
    return 0.5 * FILLED * np.array([size[0] / camera.fx, size[1] / camera.fy], np.float64)


def _sides(seen: Framing, axes: Doubles, slope: Doubles) -> Doubles:
    """Where sides of the frame touch a cloud: right and bottom, left and top; (2, 2).

    `axes` (3, 3) holds the camera's in its rows. A place p is within a side of a frame that the
    origin sees if ± x − slope z ≤ 0 and, seen by an eye e, if that is at most ± x − slope z of e.
    """
    touched = np.zeros((2, 2))
    for k in range(2):
        for n, sign in enumerate((1.0, -1.0)):
            touched[n, k] = seen.farthest(sign * axes[k] - slope[k] * axes[2])
    return touched


def _eye(seen: Framing, axes: Doubles, slope: Doubles) -> Doubles:
    """Nearest place (3,) of an eye, along its own axes, that has all points within its sides."""
    right, left = _sides(seen, axes, slope)
    depth = float((-(right + left) / (2.0 * slope)).min())
    depth = min(depth, -seen.farthest(-axes[2]) - LEAST)
    return np.array([*(0.5 * (right - left)), depth])


def _visible(cloud: Cloud | Surfels) -> Framing:
    """Points of a cloud without those that stand apart."""
    position = cloud.position if isinstance(cloud, Surfels) else places(cloud)
    if not len(position):
        raise ValueError("a cloud without points cannot be looked at")
    axes = cloud.axes if isinstance(cloud, Surfels) else np.zeros((0, 2, 3), np.float32)
    kept: Flags = room_beside(position, (len(position),), np.bool_)
    kept[:] = True
    left = len(position)
    stray = int(STRAY * left)  # how many may be left out in all
    while stray > 0:
        before = left
        left = _leave_out(position, kept, stray)
        if left == before:
            break
        stray -= before - left
    part, low, high = _boxes(position, kept)
    reach = max((_reach(axes[rows], kept[rows]) for rows in rows_of(axes)), default=0.0)
    origin = cloud.origin if isinstance(cloud, Surfels) else np.zeros(3)
    return Framing(position, origin, axes, kept, part, low, high, reach, np.zeros(3))


def _boxes(position: Floats | Doubles, kept: Flags) -> tuple[NDArray[np.int64], Doubles, Doubles]:
    """Parts of points that hold some that are kept, and their least and greatest coordinates."""
    found = []
    for part, rows in enumerate(rows_of(position)):
        some = position[rows][kept[rows]]
        if len(some):
            found.append((part, some.min(axis=0), some.max(axis=0)))
    parts, lows, highs = zip(*found, strict=True)
    return np.array(parts), np.array(lows, np.float64), np.array(highs, np.float64)


def _reach(axes: Floats, kept: Flags) -> float:
    """How far the largest of some discs reaches at most."""
    part = axes[kept].reshape(-1, 6).astype(np.float64)
    square = part[:, 0] * part[:, 0]
    for c in range(1, 6):
        square += part[:, c] * part[:, c]
    return math.sqrt(float(square.max(initial=0.0)))


def _leave_out(position: Floats | Doubles, kept: Flags, most: int) -> int:
    """Keep no points of the smallest clumps, which hold at most so many; how many are left.

    Clumps are points in cells that touch, of a lattice over the box around all that are kept.
    """
    from scipy import ndimage

    _, lows, highs = _boxes(position, kept)
    low, high = lows.min(axis=0), highs.max(axis=0)
    count = round((int(np.count_nonzero(kept)) / PER_CELL) ** (1 / 3))
    cells = min(max(count, LEAST_CELLS), MOST_CELLS)
    side = float((high - low).max()) / cells or 1.0

    def cell_of(rows: slice) -> NDArray[np.int64]:
        cell = np.minimum((position[rows][kept[rows]] - low) / side, cells - 1).astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(cell.T), (cells,) * 3), np.int64)

    held = np.zeros(cells**3, np.int64)
    for rows in rows_of(position):
        held += np.bincount(cell_of(rows), minlength=cells**3)
    clump, _ = ndimage.label(held.reshape((cells,) * 3) > 0, np.ones((3, 3, 3)))
    holds = np.bincount(clump.ravel(), held).astype(np.int64)
    order = np.argsort(holds, kind="stable")
    is_stray = np.zeros(len(holds), np.bool_)
    is_stray[order] = np.cumsum(holds[order]) <= most
    left = 0
    for rows in rows_of(position):
        together = ~is_stray[clump.ravel()[cell_of(rows)]]
        kept[rows][kept[rows]] = together
        left += int(np.count_nonzero(together))
    return left
