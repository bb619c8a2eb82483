"""Ways to paint samples that exist for comparison: sheets, slabs, and widened splats."""

from dataclasses import dataclass

import numpy as np

from resample.painting.choices import Footprint, PaintChoices, Technique, technique_of
from resample.painting.scenes import SamplePainter
from resample.profiles.orders import Summing, check_thickness, of_depth, thickness_of
from resample.types import Doubles, Layers, View

THINNEST = 0.05  # voxels; thinner slabs change nothing and take proportionally longer
EWA_VARIANCE = 0.25  # px², of the Gaussian that stands for a pixel's filter


def inflate() -> Technique:
    """Splats as wide as if their neighbours were at least a pixel apart, and as heavy as before.

    Swan, Mueller, Möller, Shareef, Crawfis and Yagel, An Anti-Aliasing Technique for Splatting,
    1997.
    """
    return Technique(0.0, (Footprint.EXACT,), inflated=1.0)


def ewa() -> Technique:
    """Splats convolved with the pixel filter.

    Zwicker, Pfister, van Baar and Gross, EWA Volume Splatting, 2001.
    """
    return Technique(0.0, (Footprint.EXACT,), blurred=EWA_VARIANCE)


def _painter(choice: PaintChoices) -> SamplePainter:
    """Who sums samples by sheets or slabs."""
    from resample_comparisons.volume.sheets import SheetPainter

    technique = technique_of(choice.primitive)
    if technique.inflated or technique.blurred or technique.filter_at_pixels is not None:
        raise ValueError(
            f"the primitive {choice.primitive} composites every sample, so it has no order "
            f"{choice.order}; take the order every-sample, or the primitive hybrid"
        )
    return SheetPainter(
        choice.reconstruction,
        choice.point_filter,
        technique.threshold if choice.threshold is None else float(choice.threshold),
        is_projected=True,
        are_wide=True,
        subpixels=technique.subpixels if choice.subpixels is None else int(choice.subpixels),
        pixel_filter=choice.pixel_filter,
    )


@dataclass(frozen=True)
class ImageSheets:
    """Slabs of even depth, among which splats are divided.

    Mueller, Shareef, Huang and Crawfis, High-Quality Splatting on Rectilinear Grids with Efficient
    Culling of Occluded Voxels, 1999. No bleeding and no popping; every splat is painted once per
    slab that it meets, with the share of its kernel that lies there: kernels are taken for
    Gaussians; their parts have one footprint.

    Parameters
    ----------
    thickness
        Thickness of a slab, voxels.
    """

    thickness: float = 1.0

    summing = Summing.SLABS
    painter = staticmethod(_painter)

    def __post_init__(self) -> None:
        check_thickness(self.thickness)
        if self.thickness < THINNEST:
            raise ValueError(f"slabs of {self.thickness} voxels; {THINNEST} is the least")

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        return of_depth(view, thickness_of(lattice, self.thickness))


@dataclass(frozen=True)
class AxisSheets:
    """Sheets of the lattice along the lattice axis nearest to the view axis.

    Westover, Splatting: A Parallel, Feed-Forward Volume Rendering Algorithm, 1991. Colors within a
    sheet do not bleed; pictures pop where the nearest axis changes, at 45 degrees.
    """

    thickness = 1.0
    summing = Summing.SHEETS
    painter = staticmethod(_painter)

    def __call__(self, view: View, lattice: Doubles) -> Layers:
        steps = lattice / np.linalg.norm(lattice, axis=0)
        cosine = view.rotation[2] @ steps
        nearest = int(np.argmax(np.abs(cosine)))
        to_lattice = np.linalg.inv(lattice)[nearest]
        if not view.perspective:
            to_lattice = np.sign(cosine[nearest]) * to_lattice
        eye = float(-view.rotation.T @ view.translation @ to_lattice)
        return Layers(
            (float(to_lattice[0]), float(to_lattice[1]), float(to_lattice[2])),
            0.0,  # a lattice may begin at a fraction of a voxel
            1.0,
            eye if view.perspective else -np.inf,
            begins_at_first=True,
        )
