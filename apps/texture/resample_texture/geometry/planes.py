"""Homography of a textured plane seen by a camera."""

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyCamera
from resample.types import Doubles
from resample_texture.geometry.mappings import Homography


def plane_homography(
    camera: AnyCamera,
    source_shape: tuple[int, int],
    *,
    texel_size: float = 1.0,
    pose: ArrayLike | None = None,
) -> Homography:
    """Return the homography from a texture on a plane to a camera's frame.

    It knows what is behind the camera, wherever the texture's center is. The camera's near plane is
    ignored.

    Parameters
    ----------
    camera
        Camera whose frame is the target.
    source_shape
        Height and width of the texture, px.
    texel_size
        Width of a texel, scene units.
    pose
        (4, 4) or (3, 4) from the plane's space to the world; by default the identity. In its own
        space the texture lies at z = 0, centered at the origin, with x to the right and y up; seen
        from positive z it is not mirrored. The pose may mirror or stretch it.

    Raises
    ------
    ValueError
        The camera sees the plane edge-on, or a number is invalid.
    """
    height, width = source_shape
    if not (height > 0 and width > 0 and 0 < texel_size < np.inf):
        raise ValueError(
            f"a texture of {width} × {height} texels of {texel_size} scene units has no area"
        )
    to_plane = texel_size * np.array([[1, 0, -width / 2], [0, -1, height / 2], [0, 0, 0]])
    to_plane = np.vstack([to_plane, [0.0, 0.0, 1.0]])
    view = camera.view()
    to_camera = view.rotation @ (_affine(pose) @ to_plane)
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


def _affine(pose: ArrayLike | None) -> Doubles:
    """Return the upper three rows of a pose."""
    given = np.eye(4) if pose is None else np.asarray(pose, np.float64)
    if given.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"a pose has shape (3, 4) or (4, 4), not {given.shape}")
    return given[:3]
