"""Samples of a depth image as records of `resample.hybrid`.

Around a sample a surface is its tangent plane. Nearness is linear on planes, w = a · x₁ with
x₁ = (x, y, 1), so McMillan's warping equation is a homography there, x₂ ~ (M + e aᵀ) x₁. By the
matrix determinant lemma the plane shows the target its back where 1 + a · M⁻¹ e is not positive,
and by Sherman and Morrison the nearness on the target's screen is aᵀ M⁻¹ x₂ / (1 + a · M⁻¹ e).
"""

import math
from typing import NamedTuple

from resample.engine.jit import Counter, inner_step, parallel_kernel, tasks
from resample.hybrid.classify import Widths, flat_sample
from resample.hybrid.record import NOTHING
from resample.types import Doubles, Floats, Records
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Equation, Source

EDGE_ON = 1e-6  # 1 + a · M⁻¹ e of a surface that is seen from the side
LARGEST = 1e6  # px of the target per px of the source; larger samples touch the eye
ALL = LEFT | RIGHT | UP | DOWN


class Placed(NamedTuple):
    """Samples (N, ...) of a source in the target."""

    record: Records  # (N,)
    slope: Floats  # (N, 2) change of the plane's nearness per px to the right and downward
    core: Floats  # (N,) squared index up to which a sample hides what is behind
    normal: Floats  # (N, 3) unit, as a source of a focal length like its longer side has it
    area: Floats  # (N,) px² of the target per px² of the source


@parallel_kernel
def place_samples(
    counter: Counter,
    source: Source,
    equation: Equation,
    back: Doubles,
    widths: Widths,
    cores: tuple[float, float],
    shape: tuple[int, int],
    placed: Placed,
) -> None:
    """Place all samples of a source in a frame (height, width).

    `back`: (3, 4) M⁻¹ and, in the last column, M⁻¹ e. `cores`: index up to which a sample hides
    samples behind: inside surfaces, and at boundaries.
    """
    height, width = source.nearness.shape
    for row in tasks(counter, height):
        for column in range(width):
            n = row * width + column
            placed.record[n]["kind"] = NOTHING
            if source.nearness[row, column] > 0.0:
                _place(source, (equation, back), (row, column), widths, shape, placed)
            core = cores[0] if source.links[row, column] & ALL == ALL else cores[1]
            placed.core[n] = core * core


@inner_step
def _place(
    source: Source,
    view: tuple[Equation, Doubles],
    at: tuple[int, int],
    widths: Widths,
    shape: tuple[int, int],
    placed: Placed,
) -> None:
    """Place a sample, unless it is behind the eye or seen from the back."""
    (row, column), (equation, back) = at, view
    m, e = equation.matrix, equation.epipole
    width = source.nearness.shape[1]
    n = row * width + column

    # The plane w = a · (x, y, 1), by the place of the sample and the grid's steps there.
    w = float(source.nearness[row, column])
    a0, a1 = float(source.slope[row, column, 0]), float(source.slope[row, column, 1])
    x, y, xu, yu, xv, yv = column + 0.5, row + 0.5, 1.0, 0.0, 0.0, 1.0
    if source.place.shape[0] > 0:
        x, y, xu, yu, xv, yv = _on_grid(source.place, row, column)
        share = 1.0 / (xu * yv - xv * yu)
        a0, a1 = (a0 * yv - a1 * yu) * share, (a1 * xu - a0 * xv) * share
    a2 = w - a0 * x - a1 * y

    # McMillan's equation; the back of a surface is culled.
    inverse = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2] + w * e[2])
    front = 1.0 / (1.0 + a0 * back[0, 3] + a1 * back[1, 3] + a2 * back[2, 3])
    px = (m[0, 0] * x + m[0, 1] * y + m[0, 2] + w * e[0]) * inverse
    py = (m[1, 0] * x + m[1, 1] * y + m[1, 2] + w * e[1]) * inverse
    # J of the homography, then along the grid.
    d0, d1 = m[2, 0] + a0 * e[2], m[2, 1] + a1 * e[2]
    x0, x1 = m[0, 0] + a0 * e[0] - px * d0, m[0, 1] + a1 * e[0] - px * d1
    y0, y1 = m[1, 0] + a0 * e[1] - py * d0, m[1, 1] + a1 * e[1] - py * d1
    jacobian = (
        (x0 * xu + x1 * yu) * inverse,
        (x0 * xv + x1 * yv) * inverse,
        (y0 * xu + y1 * yu) * inverse,
        (y0 * xv + y1 * yv) * inverse,
    )
    size = max(abs(jacobian[0]), abs(jacobian[1]), abs(jacobian[2]), abs(jacobian[3]))
    if not (inverse > 0.0 and size < LARGEST and 0.0 < front < 1.0 / EDGE_ON):
        return

    placed.slope[n, 0] = (a0 * back[0, 0] + a1 * back[1, 0] + a2 * back[2, 0]) * front
    placed.slope[n, 1] = (a0 * back[0, 1] + a1 * back[1, 1] + a2 * back[2, 1]) * front
    placed.area[n] = abs(jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2])
    _set_normal(placed.normal, n, (a0, a1, a2), source.nearness.shape)
    flat_sample(placed.record[n], (px, py), jacobian, 1.0 / (w * inverse), widths, shape)


@inner_step
def _set_normal(
    normal: Floats, n: int, a: tuple[float, float, float], shape: tuple[int, int]
) -> None:
    """Unit normal Kᵀ a of a plane, for a camera with its longer side as focal length."""
    focal, middle = float(max(shape)), a[0] * 0.5 * shape[1] + a[1] * 0.5 * shape[0] + a[2]
    p, q = focal * a[0], focal * a[1]
    length = math.sqrt(p * p + q * q + middle * middle)
    normal[n, 0], normal[n, 1], normal[n, 2] = p / length, q / length, middle / length


@inner_step
def _on_grid(
    place: Doubles, row: int, column: int
) -> tuple[float, float, float, float, float, float]:
    """Place of a sample, and its change to the next column and to the next row."""
    height, width = place.shape[0], place.shape[1]
    left, right = max(column - 1, 0), min(column + 1, width - 1)
    above, below = max(row - 1, 0), min(row + 1, height - 1)
    u, v = 1.0 / max(right - left, 1), 1.0 / max(below - above, 1)
    return (
        place[row, column, 0],
        place[row, column, 1],
        (place[row, right, 0] - place[row, left, 0]) * u if width > 1 else 1.0,
        (place[row, right, 1] - place[row, left, 1]) * u,
        (place[below, column, 0] - place[above, column, 0]) * v,
        (place[below, column, 1] - place[above, column, 1]) * v if height > 1 else 1.0,
    )
