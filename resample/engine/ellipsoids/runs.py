"""Runs of neighbouring samples: the tiles that may show them, their order, their culling."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.outlines import BOTTOM, LEFT, RIGHT, SPACING, TOP, Bounds
from resample.engine.ellipsoids.rows import Groups, Members, is_open
from resample.engine.ellipsoids.splats import first_inside, last_inside
from resample.engine.jit import kernel
from resample.engine.sorting import bits_of, member_of, paired, sort_pairs
from resample.engine.subpixels import Home, grid
from resample.engine.tiles import overlapping_tiles
from resample.types import Floats, Place, Record, Records, Screen, Style, Tiles

Indices = NDArray[np.int64]


@kernel
def _tiles_of(run: Record, margin: float, size: int, rows: int, columns: int) -> Iterator[int]:
    """Yield the tiles of `size` px that may show a run."""
    # Runs without a visible sample are on no tile.
    if run["seen"] > 0:
        left, right = overlapping_tiles(run["left"], run["right"], margin, size, columns)
        top, bottom = overlapping_tiles(run["top"], run["bottom"], margin, size, rows)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                yield row * columns + column


@kernel
def count_runs(runs: Records, screen: Screen, size: int, columns: int, count: Indices) -> None:
    """Count the runs that each tile of `size` px may show, added to `count` (T,)."""
    rows = count.size // columns
    for n in range(runs.size):
        for tile in _tiles_of(runs[n], screen.margin, size, rows, columns):
            count[tile] += 1


@kernel
def deal_runs(runs: Records, screen: Screen, tiles: Tiles, load: Indices) -> None:
    """Write each tile's runs, and add the number of their samples to `load` (T,)."""
    # Each tile's position moves on as its runs are written.
    size, columns, member = tiles.size, tiles.columns, tiles.member
    rows, position = load.size // columns, tiles.start[:-1].copy()
    for n in range(runs.size):
        for tile in _tiles_of(runs[n], screen.margin, size, rows, columns):
            member[position[tile]] = n
            position[tile] += 1
            load[tile] += runs[n]["seen"]


@kernel
def may_be_finer(run: Record, finest: float, style: Style) -> bool:
    """Whether a run may need a finer grid than samples of spacing `finest`."""
    return bool(not finest < np.inf or grid(run["least_spacing"], style) > grid(finest, style))


@kernel
def finest_of(room: Floats, count: int, tile: int, tiles: Tiles, margin: float) -> float:
    """Least spacing among samples of a batch of `outlines` that meet a tile."""
    size, columns, finest = tiles.size, tiles.columns, np.inf
    tile_rows = tiles.spacing.size // columns
    for n in range(count):
        k = np.uint64(n)
        # Test the tile against the tiles that each visible sample meets.
        if room[k + LEFT] <= room[k + RIGHT]:
            left, right = overlapping_tiles(room[k + LEFT], room[k + RIGHT], margin, size, columns)
            top, bottom = overlapping_tiles(
                room[k + TOP], room[k + BOTTOM], margin, size, tile_rows
            )
            if left <= tile % columns <= right and top <= tile // columns <= bottom:
                finest = min(finest, float(room[k + SPACING]))
    return finest


@kernel
def is_run_open(run: Record, place: Place, height: int, width: int, open_groups: Groups) -> bool:
    """Whether a run overlaps an open group on a canvas of `height` rows and `width` columns."""
    # Convert its bounds to sub-pixels.
    n = place.subpixels
    left = first_inside(run["left"], place.x, n)
    right = last_inside(run["right"], place.x, n, width)
    top = first_inside(run["top"], place.y, n)
    bottom = last_inside(run["bottom"], place.y, n, height)
    return left < right and top < bottom and is_open(open_groups, top, bottom, left, right)


@kernel
def home_of(home: Home) -> Bounds:
    """Bounds of the centers that a tile counts as its own; open at the frame's edges."""
    # Tiles at the frame's edge also own the centers beyond it.
    far = np.float32(np.inf)
    right, bottom = home.left + home.size, home.top + home.size
    return (
        np.float32(home.left) if home.left > 0 else -far,
        np.float32(right) if right < home.width else far,
        np.float32(home.top) if home.top > 0 else -far,
        np.float32(bottom) if bottom < home.height else far,
    )


@kernel
def in_order(runs: Records, members: Members) -> None:
    """Sort runs by their nearest keys."""
    # Sort packed pairs of key and run, and unpack the runs.
    pair, other = np.empty(members.size, np.uint64), np.empty(members.size, np.uint64)
    for n in range(members.size):
        pair[n] = paired(bits_of(runs[members[n]]["key"]), members[n])
    sort_pairs(pair, other)
    for n in range(members.size):
        members[n] = member_of(pair[n])
