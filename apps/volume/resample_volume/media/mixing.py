"""Mix overlapping volumes: extinctions add up, and colors are weighted by them.

Over a short distance, absorption is the sum over all media, and so is emission (Max, Optical Models
for Direct Volume Rendering, 1995).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from resample.types import Doubles, Floats, Indices, Samples
from resample_volume.data.memory import require_memory
from resample_volume.media.lattices import CommonLattice
from resample_volume.voxels.shading import Light
from resample_volume.voxels.transmittance import voxel_transmittance
from resample_volume.voxels.visible import BYTES_PER_VOXEL, Voxels, positions_at

BYTES_PER_BRICK = 8  # of 8 voxels per side, whether any is seen or not
BRICK = 8**3


class MixedMedia(NamedTuple):
    """The N voxels of a lattice at which any of several media is visible."""

    position: Floats  # (N, 3) scene units
    extinction: Floats  # (N,) optical depth per scene unit, of all media
    lattice: Doubles  # (3, 3) columns are the steps to the neighbours, scene units
    parts: tuple[Voxels, ...]  # of each medium
    place: tuple[Indices, ...]  # of each one's voxels among the N

    @property
    def color(self) -> Floats:
        """Black (N, 3): emission is known only for shaded parts, see `added`."""
        return np.zeros_like(self.position)


def mixed(parts: Sequence[Voxels], lattice: CommonLattice) -> MixedMedia:
    """Mix the voxels of several media on one lattice."""
    from resample_volume.data.kernels.gradients import brick_order

    x, y, z = map(int, lattice.size)
    count = sum(len(part.position) for part in parts)
    size = BYTES_PER_VOXEL * count + BYTES_PER_BRICK * int(np.prod(lattice.size // 8 + 1))
    require_memory(size, f"the scene with {count} visible voxels")
    flat = [_flat(part, lattice) for part in parts]
    every = np.unique(np.concatenate(flat))
    order = np.empty(every.size, np.int64)
    brick_order(every, (z, y, x), order)
    return _mixed(list(zip(flat, parts, strict=True)), lattice, every, order)


def mixed_at(
    parts: Sequence[tuple[Indices, Voxels]], lattice: CommonLattice
) -> tuple[Indices, MixedMedia]:
    """Return ascending flat indices (N,) into a lattice, and a part of the voxels of `mixed`."""
    every = np.unique(np.concatenate([flat for flat, _ in parts]))
    return every, _mixed(parts, lattice, every, np.arange(every.size))


def _mixed(
    parts: Sequence[tuple[Indices, Voxels]], lattice: CommonLattice, every: Indices, order: Indices
) -> MixedMedia:
    """Mix voxels of several media by flat indices; `every` has each index once."""
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    place = tuple(rank[np.searchsorted(every, index)] for index, _ in parts)
    extinction = np.zeros(every.size)
    for (_, part), index in zip(parts, place, strict=True):
        extinction[index] += part.extinction
    position = positions_at(lattice.volume(), every[order])
    voxels = tuple(part for _, part in parts)
    return MixedMedia(position, extinction.astype(np.float32), lattice.steps, voxels, place)


def with_light(media: MixedMedia, light: Light) -> MixedMedia:
    """Return the media with the light that reaches them, shadowed by all of them."""
    nothing = np.empty((0, 3), np.float32)
    whole = Voxels(media.position, nothing, media.extinction, nothing, media.lattice)
    share = voxel_transmittance(whole, light)
    each = zip(media.parts, media.place, strict=True)
    return media._replace(parts=tuple(part._replace(reached=share[at]) for part, at in each))


def added(media: MixedMedia, colors: Sequence[Floats]) -> Samples:
    """Return samples with the light of all media.

    `media`: mixed voxels. `colors`: (N, 3) linear light of each medium's voxels.
    """
    total = np.zeros(media.position.shape)
    for part, place, color in zip(media.parts, media.place, colors, strict=True):
        total[place] += part.extinction[:, np.newaxis].astype(np.float64) * color
    total /= media.extinction[:, np.newaxis]
    return Samples(media.position, total.astype(np.float32), media.extinction, media.lattice)


def _flat(part: Voxels, lattice: CommonLattice) -> Indices:
    """Return flat indices (N,) of voxels into a lattice, z slowest."""
    index = (part.position - lattice.origin) @ np.linalg.inv(lattice.steps).T
    whole = np.rint(index).astype(np.int64)
    x, y, _ = lattice.size
    return np.asarray((whole[:, 2] * y + whole[:, 1]) * x + whole[:, 0])
