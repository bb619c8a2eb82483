"""Paint samples by sheets or slabs, on the paper's core (`resample.hybrid`)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resample.hybrid.paint import Counts, paint
from resample.hybrid.record import POINT
from resample.painting.paper import PaperPainter, PlacedVoxels, empty_film
from resample.painting.scenes import PreparedScene
from resample.profiles.orders import Summing
from resample.profiles.reconstruction import Reconstruction
from resample.types import Doubles, Film, Samples, View
from resample_comparisons.volume.kernels.sheets import SUM, SheetBlend

STEPS = 1024  # of a kernel's mass up to a plane


@dataclass(frozen=True)
class SheetPainter(PaperPainter):
    """Sums samples by sheets, or the parts of samples by slabs, before it composites the sums."""

    def placed(
        self, scene: PreparedScene, samples: Samples, view: View, size: tuple[int, int]
    ) -> PlacedVoxels:
        """Samples, or parts of them, in the order of their sheets."""
        placed = super().placed(scene, samples, view, size)
        if scene.summing is not Summing.SLABS:
            return placed
        member, slab, share = _divided(scene, placed, self.reconstruction)
        turn = np.argsort(slab, kind="stable")
        records, weight = placed.records[member[turn]], share[turn].astype(np.float32)
        records["layer"] = slab[turn]
        records["weight"] *= weight
        member = member[turn]
        density, color = placed.density[member], placed.color[member]
        return PlacedVoxels(records, density, color, placed.order[member])

    def blended(
        self, scene: PreparedScene, placed: PlacedVoxels, size: tuple[int, int]
    ) -> tuple[Film, Counts]:
        """Picture of a size of placed samples, sheet by sheet."""
        del scene
        film, is_point = empty_film(size), placed.records["kind"] == POINT
        depth = -np.log1p(-np.minimum(placed.density, np.float32(1 - 2**-24)))
        density = np.where(is_point, depth, placed.density)
        blend = SheetBlend(placed.color, density, film, np.zeros(size, SUM))
        return film, paint(placed.records, self.tables, blend, size, None)


def _divided(
    scene: PreparedScene, placed: PlacedVoxels, reconstruction: Reconstruction
) -> tuple[NDArray[np.int64], NDArray[np.int32], Doubles]:
    """Which slabs each sample meets: samples (M,), slabs (M,), and the shares of their kernels."""
    reach = float(np.sqrt(scene.ellipsoid.covariance[2, 2]))
    thickness, depth = scene.layers.thickness, placed.records["depth"].astype(np.float64)
    first = np.floor((depth - reach) / thickness)
    parts, place, below = [], np.linspace(-1, 1, STEPS + 1), _mass_below(reconstruction)
    for step in range(int(np.ceil(2 * reach / thickness)) + 1):
        near = ((first + step) * thickness - depth) / reach
        ends = near, near + thickness / reach
        share = np.interp(ends[1], place, below) - np.interp(ends[0], place, below)
        member = np.flatnonzero((share > 0) & (placed.records["kind"] != 0))
        parts.append((member, (first[member] + step).astype(np.int32), share[member]))
    member, slab, share = (np.concatenate(each) for each in zip(*parts, strict=True))
    return member, slab, share


def _mass_below(reconstruction: Reconstruction) -> Doubles:
    """Share (STEPS + 1,) of a kernel's mass on one side of a plane, -1..1 radii from its center."""
    place, radius = np.linspace(-1, 1, STEPS + 1), reconstruction.radius
    node, weight = np.polynomial.legendre.leggauss(64)
    # In the plane at z: the integral of the kernel over the disc, by its squared radius.
    half = (1 - place**2) / 2
    squared = half[:, None] * (node + 1)
    density = reconstruction(radius * np.sqrt(squared + place[:, None] ** 2))
    plane = (density * weight).sum(axis=1) * half
    below = np.concatenate([[0.0], np.cumsum(0.5 * (plane[1:] + plane[:-1]))])
    return np.asarray(below / below[-1], np.float64)
