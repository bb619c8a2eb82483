"""Shadows and ambient occlusion of volumes in bricks, as of `voxel_transmittance`."""

from functools import partial
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import save_array
from resample.memory import amount
from resample.outofcore.bricks import Step
from resample.outofcore.passes import PassContext
from resample.types import Doubles, Flags, Floats
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.outline import OutlineQuery, VisibleOutline
from resample_volume.voxels.blocks import Indices, lattice_for, passed
from resample_volume.voxels.shading import Light
from resample_volume.voxels.transmittance import (
    BYTES_PER_CELL,
    LightCells,
    cells_around,
    exact_in_sums,
    light_transmittance,
    shares_at,
)

FILE = "light.npy"


class LightGrid(NamedTuple):
    """A grid of light that reaches voxels."""

    share: Flags | Path  # (Z, Y, X, 2) of cells, see `light_transmittance`; or a file of it
    cells: LightCells
    first: Indices  # (3,) least indices of visible voxels along z, y and x
    size: Step  # of the volume, z, y and x

    def at(self, place: Indices) -> Floats:
        """Return fractions of light (N, 2), 0 to 1, at voxels by flat index into the volume."""
        share = self.share
        if isinstance(share, Path):
            share = np.load(share, mmap_mode="r", allow_pickle=False)
        return shares_at(_indices(place, self.size, self.first), share, self.cells)

    @property
    def size_bytes(self) -> int:
        """Bytes of memory, or of pages of the file."""
        return 2 * prod(self.cells.grid)

    def stored_in(self, folder: Path | None) -> "LightGrid":
        """Return a copy in a file of this folder, for other processes; None: itself."""
        if folder is None or isinstance(self.share, Path):
            return self
        save_array(folder / FILE, self.share)
        return self._replace(share=folder / FILE)


def transmittance_grid(
    seen: OutlineQuery,
    outline: VisibleOutline,
    light: Light,
    steps: Doubles,
    memory: int,
    context: PassContext,
) -> LightGrid:
    """Compute the light that reaches visible voxels; `steps` (3, 3) of the lattice as columns."""
    cells = cells_around(outline.last - outline.first + 1)
    size = BYTES_PER_CELL * prod(cells.grid)
    if size > memory:
        raise ValueError(
            f"the grid of light needs {amount(size)}, {amount(memory)} are allowed; give more "
            "memory, or leave shadows and ambient-occlusion out"
        )
    bricks = bricks_of(seen.volume)
    job = partial(_summed, seen, outline, cells)
    parts = passed(bricks, lattice_for(bricks.shape), job, context)
    share = light_transmittance(cells.means(_joined(parts, cells)), cells.per * steps, light)
    return LightGrid(share, cells, outline.first, bricks.shape)


def _summed(
    seen: OutlineQuery, outline: VisibleOutline, cells: LightCells, bricks: Bricks
) -> tuple[int, Doubles]:
    """Return the first non-empty row of cells, and sums of optical depths from there on."""
    total = np.zeros(prod(cells.grid))

    def depths(place: Indices, voxels: Any) -> tuple[NDArray[np.int64], Doubles]:
        index = _indices(place, bricks.shape, outline.first)
        return cells.of(index), exact_in_sums(voxels.extinction, outline.densest, cells)

    for cell, depth in seen.classified(with_bricks(seen.volume, bricks), depths):
        np.add.at(total, cell, depth)
    rows = total.reshape(cells.grid[0], -1)
    full = np.flatnonzero(rows.any(axis=1))
    if not full.size:
        return 0, rows[:0]
    return int(full[0]), rows[full[0] : full[-1] + 1]


def _joined(parts: list[tuple[int, Doubles]], cells: LightCells) -> Doubles:
    """Return sums in all cells from those in some rows, which are consumed."""
    total = np.zeros((cells.grid[0], prod(cells.grid[1:])))
    while parts:
        first, part = parts.pop()
        total[first : first + len(part)] += part
    return total.reshape(-1)


def _indices(place: Indices, size: Step, first: Indices) -> Indices:
    """Convert flat indices to (N, 3) along z, y and x, counted from the first visible voxel."""
    return np.stack(np.unravel_index(place, size), axis=1) - first
