"""Silhouettes between samples of a depth image, and unmixing of their colors.

A silhouette between two neighbours lies somewhere between their centers: the near one's center is
still on the near surface, the far one's is not. With the edge T px from the near center (0..1), the
near surface fills T + 1/2 of the two pixels, so their summed color yields T, given the pure colors
of both surfaces, which the next samples inside have. The colors of the two then follow: the
contribution of the other surface to a pixel is replaced by more of its own.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links

TEXTURE = 5.0  # weight of the contrast of both surfaces' textures against the edge's
MISFIT = 3.0  # the same for color that no mixture of the two explains
FAINT = 1e-3  # contrast below which an edge's color is ignored, of squared color
LIMB = 0.95  # reduction of color's weight where the depth shows the surface curving away
CLEAR = 8.0  # a step shows that if it exceeds so many errors of the nearness
ROUND = 0.93  # ratio of the last two steps of nearness from which on a surface is not a limb


@kernel
def limb(ratio: float) -> float:
    """Samples to a surface's end, by the ratio of the last two steps of nearness.

    Near a limb nearness falls like a square root, √(T − t); the ratio ρ of the steps before the
    last sample (t = 0) yields T: with q = √(T + 1) + √(T + 2), q² = (1 + ρ) / (ρ (1 − ρ)) and
    √(T + 1) = (q − 1 / q) / 2. Returns 9 where nearness falls otherwise.
    """
    if ratio <= math.sqrt(2.0) - 1.0:
        return 0.0
    if ratio >= ROUND:
        return 9.0
    square = (1.0 + ratio) / (ratio * (1.0 - ratio))
    return max(0.0, 0.25 * (square - 2.0 + 1.0 / square) - 1.0)


@kernel
def _mixture(
    color: Floats, near: tuple[int, int], far: tuple[int, int], step: tuple[int, int],
    more: tuple[bool, bool],
) -> tuple[float, float]:  # fmt: skip
    """Estimate an edge by color: px from the near center, and its weight 0..1.

    `step` leads from the near to the far sample; `more` tells whether each surface has a third
    sample.
    """
    # Project the pixels' summed color on the line between the pure colors; measure the textures.
    dr, dc = step
    dot, contrast, texture, misfit = 0.0, 0.0, 0.0, 0.0
    for c in range(color.shape[2]):
        inner = float(color[near[0] - dr, near[1] - dc, c])
        outer = float(color[far[0] + dr, far[1] + dc, c])
        difference = inner - outer
        dot += (color[near[0], near[1], c] + color[far[0], far[1], c] - 2.0 * outer) * difference
        contrast += difference * difference
        # A missing third sample counts as some texture.
        further = 0.5 * difference
        if more[0]:
            further = inner - color[near[0] - 2 * dr, near[1] - 2 * dc, c]
        texture += further * further
        further = 0.5 * difference
        if more[1]:
            further = outer - color[far[0] + 2 * dr, far[1] + 2 * dc, c]
        texture += further * further

    # Without contrast there is no information.
    if not contrast > 1e-12:
        return 0.5, 0.0

    # Measure what no mixture of the pure colors explains.
    share = dot / contrast
    for c in range(color.shape[2]):
        inner = float(color[near[0] - dr, near[1] - dc, c])
        outer = float(color[far[0] + dr, far[1] + dc, c])
        left = color[near[0], near[1], c] + color[far[0], far[1], c]
        left -= share * inner + (2.0 - share) * outer
        misfit += left * left

    # Trust the edge by its contrast against textures and misfit.
    weight = contrast / (contrast + TEXTURE * (texture + MISFIT * misfit) + FAINT)
    return min(max(share - 0.5, 0.0), 1.0), weight


@kernel
def _position(
    color: Floats, nearness: Floats, links: Links, error: Doubles,
    row: int, column: int, down: bool,
) -> float:  # fmt: skip
    """Silhouette between a sample and its right (or lower) neighbour.

    In px from the nearer one's center. Negative: there is none. 1/2 where nothing is known.
    """
    # Require two samples on different surfaces.
    dr, dc = (1, 0) if down else (0, 1)
    ahead, back = (DOWN, UP) if down else (RIGHT, LEFT)
    r, c = row + dr, column + dc
    if r >= nearness.shape[0] or c >= nearness.shape[1] or links[row, column] & ahead:
        return -1.0
    first, second = nearness[row, column], nearness[r, c]
    if not (first > 0 and second > 0):
        return -1.0

    # Find which of them is nearer.
    if first > second:
        nr, nc, fr, fc = row, column, r, c
        inward, outward = back, ahead
    else:
        nr, nc, fr, fc = r, c, row, column
        dr, dc = -dr, -dc
        inward, outward = ahead, back

    # Both surfaces need another sample inside, for their pure colors.
    if not (links[nr, nc] & inward and links[fr, fc] & outward):
        return 0.5

    # Estimate the edge by color.
    is_longer = links[nr - dr, nc - dc] & inward != 0, links[fr + dr, fc + dc] & outward != 0
    found, weight = _mixture(color, (nr, nc), (fr, fc), (dr, dc), is_longer)

    # A surface that curves away predicts its end by depth, which reduces the weight of color.
    expected = 0.5
    if is_longer[0]:
        inner = nearness[nr - dr, nc - dc]
        last, previous = nearness[nr, nc] - inner, inner - nearness[nr - 2 * dr, nc - 2 * dc]
        if last < 0 and previous < 0:
            turn = limb(previous / last)
            if turn < 1.0:
                expected = turn
                step = previous / max(inner * error[0] + error[1], 1e-30)
                weight *= 1.0 - LIMB * step * step / (step * step + CLEAR * CLEAR)
    return expected + weight * (found - expected)


@parallel_kernel
def find_silhouettes(
    counter: Counter, color: Floats, nearness: Floats, links: Links, error: Doubles, edge: Floats
) -> None:
    """Find the silhouettes after each sample, toward its right and lower neighbours.

    `color`: (H, W, C). `nearness`: (H, W); 0 where unknown. `links`: (H, W). `error`: (2,) of the
    nearness: relative and absolute. `edge`: (H, W, 2) filled: px from the center of the nearer of
    the two, 0..1; −1 where there is none.
    """
    for row in tasks(counter, nearness.shape[0]):
        for column in range(nearness.shape[1]):
            # Skip samples inside a surface.
            if links[row, column] & RIGHT and links[row, column] & DOWN:
                edge[row, column, 0], edge[row, column, 1] = np.float32(-1), np.float32(-1)
                continue
            edge[row, column, 0] = _position(color, nearness, links, error, row, column, False)
            edge[row, column, 1] = _position(color, nearness, links, error, row, column, True)


@kernel
def _side(
    nearness: Floats, edge: Floats, row: int, column: int, side: int
) -> tuple[float, int, int]:
    """Share of a pixel that another surface covers on one side, and the step there.

    Sides: 0 left, 1 right, 2 up, 3 down.
    """
    # Find the neighbour on that side.
    down = side >= 2
    sign = 1 if side % 2 else -1
    dr, dc = (sign, 0) if down else (0, sign)
    r, c = row + dr, column + dc
    if not (0 <= r < nearness.shape[0] and 0 <= c < nearness.shape[1]):
        return 0.0, 0, 0
    # Look up the silhouette between them.
    axis = 1 if down else 0
    t = edge[row, column, axis] if sign > 0 else edge[r, c, axis]
    if t < 0 or not nearness[r, c] > 0:
        return 0.0, 0, 0
    # Measure how far the other surface extends into the pixel.
    if nearness[row, column] > nearness[r, c]:
        return max(0.0, 0.5 - t), dr, dc
    return max(0.0, t - 0.5), dr, dc


@kernel
def _pure(
    color: Floats, nearness: Floats, edge: Floats, row: int, column: int, result: Floats,
) -> None:  # fmt: skip
    """Write a sample's color without other surfaces' contributions."""
    # Add up what other surfaces cover.
    own, total = 1.0, 0.0
    for side in range(4):
        foreign, _, _ = _side(nearness, edge, row, column, side)
        own *= 1.0 - foreign
        total += foreign

    # Keep the color of uncovered samples.
    for c in range(color.shape[2]):
        result[row, column, c] = color[row, column, c]
    if total <= 0.0:
        return

    # Remove each side's contribution by its share.
    own = max(own, 0.4)
    for side in range(4):
        foreign, dr, dc = _side(nearness, edge, row, column, side)
        if foreign <= 0.0:
            continue
        # Take the samples that the edge was estimated from, and solve the mixture for the sample's
        # own color; limit it to lie between that and its surface's.
        weight = foreign / total
        for c in range(color.shape[2]):
            outer, inner = color[row + 2 * dr, column + 2 * dc, c], color[row - dr, column - dc, c]
            here = color[row, column, c]
            pure = here + (1.0 - own) / own * (here - outer)
            pure = min(max(pure, min(here, inner)), max(here, inner))
            result[row, column, c] += np.float32(weight * (pure - here))


@parallel_kernel
def unmix(
    counter: Counter, color: Floats, nearness: Floats, links: Links, edge: Floats, result: Floats
) -> None:
    """Write the colors (H, W, C) of surfaces without those behind or in front."""
    for row in tasks(counter, color.shape[0]):
        whole = LEFT | RIGHT | UP | DOWN
        for column in range(color.shape[1]):
            if links[row, column] == whole or not nearness[row, column] > 0:
                for c in range(color.shape[2]):
                    result[row, column, c] = color[row, column, c]
            else:
                _pure(color, nearness, edge, row, column, result)
