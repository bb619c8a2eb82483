"""The obvious slow ways to extend surfaces between samples and to see things ray by ray."""

import math
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.pixels import pixel_centers
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, UP, DepthImage

EMPTY = np.empty((0, 0, 2))
BENT = 0.65  # share of the last step by which the step beyond a surface's end may differ

TURN = np.linspace(0, 9, 100001)  # where a surface turns away, samples after its last one
RATIO = (np.sqrt(TURN + 1) - np.sqrt(TURN + 2)) / (np.sqrt(TURN) - np.sqrt(TURN + 1))


class Thing(NamedTuple):
    """Something that rays meet."""

    hit: Callable  # (eye (3,), direction (..., 3)) -> distance (...) in directions, inf: missed
    color: Callable  # (point (..., 3)) -> (..., C)


class Seen(NamedTuple):
    """What a camera sees, measured by many rays per pixel."""

    color: np.ndarray  # (H, W, C) mean over the pixel
    depth: np.ndarray  # (H, W) z at the pixel's center, inf where nothing is
    share: np.ndarray  # (H, W, things) of the pixel's area
    shown: np.ndarray  # (H, W) share of the pixel's area that another camera sees


def pattern(frequency=3.0, channels=3, size=0.2):
    """Smooth colors of the world's points, around 1 / 2."""
    rng = np.random.default_rng(7)
    wave, phase = rng.normal(0, frequency, (2, channels, 3)), rng.uniform(0, 6, (2, channels))

    def color(point):
        return 0.5 + size * sum(np.sin(point @ wave[n].T + phase[n]) for n in range(2))

    return color


def flat(*levels):
    """The same color everywhere."""
    return lambda point: np.broadcast_to(np.array(levels), (*point.shape[:-1], len(levels)))


def plane(normal, distance, color, inside=None):
    """Points with normal · point = distance; only those `inside`, if that is given."""

    def hit(eye, direction):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (distance - eye @ normal) / (direction @ np.array(normal, float))
            point = eye + np.where(np.isfinite(t), t, 0.0)[..., None] * direction
        is_met = t > 1e-9 if inside is None else (t > 1e-9) & inside(point)
        return np.where(is_met, t, np.inf)

    return Thing(hit, color)


def ball(center, radius, color):
    """Sphere, seen from outside."""

    def hit(eye, direction):
        to_eye = eye - np.array(center, float)
        a, b = (direction**2).sum(-1), (direction * to_eye).sum(-1)
        inner = b * b - a * ((to_eye**2).sum(-1) - radius**2)
        t = (-b - np.sqrt(np.maximum(inner, 0))) / a
        return np.where((inner > 0) & (t > 0), t, np.inf)

    return Thing(hit, color)


def see(things, camera, shape, *, rays=16, other=None, other_shape=None):
    """Picture and depth of things, and how much of each pixel another camera sees."""
    eye = -camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3]
    centers = pixel_centers(shape)
    depth = np.min([thing.hit(eye, _directions(camera, centers)) for thing in things], axis=0)
    sums = None
    for step in product((np.arange(rays) + 0.5) / rays - 0.5, repeat=2):
        direction = _directions(camera, centers + step)
        distance = np.array([thing.hit(eye, direction) for thing in things])
        first, nearest = distance.argmin(axis=0), distance.min(axis=0)
        is_met = np.isfinite(nearest)
        point = eye + np.where(is_met, nearest, 0)[..., None] * direction
        colors = np.array([thing.color(point) for thing in things])
        color = np.take_along_axis(colors, first[None, ..., None], 0)[0] * is_met[..., None]
        share = (np.arange(len(things)) == first[..., None]) & is_met[..., None]
        shown = is_met & _shows(things, other, other_shape, point) if other else is_met
        parts = color, share.astype(float), shown.astype(float)
        sums = parts if sums is None else [a + b for a, b in zip(sums, parts, strict=True)]
    mean = [part / rays**2 for part in sums]
    return Seen(mean[0], depth, mean[1], mean[2])


def depth_image(things, camera, shape, *, rays=16):
    """What a source has: mean colors, and nearness at pixel centers."""
    seen = see(things, camera, shape, rays=rays)
    return DepthImage(seen.color.astype(np.float32), (1 / seen.depth).astype(np.float32), EMPTY)


def _directions(camera, place):
    """World directions through places (..., 2), px, of depth 1."""
    back = np.linalg.inv(camera.matrix)
    direction = place @ back[:, :2].T + back[:, 2]
    return direction @ camera.world_to_camera[:3, :3]


