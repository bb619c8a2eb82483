"""Composite ellipsoids tile by tile, in one order for the whole picture."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import (
    Counter,
    inner_kernel,
    inner_step,
    lane_role,
    lane_step,
    load_soon,
    parallel_kernel,
    plays,
    tasks,
)
from resample.engine.shaped.canvas import (
    LANES,
    SIDE,
    SIZE,
    Line,
    Open,
    PaintedShapes,
    TilePlace,
    clear,
    close_groups,
    groups_of,
    lay,
    line_of,
    subpixels_of,
    write_tile,
)
from resample.engine.shaped.integrals import Integral, expm1_of, line_integral, of_16_times
from resample.engine.shaped.lists import TileGrid, TileLists
from resample.engine.shaped.records import (
    BLUE,
    GREEN,
    HIGH,
    LIMIT,
    PEAK,
    RED,
    SMALL,
    T_1,
    WIDE,
    WIDTH,
    X,
    Y,
)
from resample.types import Floats, Single

OFTEN = 16  # members of a tile after which opaque groups are looked for
DEEPEST = np.float32(-1.0)


class PeakOpacity(NamedTuple):
    """Opacities peak × exp(−i² / 2) of Gaussians."""

    most: Single  # greatest opacity


class DepthOpacity(NamedTuple):
    """Opacities 1 − exp(−τ) of optical depths, by a kernel's line integrals; or these depths."""

    integral: Integral  # relative to that through the center
    per_focal: tuple[Single, Single]  # 1 / px, of slopes; 0 where rays are parallel
    principal: tuple[Single, Single]  # px
    is_linear: bool


class CutOpacity(NamedTuple):
    """As `DepthOpacity`, for parts of rays between clipping planes."""

    partial: Floats  # (K + 1, K + 1) `partial_table`, relative to the whole through the center
    # (M, 6): rate and offset, each as a constant and per px across and down; depths are kept at
    # which rate × depth + offset is above 0.
    planes: Floats
    per_focal: tuple[Single, Single]  # 1 / px, of slopes; 0 where rays are parallel
    principal: tuple[Single, Single]  # px
    is_linear: bool


Opacity = PeakOpacity | DepthOpacity | CutOpacity


@lane_step
def falling(x: Single) -> Single:
    """exp(x) of a number between −12 and 0: a series of x / 16, squared four times."""
    r = x * np.float32(1.0 / 16.0)
    one = np.float32(1)
    p = np.float32(1.0 / 720.0) + r * np.float32(1.0 / 5040.0)
    p = np.float32(1.0 / 24.0) + r * (np.float32(1.0 / 120.0) + r * p)
    p = one + r * (one + r * (np.float32(0.5) + r * (np.float32(1.0 / 6.0) + r * p)))
    p *= p
    p *= p
    p *= p
    return p * p


@lane_step
def _absorbed(depth: Single, is_linear: bool) -> Single:
    """Opacity of an optical depth."""
    exact = -of_16_times(expm1_of(max(DEEPEST, np.float32(-1.0 / 16.0) * depth)))
    return min(np.float32(1), depth) if is_linear else exact


@lane_role
def alpha_of(opacity: Opacity, peak: Single, square: Single, longer: Single) -> Single:
    """Opacity at a squared distance i²; `longer`: length of the ray, as in `longer_of`."""
    raise NotImplementedError


@plays(alpha_of, PeakOpacity)
def _of_peak(opacity, peak, square, longer):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return min(opacity.most, peak * falling(np.float32(-0.5) * square))


@plays(alpha_of, DepthOpacity)
def _of_depth(opacity, peak, square, longer):  # type: ignore[no-untyped-def]
    t = max(np.float32(0), np.float32(1) - square)
    return _absorbed(peak * line_integral(opacity.integral, t, longer), opacity.is_linear)


@lane_role
def longer_of(opacity: Opacity, x: Single, y: Single, per: Single) -> Single:
    """Length of the ray through (x, y) px per unit of depth, times √per."""
    raise NotImplementedError


@plays(longer_of, PeakOpacity)
def _same(opacity, x, y, per):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.float32(1)


@plays(longer_of, object)
def _slanted(opacity, x, y, per):  # type: ignore[no-untyped-def]
    across = (x - opacity.principal[0]) * opacity.per_focal[0]
    down = (y - opacity.principal[1]) * opacity.per_focal[1]
    return math.sqrt((np.float32(1) + across * across + down * down) * per)


@lane_role
def response_at(
    opacity: Opacity,
    line: Line,
    dx: Single,
    place: tuple[Single, Single],
    own: tuple[Single, Single, Single],
) -> tuple[Single, Single]:
    """Opacity and depth of a record at dx px from its reference.

    `place`: px of the screen. `own`: peak, limit, and the depth from which on it is seen.
    """
    raise NotImplementedError


