"""Subsampling until no pixel is missed, as in Popescu's WarpEngine."""

from dataclasses import dataclass

import numpy as np

from resample_comparisons.warp3d.mcmillan import blank
from resample_comparisons.warp3d.meshing import MOST_SAMPLES, bands_of, check_count, orientation_of
from resample_warp3d.types import Equation, Rendered, Source

MOST = 64  # subsamples per side of a quad


@dataclass(frozen=True)
class Subsample:
    """Subsamples between linked samples, written to nearest sub-pixels (Popescu et al. 2000).

    Between 2 × 2 samples that are linked all around, color and homogeneous position are
    interpolated on a grid dense enough to reach every sub-pixel. Where a link is missing, samples
    are written alone. Visibility is by z-buffer; a pixel is the mean of its sub-pixels.

    Parameters
    ----------
    samples
        Sub-pixels per side of a pixel, 1 to 16.
    most
        Most subsamples per side of a quad, 1 to 64; larger quads have holes.

    Raises
    ------
    ValueError
        A number is out of range.
    """

    samples: int = 2
    most: int = 32

    def __post_init__(self) -> None:
        check_count("samples", self.samples, MOST_SAMPLES)
        check_count("most", self.most, MOST)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        from resample_comparisons.warp3d.kernels.meshing import project_rows
        from resample_comparisons.warp3d.kernels.subsampling import fill_bands, sort_rows

        height, width = source.nearness.shape
        vertex = np.empty((height, width, 4), np.float32)
        project_rows(source, equation, vertex)
        kind, box = np.empty((height, width), np.uint8), np.empty((height, width, 4), np.float32)
        sort_rows(source, equation, vertex, orientation_of(equation), kind, box)
        bands = bands_of(box, shape, width, self.samples)
        rendered = blank(source, shape)
        fill_bands(source, equation, vertex, kind, bands, self.most, rendered)
        return rendered
