"""Pictures between coordinate systems, of the sky, of maps and of the Earth, and their sums.

Warps by control points are here, too.
"""

from typing import TYPE_CHECKING

from resample.lazy import attributes, listing

if TYPE_CHECKING:
    from resample_sky.control import control_points
    from resample_sky.mosaics import coadd, reproject

_HOMES = {"coadd": "mosaics", "control_points": "control", "reproject": "mosaics"}

__all__ = ["coadd", "control_points", "reproject"]

__getattr__ = attributes(__name__, _HOMES)
__dir__ = listing(_HOMES)