@plays(response_at, object)
def _response_at(opacity, line, dx, place, own):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0), np.float32(1)
    n = line.n0 + dx * (line.n1 + dx * line.n2)
    d = line.d0 + dx * (line.d1 + dx * line.d2)
    per = one / d
    square = n * per
    t = (line.t0 + dx * line.t1) * per
    alpha = alpha_of(
        opacity, own[0], min(square, own[1]), longer_of(opacity, place[0], place[1], per)
    )
    return (alpha if (square <= own[1]) & (t > own[2]) else zero), t


@lane_role
def depths_kept(opacity: Opacity, x: Single, y: Single, near: Single) -> tuple[Single, Single]:
    """Depths that bound the visible part of the ray through (x, y) px."""
    raise NotImplementedError


@plays(depths_kept, object)
def _beyond_near(opacity, x, y, near):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return near, np.float32(np.inf)


@plays(depths_kept, CutOpacity)
def _between_planes(opacity, x, y, near):  # type: ignore[no-untyped-def]
    first, last, zero = near, np.float32(np.inf), np.float32(0)
    for k in range(opacity.planes.shape[0]):
        plane = opacity.planes[k]
        rate, offset = (plane[0] + plane[1] * x + plane[2] * y), plane[3] + plane[4] * x
        offset += plane[5] * y
        if rate > zero:
            first = max(first, -offset / rate)
        elif rate < zero:
            last = min(last, -offset / rate)
        elif offset <= zero:
            last = first
    return first, last


@lane_step
def _integral_until(partial: Floats, square: Single, place: Single) -> Single:
    """Line integral at a squared distance up to a place, in radii from the nearest to the center.

    `partial`: table, which is interpolated.
    """
    steps, one = np.float32(partial.shape[0] - 1), np.float32(1)
    across = np.float32(0.5) * steps * (min(max(place, -one), one) + one)
    down = steps * min(max(square, np.float32(0)), one)
    column = np.uint32(min(across, steps - one))
    row = np.uint32(min(down, steps - one))
    across, down = across - np.float32(column), down - np.float32(row)
    next_row, next_column = row + np.uint32(1), column + np.uint32(1)
    above = partial[row, column] + across * (partial[row, next_column] - partial[row, column])
    below = partial[next_row, column]
    below += across * (partial[next_row, next_column] - partial[next_row, column])
    return above + down * (below - above)


@plays(response_at, CutOpacity)
def _response_between(opacity, line, dx, place, own):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0), np.float32(1)
    d = line.d0 + dx * (line.d1 + dx * line.d2)
    per = one / d
    square = (line.n0 + dx * (line.n1 + dx * line.n2)) * per / own[1]
    t = (line.t0 + dx * line.t1) * per
    first, last = depths_kept(opacity, place[0], place[1], own[2])
    radii = math.sqrt(d / own[1])  # per unit of depth
    depth = _integral_until(opacity.partial, square, (last - t) * radii)
    depth -= _integral_until(opacity.partial, square, (first - t) * radii)
    depth *= own[0] * longer_of(opacity, place[0], place[1], per)
    alpha = _absorbed(depth, opacity.is_linear)
    is_seen = (square <= one) & (first < last)
    return (alpha if is_seen else zero), min(max(t, first), last)


@inner_step
def _composite(
    canvas: Floats,
    line: Line,
    record: Floats,
    place: tuple[int, int],
    spot: TilePlace,
    opacity: Opacity,
) -> None:
    """Composite a record on eight sub-pixels; `place`: their row and group."""
    row, group = place
    own = record[PEAK], record[LIMIT], spot.near
    light = record[RED], record[GREEN], record[BLUE]
    base = np.uint64(row * SIDE + group * LANES)
    start = line.start + np.float32(group * LANES) * spot.step
    x = np.float32(spot.left + (group * LANES + 0.5) * float(spot.step))
    y = np.float32(spot.top + (row + 0.5) * float(spot.step))
    for lane in range(LANES):
        along = np.float32(lane) * spot.step
        alpha, t = response_at(opacity, line, start + along, (x + along, y), own)
        lay(canvas, base + np.uint64(lane), alpha, t, light)


@inner_step
def _share_at(x: Single, wide: Single) -> Single:
    """Share of a box in a sub-pixel, x sub-pixels from its center; shares sum to 1."""
    half, own = np.float32(0.5) * wide, np.float32(0.5)
    return (min(max(x + half, -own), own) - min(max(x - half, -own), own)) / wide


