"""Corners of samples: a depth image as a sheet of cells, torn at surfaces' ends.

A cell is a sample's pixel; linked neighbours share the nearness of the corners between them, so the
sheet has no cracks. At a tear each surface extends to the silhouette, with the curvature of its
last samples.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_warp3d.depth.kernels.outlines import limb
from resample_warp3d.sheet.kernels.limbs import Ends, Silhouettes, ends_around
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links

Indices = NDArray[np.int32]
Four = tuple[bool, bool, bool, bool]

OVERHANG = 0.5  # px that the outermost samples extend beyond the frame
BENT = 0.65  # share of the last step of nearness by which the next step may differ


@kernel
def change(
    nearness: Floats, links: Links, row: int, column: int, offset: float, down: bool
) -> float:
    """Change of nearness `offset` px from a sample's center, along an axis."""
    # Orient the axis so that the offset is ahead.
    dr, dc = (1, 0) if down else (0, 1)
    ahead, back = (DOWN, UP) if down else (RIGHT, LEFT)
    if offset < 0:
        dr, dc, ahead, back = -dr, -dc, back, ahead
    distance = abs(offset)
    here = float(nearness[row, column])
    is_ahead, is_back = links[row, column] & ahead != 0, links[row, column] & back != 0

    # Inside a surface, take the central difference.
    if is_ahead and is_back:
        return float(
            distance * 0.5 * (nearness[row + dr, column + dc] - nearness[row - dr, column - dc])
        )

    # At the back end, take the step ahead.
    if is_ahead:
        return float(distance * (nearness[row + dr, column + dc] - here))
    if not is_back:
        return 0.0

    # At the front end, extrapolate by the last two steps.
    inner = float(nearness[row - dr, column - dc])
    last = here - inner
    bend = 0.0
    if links[row - dr, column - dc] & back:
        previous = inner - nearness[row - 2 * dr, column - 2 * dc]
        # Do not extrapolate beyond a ridge.
        if last * previous <= 0:
            return 0.0
        # Where the surface curves away, nearness falls like a square root.
        if last < 0:
            turn = limb(previous / last)
            if turn < 9.0:
                scale = last / (math.sqrt(turn) - math.sqrt(turn + 1.0))
                return scale * (math.sqrt(max(0.0, turn - distance)) - math.sqrt(turn))
        # Otherwise continue with the change between the steps, limited.
        bend = max(0.0, 1.0 - previous / last)
        bend = min(bend, BENT) * last
    return distance * last + 0.5 * distance * (distance + 1.0) * bend


@kernel
def _is_inner(links: Links, row: int, column: int) -> bool:
    """Whether the four samples around a corner of the lattice are linked all around."""
    height, width = links.shape
    if not (0 < row < height and 0 < column < width):
        return False
    return bool(
        links[row - 1, column - 1] & RIGHT != 0
        and links[row, column - 1] & RIGHT != 0
        and links[row - 1, column - 1] & DOWN != 0
        and links[row - 1, column] & DOWN != 0
    )


@kernel
def _extended(nearness: Floats, links: Links, row: int, column: int, x: float, y: float) -> float:
    """Nearness of a sample's surface at an offset from its center; kept above 0."""
    here = float(nearness[row, column])
    x_change = change(nearness, links, row, column, x, False)
    y_change = change(nearness, links, row, column, y, True)
    return max(here + x_change + y_change, 0.01 * here)


@kernel
def _smooth_vertices(nearness: Floats, links: Links, row: int, vertex: Floats) -> None:
    """Corners of four samples that are linked to all their neighbours; 0 for others.

    Means of the four extrapolations by central differences; branch-free for SIMD.
    """
    whole = LEFT | RIGHT | UP | DOWN
    r, one, two = np.uint64(row), np.uint64(1), np.uint64(2)
    for column in range(2, nearness.shape[1] - 1):
        c = np.uint64(column)
        # Test all links of the four samples at once.
        bits = links[r - one, c - one] & links[r - one, c] & links[r, c - one] & links[r, c]
        # Sum the inner four and the outer eight samples.
        inner = nearness[r - one, c - one] + nearness[r - one, c]
        inner += nearness[r, c - one] + nearness[r, c]
        outer = nearness[r - two, c - one] + nearness[r - two, c]
        outer += nearness[r + one, c - one] + nearness[r + one, c]
        outer += nearness[r - one, c - two] + nearness[r, c - two]
        outer += nearness[r - one, c + one] + nearness[r, c + one]
        smooth = np.float32(0.375) * inner - np.float32(0.0625) * outer
        vertex[r, c] = smooth if bits == whole else np.float32(0)


