"""Light that gets to voxels of volumes in bricks past all others, as `voxels_reached` finds it."""

from functools import partial
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.files.writing import save_array
from resample.memory import amount
from resample.types import Doubles, Flags, Floats
from resample_volume.data.bricks import Bricks, Step
from resample_volume.outofcore.looked import Outline, ToSee
from resample_volume.outofcore.passes import Looking, passed
from resample_volume.voxels.blocks import Indices, lattice_for
from resample_volume.voxels.reaching import (
    BYTES_PER_CELL,
    LightCells,
    cells_around,
    exact_in_sums,
    reached,
    shares_at,
)
from resample_volume.voxels.shading import Light

FILE = "light.npy"


class Reaching(NamedTuple):
    """Light that gets to voxels."""

    share: Flags | Path  # (Z, Y, X, 2) of cells, see `reached`; or a file of it
    cells: LightCells
    first: Indices  # (3,) least indices of visible voxels along z, y and x
    size: Step  # of the volume, z, y and x

    def at(self, place: Indices) -> Floats:
        """Shares (N, 2), 0 to 1, for voxels by their flat indices into the volume."""
        share = self.share
        if isinstance(share, Path):
            share = np.load(share, mmap_mode="r", allow_pickle=False)
        return shares_at(_indices(place, self.size, self.first), share, self.cells)

    @property
    def bytes_held(self) -> int:
        """Of memory, or of pages of the file."""
        return 2 * prod(self.cells.grid)

    def kept_in(self, folder: Path | None) -> "Reaching":
        """The same in a file of a folder, from which other processes read it; None: as it is.

        Raises
        ------
        OSError
            It cannot be written.
        """
        if folder is None or isinstance(self.share, Path):
            return self
        save_array(folder / FILE, self.share)
        return self._replace(share=folder / FILE)


def light_reached(
    seen: ToSee, outline: Outline, light: Light, steps: Doubles, memory: int, looking: Looking
) -> Reaching:
    """Light that gets to visible voxels.

    Parameters
    ----------
    seen, outline
        What is seen, and where.
    light
        What shines.
    steps
        (3, 3) columns are the steps of the lattice, scene units.
    memory
        Bytes that the grid of light may take.
    looking
        Who looks at all voxels again.

    Raises
    ------
    ValueError
        The grid takes more.
    """
    cells = cells_around(outline.last - outline.first + 1)
    size = BYTES_PER_CELL * prod(cells.grid)
    if size > memory:
        raise ValueError(
            f"light that gets to voxels needs {amount(size)}, {amount(memory)} are allowed; give "
            "more memory, or leave shadows and ambient-occlusion out"
        )
    bricks: Any = seen.volume.values
    job = partial(_summed, seen, outline, cells)
    parts = passed(bricks, lattice_for(bricks.shape), job, looking)
    share = reached(cells.means(_joined(parts, cells)), cells.per * steps, light)
    return Reaching(share, cells, outline.first, bricks.shape)


def _summed(
    seen: ToSee, outline: Outline, cells: LightCells, bricks: Bricks
) -> tuple[int, Doubles]:
    """First row of cells in which something is, and sums of optical depths from there on."""
    values: Any = bricks
    total = np.zeros(prod(cells.grid))

    def depths(place: Indices, voxels: Any) -> tuple[NDArray[np.int64], Doubles]:
        index = _indices(place, bricks.shape, outline.first)
        return cells.of(index), exact_in_sums(voxels.extinction, outline.densest, cells)

    for cell, depth in seen.classified(seen.volume._replace(values=values), depths):
        np.add.at(total, cell, depth)
    rows = total.reshape(cells.grid[0], -1)
    full = np.flatnonzero(rows.any(axis=1))
    if not full.size:
        return 0, rows[:0]
    return int(full[0]), rows[full[0] : full[-1] + 1]


def _joined(parts: list[tuple[int, Doubles]], cells: LightCells) -> Doubles:
    """Sums in all cells from those in some rows, which are used up."""
    total = np.zeros((cells.grid[0], prod(cells.grid[1:])))
    while parts:
        first, part = parts.pop()
        total[first : first + len(part)] += part
    return total.reshape(-1)


def _indices(place: Indices, size: Step, first: Indices) -> Indices:
    """Indices (N, 3) along z, y and x of voxels by their flat ones, from the first visible on."""
    return np.stack(np.unravel_index(place, size), axis=1) - first
