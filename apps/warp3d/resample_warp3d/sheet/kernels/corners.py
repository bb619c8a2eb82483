"""Corners of samples: a depth image as a sheet of cells, torn at surfaces' ends.

A cell is a sample's pixel; linked neighbours share the nearness of the corners between them, so the
sheet has no cracks. At a tear each surface extends to the silhouette, with the curvature of its
last samples.

Silhouettes of curved surfaces are smooth curves instead of stairs of samples. Where a surface
curves away, nearness beyond the last sample along an axis falls like a square root
(`outlines.limb`), which tells the nearness at the surface's end. A corner of the lattice beside
such ends moves to the middle between them, on the curve, and takes the nearness there. Colors are
compressed along the surface as the root is.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.depth.kernels.outlines import CLEAR, limb
from resample_warp3d.sheet.kernels.screen import Indices, projected
from resample_warp3d.types import DOWN, LEFT, RIGHT, TURNS, UP, Links

FARTHEST = 1.5  # samples from the last one to a surface's end, at most, as its depth predicts it
INSET = 0.1  # samples that a surface ends before that: its outermost rim has no color of its own
INSET_PX = 0.5  # the same on the target's screen, at most
INSET_BY_NEARNESS = 2.0  # the same, over the rise to the target's silhouette (`rise_of`), at most

Four = tuple[float, float, float, float]
Members = tuple[bool, bool, bool, bool]

OVERHANG = 0.5  # px that the outermost samples extend beyond the frame
BENT = 0.65  # share of the last step of nearness by which the next step may differ


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
def ends_around(
    nearness: Floats, links: Links, edge: Floats, error: Doubles, row: int, column: int
) -> tuple[int, int, float, float, Four, tuple[float, float]]:
    """Collect the ends around a corner of the lattice within the frame.

    Returns bits of the samples that are the nearer ones of silhouettes; how many surfaces curve
    away; the middle of their ends from the corner, px; the nearness there of each sample's surface,
    0 if it does not curve away; and their squared nearness per px, outward, along x and y.
    """
    members, count, x, y = 0, 0, 0.0, 0.0
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    rounds, counts = (0.0, 0.0), (0, 0)
    for side in range(4):  # above, below, left, right
        # Find the pair of samples that a silhouette runs between.
        down, second = side >= 2, side % 2
        r, k = (row - 1, column - 1 + second) if down else (row - 1 + second, column - 1)
        t = float(edge[r, k, 1 if down else 0])
        if t < 0.0:
            continue
        # Take the nearer of the two as the surface that ends.
        r_next, k_next = (row, k) if down else (r, column)
        sign = 1 if nearness[r, k] > nearness[r_next, k_next] else -1
        if sign < 0:
            r, k = r_next, k_next
        near, roundness = end_of(nearness, links, error, r, k, down, sign)
        # Note the surface, and go on only if it curves away.
        member = 2 * (r - row + 1) + k - column + 1
        members |= 1 << member
        if not near > 0.0:
            continue
        # Sum places from the corner, roundness along the axis, and nearness per surface.
        along, beside, count = sign * (t - 0.5), second - 0.5, count + 1
        x, y = (x + beside, y + along) if down else (x + along, y + beside)
        roundness *= sign
        if down:
            rounds, counts = (rounds[0], rounds[1] + roundness), (counts[0], counts[1] + 1)
        else:
            rounds, counts = (rounds[0] + roundness, rounds[1]), (counts[0] + 1, counts[1])
        a, b = near if member == 0 else a, near if member == 1 else b
        c, d = near if member == 2 else c, near if member == 3 else d
    # Take the means.
    share = 1.0 / max(count, 1)
    outward = rounds[0] / max(counts[0], 1), rounds[1] / max(counts[1], 1)
    return members, count, share * x, share * y, (a, b, c, d), outward


@parallel_kernel
def mark_ends(
    counter: Counter, nearness: Floats, links: Links, error: Doubles, marked: Links
) -> None:
    """Mark the sides of links (H, W) on which surfaces curve away: TURNS times each."""
    for row in tasks(counter, nearness.shape[0]):
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
                r, c = (row + sign, column) if down else (row, column + sign)
                is_inside = 0 <= r < nearness.shape[0] and 0 <= c < nearness.shape[1]
                beyond = float(nearness[r, c]) if is_inside else 0.0
                if not bits & np.uint8(1 << k) and 0 < beyond < nearness[row, column]:
                    end, _ = end_of(nearness, links, error, row, column, down, sign)
                    marked[row, column] |= np.uint8((TURNS << k) if end > 0.0 else 0)


@kernel
def rise_of(
    matrix: Doubles, epipole: Doubles, corner: Floats, roundness: Floats, seen: tuple[float, float]
) -> float:
    """Rise of nearness from a surface's end to its silhouette in the target.

    `corner`: (3,) x, y and nearness of the end. `roundness`: (2,) as of `project_ends`. `seen`:
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


