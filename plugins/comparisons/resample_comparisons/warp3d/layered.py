"""Layered depth images of Shade et al.: samples of several views in the pixels of one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from resample.types import Floats
from resample_comparisons.warp3d.mcmillan import walks_of
from resample_comparisons.warp3d.meshing import MOST_SAMPLES, check_count
from resample_warp3d.types import Equation, Rendered, Source

if TYPE_CHECKING:
    from resample_comparisons.warp3d.kernels.layered import LayeredImage

TOLERANCE = 0.01
SIZES = 4


@dataclass(frozen=True)
class LayeredDepthImage:
    """Splats of fixed sizes in the occlusion-compatible order (Shade et al. 1998).

    One source gives one layer; `build` makes layered depth images of several, `splat` draws them.

    Parameters
    ----------
    tolerance
        Relative nearness within which samples of a pixel are one layer; from 0, less than 1.
    sizes
        Number of splat sizes: 1, 3, 5, … px; 1 to 16. The size follows from the square root of a
        sample's area, so surfaces have gaps where they are magnified by more than `sizes`, or along
        one axis only.

    Raises
    ------
    ValueError
        A number is out of range.
    """

    is_per_pixel: ClassVar[bool] = True  # takes no filter: sub-pixels would stay empty
    tolerance: float = TOLERANCE
    sizes: int = SIZES

    def __post_init__(self) -> None:
        check_count("sizes", self.sizes, MOST_SAMPLES)
        if not 0.0 <= self.tolerance < 1.0:
            raise ValueError(f"tolerance is a number from 0, less than 1, not {self.tolerance}")

    def __call__(self, source: Source, equation: Equation, shape: tuple[int, int]) -> Rendered:
        same = Equation(np.eye(3), np.zeros(3))
        height, width = source.nearness.shape
        layers = build([(source, same)], (height, width), tolerance=self.tolerance)
        return splat(layers, equation, shape, sizes=self.sizes)


def build(
    sources: Sequence[tuple[Source, Equation]],
    shape: tuple[int, int],
    *,
    tolerance: float = TOLERANCE,
) -> "LayeredImage":
    """Make a layered depth image.

    Samples move to the centers of their nearest pixels, along the planes of their surfaces. The
    result does not depend on the order of the sources, except for rounding.

    `shape`: (height, width) of that view, px.
    """
    from resample_comparisons.warp3d.kernels.layered import LayeredImage, merge

    channels = {source.color.shape[2] for source, _ in sources}
    if len(channels) != 1:
        given = ", ".join(map(str, sorted(channels))) or "none"
        raise ValueError(f"sources need the same number of channels, 1 or more; given: {given}")
    parts = [_moved(source, equation, shape) for source, equation in sources]
    pixel, moved, color = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.lexsort((moved[:, 0], pixel))
    count = len(order)
    layers = LayeredImage(
        np.empty(shape[0] * shape[1] + 1, np.int64),
        np.empty((count, channels.pop()), np.float32),
        np.empty(count, np.float32),
        np.empty((count, 2), np.float32),
        shape[1],
    )
    count = merge(pixel[order], moved[order], color[order], tolerance, layers)
    return layers._replace(
        color=layers.color[:count], nearness=layers.nearness[:count], slope=layers.slope[:count]
    )


def splat(
    layers: "LayeredImage", equation: Equation, shape: tuple[int, int], *, sizes: int = SIZES
) -> Rendered:
    """Warp a layered depth image into a frame of (height, width) px.

    The size of a splat follows from the nearness and slope of its sample.

    `layers`: result of `build`. `equation`: equation from the layered image's view to the target.
    `shape`: height and width of the target, px. `sizes`: as `LayeredDepthImage` takes it.
    """
    from resample_comparisons.warp3d.kernels.layered import splat_in_order

    source_shape = (len(layers.start) - 1) // layers.width, layers.width
    walks = walks_of(equation, source_shape, np.empty((0, 0, 2)))
    rendered = Rendered(
        np.zeros((*shape, layers.color.shape[1]), np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.bool_),
    )
    splat_in_order(layers, equation, walks, patches(sizes), rendered)
    return rendered


def patches(sizes: int) -> Floats:
    """Return opacities of splats 1, 3, 5, … px wide: Gaussians rounded to 1, 1/2 or 1/4.

    Result: (sizes, 2 sizes − 1, 2 sizes − 1), each in the upper left corner of its table.
    """
    tables = np.zeros((sizes, 2 * sizes - 1, 2 * sizes - 1), np.float32)
    for size in range(sizes):
        side = 2 * size + 1
        offset = np.arange(side) - size
        sigma = side / 4
        exponent = (offset[:, None] ** 2 + offset**2) / (2 * sigma**2) / np.log(2)
        tables[size, :side, :side] = 0.5 ** np.rint(exponent).clip(0, 2)
    return tables


def _moved(
    source: Source, equation: Equation, shape: tuple[int, int]
) -> tuple["np.ndarray[tuple[int], np.dtype[np.int64]]", Floats, Floats]:
    """Warp the samples into a view; return pixel, nearness with slope, and color."""
    from resample_comparisons.warp3d.kernels.layered import move_rows

    pixel = np.empty(source.nearness.shape, np.int64)
    moved = np.empty((*source.nearness.shape, 3), np.float32)
    move_rows(source, equation, shape, pixel, moved)
    is_inside = pixel >= 0
    return pixel[is_inside], moved[is_inside], source.color[is_inside]
