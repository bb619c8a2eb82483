"""Close narrow gaps from both sides, and classify the holes that stay."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.types import Equation, Hole

NARROW = 2  # px from a gap's pixel to its farther side, at most
GROWN = 5  # px that a surface grows beyond its outline, at most
FULL = 0.97  # coverage of a side
CELL_MARGIN = (
    1.5  # times a cell's excess over a pixel's length: uncertainty of its surface's outline
)
SAME = 0.01  # of the nearness: sides closer together than this are one surface

Flags = NDArray[np.bool_]
Kinds = NDArray[np.uint8]

# Values of `Hole`, as kernels read them.
DISOCCLUDED, OUTSIDE, NO_DEPTH = int(Hole.DISOCCLUDED), int(Hole.OUTSIDE), int(Hole.NO_DEPTH)


@kernel
def _side(coverage: Floats, row: int, column: int, dr: int, dc: int) -> int:
    """Steps to the first full pixel in a direction; 0: none within `NARROW`."""
    height, width = coverage.shape
    for n in range(1, NARROW + 1):
        r, c = row + n * dr, column + n * dc
        if not (0 <= r < height and 0 <= c < width):
            return 0
        if coverage[r, c] >= FULL:
            return n
    return 0


@kernel
def _extent(reach: Kinds, row: int, column: int) -> tuple[int, int]:
    """Row and column of the nearest full pixel that may extend to this one; −1: none."""
    # Search in growing distance, in the four directions along row and column.
    for n in range(1, GROWN + 1):
        for k in range(4):
            dr, dc = (0, n) if k == 0 else (n, 0) if k == 1 else (0, -n) if k == 2 else (-n, 0)
            if reach[row + dr + GROWN, column + dc + GROWN] > n:
                return row + dr, column + dc
    return -1, -1


@kernel
def _bridge_pixel(
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats, reach: Kinds,
    row: int, column: int, new_coverage: Floats, bridged: Flags,
) -> None:  # fmt: skip
    """Fill one pixel of a gap or beside an outline; see `bridge_rows`."""
    # Find both sides of the narrowest gap: along the row, the column and both diagonals.
    best, r, k, s, m = NARROW + 2, -1, -1, -1, -1
    for way in range(4):
        dr, dc = (0, 1) if way == 0 else (1, 0) if way == 1 else (1, 1) if way == 2 else (1, -1)
        ahead = _side(coverage, row, column, dr, dc)
        back = _side(coverage, row, column, -dr, -dc)
        if ahead and back and ahead + back < best:
            best = ahead + back
            r, k = row + ahead * dr, column + ahead * dc
            s, m = row - back * dr, column - back * dc
    # Or else a surface that may extend here.
    if r < 0:
        r, k = _extent(reach, row, column)
        s, m = r, k
    if r < 0:
        return
    # Continue the farther side behind the nearer one: use it for both.
    if nearness[r, k] < nearness[s, m] * (1.0 - SAME):
        s, m = r, k
    elif nearness[s, m] < nearness[r, k] * (1.0 - SAME):
        r, k = s, m
    # Fill what coverage is missing with the mean of both sides.
    missing = np.float32(1) - coverage[row, column]
    for c in range(image.shape[2]):
        filling = image[r, k, c] / coverage[r, k] + image[s, m, c] / coverage[s, m]
        image[row, column, c] += missing * np.float32(0.5) * filling
    new_coverage[row, column] = 1
    # Take depth and magnification too where most of the pixel is filled.
    if coverage[row, column] < 0.5:
        nearness[row, column] = np.float32(0.5) * (nearness[r, k] + nearness[s, m])
        magnification[row, column] = magnification[r, k]
        bridged[row, column] = True


@parallel_kernel
def reach_of_rows(counter: Counter, coverage: Floats, magnification: Floats, reach: Kinds) -> None:
    """Write how far pixels' surfaces may extend, px + 1; 0 where not full.

    `coverage`, `magnification`: (H, W) of a picture. `reach`: (H + 2 GROWN, W + 2 GROWN) zeros; all
    but a margin of `GROWN` is filled.
    """
    for row in tasks(counter, coverage.shape[0]):
        for column in range(coverage.shape[1]):
            # Larger cells leave the outline less certain, and may grow more.
            grown = CELL_MARGIN * (math.sqrt(magnification[row, column]) - 1.0)
            steps = 1 + int(max(0.0, min(grown, float(GROWN))))
            is_full = coverage[row, column] >= FULL
            reach[row + GROWN, column + GROWN] = steps if is_full else 0


@kernel
def _find_reached(reach: Kinds, row: int, reached: Kinds) -> None:
    """Mark the pixels of a row in gaps or beside outlines, branch-free for SIMD."""
    reached[:] = 0
    r, first = np.uint64(row + GROWN), GROWN
    # Mark gaps: full pixels on both sides, at most NARROW px away, in four directions.
    for k in range(4):
        dr, dc = (0, 1) if k == 0 else (1, 0) if k == 1 else (1, 1) if k == 2 else (1, -1)
        ahead, far_ahead = np.uint64(row + GROWN + dr), np.uint64(row + GROWN + 2 * dr)
        back, far_back = np.uint64(row + GROWN - dr), np.uint64(row + GROWN - 2 * dr)
        for column in range(reached.size):
            c = column + first
            is_ahead = reach[ahead, np.uint64(c + dc)] > 0
            is_back = reach[back, np.uint64(c - dc)] > 0
            is_narrow = is_ahead & is_back
            is_narrow |= is_ahead & (reach[far_back, np.uint64(c - 2 * dc)] > 0)
            is_narrow |= is_back & (reach[far_ahead, np.uint64(c + 2 * dc)] > 0)
            reached[np.uint64(column)] |= np.uint8(is_narrow)
    # Mark pixels that surfaces above, below, left or right may extend to.
    for n in range(1, GROWN + 1):
        above, below = np.uint64(row + GROWN - n), np.uint64(row + GROWN + n)
        for column in range(reached.size):
            c = column + first
            is_rim = (reach[above, np.uint64(c)] > n) | (reach[below, np.uint64(c)] > n)
            is_rim |= (reach[r, np.uint64(c - n)] > n) | (reach[r, np.uint64(c + n)] > n)
            reached[np.uint64(column)] |= np.uint8(is_rim)


@parallel_kernel
def bridge_rows(
    counter: Counter, image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
    reach: Kinds, new_coverage: Floats, bridged: Flags,
) -> None:  # fmt: skip
    """Close narrow gaps, and grow magnified surfaces up to their uncertainty.

    `image`, `coverage`, `nearness`, `magnification`: (H, W[, C]) of a picture. All but the coverage
    are changed, where it is below `FULL`. `reach`: as `reach_of_rows` writes it. `new_coverage`:
    copy of the coverage, to be changed. `bridged`: (H, W) all False; set where most of a pixel's
    color is filled in.
    """
    for row in tasks(counter, coverage.shape[0]):
        width = coverage.shape[1]
        # Leave full rows alone: most are.
        missing = 0
        for column in range(width):
            missing += int(coverage[row, column] < FULL)
        if missing == 0:
            continue
        # Test all pixels at once, then visit those marked.
        reached = np.empty(width, np.uint8)
        _find_reached(reach, row, reached)
        for column in range(width):
            if reached[column] and coverage[row, column] < FULL:
                _bridge_pixel(
                    image, coverage, nearness, magnification, reach, row, column, new_coverage,
                    bridged,
                )  # fmt: skip


@kernel
def on_lattice(place: Doubles, x: float, y: float) -> tuple[float, float]:
    """Place on a distorted source's lattice of an ideal camera's x, y."""
    height, width = place.shape[0], place.shape[1]
    # Iterate to the fixed point: distortion changes little within a pixel.
    u, v = x, y
    for _ in range(4):
        column = min(max(math.floor(u), 0), width - 1)
        row = min(max(math.floor(v), 0), height - 1)
        if not (math.isfinite(place[row, column, 0]) and math.isfinite(place[row, column, 1])):
            return u, v
        u = min(max(column + 0.5 + x - place[row, column, 0], -1e6), 1e6)
        v = min(max(row + 0.5 + y - place[row, column, 1], -1e6), 1e6)
    return u, v


@kernel
def back_projected(way: Equation, x: float, y: float, near: float) -> tuple[float, float]:
    """Project a target point into the source; NaN behind the source's camera."""
    back, origin = way.matrix, way.epipole
    scale = back[2, 0] * x + back[2, 1] * y + back[2, 2] + near * origin[2]
    u = (back[0, 0] * x + back[0, 1] * y + back[0, 2] + near * origin[0]) / scale
    v = (back[1, 0] * x + back[1, 1] * y + back[1, 2] + near * origin[1]) / scale
    return u if scale > 0 else math.nan, v


