"""Pixels of a camera with a lens, and of one without.

Places are (..., 2) px, x and y, with the first pixel's center at (0.5, 0.5).
"""

from collections.abc import Callable

import numpy as np

from resample.cameras.lens import Points, bend, distortion, unbend
from resample.cameras.models import Camera
from resample.types import Doubles

TOLERANCE = 1e-7  # px, of a place put through the lens again
BLOCK = 1 << 15  # points at a time; their arrays stay in the cache


def pixel_centers(shape: tuple[int, int]) -> Doubles:
    """Centers of all pixels, (H, W, 2) px."""
    height, width = shape
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    return np.stack(np.broadcast_arrays(columns[None, :], rows[:, None]), axis=2)


def directions(camera: Camera, place: Doubles) -> Doubles:
    """Points of the plane at distance 1 (..., 2) that a pinhole sees at places (..., 2) px."""
    back = np.linalg.inv(camera.matrix)
    return np.asarray(place @ back[:2, :2].T + back[:2, 2], np.float64)


def undistorted_places(camera: Camera, place: Doubles, ideal: Camera | None = None) -> Doubles:
    """Where a pinhole would see what the camera sees at places (..., 2) px.

    Parameters
    ----------
    camera
        Camera that took the picture.
    place
        Places in it.
    ideal
        The pinhole, of which the matrix matters; by default the camera without its lens.

    Returns
    -------
    (..., 2) px, not a number where no light comes through the lens.
    """
    pinhole = camera if ideal is None else ideal
    if camera.distortion is None:
        return _moved(lambda x, y: (x, y), place, camera, pinhole)
    lens = distortion(camera.distortion)
    tolerance = TOLERANCE / max(abs(camera.fx), abs(camera.fy))
    return _moved(lambda x, y: unbend(lens, x, y, tolerance), place, camera, pinhole)


def distorted_places(camera: Camera, place: Doubles, ideal: Camera | None = None) -> Doubles:
    """Where the camera sees what a pinhole sees at places (..., 2) px.

    Parameters
    ----------
    camera, ideal
        As in `undistorted_places`.
    place
        Places in the pinhole's picture.

    Returns
    -------
    (..., 2) px, not a number beyond where the lens begins to turn points back.
    """
    pinhole = camera if ideal is None else ideal
    if camera.distortion is None:
        return _moved(lambda x, y: (x, y), place, pinhole, camera)
    lens = distortion(camera.distortion)
    return _moved(lambda x, y: bend(lens, x, y), place, pinhole, camera)


def _moved(
    move: Callable[[Doubles, Doubles], Points], place: Doubles, before: Camera, after: Camera
) -> Doubles:
    """Places of one camera as another's, by where points of the plane at distance 1 go."""
    given = np.asarray(place, np.float64).reshape(-1, 2)
    found = np.empty_like(given)
    back, matrix = np.linalg.inv(before.matrix), after.matrix
    for n in range(0, len(given), BLOCK):
        column, row = given[n : n + BLOCK].T
        x, y = move(
            back[0, 0] * column + back[0, 1] * row + back[0, 2], back[1, 1] * row + back[1, 2]
        )
        found[n : n + BLOCK, 0] = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]
        found[n : n + BLOCK, 1] = matrix[1, 1] * y + matrix[1, 2]
    return found.reshape(np.shape(place))
