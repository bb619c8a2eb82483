"""Close narrow gaps of a warped picture, and classify its holes."""

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.equation import inverse
from resample_warp3d.types import Equation, Hole, Rendered, Source


def bridged(rendered: Rendered) -> Rendered:
    """Close gaps of up to two pixels from their sides, the farther one first.

    Gaps at which no surface ends open between samples that a view pulls apart; and where a sample
    covers many pixels, the end of its surface is only known to a part of a sample. The input is
    overwritten.
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
    """Classify each pixel, (H, W) values of `Hole`.

    A hole is assumed to be as far as the farther of its neighbours in its row; an empty row as far
    as the farthest point of the nearest row that is not empty.
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
    """Return the trust of the pixels' depth (H, W): 1 where it was not refined.

    Refined depth has the share of votes for it; filled depth half of that.
    """
    from resample_warp3d.sheet.kernels.trusting import sample_map

    found = np.ones(rendered.nearness.shape, np.float32)
    if source.trust.size:
        back = inverse(equation)
        sample_map(
            rendered.nearness, back.matrix, back.epipole, source.place, source.trust, found
        )  # fmt: skip
    return found


def farthest_of_rows(rendered: Rendered) -> Floats:
    """Return the nearness (H,) of each row's farthest point, or the nearest row's; 0: none."""
    nearness = np.where(rendered.coverage > 0, rendered.nearness, np.inf).min(axis=1)
    full = np.flatnonzero(np.isfinite(nearness))
    if not full.size:
        return np.zeros(nearness.shape, np.float32)
    rows = np.arange(nearness.size)
    after = np.clip(np.searchsorted(full, rows), 0, full.size - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(full[before] - rows) < np.abs(full[after] - rows)
    return np.asarray(nearness[np.where(is_before, full[before], full[after])], np.float32)