@kernel
def _fill_vertices(nearness: Floats, links: Links, row: int, vertex: Floats) -> None:
    """Write a row of corners: first smooth ones, then those with open links."""
    vertex[row, :] = 0
    if 2 <= row < nearness.shape[0] - 1:
        _smooth_vertices(nearness, links, row, vertex)
    # Average the extrapolations of the four samples, by the neighbours that each has.
    for column in range(vertex.shape[1]):
        if vertex[row, column] == 0 and _is_inner(links, row, column):
            vertex[row, column] = np.float32(
                0.25
                * (
                    _extended(nearness, links, row - 1, column - 1, 0.5, 0.5)
                    + _extended(nearness, links, row - 1, column, -0.5, 0.5)
                    + _extended(nearness, links, row, column - 1, 0.5, -0.5)
                    + _extended(nearness, links, row, column, -0.5, -0.5)
                )
            )


@parallel_kernel
def fill_vertices(counter: Counter, nearness: Floats, links: Links, vertex: Floats) -> None:
    """Write the nearness at corners (H + 1, W + 1); 0 where the sheet is torn."""
    for row in tasks(counter, vertex.shape[0]):
        _fill_vertices(nearness, links, row, vertex)


def number_torn(nearness: Floats, vertex: Floats, index: Indices) -> int:
    """Number the cells with their own corners; −1 for the others, −2 for none."""
    shared = vertex > 0
    is_whole = shared[:-1, :-1] & shared[:-1, 1:] & shared[1:, :-1] & shared[1:, 1:]
    is_torn = (nearness > 0) & ~is_whole
    count = int(np.count_nonzero(is_torn))
    index[:] = np.where(nearness > 0, -1, -2)
    index[is_torn] = np.arange(count)
    return count


@kernel
def _shift(nearness: Floats, edge: Floats, row: int, column: int, down: bool) -> float:
    """Offset of a corner along an axis to the silhouettes beside it, px."""
    # Extend the sheet at the frame's border.
    height, width = nearness.shape
    place, last = (row, height) if down else (column, width)
    if place == 0:
        return -OVERHANG
    if place == last:
        return OVERHANG
    # Average the silhouettes on both sides of the corner, as offsets from the middle.
    total, count = 0.0, 0
    for side in range(2):
        if down:
            r, c, r_next, c_next = row - 1, column - 1 + side, row, column - 1 + side
        else:
            r, c, r_next, c_next = row - 1 + side, column - 1, row - 1 + side, column
        if r < 0 or c < 0 or r_next >= height or c_next >= width:
            continue
        t = edge[r, c, 1 if down else 0]
        if t < 0:
            continue
        # Silhouettes are measured from the nearer sample.
        is_near = nearness[r, c] > nearness[r_next, c_next]
        total += t - 0.5 if is_near else 0.5 - t
        count += 1
    return total / count if count else 0.0


@kernel
def _linked(links: Links, row: int, column: int, member: int) -> tuple[bool, bool, bool, bool]:
    """Flags of the samples around a corner on the surface of one of them.

    Members: 0 above left, 1 above right, 2 below left, 3 below right of the corner.
    """
    # Read the four links between the samples.
    height, width = links.shape
    up, low, left, right = row > 0, row < height, column > 0, column < width
    top = up and left and right and links[row - 1, column - 1] & RIGHT != 0
    bottom = low and left and right and links[row, column - 1] & RIGHT != 0
    before = left and up and low and links[row - 1, column - 1] & DOWN != 0
    after = right and up and low and links[row - 1, column] & DOWN != 0
    # Flood from the member; three steps go all around.
    a, b, c, d = member == 0, member == 1, member == 2, member == 3
    for _ in range(3):
        if top and (a or b):
            a, b = True, True
        if bottom and (c or d):
            c, d = True, True
        if before and (a or c):
            a, c = True, True
        if after and (b or d):
            b, d = True, True
    return a, b, c, d


