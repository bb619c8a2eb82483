"""Ways to paint samples that exist for comparison: an order of sheets, and widened splats."""

from dataclasses import dataclass

import numpy as np

from resample.painting.choices import Footprint, Technique
from resample.profiles.orders import Summing
from resample.types import Doubles, Layers, View

EWA_VARIANCE = 0.25  # px², of the Gaussian that stands for a pixel's filter


def inflate() -> Technique:
    """Splats as wide as if their neighbours were at least a pixel apart.

    Swan, Mueller, Möller, Shareef, Crawfis and Yagel, An Anti-Aliasing Technique for Splatting,
    1997.
    """
    return Technique(0.0, (Footprint.AFFINE,), Footprint.AFFINE, inflated=1.0)


def ewa() -> Technique:
    """Splats convolved with the pixel filter.

    Zwicker, Pfister, van Baar and Gross, EWA Volume Splatting, 2001.
    """
    return Technique(0.0, (Footprint.AFFINE,), Footprint.AFFINE, blurred=EWA_VARIANCE)


@dataclass(frozen=True)
class AxisSheets:
    """Sheets of the lattice along the lattice axis nearest to the view axis.

    Westover, Splatting: A Parallel, Feed-Forward Volume Rendering Algorithm, 1991. Colors within a
    sheet do not bleed; pictures pop where the nearest axis changes, at 45 degrees.
    """

    thickness = 1.0
    summing = Summing.SHEETS

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
