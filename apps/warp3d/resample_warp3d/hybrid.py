"""The hybrid method: cells where samples shrink or grow alike, exact visibility, two layers.

Samples are cells of a sheet that is torn at silhouettes (`sheets`). Where a cell is smaller than a
pixel it is a point with the area it covers; where it is larger it is cut into parts of a pixel's
size, with colors of a parabola that keeps the sample's mean. So a pixel is the mean of what it
shows, at any scale and along each axis.
"""

from dataclasses import dataclass

import numpy as np

from resample_warp3d.holes import bridged
from resample_warp3d.sheets import sheet_of
from resample_warp3d.types import Equation, Rendered, Source

BAND = 32  # rows of the target that one thread paints at a time


@dataclass(frozen=True)
class Hybrid:
    """Cells cut to the target's pixels, in two layers with coverage at silhouettes.

    Parameters
    ----------
    quality
        Parts that cells are cut into per px of the target, 0.25 to 8; 0.5 is a preview.
    labels
        Colors are names, which are not mixed: each pixel has the one that covers most of it.

    Raises
    ------
    ValueError
        The quality is out of range.
    """

    quality: float = 1.0
    labels: bool = False

    keeps_samples = True  # where nothing moves, nothing changes

    def __post_init__(self) -> None:
        if not 0.25 <= self.quality <= 8.0:
            raise ValueError(f"quality {self.quality:g}; 0.25 to 8 parts per px are allowed")

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        """Warp; what the source does not show stays empty."""
        from resample_warp3d.kernels import layers, screen

        sheet = source.sheet
        if sheet is None or self.labels:
            sheet = sheet_of(source, is_label=self.labels)
        scale = np.linalg.norm(equation.matrix[2])
        matrix, epipole = equation.matrix / scale, equation.epipole / scale
        height, width = source.nearness.shape
        vertices = np.empty((height + 1, width + 1, 3), np.float32)
        screen.project_vertices(sheet.vertex, sheet.place, matrix, epipole, vertices)
        torn = np.empty_like(sheet.corner)
        screen.project_corners(sheet.corner, matrix, epipole, torn)
        bounds = np.empty((height, screen.segment_count(width), 4), np.float32)
        screen.bound_segments(vertices, torn, sheet.torn, bounds)
        image = np.empty((*shape, source.color.shape[2]), np.float32)
        coverage, nearness, magnification = (np.empty(shape, np.float32) for _ in range(3))
        layers.paint_bands(
            vertices, torn, sheet.torn, bounds, sheet.color, sheet.links,
            BAND, self.quality, float(np.sign(np.linalg.det(matrix))), self.labels,
            image, coverage, nearness, magnification,
        )  # fmt: skip
        # The equation was divided by `scale`, and with it what nearness is divided by.
        nearness /= np.float32(scale)
        empty = np.zeros(shape, np.bool_)
        painted = Rendered(image, coverage, nearness, magnification, empty)
        return painted if self.labels else bridged(painted)
