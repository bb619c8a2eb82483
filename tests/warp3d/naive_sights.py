"""What cameras of any kind see, ray by ray."""

from itertools import product

import numpy as np

from resample.cameras.models import Orthographic
from resample.cameras.pixels import Equirectangular


def rays(camera, shape, place):
    """Eyes (..., 3) and unit directions (..., 3) in the camera's axes of places (..., 2) px."""
    x, y = np.moveaxis(place, -1, 0)
    if isinstance(camera, Equirectangular):
        height, width = shape
        east, south = (x / width - 0.5) * 2 * np.pi, (y / height - 0.5) * np.pi
        ray = np.cos(south) * np.sin(east), np.sin(south), np.cos(south) * np.cos(east)
        return np.zeros(3), np.stack(ray, axis=-1)
    if isinstance(camera, Orthographic):
        flat = (x - camera.cx) / camera.sx, (y - camera.cy) / camera.sy
        eye = np.stack([*flat, np.zeros_like(x)], axis=-1)
        return eye, np.broadcast_to([0.0, 0.0, 1.0], eye.shape)
    import cv2

    flat = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    if camera.distortion is None:
        ray = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy], axis=-1)
    elif camera.model == "fisheye":
        ray = cv2.fisheye.undistortPoints(flat, camera.matrix, camera.distortion)
    else:
        ray = straightened(camera, flat[:, 0])
    ray = np.concatenate([ray.reshape(*x.shape, 2), np.ones((*x.shape, 1))], axis=-1)
    return np.zeros(3), ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def straightened(camera, flat):
    """Points of the plane at distance 1 that a lens of k1, k2, p1, p2, k3 shows at px (N, 2)."""
    k1, k2, p1, p2, k3 = camera.distortion
    wanted = (flat - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    x, y = wanted.T
    for _ in range(100):
        s = x * x + y * y
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        aside = 2 * p1 * x * y + p2 * (s + 2 * x * x), p1 * (s + 2 * y * y) + 2 * p2 * x * y
        x, y = (wanted[:, 0] - aside[0]) / radial, (wanted[:, 1] - aside[1]) / radial
    return np.stack([x, y], axis=1)


def traced(things, camera, shape, count=4):
    """Color (H, W, C), mean over pixels, and z at their centers, or the length of panoramas' rays.

    Things take one eye at a time, so those of parallel rays are moved instead: `hit` and `color`
    are asked for all rays with eyes (..., 3).
    """
    turn, shift = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    columns, rows = np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0]) + 0.5)
    centers = np.stack([columns, rows], axis=-1)

    def met(place):
        eye, ray = rays(camera, shape, place)
        start, direction = (eye - shift) @ turn, ray @ turn
        distance = np.array([thing.hit(start, direction) for thing in things])
        first, nearest = distance.argmin(axis=0), distance.min(axis=0)
        point = start + np.where(np.isfinite(nearest), nearest, 0)[..., None] * direction
        shown = np.array([thing.color(point) for thing in things])
        color = np.take_along_axis(shown, first[None, ..., None], 0)[0]
        far = nearest if isinstance(camera, Equirectangular) else nearest * ray[..., 2]
        return np.where(np.isfinite(nearest)[..., None], color, 0.0), far

    steps = (np.arange(count) + 0.5) / count - 0.5
    color = sum(met(centers + np.array(step))[0] for step in product(steps, repeat=2)) / count**2
    return color.astype(np.float32), met(centers)[1]
