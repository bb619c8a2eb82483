"""From points of a picture to pixels, lines and places of its scene."""

import numpy as np

from resample.cameras.models import Camera
from resample.types import Doubles, View


def pixel_at(size: tuple[int, int], x: float, y: float) -> tuple[int, int]:
    """Row and column of the pixel at a position, px; positions beyond the edge get the last."""
    return min(int(y), size[1] - 1), min(int(x), size[0] - 1)


def lines_of(view: View, pixels: Doubles) -> tuple[Doubles, Doubles]:
    """Points (N, 3) at depth 0 of lines through pixels (N, 2), and their steps per depth."""
    on_plane = np.column_stack([(pixels - view.principal) / view.focal, np.zeros(len(pixels))])
    ahead = np.array([0.0, 0.0, 1.0])
    start = np.zeros_like(on_plane) if view.perspective else on_plane
    along = on_plane + ahead if view.perspective else np.broadcast_to(ahead, on_plane.shape)
    return (start - view.translation) @ view.rotation, along @ view.rotation


def position_at(view: View, pixel: tuple[int, int], depth: float) -> Doubles:
    """Scene position (3,) at a depth behind the center of a pixel, by its row and column.

    The camera's picture has no distortion.
    """
    row, column = pixel
    (start,), (ahead,) = lines_of(view, np.array([[column + 0.5, row + 0.5]]))
    return np.asarray(start + depth * ahead)


def place_at(camera: Camera, x: float, y: float, depth: float) -> Doubles | None:
    """Scene position (3,) at a depth behind a point of the picture; None if it is infinite."""
    if not np.isfinite(depth):
        return None
    ray = np.linalg.solve(camera.matrix, [x, y, 1.0])
    pose = camera.world_to_camera
    place: Doubles = pose[:3, :3].T @ (depth * ray / ray[2] - pose[:3, 3])
    return place
