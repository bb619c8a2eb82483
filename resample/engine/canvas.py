"""The sub-pixels of a tile: set up, seen by rays, and filtered to pixels."""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import radial
from resample.types import Canvas, Ellipsoid, Film, Floats, Place, Record, Screen, Tables, View


class Home(NamedTuple):
    """A tile and the frame it belongs to, px."""

    left: int
    top: int
    size: int
    width: int
    height: int


@kernel
def new_canvas(rows: int, columns: int) -> Canvas:
    """Empty canvas of that many sub-pixels."""
    pixel = np.zeros((rows, columns, 8), np.float32)
    pixel[:, :, 3] = 1.0
    pixel[:, :, 6] = np.inf
    return Canvas(
        pixel,
        np.zeros((rows, columns, 8), np.float32),
        np.zeros((rows, columns, 2), np.float32),
        np.array([rows, 0, columns, 0]),
    )


@kernel
def cast_rays(ray: Floats, place: Place, view: View, ellipsoid: Ellipsoid) -> None:
    """Per sub-pixel, what the exact footprints of all samples share."""
    n, unit = place.subpixels, ellipsoid.to_unit
    for row in range(ray.shape[0]):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(ray.shape[1]):
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            if not view.perspective:
                x, y = 0.0, 0.0
            squared = 0.0
            for axis in range(3):
                across = unit[axis, 0] * x + unit[axis, 1] * y + unit[axis, 2]
                squared += across * across
            ray[row, column, 0] = 1.0 / squared
            ray[row, column, 1] = ellipsoid.scale * math.sqrt((1.0 + x * x + y * y) / squared)


@kernel
def is_at_home(record: Record, home: Home) -> bool:
    """Whether the sample's center, moved into the frame, lies in the tile."""
    x = max(0.0, min(home.width - 1.0, float(record["x"]))) - home.left
    y = max(0.0, min(home.height - 1.0, float(record["y"]))) - home.top
    return 0.0 <= x < home.size and 0.0 <= y < home.size


@kernel
def pixel_weights(tables: Tables, n: int) -> Floats:
    """Weights, with sum 1, of the sub-pixels along one axis that a pixel's filter reads."""
    margin = tables.pixel_margin
    weight, total = np.zeros((2 * margin + 1) * n, np.float32), np.float32(0.0)
    for tap in range(weight.size):
        distance = abs((tap + 0.5) / n - margin - 0.5)
        weight[tap] = radial(tables.pixel, tables.pixel_extent, distance)
        total += weight[tap]
    for tap in range(weight.size):
        weight[tap] /= total
    return weight


@kernel
def resolve(pixel: Floats, n: int, weight: Floats, home: Home, film: Film) -> None:
    """Filter the sub-pixels of a tile to its pixels of a film (H, W)."""
    height, width = film.depth.shape
    one, zero = np.float32(1.0), np.float32(0.0)
    sums = np.zeros(6, np.float32)
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    for row in range(home.top, min(home.top + home.size, height)):
        for column in range(home.left, min(home.left + home.size, width)):
            sums[:] = zero
            first = np.inf
            for down in range(weight.size):
                r = (row - home.top) * n + down
                for right in range(weight.size):
                    c = (column - home.left) * n + right
                    share = weight[down] * weight[right]
                    covered = max(pixel[r, c, 7], min(one, pixel[r, c, 5]))
                    sums[0] += share * pixel[r, c, 0]
                    sums[1] += share * pixel[r, c, 1]
                    sums[2] += share * pixel[r, c, 2]
                    sums[3] += share * pixel[r, c, 7]
                    sums[4] += share * pixel[r, c, 4]
                    sums[5] += share * covered
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, pixel[r, c, 6])
            for channel in range(3):
                film.rgba[row, column, channel] = max(zero, sums[channel])
            film.rgba[row, column, 3] = min(one, max(zero, sums[3]))
            if sums[3] > zero:
                film.depth[row, column] = sums[4] / sums[3]
            film.first_depth[row, column] = first
            film.coverage[row, column] = min(one, max(zero, sums[5]))


@kernel
def laid_out(
    tile: int, size: int, tiles_in_row: int, subpixels: int, margin: int, screen: Screen
) -> tuple[Home, Place, int, int]:
    """Where a tile of `size` px lies, its canvas, and that one's rows and columns of sub-pixels."""
    left, top = tile % tiles_in_row * size, tile // tiles_in_row * size
    home = Home(left, top, size, screen.width, screen.height)
    place = Place(float(left - margin), float(top - margin), subpixels)
    # What lies beyond the frame's edge is left out: nothing might ever cover it.
    rows = (min(size, screen.height - top) + 2 * margin) * subpixels
    columns = (min(size, screen.width - left) + 2 * margin) * subpixels
    return home, place, rows, columns