@kernel
def _torn_corner(
    nearness: Floats, links: Links, row: int, column: int, is_member: Four, x: float, y: float
) -> float:
    """Nearness at a shifted corner: mean of its members' extrapolations."""
    a, b, c, d = is_member
    total, count = 0.0, 0
    if a:
        total += _extended(nearness, links, row - 1, column - 1, 0.5 + x, 0.5 + y)
        count += 1
    if b:
        total += _extended(nearness, links, row - 1, column, x - 0.5, 0.5 + y)
        count += 1
    if c:
        total += _extended(nearness, links, row, column - 1, 0.5 + x, y - 0.5)
        count += 1
    if d:
        total += _extended(nearness, links, row, column, x - 0.5, y - 0.5)
        count += 1
    return total / count


@kernel
def _end_of_surface(is_member: Four, ends: Ends) -> float:
    """Mean nearness at which a surface curves away; 0 if it does not."""
    total, count = 0.0, 0
    for k in range(4):
        if is_member[k] and ends.nearness[k] > 0.0:
            total += ends.nearness[k]
            count += 1
    return total / max(count, 1)


@kernel
def _is_one(links: Links, row: int, column: int, members: int) -> bool:
    """Whether samples around a corner, given as bits, are on one surface."""
    for member in range(4):
        if members >> member & 1:
            a, b, c, d = _linked(links, row, column, member)
            return members & ~(int(a) | int(b) << 1 | int(c) << 2 | int(d) << 3) == 0
    return True


@kernel
def _fill_corner(
    nearness: Floats, links: Links, silhouettes: Silhouettes, row: int, column: int, member: int,
    corner: Floats, roundness: Floats,
) -> None:  # fmt: skip
    """Write a shifted corner of the lattice for the surface of one of its members."""
    # Move the corner to the silhouettes beside it.
    x = _shift(nearness, silhouettes.edge, row, column, False)
    y = _shift(nearness, silhouettes.edge, row, column, True)
    is_member, near = _linked(links, row, column, member), 0.0
    roundness[0], roundness[1] = 0, 0
    # Prefer the smooth curve of silhouettes where a surface curves away.
    if 0 < row < nearness.shape[0] and 0 < column < nearness.shape[1]:
        ends = ends_around(nearness, links, silhouettes, row, column)
        near = _end_of_surface(is_member, ends)
        if ends.turns and _is_one(links, row, column, ends.members):
            x, y = ends.x, ends.y
        if near > 0.0:
            roundness[0], roundness[1] = np.float32(ends.round_x), np.float32(ends.round_y)
    # Otherwise extrapolate the members' surfaces to the corner.
    if not near > 0.0:
        near = _torn_corner(nearness, links, row, column, is_member, x, y)
    corner[0], corner[1], corner[2] = np.float32(column + x), np.float32(row + y), np.float32(near)


@kernel
def _fill_torn(
    nearness: Floats, links: Links, silhouettes: Silhouettes, index: Indices, row: int,
    corner: Floats, roundness: Floats,
) -> None:  # fmt: skip
    """Write the corners of a row's torn cells; see `fill_torn`."""
    for column in range(nearness.shape[1]):
        n = index[row, column]
        if n < 0:
            continue
        # The cell is the opposite member of each of its corners.
        for k in range(4):
            r, c = row + k // 2, column + k % 2
            _fill_corner(nearness, links, silhouettes, r, c, 3 - k, corner[n, k], roundness[n, k])


@parallel_kernel
def fill_torn(
    counter: Counter, nearness: Floats, links: Links, silhouettes: Silhouettes, index: Indices,
    corner: Floats, roundness: Floats,
) -> None:  # fmt: skip
    """Write the corners of torn cells, which have their own.

    `index`: (H, W) as `number_torn` writes it. `corner`: (N, 4, 3) filled: x and y in px of the
    source and the nearness there; top left, top right, bottom left, bottom right. `roundness`: (N,
    4, 2) filled: squared nearness per px, outward, where a surface curves away; else 0.
    """
    for row in tasks(counter, nearness.shape[0]):
        _fill_torn(nearness, links, silhouettes, index, row, corner, roundness)
