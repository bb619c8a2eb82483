"""Narrow gaps closed from both their sides, and the reasons of the holes that stay."""

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from resample.kernels.jit import kernel, parallel_kernel
from resample.types import Doubles, Floats
from resample_warp3d.types import Hole

NARROW = 3  # px from a gap's pixel to its farther side, at most
GROWN = 5  # px that a rim grows, at most
BLOCK = 64  # pixels of a row that are skipped together
FULL = 0.97  # coverage of a side
RIM = 1.5  # of what a cell is longer than a pixel: how uncertain the end of its surface is
SAME = 0.01  # of the nearness: sides closer together than this are one surface

Flags = NDArray[np.bool_]
Kinds = NDArray[np.uint8]

# Values of `Hole`, as kernels read them.
DISOCCLUDED, OUTSIDE, NO_DEPTH = int(Hole.DISOCCLUDED), int(Hole.OUTSIDE), int(Hole.NO_DEPTH)


@kernel
def _side(coverage: Floats, row: int, column: int, dr: int, dc: int) -> int:
    """Steps to the first full pixel in a direction; 0: none within reach."""
    height, width = coverage.shape
    for n in range(1, NARROW + 1):
        r, c = row + n * dr, column + n * dc
        if not (0 <= r < height and 0 <= c < width):
            return 0
        if coverage[r, c] >= FULL:
            return n
    return 0


@kernel
def _sides(coverage: Floats, row: int, column: int) -> tuple[int, int, int, int]:
    """Rows and columns of the two sides of the narrowest gap that a pixel lies in; −1: none."""
    best, found = NARROW + 1, (-1, -1, -1, -1)
    for k in range(4):
        dr, dc = (0, 1) if k == 0 else (1, 0) if k == 1 else (1, 1) if k == 2 else (1, -1)
        ahead = _side(coverage, row, column, dr, dc)
        back = _side(coverage, row, column, -dr, -dc)
        if ahead and back and ahead + back < best:
            best = ahead + back
            found = row + ahead * dr, column + ahead * dc, row - back * dr, column - back * dc
    return found


@kernel
def _rim(coverage: Floats, magnification: Floats, row: int, column: int) -> tuple[int, int]:
    """Row and column of the nearest full pixel whose surface may well reach this one; −1: none."""
    for n in range(1, GROWN + 1):
        for k in range(4):
            dr, dc = (0, n) if k == 0 else (n, 0) if k == 1 else (0, -n) if k == 2 else (-n, 0)
            r, c = row + dr, column + dc
            if not (0 <= r < coverage.shape[0] and 0 <= c < coverage.shape[1]):
                continue
            if coverage[r, c] >= FULL and n <= RIM * (math.sqrt(magnification[r, c]) - 1.0):
                return r, c
    return -1, -1


@kernel
def _is_far(coverage: Floats, row: int, start: int) -> bool:
    """Whether nothing is covered within reach of `BLOCK` pixels of a row."""
    height, width = coverage.shape
    for r in range(max(0, row - GROWN), min(height, row + GROWN + 1)):
        for c in range(max(0, start - GROWN), min(width, start + BLOCK + GROWN)):
            if coverage[r, c] > 0:
                return False
    return True


@kernel
def _bridge_pixel(
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
    row: int, column: int, new_coverage: Floats, bridged: Flags,
) -> None:  # fmt: skip
    r, k, s, m = _sides(coverage, row, column)
    if r < 0:
        r, k = _rim(coverage, magnification, row, column)
        s, m = r, k
    if r < 0:
        return
    # What is farther goes on behind what is nearer.
    if nearness[r, k] < nearness[s, m] * (1.0 - SAME):
        s, m = r, k
    elif nearness[s, m] < nearness[r, k] * (1.0 - SAME):
        r, k = s, m
    missing = np.float32(1) - coverage[row, column]
    for c in range(image.shape[2]):
        filling = image[r, k, c] / coverage[r, k] + image[s, m, c] / coverage[s, m]
        image[row, column, c] += missing * np.float32(0.5) * filling
    new_coverage[row, column] = 1
    if coverage[row, column] < 0.5:
        nearness[row, column] = np.float32(0.5) * (nearness[r, k] + nearness[s, m])
        magnification[row, column] = magnification[r, k]
        bridged[row, column] = True