@inner_step
def _lay_small(
    canvas: Floats,
    is_open: Open,
    record: Floats,
    spot: TilePlace,
    rows: tuple[int, int],
    opacity: Opacity,
) -> None:
    """Composite the box of an ellipsoid smaller than a sub-pixel on the sub-pixels it meets."""
    t, light = record[T_1], (record[RED], record[GREEN], record[BLUE])
    nearest, farthest = depths_kept(opacity, record[X], record[Y], spot.near)
    if not nearest < t < farthest:
        return
    first, last = subpixels_of(record, 0, spot.left, spot.step)
    per = 1.0 / float(spot.step)
    # From the center to the tile's first sub-pixel.
    left = np.float32((spot.left - float(record[X])) * per + 0.5)
    top = np.float32((spot.top - float(record[Y])) * per + 0.5)
    for row in range(rows[0], rows[1]):
        bits = is_open[row]
        taken = record[PEAK] * _share_at(top + np.float32(row), record[HIGH])
        for column in range(first, last):
            if bits >> np.uint32(column // LANES) & np.uint32(1) != np.uint32(0):
                alpha = taken * _share_at(left + np.float32(column), record[WIDE])
                k = np.uint64(row * SIDE + column)
                lay(canvas, k, min(np.float32(1), alpha), t, light)


@inner_step
def _visit(
    canvas: Floats, is_open: Open, records: Floats, number: int, spot: TilePlace, opacity: Opacity
) -> None:
    """Composite a record on the sub-pixels of a tile that it may cover."""
    record = records[number]
    top, bottom = subpixels_of(record, 1, spot.top, spot.step)
    if record[LIMIT] == SMALL:
        _lay_small(canvas, is_open, record, spot, (top, bottom), opacity)
        return
    columns = subpixels_of(record, 0, spot.left, spot.step)
    for row in range(top, bottom):
        bits = is_open[row]
        if bits == np.uint32(0):
            continue
        line = line_of(record, spot, row)
        first, last = groups_of(record, line, spot, columns)
        for group in range(first, last):
            if bits >> np.uint32(group) & np.uint32(1) != np.uint32(0):
                _composite(canvas, line, record, (row, group), spot, opacity)


@inner_step
def tile_at(grid: TileGrid, tile: int, near: float) -> tuple[tuple[int, int], TilePlace]:
    """Row and column of a tile's first pixel in its picture, and its place on the screen."""
    top, left = tile // grid.columns * grid.side, tile % grid.columns * grid.side
    step, nearest = np.float32(1.0 / grid.fine), np.float32(near)
    return (top, left), TilePlace(grid.left + left, grid.top + top, step, nearest)


@inner_kernel
def _paint_members(
    canvas: Floats,
    is_open: Open,
    records: Floats,
    lists: TileLists,
    tile: int,
    spot: TilePlace,
    opacity: Opacity,
) -> None:
    """Composite the members of a tile behind its canvas's content."""
    flat = records.reshape(-1)
    end = lists.start[tile + 1]
    for k in range(lists.start[tile], end):
        if k + 4 < end:
            load_soon(flat, lists.member[k + 4] * WIDTH)
        _visit(canvas, is_open, records, lists.member[k], spot, opacity)
        if k % OFTEN == OFTEN - 1 and not close_groups(canvas, is_open):
            break


@parallel_kernel
def paint_shapes(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    grid: TileGrid,
    near: float,
    opacity: Opacity,
    picture: PaintedShapes,
) -> None:
    """Paint all tiles.

    `lists`: members of tiles, nearest first. `near`: scene units. `picture`: filled.
    """
    canvas, is_open = np.empty(SIZE, np.float32), np.empty(SIDE, np.uint32)
    for tile in tasks(counter, lists.start.size - 1):
        origin, spot = tile_at(grid, tile, near)
        clear(canvas, is_open)
        _paint_members(canvas, is_open, records, lists, tile, spot, opacity)
        write_tile(canvas, origin, grid.fine, picture)


@parallel_kernel
def paint_behind(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    grid: TileGrid,
    near: float,
    opacity: Opacity,
    canvas: Floats,
    is_open: NDArray[np.uint32],
) -> None:
    """Paint all tiles behind what their canvases (T, SIZE) hold; `is_open` (T, SIDE)."""
    for tile in tasks(counter, lists.start.size - 1):
        if lists.start[tile] < lists.start[tile + 1]:
            _, spot = tile_at(grid, tile, near)
            _paint_members(canvas[tile], is_open[tile], records, lists, tile, spot, opacity)
            close_groups(canvas[tile], is_open[tile])


@parallel_kernel
def clear_tiles(counter: Counter, canvas: Floats, is_open: NDArray[np.uint32]) -> None:
    """Empty canvases."""
    for tile in tasks(counter, len(canvas)):
        clear(canvas[tile], is_open[tile])


@parallel_kernel
def write_tiles(counter: Counter, canvas: Floats, grid: TileGrid, picture: PaintedShapes) -> None:
    """Average all tiles' sub-pixels to pixels."""
    for tile in tasks(counter, len(canvas)):
        origin, _ = tile_at(grid, tile, 0.0)
        write_tile(canvas[tile], origin, grid.fine, picture)
