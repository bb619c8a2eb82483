"""Silhouettes of curved surfaces: smooth curves instead of stairs of samples.

Where a surface curves away, nearness beyond the last sample along an axis falls like a square root
(`outlines.limb`), which tells the nearness at the surface's end. A corner of the lattice beside
such ends moves to the middle between them, on the curve, and takes the nearness there. Colors are
compressed along the surface as the root is.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.depth.kernels.outlines import CLEAR, limb
from resample_warp3d.sheet.kernels.screen import Indices, projected
from resample_warp3d.types import DOWN, LEFT, RIGHT, TURNS, UP, Links

FARTHEST = 1.5  # samples from the last one to a surface's end, at most, as its depth predicts it
INSET = 0.1  # samples that a surface ends earlier: its outermost rim has no color of its own
INSET_PX = 0.5  # the same on the target's screen, at most
INSET_BY_NEARNESS = 2.0  # the same, over the rise to the target's silhouette (`rise_of`), at most

Four = tuple[float, float, float, float]


class Silhouettes(NamedTuple):
    """Silhouettes of a depth image."""

    edge: Floats  # (H, W, 2) of `outlines.find_silhouettes`
    error: Doubles  # (2,) of the nearness: relative, and absolute


class SilhouetteEnd(NamedTuple):
    """End of the nearer surface of a silhouette between two samples."""

    member: int  # its sample, as in `corners._linked`; −1: no silhouette
    x: float  # px from the corner of the lattice
    y: float
    nearness: float  # at the end, if the surface curves away there; 0: it does not
    roundness: float  # rise of squared nearness inward, per px; below 0 toward the left, up


class Ends(NamedTuple):
    """Ends of curved surfaces around a corner of the lattice."""

    members: int  # bits of the samples that are the nearer ones of silhouettes
    turns: int  # silhouettes where surfaces curve away
    x: float  # px, the silhouettes' middle from the corner
    y: float
    nearness: Four  # there, of each sample's surface; 0: it does not curve away
    round_x: float  # squared nearness per px, outward
    round_y: float


@kernel
def end_of(
    nearness: Floats, links: Links, error: Doubles, row: int, column: int, down: bool, sign: int
) -> tuple[float, float]:
    """Nearness and roundness at the end of a surface after a sample toward `sign`.

    Both are 0 where it does not curve away. Nearness exceeds that at the end by the root of
    roundness times distance.
    """
    # Require two samples behind on the same surface.
    back = (UP if sign > 0 else DOWN) if down else (LEFT if sign > 0 else RIGHT)
    dr, dc = (sign, 0) if down else (0, sign)
    if not (links[row, column] & back and links[row - dr, column - dc] & back):
        return 0.0, 0.0
    # Require steps that fall clearly beyond the depth's error.
    here, inner = float(nearness[row, column]), float(nearness[row - dr, column - dc])
    last, previous = here - inner, inner - float(nearness[row - 2 * dr, column - 2 * dc])
    if not (last < 0.0 and -previous > CLEAR * (inner * error[0] + error[1])):
        return 0.0, 0.0
    # Fit the square root; reject an end too far from the last sample.
    turn = limb(previous / last)
    if turn > FARTHEST:
        return 0.0, 0.0
    scale = last / (math.sqrt(turn) - math.sqrt(turn + 1.0))
    return max(here - scale * math.sqrt(turn), 0.01 * here), scale * scale


@kernel
def _end(
    nearness: Floats, links: Links, silhouettes: Silhouettes, row: int, column: int, side: int
) -> SilhouetteEnd:
    """Return one of the silhouettes around a corner: above, below, left, right."""
    edge, error = silhouettes
    # Find the pair of samples that it runs between.
    down, second = side >= 2, side % 2
    r, c = (row - 1, column - 1 + second) if down else (row - 1 + second, column - 1)
    t = float(edge[r, c, 1 if down else 0])
    if t < 0.0:
        return SilhouetteEnd(-1, 0.0, 0.0, 0.0, 0.0)
    # Take the nearer of the two as the surface that ends.
    r_next, c_next = (row, c) if down else (r, column)
    sign = 1 if nearness[r, c] > nearness[r_next, c_next] else -1
    if sign < 0:
        r, c = r_next, c_next
    near, roundness = end_of(nearness, links, error, r, c, down, sign)
    # Measure the end from the corner.
    along, beside = sign * (t - 0.5), second - 0.5
    x, y = (beside, along) if down else (along, beside)
    return SilhouetteEnd(2 * (r - row + 1) + c - column + 1, x, y, near, sign * roundness)


@kernel
def ends_around(
    nearness: Floats, links: Links, silhouettes: Silhouettes, row: int, column: int
) -> Ends:
    """Collect the ends around a corner of the lattice within the frame."""
    members, count, x, y = 0, 0, 0.0, 0.0
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    rounds, counts = (0.0, 0.0), (0, 0)
    for side in range(4):
        end = _end(nearness, links, silhouettes, row, column, side)
        if end.member < 0:
            continue
        # Note the surface, and go on only if it curves away.
        members |= 1 << end.member
        if not end.nearness > 0.0:
            continue
        # Sum places, roundness along the axis, and nearness per surface.
        x, y, count = x + end.x, y + end.y, count + 1
        if side < 2:
            rounds, counts = (rounds[0] + end.roundness, rounds[1]), (counts[0] + 1, counts[1])
        else:
            rounds, counts = (rounds[0], rounds[1] + end.roundness), (counts[0], counts[1] + 1)
        member, near = end.member, end.nearness
        a, b, c, d = _with(member, near, (a, b, c, d))
    # Take the means.
    share = 1.0 / max(count, 1)
    round_x, round_y = rounds[0] / max(counts[0], 1), rounds[1] / max(counts[1], 1)
    return Ends(members, count, share * x, share * y, (a, b, c, d), round_x, round_y)


@kernel
def _with(member: int, value: float, four: Four) -> Four:
    """Replace one of four values."""
    a, b, c, d = four
    return (
        value if member == 0 else a, value if member == 1 else b,
        value if member == 2 else c, value if member == 3 else d,
    )  # fmt: skip


@kernel
def _beside(nearness: Floats, row: int, column: int, down: bool, sign: int) -> float:
    """Nearness of the next sample; 0 beyond the frame."""
    r, c = (row + sign, column) if down else (row, column + sign)
    is_inside = 0 <= r < nearness.shape[0] and 0 <= c < nearness.shape[1]
    return float(nearness[r, c]) if is_inside else 0.0


@kernel
def _mark_row(nearness: Floats, links: Links, error: Doubles, row: int, marked: Links) -> None:
    """Mark a row; see `mark_ends`."""
    whole = LEFT | RIGHT | UP | DOWN
    for column in range(nearness.shape[1]):
        bits = links[row, column]
        marked[row, column] = bits
        # Samples inside a surface have no end.
        if bits == whole or not nearness[row, column] > 0:
            continue
        # Test the four sides that border on a farther surface.
        for k in range(4):
            down, sign = k % 2 == 1, 1 if k < 2 else -1
            beyond = _beside(nearness, row, column, down, sign)
            if not bits & np.uint8(1 << k) and 0 < beyond < nearness[row, column]:
                end, _ = end_of(nearness, links, error, row, column, down, sign)
                marked[row, column] |= np.uint8((TURNS << k) if end > 0.0 else 0)


@parallel_kernel
def mark_ends(
    counter: Counter, nearness: Floats, links: Links, error: Doubles, marked: Links
) -> None:
    """Mark the sides of links (H, W) on which surfaces curve away: TURNS times each.

    `error` is as in `Silhouettes`.
    """
    for row in tasks(counter, nearness.shape[0]):
        _mark_row(nearness, links, error, row, marked)


@kernel
def rise_of(
    matrix: Doubles, epipole: Doubles, corner: Floats, roundness: Floats, seen: tuple[float, float]
) -> float:
    """Rise of nearness from a surface's end to its silhouette in the target.

    `corner`: (3,) x, y and nearness of the end. `roundness`: (2,) as in `project_ends`. `seen`:
    place of the end in the target, px.
    """
    # Take the outward direction, and the scale of the warp at the end.
    x, y, near = float(corner[0]), float(corner[1]), float(corner[2])
    length = math.hypot(roundness[0], roundness[1])
    out_x, out_y = roundness[0] / length, roundness[1] / length
    scale = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] + near * epipole[2]
    # Differentiate the place on the screen, times the scale: outward, along the end, by nearness.
    xx, xy = matrix[0, 0] - seen[0] * matrix[2, 0], matrix[0, 1] - seen[0] * matrix[2, 1]
    yx, yy = matrix[1, 0] - seen[1] * matrix[2, 0], matrix[1, 1] - seen[1] * matrix[2, 1]
    ahead_x, ahead_y = xx * out_x + xy * out_y, yx * out_x + yy * out_y
    side_x, side_y = xy * out_x - xx * out_y, yy * out_x - yx * out_y
    near_x, near_y = epipole[0] - seen[0] * epipole[2], epipole[1] - seen[1] * epipole[2]
    along = ahead_x * side_y - ahead_y * side_x
    rise = 0.0
    # The silhouette is where moving by nearness cancels moving by distance, across the end.
    if along != 0.0:
        rise = 0.5 * length * (near_x * side_y - near_y * side_x) / along
    speed = max(math.hypot(near_x, near_y) / abs(scale), 1e-30)
    # Keep an inset: a surface seen from the source's viewpoint ends as there, without a gap beside.
    least = min(math.sqrt(length * INSET), INSET_PX / speed, INSET_BY_NEARNESS * abs(rise))
    return float(min(max(rise, least), math.sqrt(length)))


@kernel
def _project_end(
    matrix: Doubles, epipole: Doubles, corner: Floats, roundness: Floats, screen: Floats
) -> None:
    """Project one corner; see `project_ends`."""
    x, y, near = float(corner[0]), float(corner[1]), float(corner[2])
    seen_x, seen_y, seen = projected(matrix, epipole, x, y, near)
    # Move the corner inward along the curved surface, to the target's silhouette.
    if seen > 0:
        rise = rise_of(matrix, epipole, corner, roundness, (seen_x, seen_y))
        squared = roundness[0] * roundness[0] + roundness[1] * roundness[1]
        back = rise * rise / squared
        x, y = x - back * roundness[0], y - back * roundness[1]
        seen_x, seen_y, seen = projected(matrix, epipole, x, y, near + rise)
    screen[0], screen[1], screen[2] = seen_x, seen_y, seen


@parallel_kernel
def project_ends(
    counter: Counter, corner: Floats, which: Indices, roundness: Floats, matrix: Doubles,
    epipole: Doubles, screen: Floats,
) -> None:  # fmt: skip
    """Project the ends of curved surfaces to their silhouettes in the target.

    That is the same place if the target sees farther around; otherwise it is where the surface
    curves away from the target.

    `corner`: (N, 4, 3) as `corners.fill_torn` writes them. `which`: (M, 2) rows of `corner`, and
    which of the four corners. `roundness`: (M, 2) rise of squared nearness inward, per px, along x
    and y; outward is above 0. `matrix`, `epipole`: of the warping equation. `screen`: (N, 4, 3) of
    `screen.project_corners`, in which those corners are overwritten.
    """
    for n in tasks(counter, which.shape[0]):
        row, k = which[n, 0], which[n, 1]
        _project_end(matrix, epipole, corner[row, k], roundness[n], screen[row, k])
