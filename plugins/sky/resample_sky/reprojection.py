"""Backward maps between pictures of two coordinate systems: of the sky, of maps, of the Earth.

World coordinates are pairs of arrays: longitude and latitude, or easting and northing.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles
from resample_sky.control import coarsely
from resample_texture.geometry.mappings import BackwardMap, Homography
from resample_texture.geometry.matrices import homography

ERROR = 0.01  # px
FARTHEST_BACK = 1.0  # px between a pixel and where its world coordinates lead back to


class WorldCoordinates(Protocol):
    """World coordinates of a picture, as astropy's APE 14 has them; pixel centers at integers."""

    def pixel_to_world_values(self, *pixel: Any) -> Any:
        """World coordinates of x and y."""

    def world_to_pixel_values(self, *world: Any) -> Any:
        """Pixels, x and y, of world coordinates."""


World = WorldCoordinates | ArrayLike
Pairs = Callable[[Any, Any], Any]


def reprojection(
    source: World,
    target: World,
    shape: tuple[int, int],
    *,
    transform: Any = None,
    error: float = ERROR,
) -> Homography | BackwardMap:
    """Return the map from a target's pixels to those of a source, by their world coordinates.

    It is a `Homography` between two affine maps without a transform.

    Parameters
    ----------
    source, target, transform, error
        As `reproject` takes them.
    shape
        Height and width of the target, px.
    """
    between = _between(transform)
    before, after = _affine(source, "source"), _affine(target, "target")
    if before is not None and after is not None and between is None:
        return Homography(np.linalg.inv(after.matrix) @ before.matrix)
    have_frames = between is None and _has_frames(source) and _has_frames(target)
    if have_frames:
        there, back = _by_astropy(target, source), _by_astropy(source, target)
    else:
        there = _chained(_to_world(target, after), between, _from_world(source, before))
        back = _chained(_to_world(source, before), None, _from_world(target, after))
    is_sky = between is None and before is None and after is None
    with np.errstate(invalid="ignore"):
        return coarsely(_there_and_back(there, back) if is_sky else there, shape, error)


def _chained(forth: Pairs, between: Pairs | None, back: Pairs) -> Pairs:
    def places(x: Any, y: Any) -> Any:
        world = forth(x, y)
        return back(*(world if between is None else between(*world)))

    return places


def _there_and_back(there: Pairs, back: Pairs) -> Pairs:
    """Return places that lead back: those on the sky's other side have coordinates, too."""

    def places(x: Any, y: Any) -> Any:
        place = there(x, y)
        again = back(*place)
        is_one = np.hypot(again[0] - x, again[1] - y) <= FARTHEST_BACK
        return tuple(np.where(is_one, one, np.nan) for one in place)

    return places


def _has_frames(given: Any) -> bool:
    """Whether world coordinates are of astropy's objects, which know their frames."""
    return hasattr(given, "pixel_to_world") and hasattr(given, "world_to_pixel")


def _by_astropy(first: Any, second: Any) -> Pairs:
    from astropy.wcs.utils import pixel_to_pixel

    def places(x: Any, y: Any) -> Any:
        u, v = pixel_to_pixel(first, second, x - 0.5, y - 0.5)
        return u + 0.5, v + 0.5

    return places


def _between(transform: Any) -> Pairs | None:
    """Return a transform of coordinates: a function, or `pyproj.Transformer`."""
    found: Pairs | None = getattr(transform, "transform", transform)
    if found is not None and not callable(found):
        raise ValueError(
            f"transform is a function from x and y to x and y, or a pyproj.Transformer,"
            f" not {type(transform).__name__}"
        )
    return found


def _affine(given: Any, name: str) -> Homography | None:
    """Return the affine map from pixels, the first one's corner at 0, to world coordinates."""
    if hasattr(given, "pixel_to_world_values") and hasattr(given, "world_to_pixel_values"):
        return None
    if all(hasattr(given, letter) for letter in "abcdef"):  # as rasterio has it
        given = [[given.a, given.b, given.c], [given.d, given.e, given.f]]
    try:
        matrix = np.asarray(given, np.float64)
        if matrix.shape in ((2, 3), (3, 3)) and (matrix[2:] == [0.0, 0.0, 1.0]).all():
            return homography(matrix)
    except (TypeError, ValueError) as wrong:
        if "inverse" in str(wrong) or "finite" in str(wrong):
            raise
    raise ValueError(
        f"the {name} is an affine map (2, 3) or has pixel_to_world_values and"
        f" world_to_pixel_values, as astropy.wcs.WCS; it is {type(given).__name__}"
    )


def _to_world(given: Any, affine: Homography | None) -> Pairs:
    if affine is not None:
        return _by(affine.matrix)
    return lambda x, y: given.pixel_to_world_values(x - 0.5, y - 0.5)


def _from_world(given: Any, affine: Homography | None) -> Pairs:
    if affine is not None:
        return _by(affine.inverse())

    def pixels(*world: Any) -> tuple[Doubles, Doubles]:
        x, y = given.world_to_pixel_values(*world)
        return np.asarray(x) + 0.5, np.asarray(y) + 0.5

    return pixels


def _by(matrix: Doubles) -> Pairs:
    def mapped(x: Any, y: Any) -> tuple[Any, Any]:
        (a, b, c), (d, e, f) = matrix[:2].tolist()
        return a * x + b * y + c, d * x + e * y + f

    return mapped