def _shows(things, camera, shape, point):
    """Whether a camera's frame shows points, with nothing before them."""
    pose = camera.world_to_camera
    seen = (point @ pose[:3, :3].T + pose[:3, 3]) @ camera.matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    eye = -pose[:3, :3].T @ pose[:3, 3]
    distance = np.min([thing.hit(eye, point - eye) for thing in things], axis=0)
    inside = (seen[..., 2] > 0) & (x > 0) & (x < shape[1]) & (y > 0) & (y < shape[0])
    return inside & (distance > 1 - 1e-6)


def colors_of(sheet):
    """Colors of a sheet's cells, (H, W, C) with C a multiple of three."""
    inside = sheet.color[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    return np.moveaxis(inside.reshape(-1, *inside.shape[2:]), 0, 2)


def corner_nearness(nearness, links, corner, member, place):
    """Nearness at a place near a lattice corner on the surface of one of the samples around it.

    The mean of what the samples of that surface that touch the corner extrapolate. Samples touching
    are on one surface if links among the four lead from one to the other.
    """
    shape = nearness.shape
    keys = product((corner[0] - 1, corner[0]), (corner[1] - 1, corner[1]))
    group, around = {member}, [(r, c) for r, c in keys if 0 <= r < shape[0] and 0 <= c < shape[1]]
    for _ in range(3):
        group |= {key for key in around for other in group if _is_link(links, key, other)}
    values = []
    for row, column in group:
        x = change(nearness, links, (row, column), place[0] - column - 0.5, (0, 1))
        y = change(nearness, links, (row, column), place[1] - row - 0.5, (1, 0))
        values.append(max(nearness[row, column] + x + y, 0.01 * nearness[row, column]))
    return float(np.mean(values))


def change(nearness, links, key, offset, axis):
    """Change of nearness from a sample's center along an axis, by the samples of its surface."""
    sign = 1 if offset >= 0 else -1
    line = _line(nearness, links, key, (sign * axis[0], sign * axis[1]))
    distance = abs(offset)
    if 1 in line and -1 in line:
        return distance * (line[1] - line[-1]) / 2
    if 1 in line:
        return distance * (line[1] - line[0])
    if -1 not in line:
        return 0.0
    return _beyond(line[0] - line[-1], line[-1] - line[-2] if -2 in line else None, distance)


def _beyond(last, previous, distance):
    """Change beyond a surface's last sample, by its last two steps."""
    if previous is None:
        return distance * last
    if last * previous <= 0:
        return 0.0
    ratio = previous / last
    turn = 9.0 if ratio >= 0.93 else float(np.interp(ratio, RATIO, TURN))
    if last < 0 and turn < 9:
        scale = last / (math.sqrt(turn) - math.sqrt(turn + 1))
        return scale * (math.sqrt(max(0.0, turn - distance)) - math.sqrt(turn))
    bend = min(max(0.0, 1 - previous / last), BENT) * last
    return distance * last + distance * (distance + 1) / 2 * bend


def _line(nearness, links, key, step):
    """Nearness of the samples on a sample's surface along a line: by place, −2 to 1."""
    found = {0: float(nearness[key])}
    for places in ((1,), (-1, -2)):
        here = key
        for place in places:
            sign = 1 if place > 0 else -1
            there = here[0] + sign * step[0], here[1] + sign * step[1]
            if not _is_link(links, here, there):
                break
            found[place] = float(nearness[there])
            here = there
    return found


def _is_link(links, here, there):
    """Whether two samples are linked neighbours."""
    bits = {(0, 1): RIGHT, (1, 0): DOWN, (0, -1): LEFT, (-1, 0): UP}
    bit = bits.get((there[0] - here[0], there[1] - here[1]), 0)
    return bool(links[here] & bit)


def camera_at(eye=(0.0, 0.0, 0.0), yaw=0.0, roll=0.0, *, focal=64.0, shape=(64, 64)):
    """Camera of square pixels with its principal point in the middle; yaw to the right, rad."""
    turn = np.array(
        [[math.cos(yaw), 0, -math.sin(yaw)], [0, 1, 0], [math.sin(yaw), 0, math.cos(yaw)]]
    )
    turn = (
        np.array(
            [[math.cos(roll), math.sin(roll), 0], [-math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
        )
        @ turn
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ eye
    return Camera.from_intrinsics(focal, focal, shape[1] / 2, shape[0] / 2, world_to_camera=pose)
