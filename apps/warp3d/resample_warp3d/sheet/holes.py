"""What is missing in a warped picture: narrow gaps closed, and the rest explained."""

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.equation import inverse
from resample_warp3d.types import Equation, Hole, Rendered, Source


def bridged(rendered: Rendered) -> Rendered:
    """Picture with gaps of up to two pixels closed from their sides, the farther one first.

    Between samples that a view pulls apart gaps open which no surface ends at; and where a sample
    covers many pixels, the end of its surface is known to a part of that only. What is given is
    written over.
    """
    from resample_warp3d.sheet.kernels.bridging import GROWN, bridge_rows, reach_of_rows

    closed = np.zeros(rendered.coverage.shape, np.bool_)
    coverage = rendered.coverage.copy()
    reach = np.zeros([length + 2 * GROWN for length in coverage.shape], np.uint8)
    reach_of_rows(rendered.coverage, rendered.magnification, reach)
    bridge_rows(
        rendered.image, rendered.coverage, rendered.nearness, rendered.magnification, reach,
        coverage, closed,
    )  # fmt: skip
    return rendered._replace(coverage=coverage, bridged=closed)


def explained(rendered: Rendered, source: Source, equation: Equation) -> NDArray[np.uint8]:
    """Why each pixel is what it is, (H, W) values of `Hole`.

    A hole is taken to be as far as what lies beside it in its row, on the farther side; an empty
    row as far as the farthest of the next row that is not.
    """
    from resample_warp3d.sheet.kernels.bridging import explain_holes

    back = inverse(equation)
    holes = np.empty(rendered.coverage.shape, np.uint8)
    explain_holes(
        rendered.coverage, rendered.nearness, back.matrix, back.epipole, source.place,
        source.nearness > 0, farthest_of_rows(rendered), holes,
    )  # fmt: skip
    holes[rendered.bridged] = Hole.CRACK
    return holes


def trusted(rendered: Rendered, source: Source, equation: Equation) -> Floats:
    """How sure the depth is that pixels (H, W) are made of: 1 where it is as it was given.

    Depth that was refined is as sure as the share of votes for it; half as sure, made up.
    """
    from resample_warp3d.sheet.kernels.trusting import look_up

    found = np.ones(rendered.nearness.shape, np.float32)
    if source.trust.size:
        back = inverse(equation)
        look_up(
            rendered.nearness, back.matrix, back.epipole, source.place, source.trust, found
        )  # fmt: skip
    return found


def farthest_of_rows(rendered: Rendered) -> Floats:
    """Nearness (H,) of the farthest thing in each row, or in the next row that has any; 0: none."""
    nearness = np.where(rendered.coverage > 0, rendered.nearness, np.inf).min(axis=1)
    full = np.flatnonzero(np.isfinite(nearness))
    if not full.size:
        return np.zeros(nearness.shape, np.float32)
    rows = np.arange(nearness.size)
    after = np.clip(np.searchsorted(full, rows), 0, full.size - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(full[before] - rows) < np.abs(full[after] - rows)
    return np.asarray(nearness[np.where(is_before, full[before], full[after])], np.float32)
