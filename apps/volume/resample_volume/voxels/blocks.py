"""Small blocks of a volume: their number of visible voxels and their bounds on screen."""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.scenes.plans import Window
from resample.types import Doubles, Floats, View
from resample_volume.data.bricks import BrickRequest, Step
from resample_volume.types import Volume
from resample_volume.voxels.visible import lattice_of

SIDE = 8  # voxels, at least
MOST = 1 << 18  # blocks at most; otherwise their side is doubled

Indices = NDArray[np.int64]


class Lattice(NamedTuple):
    """Partition of a volume into blocks."""

    size: Step  # voxels along z, y and x
    side: int  # voxels of a block along each axis

    @property
    def blocks(self) -> Step:
        """Blocks along z, y and x."""
        z, y, x = (-(-size // self.side) for size in self.size)
        return z, y, x

    def counted(self, place: Indices) -> tuple[Indices, Indices]:
        """Return the blocks that contain voxels, by flat index, and their counts."""
        if not place.size:
            return place, place
        at = np.unravel_index(place, self.size)
        z, y, x = (_in_steps(n, self.side) for n in at)
        number = np.ravel_multi_index((z, y, x), self.blocks)
        first = int(number.min())
        count = np.bincount(number - first)
        found = np.flatnonzero(count)
        return found + first, count[found]

    def request(self, number: Indices) -> BrickRequest:
        """Return a request for some of the blocks, as bricks take it."""
        is_requested = np.zeros(self.blocks, bool)
        is_requested.reshape(-1)[number] = True
        return BrickRequest(self.side, is_requested)


def _in_steps(index: Indices, side: int) -> Indices:
    """Divide indices (N,) by a side, fast for powers of two."""
    bits = side.bit_length() - 1
    return index >> bits if side == 1 << bits else index // side


class Blocks(NamedTuple):
    """The blocks of a volume with visible voxels."""

    lattice: Lattice
    number: Indices  # (N,) flat indices, z slowest
    visible: Indices  # (N,) visible voxels
    bounds: Floats  # (N, 4) left, top, right and bottom of their footprints, px

    def within(self, window: Window, margin: float) -> NDArray[np.bool_]:
        """Return which blocks (N,) may be visible in a window with a margin, px."""
        left, top, right, bottom = self.bounds.T
        x0, y0, x1, y1 = window
        is_across = (right >= x0 - margin) & (left <= x1 + margin)
        return np.asarray(is_across & (bottom >= y0 - margin) & (top <= y1 + margin))

    def bare(self) -> "Blocks":
        """Return a copy without per-block data that windows do not need."""
        return Blocks(self.lattice, self.number[:0], self.visible[:0], self.bounds[:0])


def lattice_for(size: Step) -> Lattice:
    """Partition a volume (Z, Y, X) into a limited number of blocks."""
    lattice = Lattice(size, SIDE)
    while np.prod(lattice.blocks, dtype=float) > MOST:
        lattice = Lattice(size, 2 * lattice.side)
    return lattice


def ends_of(lattice: Lattice, index: Indices) -> tuple[Doubles, Doubles]:
    """Return the first and last voxels (N, 3) of blocks (N,), along x, y and z."""
    at = np.stack(np.unravel_index(index, lattice.blocks)[::-1], axis=1)
    low = (at * lattice.side).astype(np.float64)
    return low, np.minimum(low + lattice.side, lattice.size[::-1]) - 1


def bounds_of(volume: Volume, lattice: Lattice, index: Indices, reach: float, view: View) -> Floats:
    """Return the bounds of blocks on the screen.

    Parameters
    ----------
    lattice, index
        The blocks, (N,) flat.
    reach
        Radius of the kernels, voxels.

    Returns
    -------
    Left, top, right and bottom (N, 4), px, of the boxes around the ellipsoids of all their voxels;
    a box is convex, so the projections of its corners bound it. Infinite where a box reaches the
    near plane.
    """
    low, high = ends_of(lattice, index)
    low, high = low - reach, high + reach
    steps = view.rotation @ lattice_of(volume)
    start = view.rotation @ volume.origin + view.translation
    least, most = np.full((2, index.size, 2), np.inf) * [[[1.0]], [[-1.0]]]
    is_near = np.zeros(index.size, bool)
    for is_high in product((False, True), repeat=3):
        place = np.where(is_high, high, low) @ steps.T + start
        is_near |= place[:, 2] <= view.near
        on_screen = _projected(place, view)
        least, most = np.minimum(least, on_screen), np.maximum(most, on_screen)
    if view.perspective:
        least[is_near], most[is_near] = -np.inf, np.inf
    return np.column_stack([least, most]).astype(np.float32)


def widened(bounds: Floats, is_mirrored: bool, reach: float) -> Floats:
    """Widen bounds (N, 4), px, to what footprints paint beyond them.

    By a margin in px, and by their own width if footprints are symmetric about their center.
    """
    low, high = bounds[:, :2], bounds[:, 2:]
    aside = reach + (high - low if is_mirrored else 0)
    return np.column_stack([low - aside, high + aside]).astype(np.float32)


def _projected(place: Doubles, view: View) -> Doubles:
    """Project points (N, 3) in camera axes to (N, 2) px; undefined behind the camera."""
    if not view.perspective:
        return np.asarray(place[:, :2] * view.focal + view.principal)
    depth = np.where(place[:, 2] > 0, place[:, 2], 1.0)[:, np.newaxis]
    return np.asarray(place[:, :2] / depth * view.focal + view.principal)
