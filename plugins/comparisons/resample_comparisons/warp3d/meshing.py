"""Triangle meshes between adjacent samples, as graphics cards draw depth images."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resample.types import Floats
from resample_comparisons.warp3d.mcmillan import blank
from resample_warp3d.types import Equation, Rendered, Source

if TYPE_CHECKING:
    from resample_comparisons.warp3d.kernels.meshing import Bands

MOST_SAMPLES = 16
BAND = 32  # height of a band in sub-pixels


@dataclass(frozen=True)
class DepthMesh:
    """Two triangles between 2 × 2 samples, with perspective and a z-buffer (Mark et al. 1997).

    Triangles have the samples as corners, so the outer half pixel of the source is missing.
    Triangles that show their back or have a corner behind the camera are not drawn.

    Parameters
    ----------
    cut
        `links`: triangles join linked samples only. A number: triangles with depths that differ by
        more, relative to the nearest, are not drawn (0.03 is common). `none`: a rubber sheet.
    samples
        Sub-pixels per side of a pixel, 1 to 16; the pixel is their mean.

    Raises
    ------
    ValueError
        An option is unknown or out of range.
    """

    cut: str | float = "links"
    samples: int = 1

    def __post_init__(self) -> None:
        check_count("samples", self.samples, MOST_SAMPLES)
        if not _step(self.cut) >= 0.0 and self.cut != "links":
            raise ValueError(f"cut is links, none or a number from 0, not {self.cut!r}")

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        from resample_comparisons.warp3d.kernels.meshing import (
            divide_rows,
            draw_bands,
            project_rows,
        )

        height, width = source.nearness.shape
        vertex = np.empty((height, width, 4), np.float32)
        project_rows(source, equation, vertex)
        quads = max(height - 1, 0), max(width - 1, 0)
        parts, box = np.empty(quads, np.uint16), np.empty((*quads, 4), np.float32)
        divide_rows(source, vertex, (_step(self.cut), orientation_of(equation)), parts, box)
        bands = bands_of(box, shape, width, self.samples)
        rendered = blank(source, shape)
        draw_bands(source, vertex, parts, bands, rendered)
        return rendered


def orientation_of(equation: Equation) -> float:
    """Return the sign of front-facing areas in the target; −1 if one view is mirrored."""
    return math.copysign(1.0, np.linalg.det(equation.matrix))


def bands_of(box: Floats, shape: tuple[int, int], width: int, samples: int) -> "Bands":
    """Sort items into the bands of the target that they touch.

    `box`: (H, W, 4) left, top, right, bottom of each item in the target, px; left above right:
    none. `shape`: height and width of the target, px. `samples`: Sub-pixels per side of a pixel.
    """
    from resample_comparisons.warp3d.kernels.meshing import Bands, deal

    height = max(1, BAND // samples)
    count = np.zeros(-(-shape[0] // height), np.int64)
    deal(box, shape, height, count, np.empty(0, np.int32), width)
    start = np.concatenate([np.zeros(1, np.int64), np.cumsum(count)])
    item = np.empty(start[-1], np.int32)
    deal(box, shape, height, start[:-1].copy(), item, width)
    return Bands(start, item, height, samples)


def check_count(name: str, count: int, most: int) -> None:
    """Reject anything but a whole number from 1 to `most`."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise ValueError(f"{name} is a whole number from 1 to {most}, not {count}")


def _step(cut: str | float) -> float:
    """Return the largest relative depth step in a triangle; −1 for links or an invalid cut."""
    if cut == "none":
        return math.inf
    try:
        return float(cut)
    except ValueError:
        return -1.0