@kernel
def _reason(known: Flags, u: float, v: float) -> int:
    """Reason why the source shows nothing at u, v; branch-free for SIMD."""
    is_inside = (u >= 0) & (u < known.shape[1]) & (v >= 0) & (v < known.shape[0])
    column, row = np.int32(u if is_inside else 0.0), np.int32(v if is_inside else 0.0)
    reason = DISOCCLUDED if known[np.uint64(row), np.uint64(column)] else NO_DEPTH
    return reason if is_inside else OUTSIDE


@kernel
def _explain_hole(
    back: Equation, place: Doubles, known: Flags, near: float,
    row: int, begin: int, end: int, holes: Kinds,
) -> None:  # fmt: skip
    """Classify the pixels of a row's hole, assuming the nearness `near` in all of it."""
    # Without distortion, the loop stays free of branches.
    if place.size == 0:
        for column in range(begin, end):
            u, v = back_projected(back, column + 0.5, row + 0.5, near)
            holes[row, column] = _reason(known, u, v)
        return
    # With distortion, find the place on the lattice first.
    for column in range(begin, end):
        u, v = back_projected(back, column + 0.5, row + 0.5, near)
        if abs(u) < 1e6 and abs(v) < 1e6:
            u, v = on_lattice(place, u, v)
        holes[row, column] = _reason(known, u, v)


