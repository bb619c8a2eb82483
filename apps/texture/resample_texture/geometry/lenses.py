"""Maps that take a lens's distortion out of a photo, or put it in."""

import numpy as np

from resample.cameras.models import Camera
from resample.cameras.pixels import distorted_places, pixel_centers, undistorted_places
from resample_texture.geometry.mappings import BackwardMap, ForwardMap


def undistorting(
    camera: Camera, shape: tuple[int, int], *, ideal: Camera | None = None
) -> BackwardMap:
    """Map of a pinhole's picture, seen in the photo that the camera took.

    Parameters
    ----------
    camera
        Whose lens is taken out.
    shape
        Height and width of the pinhole's picture, the target, px.
    ideal
        The pinhole, of which the matrix matters; by default the camera without its lens.

    Returns
    -------
    Map without numbers where the distortion's polynomial folds back: there
    `cv2.initUndistortRectifyMap` shows parts of the photo twice.
    """
    places = distorted_places(camera, pixel_centers(shape), ideal)
    return BackwardMap(*np.moveaxis(places, 2, 0))


def distorting(
    camera: Camera, shape: tuple[int, int], *, ideal: Camera | None = None
) -> BackwardMap:
    """Map of the photo that the camera would take, seen in a pinhole's picture.

    Parameters
    ----------
    camera, ideal
        As in `undistorting`.
    shape
        Height and width of the photo, the target, px.

    Returns
    -------
    Map without numbers where no light comes through the lens.
    """
    places = undistorted_places(camera, pixel_centers(shape), ideal)
    return BackwardMap(*np.moveaxis(places, 2, 0))


def undistorting_forward(
    camera: Camera, source_shape: tuple[int, int], *, ideal: Camera | None = None
) -> ForwardMap:
    """Map that moves the photo's texels to their places in a pinhole's picture.

    Parameters
    ----------
    camera, ideal
        As in `undistorting`.
    source_shape
        Height and width of the photo, the source, px.
    """
    places = undistorted_places(camera, pixel_centers(source_shape), ideal)
    return ForwardMap(*np.moveaxis(places, 2, 0))