@parallel_kernel
def project_ends(
    counter: Counter, corner: Floats, which: Indices, roundness: Floats, matrix: Doubles,
    epipole: Doubles, screen: Floats,
) -> None:  # fmt: skip
    """Project the ends of curved surfaces to their silhouettes in the target.

    `corner`: (N, 4, 3) of `fill_torn`. `which`: (M, 2) rows of `corner`, and which of four corners.
    `roundness`: (M, 2) rise of squared nearness inward, per px; outward is above 0. `screen`: (N,
    4, 3) of `screen.project_corners`, in which those corners are overwritten.
    """
    for n in tasks(counter, which.shape[0]):
        row, k = which[n, 0], which[n, 1]
        end, out = corner[row, k], roundness[n]
        x, y, near = float(end[0]), float(end[1]), float(end[2])
        seen_x, seen_y, seen = projected(matrix, epipole, x, y, near)
        # Move the corner inward along the curved surface, to the target's silhouette.
        if seen > 0:
            rise = rise_of(matrix, epipole, end, out, (seen_x, seen_y))
            back = rise * rise / (out[0] * out[0] + out[1] * out[1])
            x, y = x - back * out[0], y - back * out[1]
            seen_x, seen_y, seen = projected(matrix, epipole, x, y, near + rise)
        screen[row, k, 0], screen[row, k, 1], screen[row, k, 2] = seen_x, seen_y, seen


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


@parallel_kernel
def fill_vertices(counter: Counter, nearness: Floats, links: Links, vertex: Floats) -> None:
    """Write the nearness at corners (H + 1, W + 1); 0 where the sheet is torn."""
    for row in tasks(counter, vertex.shape[0]):
        # First the smooth ones, then those with open links.
        vertex[row, :] = 0
        if 2 <= row < nearness.shape[0] - 1:
            _smooth_vertices(nearness, links, row, vertex)
        # Average the extrapolations of the four samples, by the neighbours that each has.
        for column in range(vertex.shape[1]):
            if vertex[row, column] == 0 and _is_inner(links, row, column):
                mean = _extended(nearness, links, row - 1, column - 1, 0.5, 0.5)
                mean += _extended(nearness, links, row - 1, column, -0.5, 0.5)
                mean += _extended(nearness, links, row, column - 1, 0.5, -0.5)
                mean += _extended(nearness, links, row, column, -0.5, -0.5)
                vertex[row, column] = np.float32(0.25 * mean)


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
    nearness: Floats, links: Links, row: int, column: int, is_member: Members, x: float, y: float
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
def _is_one(links: Links, row: int, column: int, members: int) -> bool:
    """Whether samples around a corner, given as bits, are on one surface."""
    for member in range(4):
        if members >> member & 1:
            a, b, c, d = _linked(links, row, column, member)
            return members & ~(int(a) | int(b) << 1 | int(c) << 2 | int(d) << 3) == 0
    return True


@kernel
def _fill_corner(
    nearness: Floats, links: Links, edge: Floats, error: Doubles, row: int, column: int,
    member: int, corner: Floats, roundness: Floats,
) -> None:  # fmt: skip
    """Write a shifted corner of the lattice for the surface of one of its members."""
    # Move the corner to the silhouettes beside it.
    x = _shift(nearness, edge, row, column, False)
    y = _shift(nearness, edge, row, column, True)
    is_member, near = _linked(links, row, column, member), 0.0
    roundness[0], roundness[1] = 0, 0
    # Prefer the smooth curve of silhouettes where a surface curves away.
    if 0 < row < nearness.shape[0] and 0 < column < nearness.shape[1]:
        members, turns, end_x, end_y, nearest, outward = ends_around(
            nearness, links, edge, error, row, column
        )
        # Mean nearness at which the surface curves away.
        count = 0
        for k in range(4):
            if is_member[k] and nearest[k] > 0.0:
                near += nearest[k]
                count += 1
        near /= max(count, 1)
        if turns and _is_one(links, row, column, members):
            x, y = end_x, end_y
        if near > 0.0:
            roundness[0], roundness[1] = np.float32(outward[0]), np.float32(outward[1])
    # Otherwise extrapolate the members' surfaces to the corner.
    if not near > 0.0:
        near = _torn_corner(nearness, links, row, column, is_member, x, y)
    corner[0], corner[1], corner[2] = np.float32(column + x), np.float32(row + y), np.float32(near)


@parallel_kernel
def fill_torn(
    counter: Counter, nearness: Floats, links: Links, edge: Floats, error: Doubles,
    index: Indices, corner: Floats, roundness: Floats,
) -> None:  # fmt: skip
    """Write the corners of torn cells, which have their own.

    `edge`: (H, W, 2) of `outlines.find_silhouettes`. `error`: (2,) of the nearness, relative and
    absolute. `index`: (H, W) of `number_torn`. `corner`: (N, 4, 3) filled: x and y in px of the
    source and the nearness there; top left, top right, bottom left, bottom right. `roundness`: (N,
    4, 2) filled: squared nearness per px, outward, where a surface curves away; else 0.
    """
    for row in tasks(counter, nearness.shape[0]):
        for column in range(nearness.shape[1]):
            n = index[row, column]
            if n < 0:
                continue
            # The cell is the opposite member of each of its corners.
            for k in range(4):
                r, c = row + k // 2, column + k % 2
                _fill_corner(
                    nearness, links, edge, error, r, c, 3 - k, corner[n, k], roundness[n, k]
                )
