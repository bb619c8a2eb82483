"""What is missing in a warped picture: narrow gaps closed, and the rest explained."""

import numpy as np
from numpy.typing import NDArray

from resample_warp3d.equation import inverse
from resample_warp3d.types import Equation, Hole, Rendered, Source


def bridged(rendered: Rendered) -> Rendered:
    """Picture with gaps of up to two pixels closed from their sides, the farther one first.

    Between samples that a view pulls apart gaps open which no surface ends at; and where a sample
    covers many pixels, the end of its surface is known to a part of that only. What is given is
    written over.
    """
    from resample_warp3d.kernels.bridging import bridge_rows

    closed = np.zeros(rendered.coverage.shape, np.bool_)
    coverage = rendered.coverage.copy()
    bridge_rows(
        rendered.image, rendered.coverage, rendered.nearness, rendered.magnification,
        coverage, closed,
    )  # fmt: skip
    return rendered._replace(coverage=coverage, bridged=closed)


def explained(rendered: Rendered, source: Source, equation: Equation) -> NDArray[np.uint8]:
    """Why each pixel is what it is, (H, W) values of `Hole`.

    A hole is taken to be as far as what lies beside it in its row, on the farther side.
    """
    from resample_warp3d.kernels.bridging import explain_holes

    back = inverse(equation)
    holes = np.empty(rendered.coverage.shape, np.uint8)
    explain_holes(
        rendered.coverage, rendered.nearness, back.matrix, back.epipole, source.place,
        source.nearness > 0, holes,
    )  # fmt: skip
    holes[rendered.bridged] = Hole.CRACK
    return holes
