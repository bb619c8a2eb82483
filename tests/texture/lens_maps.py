"""Maps of lenses, evaluated for whole pictures."""

from functools import partial

import numpy as np

from resample.cameras.pixels import pixel_centers, undistorted_places
from resample_texture import BackwardMap, ForwardMap
from resample_texture.geometry.cameras import places_by_lens


def lens_map(camera, shape, *, inverse, **given):
    """The backward map of a pinhole's picture into the camera's photo, or the inverse's."""
    return BackwardMap.from_function(places_by_lens(camera, inverse=inverse, **given), shape)


undistorting, distorting = (partial(lens_map, inverse=inverse) for inverse in (False, True))


def undistorting_forward(camera, shape, *, ideal=None, rotation=None):
    """The forward map of a photo's texels to a pinhole's picture."""
    places = undistorted_places(camera, pixel_centers(shape), ideal, rotation)
    return ForwardMap(*np.moveaxis(places, 2, 0))
