"""Rasters of clouds seen from above, as in maps: a value per square cell."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.messages import check_threads
from resample.progress import report
from resample.types import Doubles, Floats
from resample_points.data.cloud import Cloud, check_cloud, columns_of
from resample_points.data.columns import SCANNED
from resample_points.data.parts import rows_of, span_in

QUANTITIES = ("z", "color", "class", "intensity", "density")
MOST_CELLS, MOST_POINTS = 1 << 22, 1 << 22  # of a band that has more than one row
SPREAD = 1.5  # spacings, radius of the surface around a cell
LEAST = 0.75  # of a cell, that radius at least
PER_SQUARE = 16.0  # points, about, of the squares that are counted to measure the spacing
EXACT = 1e-9  # of a cell: places nearer to an edge lie on it
FARTHEST = float(1 << 52)  # cells from 0


class Raster(NamedTuple):
    """Square cells, seen from above; their edges are whole multiples of their side.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, raster_of
    >>> places = np.array([[0.3, 0.2, 5.0], [1.4, 0.9, 5.0]])
    >>> raster_of(Cloud(places, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)), 0.5)
    Raster(resolution=0.5, left=0.0, top=1.0, height=2, width=3)
    """

    resolution: float  # side of a cell, scene units
    left: float  # x of the left edge, scene units
    top: float  # y of the upper edge, scene units
    height: int  # cells
    width: int


def raster_of(cloud: Cloud, resolution: float) -> Raster:
    """Return the cells that a cloud covers.

    Raises
    ------
    ValueError
        The resolution is not above 0, or too fine for these coordinates; the cloud is empty.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, raster_of
    >>> places = np.array([[435_000.3, 5_120_000.2, 5.0], [435_001.4, 5_120_000.9, 5.0]])
    >>> raster = raster_of(Cloud(places, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)), 0.5)
    >>> raster.left, raster.top, raster.width
    (435000.0, 5120001.0, 3)
    """
    check_cloud(cloud, Cloud)
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"a resolution of {resolution:g}; give the side of a cell, above 0")
    ends = [span_in(cloud.position[:, axis]) for axis in (0, 1)]
    if ends[0] is None or ends[1] is None:
        raise ValueError("the cloud has no points")
    (left, right), (bottom, top) = [
        [math.floor(end / resolution + EXACT) for end in span] for span in ends if span is not None
    ]
    if max(map(abs, (left, right, bottom, top))) > FARTHEST:
        raise ValueError(f"cells of {resolution:g} are finer than these coordinates; take larger")
    shape = top + 1 - bottom, right + 1 - left
    return Raster(resolution, left * resolution, (top + 1) * resolution, *shape)


def usual_resolution(cloud: Cloud) -> float:
    """Return the usual distance of a cloud's points in x and y, as 1, 2 or 5 times 10^n or less."""
    ends = [span_in(cloud.position[:, axis]) or (0.0, 0.0) for axis in (0, 1)]
    across, down = (high - low for low, high in ends)
    rough = math.sqrt(across * down / max(len(cloud.position), 1)) or max(across, down)
    if not rough > 0:
        raise ValueError("all points lie above one place; give a resolution")
    exact = _counted(cloud, raster_of(cloud, rough))[0] * (1.0 + EXACT)
    power = 10.0 ** math.floor(math.log10(exact))
    return next(k for k in (5.0, 2.0, 1.0) if k * power <= exact) * power


