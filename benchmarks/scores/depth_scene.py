"""A scene of balls, walls, bars and a card, with exact depth; and peers that warp its pictures.

Cameras are OpenCV's (x right, y down, z ahead); pixel (0, 0) has its center at (0, 0). Poses map
the world to the camera. A picture is the mean over the area of each pixel.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from benchmarks.scores.judging import Floats
from benchmarks.scores.kernels.scene import (
    CHECKER,
    NOISE,
    PHOTO,
    RECTANGLE,
    SPHERE,
    STRIPES,
    render,
    visible_share,
)
from benchmarks.scores.kernels.warps import add_softly, draw_triangles

RAYS = 8  # along a side of a pixel
SHADOW_RAYS = 4


class Shot(NamedTuple):
    """A camera with its pose."""

    matrix: Floats  # (3, 3)
    pose: Floats  # (4, 4) world to camera
    size: tuple[int, int]  # width, height

    @property
    def inverse(self) -> Floats:
        """Inverse of the matrix."""
        return np.asarray(np.linalg.inv(self.matrix), np.float64)

    @property
    def turn(self) -> Floats:
        """Rotation from the world to the camera."""
        return np.ascontiguousarray(self.pose[:3, :3])

    @property
    def eye(self) -> Floats:
        """The camera's place in the world."""
        return np.asarray(-self.pose[:3, :3].T @ self.pose[:3, 3])


def matrix_of(width: int, height: int, fov: float = 60.0) -> Floats:
    """Matrix of a camera; the field of view, degrees, is the width's."""
    focal = 0.5 * width / math.tan(math.radians(fov) / 2)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def pose_of(eye: tuple[float, float, float], turn: float = 0, rise: float = 0) -> Floats:
    """Pose of a camera at `eye`, turned about y, then about x, rad."""
    cos, sin = math.cos(turn), math.sin(turn)
    about_y = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    cos, sin = math.cos(rise), math.sin(rise)
    about_x = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
    pose = np.eye(4)
    pose[:3, :3] = about_x @ about_y
    pose[:3, 3] = -pose[:3, :3] @ np.array(eye)
    return pose


def shapes() -> Floats:
    """Rows of the scene; see `kernels.scene`."""

    def sphere(x: float, y: float, z: float, radius: float, texture: int, scale: float) -> None:
        rows.append([SPHERE, x, y, z, radius, 0, 0, 0, texture, scale])

    def rectangle(axis: int, place: float, bounds: tuple[float, ...], *look: float) -> None:
        rows.append([RECTANGLE, axis, place, *bounds, 0, *look])

    rows: list[list[float]] = []
    rectangle(2, 9.0, (-14, 14, -9, 2.0), PHOTO, 70)  # back wall
    rectangle(1, 2.0, (-14, 14, -2, 9.0), CHECKER, 2.5)  # floor
    rectangle(0, -5.5, (-9, 2.0, -2, 9.0), NOISE, 3.0)  # left wall
    sphere(-1.6, 0.9, 5.0, 1.1, PHOTO, 160)
    sphere(1.7, 1.1, 4.2, 0.9, STRIPES, 6)
    sphere(0.2, -0.9, 6.5, 0.8, NOISE, 6)
    sphere(2.9, -0.6, 7.0, 0.9, CHECKER, 6)
    for bar in range(5):  # 2 to 6 hundredths wide
        left = -0.55 + 0.25 * bar
        rectangle(2, 3.6, (left, left + 0.02 + 0.01 * bar, -0.2, 2.0), STRIPES, 12)
    rectangle(2, 3.9, (-3.2, -2.2, -1.4, 0.2), PHOTO, 220)  # card in front
    return np.array(rows)


class Scene:
    """The scene with a photograph as its texture."""

    def __init__(self, photo: Path) -> None:
        self.texture = np.asarray(Image.open(photo).convert("RGB"), np.float64) / 255
        self.shapes = shapes()

    def render(self, shot: Shot, rays: int = RAYS) -> tuple[Floats, Floats]:
        """Colors (H, W, 3) and depths z (H, W)."""
        width, height = shot.size
        color, depth = np.zeros((height, width, 3)), np.zeros((height, width))
        camera = shot.inverse, shot.turn, shot.eye
        render(self.shapes, self.texture, *camera, rays, color, depth)
        return color, depth

    def visible(self, shot: Shot, source: Shot) -> Floats:
        """The share of each pixel's area that another camera sees."""
        share = np.zeros(shot.size[::-1])
        ours, theirs = (shot.inverse, shot.turn, shot.eye), (source.matrix, source.turn, source.eye)
        width, height = source.size
        visible_share(self.shapes, *ours, *theirs, height, width, SHADOW_RAYS, share)
        return share


def projected(depth: Floats, matrix: Floats, pose: Floats) -> tuple[Floats, Floats, Floats]:
    """Places (px, corner convention) and depths of a source's px in a new view.

    `pose` maps the source's camera to the new one; both have the same matrix.
    """
    row, column = np.mgrid[: depth.shape[0], : depth.shape[1]].astype(float)
    x, y = (column - matrix[0, 2]) / matrix[0, 0], (row - matrix[1, 2]) / matrix[1, 1]
    place = np.stack([x * depth, y * depth, depth], -1) @ pose[:3, :3].T + pose[:3, 3]
    ahead = np.where((depth > 0) & (place[..., 2] > 1e-3), place[..., 2], 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (
            np.where(ahead > 0, matrix[k, k] * place[..., k] / ahead + matrix[k, 2] + 0.5, -1e6)
            for k in (0, 1)
        )
    return u, v, ahead


def by_peers(
    color: Floats, depth: Floats, matrix: Floats, pose: Floats
) -> Iterator[tuple[str, Floats]]:
    """Names and pictures: meshes, RVS's triangles, and softmax splatting."""
    height, width = depth.shape
    u, v, z = projected(depth, matrix, pose)
    for name, samples, by_rvs in (("mesh 4 x 4", 4, False), ("mesh", 1, False), ("RVS", 1, True)):
        picture = np.zeros((height * samples, width * samples, 3))
        best = np.zeros((height * samples, width * samples))
        draw_triangles(color, u, v, z, samples, by_rvs, picture, best)
        hit = (best > 0).astype(float)[..., None]
        total, share = (
            each.reshape(height, samples, width, samples, -1).mean((1, 3))
            for each in (picture * hit, hit)
        )
        yield name, np.where(share > 0.2, total / np.maximum(share, 1e-9), 0)
    nearest = z[z > 0].min()
    for sharpness in (5.0, 30.0):
        total, weight = np.zeros((height, width, 3)), np.zeros((height, width))
        add_softly(color, u, v, z, sharpness, nearest, total, weight)
        yield f"softmax, {sharpness:g}", total / np.maximum(weight, 1e-200)[..., None]
