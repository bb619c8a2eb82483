"""Map pixels between a camera with a lens and one without.

Positions are (..., 2) px, x and y, with the first pixel's center at (0.5, 0.5).
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from resample.cameras.models import Camera, Distortion, Fisheye, LensModel, Points, fisheye, project
from resample.cameras.models import distortion as distorting
from resample.types import Doubles

TOLERANCE = 1e-7  # px, for the position distorted again
BLOCK = 1 << 15  # points at a time, so that their arrays fit into the CPU cache

Move = Callable[[Doubles, Doubles], Points]  # maps points of the plane at distance 1


def pixel_centers(shape: tuple[int, int]) -> Doubles:
    """Centers of all pixels, (H, W, 2) px."""
    height, width = shape
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    return np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=2)


def directions(camera: Camera, place: Doubles) -> Doubles:
    """Points (..., 2) of the plane at distance 1 that a pinhole sees at positions (..., 2)."""
    back = np.linalg.inv(camera.matrix)
    return np.asarray(place @ back[:2, :2].T + back[:2, 2], np.float64)


def undistorted_places(
    camera: Camera,
    place: Doubles,
    ideal: Camera | None = None,
    rotation: Doubles | None = None,
) -> Doubles:
    """Undistort positions: from the camera's picture to a pinhole's, (..., 2) px.

    `rotation`: (3, 3) from the camera's axes to the pinhole's, OpenCV's R. Default: the identity.
    Result: (..., 2) px, NaN where no light passes the lens or the point is behind the pinhole.
    """
    moves: list[Move] = []
    if camera.distortion is not None:
        tolerance = TOLERANCE / max(abs(camera.fx), abs(camera.fy))
        moves.append(partial(_lens(camera, camera.distortion).unbend, tolerance=tolerance))
    if rotation is not None:
        moves.append(partial(project, rotation))
    return _moved(moves, place, camera, camera if ideal is None else ideal)


def distorted_places(
    camera: Camera,
    place: Doubles,
    ideal: Camera | None = None,
    rotation: Doubles | None = None,
) -> Doubles:
    """Distort positions: from a pinhole's picture to the camera's, (..., 2) px.

    Result: (..., 2) px, NaN behind the camera and beyond the fold of the lens.
    """
    moves: list[Move] = []
    if rotation is not None:
        moves.append(partial(project, rotation.T))
    if camera.distortion is not None:
        moves.append(_lens(camera, camera.distortion).bend)
    return _moved(moves, place, camera if ideal is None else ideal, camera)


def _lens(camera: Camera, distortion: Doubles) -> Distortion | Fisheye:
    """Lens of a camera."""
    return (fisheye if camera.model == LensModel.FISHEYE else distorting)(distortion)


def _moved(moves: Sequence[Move], place: Doubles, before: Camera, after: Camera) -> Doubles:
    """Map positions from one camera to another, by mappings of the plane at distance 1."""
    given = np.asarray(place, np.float64).reshape(-1, 2)
    found = np.empty_like(given)
    back, matrix = np.linalg.inv(before.matrix), after.matrix
    for n in range(0, len(given), BLOCK):
        column, row = given[n : n + BLOCK].T
        x = back[0, 0] * column + back[0, 1] * row + back[0, 2]
        y = back[1, 1] * row + back[1, 2]
        with np.errstate(over="ignore"):
            for move in moves:
                x, y = move(x, y)
        found[n : n + BLOCK, 0] = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]
        found[n : n + BLOCK, 1] = matrix[1, 1] * y + matrix[1, 2]
    return found.reshape(np.shape(place))
