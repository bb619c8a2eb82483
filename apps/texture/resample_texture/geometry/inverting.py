"""Inverses of maps that are given by their values at pixel centers.

Between centers a map is a cubic spline, and beyond them it goes on as it ends. Its inverse at a
place is found by Newton's method from the pixel whose value lies nearest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles

TOLERANCE = 1e-3  # px by which an inverse's value may miss its place
MOST_STEPS = 20
LONGEST_STEP = 8.0  # px
BEYOND = 2.0  # px beyond the map's edges where it is still inverted
MARGIN = 20  # pixels by which a map is extended; a spline forgets its ends by 0.27 per pixel


class _Spline(NamedTuple):
    """A map (2, h, w) as a spline, its derivatives, and where it is known."""

    values: Doubles  # (2, h, w) coefficients, extended
    steps: Doubles  # (2, 2, h, w) change of x and y per column, and per row
    is_known: Doubles  # (h, w) 1 or 0

    def at(self, place: Doubles) -> Doubles:
        """Return the map's values (2, N) at places (2, N), px."""
        return np.stack([_sampled(one, place, 3) for one in self.values])

    def slopes_at(self, place: Doubles) -> Doubles:
        """Return derivatives (2, 2, N): of x and y along x, and along y."""
        return np.stack([[_sampled(one, place, 1) for one in along] for along in self.steps])


def inverse_of(
    x: Doubles, y: Doubles, shape: tuple[int, int], tolerance: float = TOLERANCE
) -> tuple[Doubles, Doubles]:
    """Return where a map (h, w) takes the value of each pixel center of a picture.

    Not a number where the map takes no such value. Where a fold takes one twice, it is one of the
    two.

    `x`, `y`: places of the map's pixel centers, px; not a number where there are none. `shape`:
    height and width of the picture to whose pixel centers the inverse belongs, px. `tolerance`:
    distance, px, of the inverse's value from the center, at most.
    """
    if not tolerance > 0.0:
        raise ValueError(f"a tolerance lies above 0 px, not at {tolerance}")
    is_known = np.isfinite(x) & np.isfinite(y)
    if not is_known.any():
        return np.full(shape, np.nan), np.full(shape, np.nan)
    wanted = np.stack([a.ravel() for a in np.meshgrid(*(np.arange(n) + 0.5 for n in shape[::-1]))])
    place = _nearest(x, y, is_known, shape)
    u, v = _found(x, y, place, wanted, tolerance).reshape(2, *shape)
    return u, v


def points_back(x: Doubles, y: Doubles, wanted: Doubles) -> Doubles:
    """Return where a map (h, w) takes the values (2, N); not a number where it does not."""
    from scipy.spatial import cKDTree

    row, column = np.nonzero(np.isfinite(x))
    if not row.size:
        return np.full(wanted.shape, np.nan)
    tree, is_given = cKDTree(np.stack([x, y])[:, row, column].T), np.isfinite(wanted).all(axis=0)
    _, nearest = tree.query(np.where(is_given, wanted, 0.0).T)
    place = np.stack([column + 0.5, row + 0.5])[:, nearest].astype(np.float64)
    return np.where(is_given, _found(x, y, place, wanted, TOLERANCE), np.nan)


def points_along(x: Doubles, y: Doubles, place: Doubles) -> Doubles:
    """Return the values of a map (h, w) at places (2, N), px; not a number beyond its edges."""
    is_known = np.isfinite(x)
    if not is_known.any():
        return np.full(place.shape, np.nan)
    spline, size = _spline(np.stack([x, y]), is_known), np.array(x.shape[::-1])[:, None]
    is_within = ((place >= 0.0) & (place <= size)).all(axis=0)
    here = np.where(is_within, place, 0.0)
    is_within &= _sampled(spline.is_known, here, 1) > 1.0 - 1e-6
    return np.where(is_within, spline.at(here), np.nan)


def _found(x: Doubles, y: Doubles, place: Doubles, wanted: Doubles, tolerance: float) -> Doubles:
    """Return where a map has the wanted values, from places (2, N) nearby; else not a number."""
    spline = _spline(np.stack([x, y]), np.isfinite(x) & np.isfinite(y))
    miss = _refine(spline, place, wanted, tolerance)
    size = np.array(x.shape[::-1], np.float64)[:, None]
    is_found = (miss <= tolerance) & (place >= -BEYOND).all(axis=0)
    is_found &= (place <= size + BEYOND).all(axis=0)
    is_found &= _sampled(spline.is_known, place, 1) > 1.0 - 1e-6
    return np.where(is_found, place, np.nan)


def _refine(spline: _Spline, place: Doubles, wanted: Doubles, tolerance: float) -> Doubles:
    """Move places (2, N) to where the map has the wanted values; return how far it is off."""
    miss = np.full(place.shape[1], np.inf)
    left = np.arange(place.shape[1])
    for _ in range(MOST_STEPS):
        here = place[:, left]
        off = wanted[:, left] - spline.at(here)
        miss[left] = np.hypot(*off)
        (a, c), (b, d) = spline.slopes_at(here)
        area = a * d - b * c
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.stack([d * off[0] - b * off[1], a * off[1] - c * off[0]]) / area
            long = np.hypot(*step)
            step *= np.where(long > LONGEST_STEP, LONGEST_STEP / long, 1.0)
        is_left = (miss[left] > tolerance) & np.isfinite(step).all(axis=0)
        left = left[is_left]
        if not left.size:
            break
        place[:, left] += step[:, is_left]
    return miss


def _nearest(
    x: Doubles, y: Doubles, is_known: NDArray[np.bool_], shape: tuple[int, int]
) -> Doubles:
    """Return the center (2, N) of the map's pixel whose value lies next to each pixel's center."""
    from scipy import ndimage

    row, column = np.nonzero(is_known)
    there = np.floor(np.stack([y[row, column], x[row, column]]))
    high = np.array(shape)[:, None] - 1
    with np.errstate(invalid="ignore"):
        index = np.clip(there, 0, high).astype(np.int64)
    order = np.argsort(-np.abs(there - index).max(axis=0), kind="stable")  # those within come last
    index, row, column = index[:, order], row[order], column[order]
    found = np.zeros((3, *shape), np.int64)
    found[:, index[0], index[1]] = np.ones_like(row), row, column
    own = ndimage.distance_transform_edt(found[0] == 0, return_distances=False, return_indices=True)
    nearest = found[:, own[0], own[1]]
    return np.asarray(nearest[:0:-1].reshape(2, -1) + 0.5)


def _spline(places: Doubles, is_known: NDArray[np.bool_]) -> _Spline:
    from scipy import ndimage

    if not is_known.all():
        own = ndimage.distance_transform_edt(~is_known, return_distances=False, return_indices=True)
        places = places[:, own[0], own[1]]
    # Beyond their sides values go on as they end there.
    wide = np.stack([np.pad(one, MARGIN, mode="reflect", reflect_type="odd") for one in places])
    steps = np.stack([np.gradient(wide, axis=axis) for axis in (2, 1)])
    values = np.stack([ndimage.spline_filter(one, 3, mode="mirror") for one in wide])
    return _Spline(values, steps, np.pad(is_known.astype(np.float64), MARGIN, mode="edge"))


def _sampled(values: Doubles, place: Doubles, order: int) -> Doubles:
    from scipy import ndimage

    where = place[::-1] - 0.5 + MARGIN
    return np.asarray(
        ndimage.map_coordinates(values, where, order=order, mode="nearest", prefilter=False)
    )
