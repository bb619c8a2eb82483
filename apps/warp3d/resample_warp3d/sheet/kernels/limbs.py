"""Where surfaces turn away: their ends lie on one smooth curve instead of on stairs of samples.

Beyond the last sample along an axis nearness falls like a square root (`outlines.limb`), which
tells how near the surface is where it ends. A corner of the lattice beside such ends moves to the
middle between them, on the curve, and has the nearness that the surface has there. Colors run
along the surface as the root does, too.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.depth.kernels.outlines import CLEAR, limb
from resample_warp3d.sheet.kernels.screen import Indices, seen_at
from resample_warp3d.types import DOWN, LEFT, RIGHT, TURNS, UP, Links

FARTHEST = 1.5  # samples from the last one to where a surface turns away, by its depth
INSET = 0.1  # samples that a surface ends before that: its outermost rim has no color of its own
INSET_PX = 0.5  # the same on the target's screen, at most
INSET_BEYOND = 2.0  # the same in nearness, by its fall to where the target sees farther around

Four = tuple[float, float, float, float]


class Silhouettes(NamedTuple):
    """Where silhouettes run."""

    edge: Floats  # (H, W, 2) of `outlines.find_silhouettes`
    error: Doubles  # (2,) of the nearness: relative, and absolute


class End(NamedTuple):
    """Where the nearer surface of a silhouette between two samples ends."""

    member: int  # its sample, as of `corners._linked`; −1: there is no silhouette
    x: float  # px from the corner of the lattice
    y: float
    nearness: float  # there, if the surface turns away; 0: it does not
    roundness: float  # how fast squared nearness rises inward, per px; below 0 toward the left, up


class Ends(NamedTuple):
    """Where surfaces turn away around a corner of the lattice."""

    members: int  # bits of the samples that are the nearer ones of silhouettes
    turns: int  # silhouettes where surfaces turn away
    x: float  # px, the middle of those from the corner
    y: float
    nearness: Four  # there, of each sample's surface; 0: it does not turn away
    round_x: float  # squared nearness per px, outward
    round_y: float


@kernel
def end_of(
    nearness: Floats, links: Links, error: Doubles, row: int, column: int, down: bool, sign: int
) -> tuple[float, float]:
    """Nearness where a surface turns away after a sample toward `sign`, and how round it is there.

    Both are 0 where it does not turn away. Nearness is above that at the end by the root of
    roundness times distance.
    """
    back = (UP if sign > 0 else DOWN) if down else (LEFT if sign > 0 else RIGHT)
    dr, dc = (sign, 0) if down else (0, sign)
    if not (links[row, column] & back and links[row - dr, column - dc] & back):
        return 0.0, 0.0
    here, inner = float(nearness[row, column]), float(nearness[row - dr, column - dc])
    last, previous = here - inner, inner - float(nearness[row - 2 * dr, column - 2 * dc])
    if not (last < 0.0 and -previous > CLEAR * (inner * error[0] + error[1])):
        return 0.0, 0.0
    turn = limb(previous / last)
    if turn > FARTHEST:
        return 0.0, 0.0
    scale = last / (math.sqrt(turn) - math.sqrt(turn + 1.0))
    return max(here - scale * math.sqrt(turn), 0.01 * here), scale * scale


@kernel
def _end(
    nearness: Floats, links: Links, silhouettes: Silhouettes, row: int, column: int, side: int
) -> End:
    """One of the four silhouettes around a corner: above, below, left, right of it."""
    edge, error = silhouettes
    down, second = side >= 2, side % 2
    r, c = (row - 1, column - 1 + second) if down else (row - 1 + second, column - 1)
    t = float(edge[r, c, 1 if down else 0])
    if t < 0.0:
        return End(-1, 0.0, 0.0, 0.0, 0.0)
    r_next, c_next = (row, c) if down else (r, column)
    sign = 1 if nearness[r, c] > nearness[r_next, c_next] else -1
    if sign < 0:
        r, c = r_next, c_next
    near, roundness = end_of(nearness, links, error, r, c, down, sign)
    along, beside = sign * (t - 0.5), second - 0.5
    x, y = (beside, along) if down else (along, beside)
    return End(2 * (r - row + 1) + c - column + 1, x, y, near, sign * roundness)


@kernel
def ends_around(
    nearness: Floats, links: Links, silhouettes: Silhouettes, row: int, column: int
) -> Ends:
    """Ends around a corner of the lattice within the frame."""
    members, count, x, y = 0, 0, 0.0, 0.0
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    rounds, counts = (0.0, 0.0), (0, 0)
    for side in range(4):
        end = _end(nearness, links, silhouettes, row, column, side)
        if end.member < 0:
            continue
        members |= 1 << end.member
        if not end.nearness > 0.0:
            continue
        x, y, count = x + end.x, y + end.y, count + 1
        if side < 2:
            rounds, counts = (rounds[0] + end.roundness, rounds[1]), (counts[0] + 1, counts[1])
        else:
            rounds, counts = (rounds[0], rounds[1] + end.roundness), (counts[0], counts[1] + 1)
        member, near = end.member, end.nearness
        a, b, c, d = _with(member, near, (a, b, c, d))
    share = 1.0 / max(count, 1)
    round_x, round_y = rounds[0] / max(counts[0], 1), rounds[1] / max(counts[1], 1)
    return Ends(members, count, share * x, share * y, (a, b, c, d), round_x, round_y)


@kernel
def _with(member: int, value: float, four: Four) -> Four:
    """Four values, of which one is another."""
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
    whole = LEFT | RIGHT | UP | DOWN
    for column in range(nearness.shape[1]):
        bits = links[row, column]
        marked[row, column] = bits
        if bits == whole or not nearness[row, column] > 0:
            continue
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
    """Write links (H, W) with the bits of the sides on which surfaces turn away: TURNS times each.

    `error` is as in `Silhouettes`.
    """
    for row in tasks(counter, nearness.shape[0]):
        _mark_row(nearness, links, error, row, marked)


@kernel
def rise_of(
    matrix: Doubles, epipole: Doubles, corner: Floats, roundness: Floats, seen: tuple[float, float]
) -> float:
    """How much nearer than at its end a surface is where the target sees it end.

    Parameters
    ----------
    corner
        (3,) x, y and nearness of the end.
    roundness
        (2,) as of `project_ends`.
    seen
        Where the target sees the end.
    """
    x, y, near = float(corner[0]), float(corner[1]), float(corner[2])
    length = math.hypot(roundness[0], roundness[1])
    out_x, out_y = roundness[0] / length, roundness[1] / length
    scale = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] + near * epipole[2]
    # What places on the screen change by, times the scale: outward, along the end, by nearness.
    xx, xy = matrix[0, 0] - seen[0] * matrix[2, 0], matrix[0, 1] - seen[0] * matrix[2, 1]
    yx, yy = matrix[1, 0] - seen[1] * matrix[2, 0], matrix[1, 1] - seen[1] * matrix[2, 1]
    ahead_x, ahead_y = xx * out_x + xy * out_y, yx * out_x + yy * out_y
    side_x, side_y = xy * out_x - xx * out_y, yy * out_x - yx * out_y
    near_x, near_y = epipole[0] - seen[0] * epipole[2], epipole[1] - seen[1] * epipole[2]
    along = ahead_x * side_y - ahead_y * side_x
    rise = 0.0
    if along != 0.0:  # it turns away from the target where nearness moves it as far as distance
        rise = 0.5 * length * (near_x * side_y - near_y * side_x) / along
    speed = max(math.hypot(near_x, near_y) / abs(scale), 1e-30)
    # A surface that is seen as the source sees it ends as it does there: no gap opens beside it.
    least = min(math.sqrt(length * INSET), INSET_PX / speed, INSET_BEYOND * abs(rise))
    return float(min(max(rise, least), math.sqrt(length)))


@kernel
def _project_end(
    matrix: Doubles, epipole: Doubles, corner: Floats, roundness: Floats, screen: Floats
) -> None:
    x, y, near = float(corner[0]), float(corner[1]), float(corner[2])
    seen_x, seen_y, seen = seen_at(matrix, epipole, x, y, near)
    if seen > 0:
        rise = rise_of(matrix, epipole, corner, roundness, (seen_x, seen_y))
        squared = roundness[0] * roundness[0] + roundness[1] * roundness[1]
        back = rise * rise / squared
        x, y = x - back * roundness[0], y - back * roundness[1]
        seen_x, seen_y, seen = seen_at(matrix, epipole, x, y, near + rise)
    screen[0], screen[1], screen[2] = seen_x, seen_y, seen


@parallel_kernel
def project_ends(
    counter: Counter, corner: Floats, which: Indices, roundness: Floats, matrix: Doubles,
    epipole: Doubles, screen: Floats,
) -> None:  # fmt: skip
    """Project corners where surfaces turn away to where the target sees them end.

    That is the same place if the target sees farther around; otherwise it is where the surface
    turns away from the target.

    Parameters
    ----------
    corner
        (N, 4, 3) as `corners.fill_torn` writes them.
    which
        (M, 2) rows of `corner`, and corners of them.
    roundness
        (M, 2) how fast squared nearness rises inward, per px, along x and y; outward is above 0.
    matrix, epipole
        Of the equation.
    screen
        (N, 4, 3) of `screen.project_corners`, of which those corners are written over.
    """
    for n in tasks(counter, which.shape[0]):
        row, k = which[n, 0], which[n, 1]
        _project_end(matrix, epipole, corner[row, k], roundness[n], screen[row, k])
