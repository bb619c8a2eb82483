"""Surfaces with colors by formula, their samples, and their pictures."""

import math
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.scores.judging import Booleans, Floats
from benchmarks.scores.kernels.triangles import nearest_depths
from benchmarks.scores.pictures import View, to_levels, to_light

SIZE, FOCAL = (400, 300), 440.0  # px
BALL, RADIUS = np.array([0.1, -0.2, 1.3]), 1.0
FLOOR = 3.0  # half side of the floor z = 0
SKY, GROUND, CARS, WALLS, POLES = range(5)  # kinds of things in a street


def painted(position: Floats, cell: float, floor: Booleans | None = None) -> Floats:
    """Levels at positions (N, 3): a checkerboard with slow waves; z of `floor` counts as 0."""
    x, y, z = position.T
    if floor is not None:
        z = np.where(floor, 0.5 * cell, z)
    odd = (np.floor(x / cell) + np.floor(y / cell) + np.floor(z / cell)) % 2
    green, blue = 0.5 + 0.35 * np.sin(0.9 * x / cell), 0.5 + 0.35 * np.cos(0.7 * y / cell)
    return np.stack([0.25 + 0.5 * odd, green, blue], 1).clip(0, 1)


def ball_and_floor(eye: Floats, ways: Floats) -> tuple[Floats, Booleans]:
    """Distances along `ways` (N, 3), inf for nothing, and whether the floor is hit."""
    a, b = (ways**2).sum(1), ways @ (eye - BALL)
    inside = b * b - a * (((eye - BALL) ** 2).sum() - RADIUS**2)
    ball = np.where(inside > 0, (-b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    ball[ball <= 0] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        down = -eye[2] / ways[:, 2]
        x, y = (np.abs(eye[k] + down * ways[:, k]) for k in (0, 1))
        hit = (down > 0) & (x < FLOOR) & (y < FLOOR) & (down < ball)
    return np.where(hit, down, ball), hit


def rays_of(view: View, rays: int) -> Floats:
    """Ways (H rays, W rays, 3) in the world whose z in the camera is 1."""
    x, y = ((np.arange(n * rays) + 0.5) / rays for n in SIZE)
    right = (x - view.center[0]) / view.focal
    down = ((y - view.center[1]) / view.focal)[:, None]
    return np.stack(np.broadcast_arrays(right, down, 1.0), -1) @ view.turn


def depths(mesh: Floats, view: View, rays: int) -> Floats:
    """Depths of triangles (N, 3, 3) at rays x rays samples of each pixel."""
    depth = np.full((SIZE[1] * rays, SIZE[0] * rays), np.inf)
    corners, (x, y) = (mesh - view.eye) @ view.turn.T, view.center
    nearest_depths(corners, view.focal * rays, x * rays, y * rays, depth)
    return depth


def truth(view: View, cell: float, rays: int, mesh: Floats | None = None) -> tuple[Floats, Floats]:
    """Levels (H, W, 3) of the ball and the floor, or a mesh, and the covered share (H, W)."""
    ways = rays_of(view, rays).reshape(-1, 3)
    floor = None
    if mesh is None:
        distance, floor = ball_and_floor(view.eye, ways)
    else:
        distance = depths(mesh, view, rays).ravel()
    hit, light = np.isfinite(distance), np.zeros((len(distance), 3))
    places = view.eye + distance[hit, None] * ways[hit]
    light[hit] = to_light(painted(places, cell, None if floor is None else floor[hit]))
    means, share = (
        np.asarray(each.reshape(SIZE[1], rays, SIZE[0], rays, -1).mean((1, 3)))
        for each in (light, hit.astype(float))
    )
    return to_levels(means), share[..., 0]


def sampled_scene(count: int, rng: np.random.Generator) -> tuple[Floats, Booleans, float]:
    """Points at random on the ball and the floor, which are the floor's, and their spacing."""
    floor_area, ball_area = (2 * FLOOR) ** 2, 4 * math.pi * RADIUS**2
    on_floor = round(count * floor_area / (floor_area + ball_area))
    floor = np.c_[rng.uniform(-FLOOR, FLOOR, (on_floor, 2)), np.zeros(on_floor)]
    ball = rng.normal(size=(count - on_floor, 3))
    ball *= RADIUS / np.linalg.norm(ball, axis=1, keepdims=True)
    spacing = math.sqrt((floor_area + ball_area) / count)
    return np.r_[floor, BALL + ball], np.arange(count) < on_floor, spacing


def read_triangles(path: Path) -> Floats:
    """Triangles (N, 3, 3) of a mesh, at the origin and 2 units large."""
    corners = np.asarray(trimesh.load(path, process=False).triangles, np.float64)
    places = corners.reshape(-1, 3)
    return np.asarray((corners - places.mean(0)) * (2 / np.ptp(places, axis=0).max()))


def sampled_mesh(mesh: Floats, count: int, rng: np.random.Generator) -> tuple[Floats, float]:
    """Points at random on triangles, and their spacing."""
    a, b, c = mesh.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    which = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[which] + u * (b - a)[which] + v * (c - a)[which]
    return points, math.sqrt(area.sum() / count)


def street(
    ways: Floats, rng: np.random.Generator
) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Distances along unit ways (N, 3), 1.7 m above the ground, and kinds of what is there."""
    distance, kind = np.full(len(ways), 70.0), np.full(len(ways), SKY)
    down = ways[:, 2]
    ground = np.where(down < -1e-3, -1.7 / np.minimum(down, -1e-3), np.inf)
    kind[ground < distance] = GROUND
    distance = np.minimum(distance, ground)
    ahead, aside = rng.uniform(6, 30, 5), rng.uniform(4.0, 8, 5) * [1, -1, 1, -1, 1]
    boxes = [
        ((x - 2.1, y - 0.9, -1.7), (x + 2.1, y + 0.9, -0.25), CARS)
        for x, y in zip(ahead, aside, strict=True)
    ]
    boxes += [((-40, 10, -1.7), (50, 11, 7), WALLS), ((-40, -12, -1.7), (50, -11, 5), WALLS)]
    boxes += [((x, 9, -1.7), (x + 0.25, 9.25, 4), POLES) for x in range(4, 40, 9)]
    for low, high, what in boxes:
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = np.array(low) / ways, np.array(high) / ways
        near, far = np.minimum(first, second).max(1), np.maximum(first, second).min(1)
        hit = (near < far) & (near > 0) & (near < distance)
        distance[hit], kind[hit] = near[hit], what
    return distance, kind
