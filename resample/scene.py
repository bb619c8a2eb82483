"""What is painted: samples checked, seen by a camera, and dealt to the tiles of the screen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resample.types import (
    Doubles,
    Ellipsoid,
    Floats,
    Records,
    Samples,
    Screen,
    Sheets,
    Style,
    Tables,
    Tiles,
    View,
)

MEMBERS_PER_STEP = 2_000_000  # between two looks at the progress and at Ctrl-C

Progress = Callable[[float], None]


def check_samples(samples: Samples) -> Samples:
    """Samples as contiguous float32 arrays that fit together.

    Raises
    ------
    ValueError
        Shapes do not fit, a value is not finite, an extinction is negative, or the lattice is
        singular.
    """
    position = np.ascontiguousarray(samples.position, np.float32)
    color = np.ascontiguousarray(samples.color, np.float32)
    extinction = np.ascontiguousarray(samples.extinction, np.float32)
    lattice = np.ascontiguousarray(samples.lattice, np.float64)
    count = extinction.size
    if extinction.ndim != 1 or position.shape != (count, 3) or color.shape != (count, 3):
        raise ValueError(
            f"positions {position.shape}, colors {color.shape} and extinctions {extinction.shape} "
            "do not fit; they have shapes (N, 3), (N, 3) and (N,)"
        )
    if lattice.shape != (3, 3) or not _is_regular(lattice):
        raise ValueError("the lattice must be a finite, regular matrix (3, 3)")
    for name, array in (("position", position), ("color", color), ("extinction", extinction)):
        if not np.isfinite(array).all():
            raise ValueError(f"a sample's {name} is not finite; leave such samples out")
    if count and extinction.min() < 0:
        raise ValueError(f"an extinction is {extinction.min()}; it must be 0 or more")
    return Samples(position, color, extinction, lattice)


def _is_regular(matrix: Doubles) -> bool:
    """Whether a matrix can be inverted in float64 without losing all digits."""
    return bool(np.isfinite(matrix).all() and np.linalg.cond(matrix) < 1e12)


def ellipsoid_of(lattice: Doubles, view: View, radius: float) -> Ellipsoid:
    """Reconstruction ellipsoid of a lattice (3, 3) in a camera's axes; `radius` in voxels."""
    from_unit = view.rotation @ lattice * radius
    to_unit = np.linalg.inv(from_unit).astype(np.float64)
    return Ellipsoid(
        to_unit,
        to_unit[:, :2] / view.focal,
        np.ascontiguousarray(from_unit),
        from_unit @ from_unit.T,
        float(abs(np.linalg.det(lattice))),
        1 / radius**3,
        float(radius),
    )


def screen_of(width: int, height: int, margin: float, view: View, ellipsoid: Ellipsoid) -> Screen:
    """Picture of that size, with the planes beyond which an ellipsoid's center cannot be seen."""
    sides = np.zeros((4, 4))
    for side, (axis, edge) in enumerate(
        [(0, -margin), (0, width + margin), (1, -margin), (1, height + margin)]
    ):
        sign = -1.0 if side % 2 == 0 else 1.0
        offset = sign * (edge - view.principal[axis]) / view.focal[axis]
        sides[side, axis] = sign
        sides[side, 2 if view.perspective else 3] = -offset
        outward = sides[side, :3]
        sides[side, 3] -= np.sqrt(outward @ ellipsoid.covariance @ outward)
    return Screen(width, height, float(margin), sides)


def tile_size(footprints: Records, style: Style) -> int:
    """Side of a tile in px, smaller where pixels are divided finer."""
    from resample.kernels.grid import grid
    from resample.kernels.tiles import smallest_spacing

    return max(8, 32 // grid(smallest_spacing(footprints), style))


def dealt_to_tiles(footprints: Records, screen: Screen, size: int) -> Tiles:
    """Members of every tile of `size` px."""
    from resample.kernels.tiles import CHUNKS, count_members, deal_members

    columns, rows = -(-screen.width // size), -(-screen.height // size)
    count = np.zeros((CHUNKS, rows * columns), np.int64)
    count_members(footprints, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count.sum(axis=0))])
    position = start[:-1] + np.cumsum(count, axis=0) - count
    smallest = np.full(count.shape, np.inf, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), smallest[0], size, columns)
    deal_members(footprints, screen, tiles, position, smallest)
    return tiles._replace(spacing=smallest.min(axis=0))


@dataclass(frozen=True)
class Scene:
    """Samples seen by a camera, and everything else that the painters read."""

    footprints: Records
    view: View
    ellipsoid: Ellipsoid
    screen: Screen
    style: Style
    tables: Tables

    def paint(
        self, sheets: Sheets, tiles: Tiles, progress: Progress | None
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Frame (H, W, 7) and the tally of every tile, painted in steps that can be watched."""
        from resample.kernels.paint import paint_tiles

        frame = np.zeros((self.screen.height, self.screen.width, 7), np.float32)
        frame[..., 4:6] = np.inf
        load = np.diff(tiles.start)
        tally = np.zeros((load.size, 4), np.int64)
        turn = np.argsort(-load, kind="stable")
        turn = turn[load[turn] > 0]
        done = np.cumsum(load[turn])
        total = done[-1] if done.size else 0
        first = 0
        while first < turn.size:
            before = done[first - 1] if first else 0
            last = max(first + 1, int(np.searchsorted(done, before + MEMBERS_PER_STEP)))
            paint_tiles(
                turn[first:last],
                tiles,
                self.footprints,
                sheets,
                sheets.key.view(np.uint32),
                self.view,
                self.ellipsoid,
                self.screen,
                self.style,
                self.tables,
                frame,
                tally,
            )
            first = last
            if progress is not None:
                progress(done[last - 1] / total)
        return frame, tally
