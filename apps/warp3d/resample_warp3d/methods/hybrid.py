"""The hybrid method: cells where samples shrink or grow alike, exact visibility, two layers.

Samples are cells of a sheet that is torn at silhouettes (`sheets`). Where a cell is smaller than a
pixel it is a point with the area it covers; where it is larger it gives every pixel the mean of its
color over their overlap. So a pixel is the mean over its area, at any scale and along each axis.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from resample.messages import number
from resample.types import Doubles
from resample_warp3d.depth.equation import is_identity, unmoved
from resample_warp3d.projection_models import Passage, Way
from resample_warp3d.sheet.filling import bridged
from resample_warp3d.sheet.sheets import SheetCache
from resample_warp3d.types import Equation, Rendered, Sheet, Source

if TYPE_CHECKING:
    from resample_warp3d.sheet.kernels.screen import SheetScreen
    from resample_warp3d.sheet.kernels.segments import BandFrame

BAND = 32  # rows of the target that one thread paints at a time
LARGEST_BAND = 1 << 30  # px; kernels count them in 32 bits


@dataclass(frozen=True)
class Hybrid:
    """Cells cut to the target's pixels, in two layers with coverage at silhouettes.

    Parameters
    ----------
    quality
        Parts that cells are cut into per px of the target, 0.25 to 8.
    labels
        Colors are names, which are not mixed: each pixel has the one that covers most of it.

    Raises
    ------
    ValueError
        The quality is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, Hybrid, warp
    >>> names = np.float32(np.indices((24, 32))[1] // 8)  # of four stripes
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> away = camera.moved(np.c_[np.eye(3), [0.1, 0, 1.3]])
    >>> warped = warp(names, np.full((24, 32), 2.0), camera, away, method=Hybrid(labels=True))
    >>> np.unique(warped.image).tolist()  # none are mixed
    [0.0, 1.0, 2.0, 3.0]
    """

    quality: float = 1.0
    labels: bool = False
    _sheets: SheetCache = field(default_factory=SheetCache, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0.25 <= number("quality", self.quality) <= 8.0:
            raise ValueError(f"quality {self.quality:g}; 0.25 to 8 parts per px are allowed")

    def __call__(self, source: Source, equation: Way, shape: tuple[int, int]) -> Rendered:
        """Warp; parts that the source does not show stay empty."""
        if isinstance(equation, Equation) and is_identity(source, equation, shape):
            return unmoved(source)
        layers = self.layers(source, equation, shape)
        return layers if self.labels else bridged(layers)

    def sheet(self, source: Source) -> Sheet:
        """Sheet of a source, made on first use."""
        return self._sheets(source, is_label=self.labels)

    def layers(self, source: Source, equation: Way, shape: tuple[int, int]) -> Rendered:
        """Warp without closing narrow gaps, for sub-pixels."""
        from resample_warp3d.sheet.kernels.layers import CellColors, LayerPicture, paint_layers

        sheet = self.sheet(source)
        screen, orientation, scale = laid(sheet, equation)
        blank = empty(shape, source.color.shape[2])
        colors, picture = CellColors(sheet.color, sheet.links), LayerPicture(*blank[:4])
        frame = whole_frame(orientation, shape, self.quality, is_label=self.labels)
        paint_layers(screen, colors, band_of(shape), frame, picture)
        blank.nearness[:] /= np.float32(scale)
        return blank


@dataclass(frozen=True)
class Preview:
    """The nearest cell over each pixel's center: quick, but not antialiased."""

    _sheets: SheetCache = field(default_factory=SheetCache, init=False, repr=False, compare=False)

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        """Warp; parts that the source does not show stay empty."""
        from resample_warp3d.sheet.kernels.layers import CellColors, LayerPicture
        from resample_warp3d.sheet.kernels.preview import fill_picture

        if is_identity(source, equation, shape):
            return unmoved(source)
        sheet = self._sheets(source)
        screen, volume, scale = laid(sheet, equation)
        blank = empty(shape, source.color.shape[2])
        colors, picture = CellColors(sheet.color, sheet.links), LayerPicture(*blank[:4])
        fill_picture(screen, colors, band_of(shape), whole_frame(volume, shape), picture)
        blank.nearness[:] /= np.float32(scale)
        return blank


def band_of(shape: tuple[int, int]) -> int:
    """Rows of the target that one thread paints at a time."""
    return max(1, min(BAND, LARGEST_BAND // shape[1]))


def laid(sheet: Sheet, way: Way) -> tuple["SheetScreen", float, float]:
    """Sheet on a target's screen, its orientation, and the divisor of its nearness."""
    if isinstance(way, Passage):
        return way.laid(sheet), way.orientation, 1.0
    scale = float(np.linalg.norm(way.matrix[2]))  # to a matrix and epipole of a usual size
    matrix = way.matrix / scale
    return project(sheet, matrix, way.epipole / scale), float(np.linalg.det(matrix)), scale


def whole_frame(
    volume: float, shape: tuple[int, int], quality: float = 1.0, *, is_label: bool = False
) -> "BandFrame":
    """All rows of a target's frame; the volume is below 0 where it is a mirror image."""
    from resample_warp3d.sheet.kernels.segments import BandFrame

    orientation = np.float32(np.sign(volume))
    return BandFrame(0, *shape, orientation, np.float32(quality), is_label)


def project(sheet: Sheet, matrix: Doubles, epipole: Doubles) -> "SheetScreen":
    """Sheet on the screen of a target."""
    from resample_warp3d.sheet.kernels import screen
    from resample_warp3d.sheet.kernels.corners import project_ends

    height, width = sheet.torn.shape
    vertices = np.empty((3, height + 1, width + 1), np.float32)
    screen.project_vertices(sheet.vertex, sheet.place, matrix, epipole, vertices)
    torn = np.empty_like(sheet.corner)
    screen.project_corners(sheet.corner, matrix, epipole, torn)
    project_ends(sheet.corner, sheet.ends, sheet.roundness, matrix, epipole, torn)
    bounds = np.empty((height, screen.segment_count(width), 4), np.int32)
    screen.bound_segments(vertices, torn, sheet.torn, bounds)
    return screen.SheetScreen(vertices, torn, sheet.torn, bounds)


def empty(shape: tuple[int, int], channels: int) -> Rendered:
    """Arrays to be filled."""
    coverage, nearness, magnification = (np.empty(shape, np.float32) for _ in range(3))
    image = np.empty((*shape, channels), np.float32)
    return Rendered(image, coverage, nearness, magnification, np.zeros(shape, np.bool_))