def rasterized(
    cloud: Cloud,
    raster: Raster,
    quantity: str = "z",
    *,
    height_unit: float = 1.0,
    threads: int | None = None,
) -> Iterator[tuple[int, Floats]]:
    """Yield the values of a raster's cells in bands of rows from the top.

    A cell shows the surface of its highest point, or of the nearest point where it has none: the
    plane through that surface's points around its center, weighted by their distance, within
    0.75 cells or 1.5 spacings of the points, whichever is larger. Small gaps are closed, walls are
    not crossed.

    Parameters
    ----------
    cloud
        Points; a cloud larger than memory is read in parts.
    quantity
        `z`; `color`; `intensity`, or the name of another column; `class`, of the highest or
        nearest point; or `density`, points per square unit.
    height_unit
        Units of z per unit of x and y, which tell a slope from a wall; 111,320 for degrees.
    threads
        Most threads to use; the values do not depend on it.

    Yields
    ------
    The first row, and values (h, width, 1), or of `color` (h, width, 3) in linear light; NaN where
    there is nothing.

    Raises
    ------
    ValueError
        The cloud lacks the quantity.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, raster_of, rasterized
    >>> x, y = np.meshgrid(np.arange(0.05, 4, 0.1), np.arange(0.05, 2, 0.1))
    >>> slope = np.stack([x, y, 10 + x], axis=2).reshape(-1, 3)
    >>> cloud = Cloud(slope, np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    >>> ((_, height),) = rasterized(cloud, raster_of(cloud, 1.0))
    >>> height[..., 0].round(2).tolist()
    [[10.5, 11.5, 12.5, 13.5], [10.5, 11.5, 12.5, 13.5]]
    """
    from resample.engine import jit

    is_class, values = quantity == "class", cloud.position[:, 2:]
    if quantity == "color":
        if not len(cloud.color):
            raise ValueError("the cloud has no colors; take z, density or a column")
        values = cloud.color
    elif quantity not in ("z", "density"):
        name = SCANNED[1] if is_class else quantity
        if name not in cloud.columns:
            known = ", ".join((*QUANTITIES, *columns_of(cloud)[3:]))
            raise ValueError(f"there is no column {name!r} to map; known: {known}")
        values = np.asarray(cloud.columns[name])[:, None]
    check_threads(threads)
    spacing, held = _counted(cloud, raster)
    side = max(LEAST, SPREAD * spacing / raster.resolution)
    # The cells and points of a band fit into memory.
    until, most, first = np.cumsum(held), max(1, MOST_CELLS // raster.width), 0
    with jit.threads(jit.workers() if threads is None else threads):
        while first < raster.height:
            before = until[first - 1] if first else 0
            full = int(np.searchsorted(until, before + MOST_POINTS, side="right"))
            last = min(max(full, first + 1), first + most, raster.height)
            if quantity == "density":
                yield first, _density(cloud, raster, first, last)
            else:
                band = first, last
                yield first, _band(cloud, values, raster, band, side, height_unit, is_class)
            report(last, raster.height)
            first = last


def _cells(cloud: Cloud, raster: Raster, rows: slice) -> Doubles:
    """Return the places (n, 2) of points, right and down in cells from the raster's corner."""
    place = np.asarray(cloud.position[rows, :2], np.float64)
    place = (place - (raster.left, raster.top)) / (raster.resolution, -raster.resolution)
    near = np.rint(place)
    return np.where(np.abs(place - near) < EXACT, near, place)


def _counted(cloud: Cloud, raster: Raster) -> tuple[float, NDArray[np.int64]]:
    """Return the usual distance of neighbours in x and y, scene units, and points of each row."""
    count, held = len(cloud.position), np.zeros(raster.height, np.int64)
    side = max(math.sqrt(PER_SQUARE * raster.height * raster.width / count), 1.0)  # cells
    shape = math.ceil(raster.height / side), math.ceil(raster.width / side)
    is_held = np.zeros(shape, np.bool_)
    for rows in rows_of(cloud.position):
        place = _cells(cloud, raster, rows)
        column, row = np.minimum(place / side, np.array(shape[::-1]) - 1).astype(np.int64).T
        is_held[row, column] = True
        row = np.minimum(place[:, 1], raster.height - 1).astype(np.int64)
        held += np.bincount(row, minlength=raster.height)
    return math.sqrt(np.count_nonzero(is_held) / count) * side * raster.resolution, held


def _density(cloud: Cloud, raster: Raster, first: int, last: int) -> Floats:
    """Return points per square unit in rows of cells."""
    count = np.zeros((last - first) * raster.width, np.int64)
    for rows in rows_of(cloud.position):
        column, row = np.floor(_cells(cloud, raster, rows)).astype(np.int64).T
        row = np.clip(row, 0, raster.height - 1)
        column = np.clip(column, 0, raster.width - 1)
        is_here = (row >= first) & (row < last)
        place = (row[is_here] - first) * raster.width + column[is_here]
        count += np.bincount(place, minlength=len(count))
    shape = last - first, raster.width, 1
    return (count.reshape(shape) / raster.resolution**2).astype(np.float32)


def _band(
    cloud: Cloud,
    values: NDArray[np.generic],
    raster: Raster,
    band: tuple[int, int],
    side: float,
    height_unit: float,
    is_class: bool,
) -> Floats:
    """Return values (h, width, C) of rows of cells, from the points on them and around.

    `side`: of bins of points, cells. `is_class`: values belong to single points.
    """
    from resample_points.kernels.rasters import DOUBLINGS, fill_cells

    border, (first, last) = side * (1 << DOUBLINGS), band
    places, given = [], []
    for rows in rows_of(cloud.position):
        place = _cells(cloud, raster, rows)
        is_near = (place[:, 1] >= first - border) & (place[:, 1] < last + border)
        high = cloud.position[rows, 2][is_near] / (raster.resolution * height_unit)
        places.append(np.column_stack([place[is_near] + (border, border - first), high]))
        given.append(np.asarray(values[rows][is_near], np.float64))
    place, value = np.concatenate(places), np.concatenate(given)
    across, down = (int((n + 2 * border) / side) + 1 for n in (raster.width, last - first))
    column, row = (place[:, :2] / side).astype(np.int64).T
    number = row * across + column
    order = np.argsort(number, kind="stable")
    start = np.searchsorted(number[order], np.arange(across * down + 1))
    shape = last - first, raster.width
    found = np.full((*shape, value.shape[1]), np.nan)
    top = np.full(shape, -1, np.int64)
    nearest = max(LEAST, side / SPREAD)
    fill_cells(place[order], value[order], start, across, side, nearest, found, top)
    if is_class:
        found[top >= 0] = value[order][top[top >= 0]]
    return found.astype(np.float32)
