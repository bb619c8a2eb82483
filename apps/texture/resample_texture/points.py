"""Where points of a picture go when it is warped: corners of boxes, landmarks, outlines."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyConvention, Convention
from resample.types import Doubles
from resample.words import doubles_of
from resample_texture.arguments import Places, geometry_of, is_transform, places_of_points
from resample_texture.geometry.inverting import points_along, points_back
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography


def warp_points(
    points: ArrayLike,
    matrix: ArrayLike | Geometry | Places,
    *,
    convention: AnyConvention = "corner",
    inverse: bool = False,
) -> Doubles:
    """Return where points of a picture lie in its warp, or the way back.

    Parameters
    ----------
    points
        (2,), (N, 2) or (..., 2): x and y, px.
    matrix
        What `warp` took: a matrix, a geometry, a pair of maps as `cv2.remap` takes it, or a
        transform of scikit-image. A function only with `inverse`, as it leads from target to
        source.
    convention
        `corner`: points, and a matrix or function, count with pixel centers at + 0.5; `opencv`:
        from pixel centers.
    inverse
        True: points of the target, and their places in the source.

    Returns
    -------
    As `points`, float64; not a number where a map has no such place, to 0.001 px.

    Raises
    ------
    ValueError
        Points are not pairs of numbers, or the matrix is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp_points
    >>> box = [[0, 0], [64, 48]]
    >>> warp_points(box, [[0.5, 0, 10], [0, 0.5, 0]]).tolist()
    [[10.0, 0.0], [42.0, 24.0]]
    """
    given = doubles_of("points", points, "numbers (N, 2)")
    if given.ndim < 1 or given.shape[-1] != 2:
        raise ValueError(f"points are pairs of x and y, (N, 2), not {given.shape}")
    if convention not in tuple(Convention):
        raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
    shift = 0.5 if convention == Convention.OPENCV else 0.0
    place = given.reshape(-1, 2).T
    if is_transform(matrix):
        u, v = places_of_points(matrix, not inverse)(*(place + shift - 0.5))
        moved = np.stack([u, v]) + 0.5 - shift
    elif callable(matrix):
        if not inverse:
            raise ValueError("a function leads from target to source; give inverse=True for that")
        moved = np.stack(np.broadcast_arrays(*matrix(*place)))
    else:
        is_given = isinstance(matrix, Homography | ForwardMap | BackwardMap)
        geometry = geometry_of(matrix, (1, 1), "corner" if is_given else convention, False)
        moved = _moved(place + shift, geometry, inverse) - shift
    return np.asarray(moved.T.reshape(given.shape), np.float64)


def _moved(place: Doubles, geometry: Geometry, inverse: bool) -> Doubles:
    """Return where points (2, N) lie, pixel centers at + 0.5."""
    if isinstance(geometry, Homography):
        full = geometry.inverse() if inverse else geometry.matrix
        x, y, w = full[:, :2] @ place + full[:, 2:]
        is_seen = w > 0.0 if geometry.is_signed else w != 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(is_seen, np.stack([x, y]) / w, np.nan)
    goes_along = isinstance(geometry, BackwardMap) == inverse
    move: Any = points_along if goes_along else points_back
    found: Doubles = move(geometry.x, geometry.y, place)
    return found
