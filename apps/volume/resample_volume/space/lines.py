"""Draw lines into a painted scene, with occlusion.

A pixel has the depth where its light begins and the mean depth of its light. Its content is
modelled as a medium that extends smoothly from there to as far behind the mean: part of it occludes
a line, and the rest lies behind.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.engine.lookup import VISIBLE
from resample.types import Doubles, Frame, View
from resample_volume.data.spacings import unit_of_space
from resample_volume.picking import Picked
from resample_volume.types import Volume

LEAST_DEPTH = 1e-6  # fraction of a line's length: nearer parts are cut off in perspective


class Stroke(NamedTuple):
    """A straight line between two points."""

    ends: Doubles  # (2, 3) scene units
    color: tuple[float, float, float]  # linear
    width: float  # px


class _Marks(NamedTuple):
    """Contributions of lines to pixels."""

    pixel: NDArray[np.int64]  # (N,) row × width + column
    depth: Doubles
    light: Doubles  # (N, 4) premultiplied


def with_lines(frame: Frame, view: View, lines: Sequence[Stroke]) -> Frame:
    """Draw lines into the scene of a picture; its values are unchanged."""
    size = frame.depth.shape
    found = [marks for line in lines for marks in _marks(line, view, (size[0], size[1]))]
    if not found:
        return frame
    marks = _Marks(*map(np.concatenate, zip(*found, strict=True)))
    order = np.lexsort((-marks.depth, marks.pixel))
    marks = _Marks(marks.pixel[order], marks.depth[order], marks.light[order])
    return _composited(frame, marks)


def _marks(line: Stroke, view: View, size: tuple[int, int]) -> Iterator[_Marks]:
    """Return a line's contributions, one per pixel."""
    ends = line.ends @ view.rotation.T + view.translation
    if view.perspective:
        least = max(view.near, LEAST_DEPTH * float(np.linalg.norm(ends[1] - ends[0])))
        ends = _cut(ends, least)
    if not len(ends):
        return
    per = ends[:, 2:] if view.perspective else np.ones((2, 1))
    spot = ends[:, :2] / per * view.focal + view.principal
    row, column = _near(spot, line.width, size)
    place = np.stack([column + 0.5, row + 0.5], axis=-1)
    way = spot[1] - spot[0]
    along = np.clip((place - spot[0]) @ way / max(float(way @ way), 1e-12), 0, 1)
    away = np.linalg.norm(place - spot[0] - along[:, None] * way, axis=-1)
    share = np.clip(line.width / 2 + 0.5 - away, 0, min(1.0, line.width))
    if view.perspective:
        depth = 1 / ((1 - along) / ends[0, 2] + along / ends[1, 2])
    else:
        depth = (1 - along) * ends[0, 2] + along * ends[1, 2]
    kept = (share > 0) & (depth >= view.near)
    if not kept.any():
        return
    light = share[kept, None] * np.array([*line.color, 1.0])
    yield _Marks((row * size[1] + column)[kept], depth[kept], light)


def _cut(ends: Doubles, near: float) -> Doubles:
    """Clip a line (2, 3) to what is behind a depth; (0, 3) if nothing is."""
    depth = ends[:, 2]
    if depth.max() <= near:
        return ends[:0]
    if depth.min() >= near:
        return ends
    share = (near - depth[0]) / (depth[1] - depth[0])
    ends = ends.copy()
    ends[int(depth[1] < near)] = ends[0] + share * (ends[1] - ends[0])
    return ends


