"""Where the target sees each sample of a source, and how its surface runs there.

Around a sample a surface is its tangent plane. Nearness is linear on planes, w = a · x₁ with
x₁ = (x, y, 1), so the warping equation is a homography there, x₂ ~ (M + e aᵀ) x₁. By the matrix
determinant lemma the plane shows the target its back where 1 + a · M⁻¹ e is not positive, and by
Sherman and Morrison the nearness on the target's screen is aᵀ M⁻¹ x₂ / (1 + a · M⁻¹ e).
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats, Records
from resample_warp3d.types import Equation, Source

SEGMENT = 64  # samples of a source row whose place in the target is known together
EDGE_ON = 1e-6  # 1 + a · M⁻¹ e of a surface that is seen from the side
LARGEST = 1e6  # px of the target per px of the source; what is larger touches the eye

# Rows of a line of samples in the target: place, px; nearness there; columns of the Jacobian J, px
# per column (U) and per row (V) of the source; change of the plane's nearness per px to the right
# and downward. A sample that is unknown, behind the eye or seen from the back has X not a number.
X, Y, NEARNESS, XU, YU, XV, YV, ACROSS, DOWNWARD = range(9)
FIELDS = 9


# What samples of a segment may touch in the target, px; left > right: nothing.
# In float64, as bounds of triangles are, so that one kernel deals both to tiles.
BOUNDS = np.dtype([(name, np.float64) for name in ("left", "top", "right", "bottom", "spacing")])


class Footprint(NamedTuple):
    """How large samples are in the target."""

    radius: float  # px of the source
    least: float  # px of the target per px of the source along any direction; shorter axes grow
    most: float  # as `least`; longer axes shrink


class Placed(NamedTuple):
    """Samples of a source (H, W) in the target, and what they may touch there."""

    sample: Floats  # (H, FIELDS, W)
    touched: Records  # (H S,) of `BOUNDS`, of the S segments of each row


@kernel
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


@kernel
def project_row(
    source: Source, equation: Equation, back: Doubles, row: int, sample: Floats, line: int
) -> None:
    """Place a row of a source's samples in the target.

    Parameters
    ----------
    back
        (3, 4) M⁻¹ and, in the last column, M⁻¹ e.
    sample
        (N, FIELDS, W) of which `line` is filled.
    """
    m, e = equation.matrix, equation.epipole
    is_placed = source.place.shape[0] > 0
    y, xu, yu, xv, yv = row + 0.5, 1.0, 0.0, 0.0, 1.0
    for column in range(source.nearness.shape[1]):
        w, x = float(source.nearness[row, column]), column + 0.5
        a0, a1 = float(source.slope[row, column, 0]), float(source.slope[row, column, 1])
        if is_placed:
            x, y, xu, yu, xv, yv = _on_grid(source.place, row, column)
            area = xu * yv - xv * yu
            a0, a1 = (a0 * yv - a1 * yu) / area, (a1 * xu - a0 * xv) / area
        a2 = w - a0 * x - a1 * y
        inverse = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2] + w * e[2])
        share = 1.0 / (1.0 + a0 * back[0, 3] + a1 * back[1, 3] + a2 * back[2, 3])
        px = (m[0, 0] * x + m[0, 1] * y + m[0, 2] + w * e[0]) * inverse
        py = (m[1, 0] * x + m[1, 1] * y + m[1, 2] + w * e[1]) * inverse
        # J of the homography, then along the grid.
        d0, d1 = m[2, 0] + a0 * e[2], m[2, 1] + a1 * e[2]
        x0, x1 = m[0, 0] + a0 * e[0] - px * d0, m[0, 1] + a1 * e[0] - px * d1
        y0, y1 = m[1, 0] + a0 * e[1] - py * d0, m[1, 1] + a1 * e[1] - py * d1
        x0, x1 = x0 * xu + x1 * yu, x0 * xv + x1 * yv
        y0, y1 = y0 * xu + y1 * yu, y0 * xv + y1 * yv
        size = max(abs(x0), abs(x1), abs(y0), abs(y1)) * inverse
        is_seen = w > 0.0 and inverse > 0.0 and size < LARGEST and 0.0 < share < 1.0 / EDGE_ON
        sample[line, X, column] = px if is_seen else math.nan
        sample[line, Y, column] = py
        sample[line, NEARNESS, column] = w * inverse
        sample[line, XU, column], sample[line, XV, column] = x0 * inverse, x1 * inverse
        sample[line, YU, column], sample[line, YV, column] = y0 * inverse, y1 * inverse
        across = a0 * back[0, 0] + a1 * back[1, 0] + a2 * back[2, 0]
        downward = a0 * back[0, 1] + a1 * back[1, 1] + a2 * back[2, 1]
        sample[line, ACROSS, column] = across * share
        sample[line, DOWNWARD, column] = downward * share


@kernel
def _touch_row(
    sample: Floats, row: int, footprint: Footprint, shape: tuple[int, int], touched: Records
) -> None:
    """Find what the footprints of each segment of a row may meet of a frame (height, width)."""
    height, width = shape
    radius = np.float32(footprint.radius)
    least, most = np.float32(footprint.least**2), np.float32(footprint.most**2)
    segments = -(-sample.shape[2] // SEGMENT)
    for segment in range(segments):
        left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
        for n in range(segment * SEGMENT, min((segment + 1) * SEGMENT, sample.shape[2])):
            x, xu, xv = sample[row, X, n], sample[row, XU, n], sample[row, XV, n]
            y, yu, yv = sample[row, Y, n], sample[row, YU, n], sample[row, YV, n]
            wide = radius * math.sqrt(min(xu * xu + xv * xv + least, most))
            high = radius * math.sqrt(min(yu * yu + yv * yv + least, most))
            if x + wide > 0 and x - wide < width and y + high > 0 and y - high < height:
                left, right = min(left, x - wide), max(right, x + wide)
                top, bottom = min(top, y - high), max(bottom, y + high)
        record = touched[row * segments + segment]
        record["left"], record["right"] = max(left, 0.0), min(right, float(width))
        record["top"], record["bottom"] = max(top, 0.0), min(bottom, float(height))


@kernel
def _place_row(
    source: Source,
    view: tuple[Equation, Doubles],
    footprint: Footprint,
    shape: tuple[int, int],
    placed: Placed,
    row: int,
) -> None:
    equation, back = view
    project_row(source, equation, back, row, placed.sample, row)
    _touch_row(placed.sample, row, footprint, shape, placed.touched)


@parallel_kernel
def project_rows(
    counter: Counter,
    source: Source,
    equation: Equation,
    back: Doubles,
    footprint: Footprint,
    shape: tuple[int, int],
    placed: Placed,
) -> None:
    """Place all samples of a source in a frame (height, width).

    Parameters
    ----------
    back
        (3, 4) M⁻¹ and, in the last column, M⁻¹ e.
    placed
        Filled.
    """
    for row in tasks(counter, source.nearness.shape[0]):
        _place_row(source, (equation, back), footprint, shape, placed, row)
