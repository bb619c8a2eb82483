"""Maps that take a lens's distortion out of a photo, or put it in."""

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
    """Map of a pinhole's picture, seen in the photo that the camera took.

    Parameters
    ----------
    camera
        Whose lens is taken out.
    shape
        Height and width of the pinhole's picture, the target, px.
    ideal
        The pinhole, of which the matrix matters; by default the camera without its lens. OpenCV's
        new camera matrix.
    rotation
        (3, 3) from the camera's axes to the pinhole's; by default they are one. OpenCV's R.

    Returns
    -------
    Map without numbers behind the camera, and where the distortion's polynomial folds back: there
    `cv2.initUndistortRectifyMap` and `cv2.fisheye.initUndistortRectifyMap` show parts of the photo
    twice.

    Raises
    ------
    ValueError
        The rotation is none.
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
    """Map of the photo that the camera would take, seen in a pinhole's picture.

    Parameters
    ----------
    camera, ideal, rotation
        As in `undistorting`.
    shape
        Height and width of the photo, the target, px.

    Returns
    -------
    Map without numbers where no light comes through the lens.
    """
    return BackwardMap.from_function(
        places_by_lens(camera, ideal=ideal, rotation=rotation, inverse=True), shape
    )


def places_by_lens(
    camera: Camera, *, ideal: Camera | None, rotation: ArrayLike | None, inverse: bool
) -> Callable[[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Function from x and y of pixel centers, (h, w) each, to those of the source.

    Parameters
    ----------
    camera, ideal, rotation
        As in `undistorting`.
    inverse
        As `distorting` has it.
    """
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
    """Map that moves the photo's texels to their places in a pinhole's picture.

    Parameters
    ----------
    camera, ideal, rotation
        As in `undistorting`.
    source_shape
        Height and width of the photo, the source, px.
    """
    places = undistorted_places(camera, pixel_centers(source_shape), ideal, _checked(rotation))
    return ForwardMap(*np.moveaxis(places, 2, 0))


def _checked(rotation: ArrayLike | None) -> Doubles | None:
    return None if rotation is None else turned_by(rotation)
