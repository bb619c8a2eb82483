"""Where pixels lie in a source: on a plane under a homography, or by a map."""

import math
from typing import NamedTuple

from resample.engine.jit import (
    Counter,
    inner_kernel,
    packed_kernel,
    parallel_kernel,
)
from resample.engine.roles import plays
from resample.engine.windows.footprints import GridView, PixelFootprint, footprint_at
from resample.engine.windows.gather import (
    Extent,
    Integers,
    Mask,
    gather_tiles,
    measure_tiles,
)
from resample.types import Doubles, Floats

FARTHEST = 2.0**52  # texels from the source's origin; places beyond count as nowhere
TWELFTH = 1.0 / 12.0  # second moment of a pixel
TORN = 8.0  # a step so many times as long as that on the pixel's other side crosses a tear


Pair = tuple[float, float]


class Plane(NamedTuple):
    """A source in perspective."""

    inverse: Doubles  # (3, 3) target to source; the third coordinate is positive in front
    left: int  # px of the target at which the picture begins
    top: int


class Map(NamedTuple):
    """A source with a map that gives each pixel its source coordinates."""

    u: Doubles  # (h + 2, w + 2) source coordinates of pixel centers, with a margin of one;
    v: Doubles  # NaN: nothing


@inner_kernel
def steps(before: float, here: float, after: float) -> tuple[float, float]:
    """Steps of a map to both sides; a missing or torn one is as the other."""
    left, right = here - before, after - here
    if not abs(left) <= FARTHEST or abs(left) > TORN * abs(right) + TORN:
        left = right
    if not abs(right) <= FARTHEST or abs(right) > TORN * abs(left) + TORN:
        right = left
    return (left, right) if abs(left) <= FARTHEST else (0.0, 0.0)


@plays(footprint_at, Plane)
def _footprint_on_plane(geometry: Plane, row: int, column: int) -> PixelFootprint:
    """Project a pixel into the source plane: its mean place and its sides."""
    # Project the pixel's center; it shows nothing behind the horizon.
    a, x, y = geometry.inverse, (geometry.left + column) + 0.5, (geometry.top + row) + 0.5
    d = a[2, 0] * x + a[2, 1] * y + a[2, 2]
    share = 1.0 / d if d > 0.0 else math.nan
    u = (a[0, 0] * x + a[0, 1] * y + a[0, 2]) * share
    # Differentiate the homography for the pixel's sides.
    v = (a[1, 0] * x + a[1, 1] * y + a[1, 2]) * share
    ux, uy = (a[0, 0] - u * a[2, 0]) * share, (a[0, 1] - u * a[2, 1]) * share
    vx, vy = (a[1, 0] - v * a[2, 0]) * share, (a[1, 1] - v * a[2, 1]) * share
    # Move the middle to the mean of the pixel's points, to second order.
    bend_x, bend_y = a[2, 0] * share * TWELFTH, a[2, 1] * share * TWELFTH
    u, v = u - ux * bend_x - uy * bend_y, v - vx * bend_x - vy * bend_y
    return PixelFootprint(u, v, (ux, vx), (uy, vy))


@inner_kernel
def _squared(along_x: Pair, along_y: Pair) -> tuple[Pair, Pair]:
    """Sides of a pixel; unknown ones are the other turned by 90°, or a texel."""
    is_known_x = along_x[0] != 0.0 or along_x[1] != 0.0
    is_known_y = along_y[0] != 0.0 or along_y[1] != 0.0
    if is_known_x and is_known_y:
        return along_x, along_y
    if is_known_x:
        return along_x, (-along_x[1], along_x[0])
    if is_known_y:
        return (along_y[1], -along_y[0]), along_y
    return (1.0, 0.0), (0.0, 1.0)


@plays(footprint_at, Map)
def _footprint_by_map(geometry: Map, row: int, column: int) -> PixelFootprint:
    """Look a pixel up in the map: its mean place and its sides."""
    r, c = row + 1, column + 1
    u, v = geometry.u[r, c], geometry.v[r, c]
    # Difference the map on both sides of the pixel.
    ux = steps(geometry.u[r, c - 1], u, geometry.u[r, c + 1])
    vx = steps(geometry.v[r, c - 1], v, geometry.v[r, c + 1])
    uy = steps(geometry.u[r - 1, c], u, geometry.u[r + 1, c])
    vy = steps(geometry.v[r - 1, c], v, geometry.v[r + 1, c])
    # Take the mean of both sides, and the bend between them for the mean place.
    bend_u, bend_v = ux[1] - ux[0] + uy[1] - uy[0], vx[1] - vx[0] + vy[1] - vy[0]
    along_x = 0.5 * (ux[0] + ux[1]), 0.5 * (vx[0] + vx[1])
    along_y = 0.5 * (uy[0] + uy[1]), 0.5 * (vy[0] + vy[1])
    along_x, along_y = _squared(along_x, along_y)
    return PixelFootprint(u + 0.5 * TWELFTH * bend_u, v + 0.5 * TWELFTH * bend_v, along_x, along_y)


@packed_kernel
def fill_tiles(
    counter: Counter,
    geometry: Plane | Map,
    view: GridView,
    tiles: Integers,
    bounds: Doubles,
    wanted: Mask,
    image: Floats,
    covered: Floats,
) -> None:
    """Fill tiles of a picture with what their pixels cover; see `gather_tiles`."""
    gather_tiles(counter, geometry, view, tiles, bounds, wanted, image, covered)


@parallel_kernel
def measure(
    counter: Counter,
    geometry: Plane | Map,
    tiles: Integers,
    step: int,
    view: GridView,
    extent: Extent,
) -> None:
    """Measure what tiles cover of the source; see `measure_tiles`."""
    measure_tiles(counter, geometry, tiles, step, view, extent)
