"""Reproject depth from a separate depth camera to the picture's camera."""

import numpy as np

from resample.cameras.models import Camera
from resample.types import Floats
from resample_warp3d.depth.equation import between, lens_places
from resample_warp3d.types import DepthImage

SOLID = 0.5  # coverage from which a pixel has a depth


def registered(
    nearness: Floats, depth_camera: Camera, camera: Camera, shape: tuple[int, int]
) -> Floats:
    """Reproject nearness from the depth camera to another camera, (height, width).

    Parameters
    ----------
    nearness
        (h, w) of the depth camera; 0 where unknown.
    depth_camera, camera
        Cameras with poses in the same world; the second without distortion.
    shape
        Height and width of the result, px.

    Returns
    -------
    Nearness of the nearest surface that covers most of each pixel; 0 where none does, as in the
    shadow of objects that hide a part from the depth camera: `refine="complete"` fills that.

    Raises
    ------
    ValueError
        None of the depth is in view.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, registered
    >>> sensor, camera = Camera.from_fov(60, 24, 32), Camera.from_fov(50, 48, 64)
    >>> beside = camera.moved(np.c_[np.eye(3), [-0.05, 0, 0]])
    >>> nearness = registered(np.full((24, 32), 0.5, np.float32), sensor, beside, (48, 64))
    >>> nearness.shape, round(nearness[24, 32].item(), 3)
    ((48, 64), 0.5)
    """
    from resample_warp3d.depth.preparation import prepare
    from resample_warp3d.methods.hybrid import Hybrid

    height, width = nearness.shape
    place = lens_places(depth_camera, (height, width))
    image = DepthImage(np.ones((height, width, 1), np.float32), nearness, place)
    source = prepare(image, refine="none")
    rendered = Hybrid()(source, between(depth_camera, camera), shape)
    seen = np.where(rendered.coverage >= SOLID, rendered.nearness, np.float32(0))
    if not seen.any():
        raise ValueError(
            "none of the depth is in the picture's view; check the depth camera's pose"
        )
    return np.asarray(seen, np.float32)
