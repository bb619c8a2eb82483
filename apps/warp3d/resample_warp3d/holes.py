"""What is missing in a warped picture: narrow gaps closed, and the rest explained."""

import numpy as np
from numpy.typing import NDArray

from resample_warp3d.equation import inverse
from resample_warp3d.types import Equation, Hole, Rendered, Source


def bridged(rendered: Rendered) -> Rendered:
    """Picture with gaps of up to two pixels closed from their sides, the farther one first.

    Between samples that a view pulls apart gaps open which no surface ends at; and where a sample
    covers many pixels, the end of its surface is known to a part of that only.
    """
    from resample_warp3d.kernels.bridging import bridge_rows

    image, coverage, nearness, magnification, _ = rendered
    new = Rendered(
        np.empty_like(image), np.empty_like(coverage), np.empty_like(nearness),
        np.empty_like(magnification), np.empty(coverage.shape, np.bool_),
    )  # fmt: skip
    bridge_rows(
        image, coverage, nearness, magnification,
        new.image, new.coverage, new.nearness, new.magnification, new.bridged,
    )  # fmt: skip
    return new


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