@parallel_kernel
def explain_holes(
    counter: Counter, coverage: Floats, nearness: Floats, back: Equation, place: Doubles,
    known: Flags, farthest: Floats, holes: Kinds,
) -> None:  # fmt: skip
    """Classify empty pixels by the reason why they are empty.

    `coverage`, `nearness`: (H, W) of the target. `back`: equation of the warp back to the source.
    `place`: as in `DepthImage`. `known`: (h, w) whether the source has a depth
    there. `farthest`: (H,) nearness that an empty row is assumed to have. `holes`: (H, W) filled
    with values of `Hole`; 0 where something is.
    """
    for row in tasks(counter, coverage.shape[0]):
        width = coverage.shape[1]
        holes[row, :] = 0
        column = 0
        while column < width:
            # Skip pixels that show something.
            if coverage[row, column] > 0:
                column += 1
                continue
            # Find the end of the hole.
            end = column
            while end < width and not coverage[row, end] > 0:
                end += 1
            # Take the farther of both sides, or the row's own guess if there is none.
            before = nearness[row, column - 1] if column > 0 else np.float32(np.inf)
            after = nearness[row, end] if end < width else np.float32(np.inf)
            near = float(min(before, after))
            if not math.isfinite(near):
                near = float(farthest[row])
            _explain_hole(back, place, known, near, row, column, end, holes)
            column = end


@parallel_kernel
def sample_map(
    counter: Counter, nearness: Floats, back: Equation, place: Doubles, trust: Floats, found: Floats
) -> None:
    """Read a map of the source where pixels of the target project back to.

    `nearness`: (H, W) of the target; 0 where nothing is. `back`: equation of the warp back to the
    source. `place`: as in `DepthImage`. `trust`: (h, w) of the source.
    `found`: (H, W) filled; 0 where nothing is.
    """
    for row in tasks(counter, nearness.shape[0]):
        height, width = trust.shape
        for column in range(nearness.shape[1]):
            found[row, column] = 0
            # Skip empty pixels.
            near = float(nearness[row, column])
            if not near > 0.0:
                continue
            # Project the pixel back into the source; undo lens distortion.
            u, v = back_projected(back, column + 0.5, row + 0.5, near)
            if not (abs(u) < 1e6 and abs(v) < 1e6):
                continue
            if place.size > 0:
                u, v = on_lattice(place, u, v)
            # Read the nearest sample.
            r, c = min(max(math.floor(v), 0), height - 1), min(max(math.floor(u), 0), width - 1)
            found[row, column] = trust[r, c]
