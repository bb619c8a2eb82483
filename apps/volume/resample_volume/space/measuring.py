"""Distances and angles between points in a volume's scene."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles
from resample_volume.picking import Picked
from resample_volume.types import Volume

MILLIMETRES = "lps"  # the one space of files whose unit is known


class Measured(NamedTuple):
    """Distance and angle between points."""

    distance: float  # scene units, from the first point via the second to the last
    angle: float | None  # degrees 0 to 180 at the second of three points; None for two
    unit: str  # of the distance: mm, or empty if unknown


def unit_of_space(volume: Volume) -> str:
    """Return the name of a volume's scene units; empty if unknown."""
    return "mm" if volume.space == MILLIMETRES else ""


def measure(*places: Picked | ArrayLike, volume: Volume | None = None) -> Measured:
    """Measure the distance of two points, or the path along three and the angle at the second.

    Parameters
    ----------
    places
        Two or three points, from `Scene.pick` or (3,) scene units. A picked point is its voxel's
        center, so picked distances are accurate to a voxel.
    volume
        Gives the unit.

    Raises
    ------
    ValueError
        There are more or fewer points, one is invalid, or two of three coincide.

    Examples
    --------
    >>> from resample_volume import measure
    >>> measure((0, 0, 0), (3, 4, 0)).distance
    5.0
    >>> round(measure((1, 0, 0), (0, 0, 0), (0, 2, 0)).angle)
    90
    """
    if len(places) not in (2, 3):
        raise ValueError(f"{len(places)} places; give two for a distance, three for an angle")
    found = [_place(one) for one in places]
    ways = [after - before for before, after in pairwise(found)]
    lengths = [float(np.linalg.norm(way)) for way in ways]
    unit = "" if volume is None else unit_of_space(volume)
    if len(ways) == 1:
        return Measured(lengths[0], None, unit)
    if not all(lengths):
        raise ValueError("two of three places are the same, so there is no angle")
    back, on = -ways[0] / lengths[0], ways[1] / lengths[1]
    angle = 2 * np.arctan2(np.linalg.norm(back - on), np.linalg.norm(back + on))
    return Measured(sum(lengths), float(np.degrees(angle)), unit)


def _place(given: Picked | ArrayLike) -> Doubles:
    place = np.asarray(given.position if isinstance(given, Picked) else given, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError(f"the place {given!r} is not one of 3 finite numbers, scene units")
    return place