def _near(
    spot: Doubles, width: float, size: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the pixels near a line (2, 2) on the screen."""
    way = spot[1] - spot[0]
    major = int(abs(way[1]) > abs(way[0]))
    reach, count = width / 2 + 1, (size[1], size[0])
    ends = np.clip([spot[:, major].min() - reach, spot[:, major].max() + reach], -1, 1e9)
    first, last = max(0, math.floor(ends[0])), min(count[major] - 1, math.ceil(ends[1]))
    along = np.arange(first, last + 1)
    slope = way[1 - major] / way[major] if way[major] else 0.0
    middle = spot[0, 1 - major] + (along + 0.5 - spot[0, major]) * slope
    across = np.arange(-math.ceil(1.5 * reach), math.ceil(1.5 * reach) + 1)
    beside = np.floor(np.clip(middle, -1e9, 1e9)).astype(np.int64)[:, None] + across
    both = np.broadcast_to(along[:, None], beside.shape)
    kept = (beside >= 0) & (beside < count[1 - major])
    row, column = (both, beside) if major else (beside, both)
    return row[kept], column[kept]


def _composited(frame: Frame, marks: _Marks) -> Frame:
    """Composite marks, sorted by pixel and, within one, from back to front."""
    pixel, start = np.unique(marks.pixel, return_index=True)
    count = np.diff(np.append(start, marks.pixel.size))
    rgba = frame.rgba.reshape(-1, 4)[pixel].astype(np.float64)
    depth, first = (
        part.reshape(-1)[pixel].astype(np.float64) for part in (frame.depth, frame.first_depth)
    )
    sent = np.zeros((pixel.size, 5))  # premultiplied light, opacity, opacity × depth
    behind = np.ones(pixel.size)  # share of the medium in front of what was composited so far
    for turn in range(int(count.max())):
        some = np.flatnonzero(count > turn)
        mark = start[some] + turn
        here = _share(marks.depth[mark], first[some], depth[some])
        here = np.minimum(here, behind[some])
        sent[some] = _over(_medium(rgba[some], depth[some], behind[some] - here), sent[some])
        light = marks.light[mark]
        line = np.column_stack([light, light[:, 3] * marks.depth[mark]])
        sent[some] = _over(line, sent[some])
        behind[some] = here
        is_seen = light[:, 3] * (1 - rgba[some, 3]) ** here > VISIBLE
        first[some] = np.minimum(first[some], np.where(is_seen, marks.depth[mark], np.inf))
    sent = _over(_medium(rgba, depth, behind), sent)
    layers = [frame.rgba, frame.depth, frame.first_depth, frame.coverage]
    copies = [np.array(layer, np.float32) for layer in layers]
    copies[0].reshape(-1, 4)[pixel] = sent[:, :4]
    copies[1].reshape(-1)[pixel] = sent[:, 4] / np.maximum(sent[:, 3], 1e-30)
    copies[2].reshape(-1)[pixel] = first
    covered = np.maximum.reduceat(marks.light[:, 3], start)
    copies[3].reshape(-1)[pixel] = np.maximum(copies[3].reshape(-1)[pixel], covered)
    return frame._replace(
        rgba=copies[0], depth=copies[1], first_depth=copies[2], coverage=copies[3]
    )


def _share(depth: Doubles, first: Doubles, mean: Doubles) -> Doubles:
    """Return the share of a pixel's medium in front of a depth."""
    known = np.isfinite(first) & np.isfinite(mean)
    begin, middle = np.where(known, first, 0.0), np.where(known, mean, 0.0)
    extent = np.maximum(2 * (middle - begin), 1e-6 * np.abs(middle) + 1e-30)
    t = np.clip((depth - begin) / extent, 0, 1)
    return np.where(known, t * t * (3 - 2 * t), 1.0)


def _medium(rgba: Doubles, depth: Doubles, share: Doubles) -> Doubles:
    """Return a share of the pixels' medium, as light with depth (N, 5)."""
    whole = rgba[:, 3]
    alpha = 1 - (1 - np.minimum(whole, 1.0)) ** share
    part = np.divide(alpha, whole, out=share.copy(), where=whole > 0)
    deep = np.where(np.isfinite(depth), depth, 0.0)
    return np.column_stack([part[:, None] * rgba[:, :3], alpha, alpha * deep])


def _over(front: Doubles, back: Doubles) -> Doubles:
    return np.asarray(front + (1 - front[:, 3:4]) * back)


class Measured(NamedTuple):
    """Distance and angle between points."""

    distance: float  # scene units, from the first point via the second to the last
    angle: float | None  # degrees 0 to 180 at the second of three points; None for two
    unit: str  # of the distance: mm, µm, ..., or empty if unknown


def measure(*places: Picked | ArrayLike, volume: Volume | None = None) -> Measured:
    """Measure the distance of two points, or the path along three and the angle at the second.

    Parameters
    ----------
    places
        Two or three points, from `Scene.pick` or (3,) scene units. A picked point is its voxel's
        center, so picked distances are accurate to a voxel.
    volume
        Gives the unit.

    Raises
    ------
    ValueError
        There are more or fewer points, one is invalid, or two of three coincide.

    Examples
    --------
    >>> from resample_volume import measure
    >>> measure((0, 0, 0), (3, 4, 0)).distance
    5.0
    >>> round(measure((1, 0, 0), (0, 0, 0), (0, 2, 0)).angle)
    90
    """
    if len(places) not in (2, 3):
        raise ValueError(f"{len(places)} places; give two for a distance, three for an angle")
    found = [_place(one) for one in places]
    ways = [after - before for before, after in pairwise(found)]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    unit = "" if volume is None else unit_of_space(volume)
    if len(ways) == 1:
        return Measured(lengths[0], None, unit)
    if not all(lengths):
        raise ValueError("two of three places are the same, so there is no angle")
    back, on = -ways[0] / lengths[0], ways[1] / lengths[1]
    angle = 2 * np.arctan2(np.linalg.norm(back - on), np.linalg.norm(back + on))
    return Measured(sum(lengths), float(np.degrees(angle)), unit)


def _place(given: Picked | ArrayLike) -> Doubles:
    place = np.asarray(given.position if isinstance(given, Picked) else given, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError(f"the place {given!r} is not one of 3 finite numbers, scene units")
    return place