@kernel
def _bridge_row(
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats, row: int,
    new_coverage: Floats, bridged: Flags,
) -> None:  # fmt: skip
    width = coverage.shape[1]
    for start in range(0, width, BLOCK):
        end = min(width, start + BLOCK)
        missing, covered = 0, 0
        for column in range(start, end):
            missing += int(coverage[row, column] < FULL)
            covered += int(coverage[row, column] > 0)
        if missing == 0 or (covered == 0 and _is_far(coverage, row, start)):
            continue
        for column in range(start, end):
            if coverage[row, column] < FULL:
                _bridge_pixel(
                    image, coverage, nearness, magnification, row, column, new_coverage, bridged,
                )  # fmt: skip


@parallel_kernel
def bridge_rows(
    image: Floats, coverage: Floats, nearness: Floats, magnification: Floats,
    new_coverage: Floats, bridged: Flags,
) -> None:  # fmt: skip
    """Close narrow gaps, and let magnified surfaces grow by as little as their ends are known.

    Parameters
    ----------
    image, coverage, nearness, magnification
        (H, W[, C]) of a picture. All but the coverage are changed, where it is below `FULL`.
    new_coverage
        Copy of the coverage, which is changed.
    bridged
        (H, W) all False; set where pixels have most of their color from there.
    """
    for row in prange(coverage.shape[0]):
        _bridge_row(
            image, coverage, nearness, magnification, int(np.int64(row)), new_coverage, bridged,
        )  # fmt: skip


@kernel
def _on_lattice(place: Doubles, x: float, y: float) -> tuple[float, float]:
    """Place on a bent source's lattice of what a camera without distortion sees at x, y."""
    height, width = place.shape[0], place.shape[1]
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
def _reason(
    back: Doubles, origin: Doubles, place: Doubles, known: Flags, x: float, y: float, near: float
) -> int:
    """Why the source shows nothing at a place of the target, if it is as near as `near`."""
    scale = back[2, 0] * x + back[2, 1] * y + back[2, 2] + near * origin[2]
    if not scale > 0:
        return OUTSIDE
    u = (back[0, 0] * x + back[0, 1] * y + back[0, 2] + near * origin[0]) / scale
    v = (back[1, 0] * x + back[1, 1] * y + back[1, 2] + near * origin[1]) / scale
    if not (abs(u) < 1e6 and abs(v) < 1e6):
        return OUTSIDE
    if place.size > 0:
        u, v = _on_lattice(place, u, v)
    if not (0 <= u < known.shape[1] and 0 <= v < known.shape[0]):
        return OUTSIDE
    return DISOCCLUDED if known[math.floor(v), math.floor(u)] else NO_DEPTH


@kernel
def _explain_row(
    coverage: Floats, nearness: Floats, back: Doubles, origin: Doubles, place: Doubles,
    known: Flags, farthest: Floats, row: int, holes: Kinds,
) -> None:  # fmt: skip
    """Type a row's holes; each is taken to be as far as the farther of its two sides in the row."""
    width = coverage.shape[1]
    column = 0
    while column < width:
        holes[row, column] = 0
        if coverage[row, column] > 0:
            column += 1
            continue
        end = column
        while end < width and not coverage[row, end] > 0:
            end += 1
        before = nearness[row, column - 1] if column > 0 else np.float32(np.inf)
        after = nearness[row, end] if end < width else np.float32(np.inf)
        near = float(min(before, after))
        if not math.isfinite(near):
            near = float(farthest[row])
        for c in range(column, end):
            holes[row, c] = _reason(back, origin, place, known, c + 0.5, row + 0.5, near)
        column = end


@parallel_kernel
def explain_holes(
    coverage: Floats, nearness: Floats, back: Doubles, origin: Doubles, place: Doubles,
    known: Flags, farthest: Floats, holes: Kinds,
) -> None:  # fmt: skip
    """Say why pixels are empty.

    Parameters
    ----------
    coverage, nearness
        (H, W) of the target.
    back, origin
        Matrix and epipole of the equation that leads back to the source.
    place
        As in `DepthImage`.
    known
        (h, w) whether the source has a depth there.
    farthest
        (H,) nearness that an empty row is taken to have.
    holes
        (H, W) filled with values of `Hole`; 0 where something is.
    """
    for row in prange(coverage.shape[0]):
        _explain_row(
            coverage, nearness, back, origin, place, known, farthest, int(np.int64(row)), holes
        )
