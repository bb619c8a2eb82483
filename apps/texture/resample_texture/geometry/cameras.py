"""Maps of cameras: a lens's distortion removed from a photo or added, and a textured plane seen."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyCamera, Camera
from resample.cameras.pixels import distorted_places, undistorted_places
from resample.cameras.poses import turned_by
from resample.types import Doubles
from resample_texture.geometry.mappings import Homography, Size


def places_by_lens(
    camera: Camera,
    *,
    ideal: Camera | None = None,  # without distortion; by default the camera without its lens
    rotation: ArrayLike | None = None,  # (3, 3) from the camera's axes to the pinhole's
    inverse: bool = False,  # the target is the camera's photo
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Return a function for `warp` or `Plan` that removes a lens's distortion, or adds it.

    Its places are not numbers behind the camera, and where the lens's polynomial folds back: there
    `cv2.initUndistortRectifyMap` shows parts of the photo twice.
    """
    turned = None if rotation is None else turned_by(rotation)
    way = undistorted_places if inverse else distorted_places

    def places(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        u, v = np.moveaxis(way(camera, np.stack([x, y], axis=2), ideal, turned), 2, 0)
        return u, v

    return places


def plane_homography(
    camera: AnyCamera,
    source_shape: Size,
    *,
    texel_size: float = 1.0,  # scene units
    pose: ArrayLike | None = None,  # (4, 4) or (3, 4) from the plane's space to the world
) -> Homography:
    """Return the homography from a texture (height, width) on a plane to a camera's frame.

    In its own space the texture is centered at the origin, x to the right and y up.
    """
    height, width = source_shape
    if not (height > 0 and width > 0 and 0 < texel_size < np.inf):
        raise ValueError(
            f"a texture of {width} × {height} texels of {texel_size} scene units has no area"
        )
    to_plane = texel_size * np.array([[1, 0, -width / 2], [0, -1, height / 2], [0, 0, 0]])
    to_plane = np.vstack([to_plane, [0.0, 0.0, 1.0]])
    view = camera.view()
    given = np.eye(4) if pose is None else np.asarray(pose, np.float64)
    if given.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a pose has shape (3, 4) or (4, 4), not {given.shape}")
    to_camera = view.rotation @ (given[:3] @ to_plane)
    to_camera[:, 2] += view.translation
    depth = to_camera[2] if view.perspective else np.array([0.0, 0.0, 1.0])
    across = view.focal[:, None] * to_camera[:2] + view.principal[:, None] * depth
    try:
        return Homography(np.vstack([across, depth]), is_signed=True)
    except ValueError:
        raise ValueError(
            "the camera sees the texture's plane edge-on; move one of them, or check that all"
            " numbers are finite and neither is flat"
        ) from None
