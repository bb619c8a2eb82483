"""Other methods to compare with: triangles by RVS's rule, and softmax splatting."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.types import Doubles, Floats
from resample_warp3d.baselines.kernels.mcmillan import place_of, projected
from resample_warp3d.types import Equation, Source

BEST, WORST, PER_PX = 10000.0, 1.0, 1000.0  # quality of a triangle, and its decrease per px
BEYOND = 1e6  # px


@kernel
def project(source: Source, equation: Equation, vertex: Doubles) -> None:
    """Project all samples to x, y and nearness in the target, (H, W, 3); nearness 0: invisible."""
    for row in range(vertex.shape[0]):
        for column in range(vertex.shape[1]):
            near = np.float64(source.nearness[row, column])
            x, y, w = projected(equation, place_of(source.place, row, column), near)
            vertex[row, column, 2] = 0.0
            if near > 0.0 and w > 0.0 and abs(x) < BEYOND * w and abs(y) < BEYOND * w:
                vertex[row, column, 0], vertex[row, column, 1] = x / w, y / w
                vertex[row, column, 2] = near / w


@kernel
def _quality(a: Doubles, b: Doubles, c: Doubles) -> float:
    """Quality of a triangle by its longest side."""
    ab = math.hypot(a[0] - b[0], a[1] - b[1])
    bc = math.hypot(b[0] - c[0], b[1] - c[1])
    ca = math.hypot(c[0] - a[0], c[1] - a[1])
    return min(BEST, max(WORST, BEST - PER_PX * max(ab, bc, ca)))


@kernel
def _draw(
    corner: tuple[Doubles, Doubles, Doubles], color: tuple[Floats, Floats, Floats],
    orientation: float, worth: Doubles, image: Floats,
) -> None:  # fmt: skip
    """Draw a triangle where its quality exceeds that of what is there."""
    a, b, c = corner
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if not (a[2] > 0 and b[2] > 0 and c[2] > 0 and area * orientation > 0):
        return
    height, width = worth.shape
    first_row = math.ceil(max(min(a[1], b[1], c[1]) - 0.5, 0.0))
    last_row = math.floor(min(max(a[1], b[1], c[1]) - 0.5, height - 1.0))
    first_column = math.ceil(max(min(a[0], b[0], c[0]) - 0.5, 0.0))
    last_column = math.floor(min(max(a[0], b[0], c[0]) - 0.5, width - 1.0))
    quality = _quality(a, b, c)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            x, y = column + 0.5, row + 0.5
            u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
            v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
            w = 1.0 - u - v
            if u < 0 or v < 0 or w < 0:
                continue
            near = u * a[2] + v * b[2] + w * c[2]
            value = near * near * near * quality
            if value > worth[row, column]:
                worth[row, column] = value
                for n in range(image.shape[2]):
                    image[row, column, n] = u * color[0][n] + v * color[1][n] + w * color[2][n]


@kernel
def draw_triangles(
    color: Floats, vertex: Doubles, orientation: float, worth: Doubles, image: Floats
) -> None:
    """Draw all triangles between neighbours; less stretched ones win.

    RVS, MPEG's reference view synthesizer, compares nearness³ × quality, which decreases from 10000
    to 1 as the longest side goes from 0 to 10 px: a stretched triangle shows only in gaps.

    Parameters
    ----------
    color
        (H, W, C) of the source.
    vertex
        (H, W, 3) from `project`.
    orientation
        Sign of the areas of front faces.
    worth
        (h, w) of the target, initially 0; 0 where empty.
    image
        (h, w, C), written.
    """
    for row in range(color.shape[0] - 1):
        for column in range(color.shape[1] - 1):
            a, b = vertex[row, column], vertex[row, column + 1]
            c, d = vertex[row + 1, column], vertex[row + 1, column + 1]
            p, q = color[row, column], color[row, column + 1]
            r, s = color[row + 1, column], color[row + 1, column + 1]
            _draw((a, b, c), (p, q, r), orientation, worth, image)
            _draw((b, d, c), (q, s, r), orientation, worth, image)


@kernel
def add_splats(
    color: Floats, vertex: Doubles, sharpness: float, total: Doubles, image: Doubles
) -> None:
    """Add each sample to 2 × 2 pixels bilinearly, weighted by exp(sharpness × nearness).

    Softmax splatting (Niklaus and Liu 2020). `total` (h, w) and `image` (h, w, C) are added to.
    """
    height, width = total.shape
    most = vertex[..., 2].max()
    for row in range(color.shape[0]):
        for column in range(color.shape[1]):
            if not vertex[row, column, 2] > 0:
                continue
            share = math.exp(sharpness * (vertex[row, column, 2] / most - 1.0))
            x, y = vertex[row, column, 0] - 0.5, vertex[row, column, 1] - 0.5
            left, top = math.floor(x), math.floor(y)
            for n in range(4):
                r, c = top + n // 2, left + n % 2
                if not (0 <= r < height and 0 <= c < width):
                    continue
                weight = share * (1.0 - abs(x - c)) * (1.0 - abs(y - r))
                total[r, c] += weight
                for k in range(color.shape[2]):
                    image[r, c, k] += weight * color[row, column, k]
