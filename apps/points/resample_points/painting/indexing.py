"""Which point of a cloud each pixel shows."""

import numpy as np
from numpy.typing import NDArray

from resample.cameras.pixels import pixel_centers
from resample.messages import check_threads
from resample.painting.scenes.plans import shape_of
from resample_points.data.cloud import Cloud, check_cloud
from resample_points.data.parts import rows_of
from resample_points.geometry.spacing import Surfels, prepare_cloud
from resample_points.painting.bending import CloudView, places_at
from resample_points.painting.rendering import CloudStyle, painted_cloud
from resample_points.painting.windows import SHOWN

NOTHING = -1  # index of pixels that show nothing
Numbers = NDArray[np.int64]


def index_cloud(
    cloud: Cloud | Surfels,
    camera: CloudView,
    *,
    size: tuple[int, int],
    style: CloudStyle | None = None,
    threads: int | None = None,
) -> Numbers:
    """Return which point of a cloud each pixel shows.

    It is the point, among those that are seen, whose center is nearest to the nearest surface in
    the pixel.

    Parameters
    ----------
    cloud, camera, size, style, threads
        As of `render_cloud`.

    Returns
    -------
    Rows (height, width) of the cloud that was rendered or prepared; -1 where nothing is seen.

    Raises
    ------
    ValueError
        As of `render_cloud`, or surfels do not say which points they are.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Camera, Cloud, index_cloud
    >>> place, normal = np.array([[-1.0, 0, 4], [1.0, 0, 4]]), np.array([[0, 0, -1.0]] * 2)
    >>> cloud = Cloud(place, normal, np.empty((0, 3)), np.array([0.6, 0.6]))
    >>> print(index_cloud(cloud, Camera.from_fov(30, 3, 9), size=(9, 3)))
    [[-1 -1  0  0 -1  1  1 -1 -1]
     [-1 -1  0  0 -1  1  1 -1 -1]
     [-1 -1  0  0 -1  1  1 -1 -1]]
    """
    from scipy.spatial import KDTree

    from resample.engine import jit

    check_cloud(cloud, Cloud | Surfels)
    chosen, shape = CloudStyle() if style is None else style, shape_of(size)
    found = np.full(shape, NOTHING, np.int64)
    check_threads(threads)
    with jit.threads(jit.workers() if threads is None else threads):
        surfels = cloud if isinstance(cloud, Surfels) else prepare_cloud(cloud)
        if len(surfels.source) < len(surfels.position):
            raise ValueError("these surfels do not say which points they are; prepare the cloud")
        painted = painted_cloud(surfels, camera, shape, chosen, None)
    shown, visible = np.isfinite(painted.first_depth), painted.visible
    parts = [rows.start + np.flatnonzero(visible[rows] & SHOWN) for rows in rows_of(visible)]
    which = np.concatenate([*parts, np.zeros(0, np.int64)])
    if len(which) and shown.any():
        depth = painted.first_depth[shown].astype(np.float64)
        surface = places_at(camera, shape, pixel_centers(shape)[shown], depth)
        _, nearest = KDTree(surfels.position[which]).query(surface - surfels.origin)
        found[shown] = surfels.source[which[nearest]]
    return found
