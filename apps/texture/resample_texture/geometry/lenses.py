"""Maps that remove a lens's distortion from a photo, or add it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera
from resample.cameras.pixels import distorted_places, pixel_centers, undistorted_places
from resample.cameras.poses import turned_by
from resample.types import Doubles
from resample_texture.geometry.mappings import BackwardMap, ForwardMap


def undistorting(
    camera: Camera,
    shape: tuple[int, int],
    *,
    ideal: Camera | None = None,
    rotation: ArrayLike | None = None,
) -> BackwardMap:
    """Return the backward map of a pinhole's picture into the camera's photo.

    Parameters
    ----------
    shape
        Height and width of the pinhole's picture, the target, px.
    rotation
        (3, 3) from the camera's axes to the pinhole's (OpenCV's R); by default the identity.

    Returns
    -------
    A map that is not a number behind the camera, and where the distortion's polynomial folds back:
    there `cv2.initUndistortRectifyMap` and `cv2.fisheye.initUndistortRectifyMap` show parts of the
    photo twice.
    """
    return BackwardMap.from_function(
        places_by_lens(camera, ideal=ideal, rotation=rotation, inverse=False), shape
    )


def distorting(
    camera: Camera,
    shape: tuple[int, int],
    *,
    ideal: Camera | None = None,
    rotation: ArrayLike | None = None,
) -> BackwardMap:
    """Return the backward map of the camera's photo into a pinhole's picture.

    Parameters
    ----------
    shape
        Height and width of the photo, the target, px.

    Returns
    -------
    A map that is not a number where no light comes through the lens.
    """
    return BackwardMap.from_function(
        places_by_lens(camera, ideal=ideal, rotation=rotation, inverse=True), shape
    )


def places_by_lens(
    camera: Camera, *, ideal: Camera | None, rotation: ArrayLike | None, inverse: bool
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Return a function from x and y of pixel centers, (h, w) each, to those of the source."""
    turned = _checked(rotation)
    way = undistorted_places if inverse else distorted_places

    def places(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        u, v = np.moveaxis(way(camera, np.stack([x, y], axis=2), ideal, turned), 2, 0)
        return u, v

    return places


def undistorting_forward(
    camera: Camera,
    source_shape: tuple[int, int],
    *,
    ideal: Camera | None = None,
    rotation: ArrayLike | None = None,
) -> ForwardMap:
    """Return the forward map of a photo's texels to a pinhole's picture.

    Parameters
    ----------
    source_shape
        Height and width of the photo, the source, px.
    """
    places = undistorted_places(camera, pixel_centers(source_shape), ideal, _checked(rotation))
    return ForwardMap(*np.moveaxis(places, 2, 0))


def _checked(rotation: ArrayLike | None) -> Doubles | None:
    return None if rotation is None else turned_by(rotation)
