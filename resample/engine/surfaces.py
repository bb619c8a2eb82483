"""Surfaces over pixels: elliptical stamps, visibility, and sub-pixels to pixels."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import (
    Counter,
    called_role,
    kernel,
    making_role,
    parallel_kernel,
    plays,
    tasks,
)
from resample.types import Doubles, Floats, Single, Tiles

RIM = 11.0  # 3.3 standard deviations; 0.4 % of a Gaussian's mass lies beyond
UNIT = 1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5 * RIM)))  # peak that gives V = I the mass 1

# Rows of a line of splats: centers, px; how far they reach, px; slope and curve as in
# an `Ellipse`, 1 / V_yy; and their peaks. Without a peak there is no stamp; MASS is for callers.
X, Y, WIDE, HIGH, SLOPE, CURVE, REST, PEAK, MASS = range(9)
ROWS = 9

# exp(−z) as a polynomial, for 0 ≤ z ≤ RIM / 32; errs by 8e-8 of the value at most.
LAST_Z = np.float32(RIM / 32.0)
C0, C1, C2 = np.float32(0.99999992), np.float32(-0.99998921), np.float32(0.49975581)
C3, C4 = np.float32(-0.16469862), np.float32(0.035043686)

# A splat is weighed in stamps of up to SIDE × SIDE pixels, in one loop over all of them:
# pixel n of a stamp w pixels wide is in column ACROSS[w, n] and row DOWN[w, n].
SIDE = 16  # px
_PIXEL, _WIDTH = np.arange(SIDE * SIDE), np.maximum(np.arange(SIDE + 1), 1)[:, None]
ACROSS = (_PIXEL % _WIDTH).astype(np.float32)
DOWN = (_PIXEL // _WIDTH).astype(np.float32)


class Ellipse(NamedTuple):
    """A form V, ready to be scanned row by row."""

    wide: Single  # V_xx, px²
    high: Single  # V_yy, px²
    slope: Single  # V_xy / V_yy, px to the right per px downward
    curve: Single  # V_yy / det V, px⁻²


@kernel
def blurred_ellipse(
    along_u: tuple[Single, Single],
    along_v: tuple[Single, Single],
    area: Single,
    variance: Single,
    filter_variance: Single,
) -> tuple[Ellipse, Single]:
    """Form `variance` J Jᵀ + `filter_variance` of a circle under a filter, and det V.

    `area` is |det J|; `variance` is in the sample's units, `filter_variance` in px².
    """
    xu, yu = along_u
    xv, yv = along_v
    across, down = xu * xu + xv * xv, yu * yu + yv * yv
    wide, high = variance * across + filter_variance, variance * down + filter_variance
    # det V without the difference of two large numbers that long, thin ellipses would make it.
    rest = filter_variance * (variance * (across + down) + filter_variance)
    both = variance * area * (variance * area) + rest
    return Ellipse(wide, high, variance * (xu * yu + xv * yv) / high, high / both), both


@kernel
def longest_stretch(along_u: tuple[Single, Single], along_v: tuple[Single, Single]) -> Single:
    """Largest singular value of J."""
    half, two = np.float32(0.5), np.float32(2)
    xu, yu = along_u
    xv, yv = along_v
    across, down = xu * xu + xv * xv, yu * yu + yv * yv
    odd, twist = xu * xu + yu * yu - xv * xv - yv * yv, two * (xu * xv + yu * yv)
    return math.sqrt(half * (across + down + math.sqrt(odd * odd + twist * twist)))


class Ground(NamedTuple):
    """Pixels that lines of splats are added to."""

    sums: Floats  # flat; channels and weight of each pixel side by side
    start: int  # of the first pixel's
    width: int  # px
    height: int  # px


@kernel
def _first_pixel(bound: Single) -> int:
    """First pixel with its center not before a bound."""
    return math.ceil(float(max(bound - np.float32(0.5), np.float32(0))))


@kernel
def _last_pixel(bound: Single, size: int) -> int:
    """One past the last of `size` pixels with its center not after a bound."""
    return math.floor(float(min(bound + np.float32(0.5), np.float32(size))))


@kernel
def _weigh(
    weight: Floats, count: int, width: int, x: Single, y: Single, line: Floats, splat: int
) -> None:
    """Weights of a stamp's `count` pixels; the first center is at (x, y) from the splat's."""
    scale = np.float32(1.0 / 32.0)
    slope, peak = line[SLOPE, splat], line[PEAK, splat]
    curve, rest = line[CURVE, splat] * scale, line[REST, splat] * scale
    for n in range(count):
        m = np.uint64(n)
        below = y + DOWN[width, m]
        across = x + ACROSS[width, m] - slope * below
        z = curve * across * across + rest * below * below
        # exp(−16 z), for z up to RIM / 32; errs by 3e-6 of the value at most.
        q = min(z, LAST_Z)
        power = C0 + q * (C1 + q * (C2 + q * (C3 + q * C4)))
        power *= power
        power *= power
        power *= power
        weight[m] = peak * (power * power) if z <= LAST_Z else np.float32(0)


@kernel
def _add_stamp(
    sums: Floats,
    at: int,
    stride: int,
    weight: Floats,
    size: tuple[int, int],
    values: Floats,
    n: int,
) -> None:
    """Add a stamp of weights to the pixels from `at` on."""
    width, height = size
    lanes = values.shape[0] + 1
    from_weight = np.uint64(0)
    if lanes == 2:
        value = values[0, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                sums[to + m + m] += share * value
                sums[to + m + m + np.uint64(1)] += share
            from_weight += np.uint64(width)
    else:
        red, green, blue = values[0, n], values[1, n], values[2, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                i = to + np.uint64(4) * m
                j, k, o = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
                sums[i] += share * red
                sums[j] += share * green
                sums[k] += share * blue
                sums[o] += share
            from_weight += np.uint64(width)


@kernel
def _columns(line: Floats, n: int, dy: Single, rows: int, left: int, right: int) -> tuple[int, int]:
    """First and last + 1 of the columns that a splat may meet in some rows from `dy` below it."""
    half = math.sqrt(np.float32(RIM) / line[CURVE, n])
    first = line[X, n] + line[SLOPE, n] * dy
    last = first + line[SLOPE, n] * np.float32(rows - 1)
    return (
        max(left, _first_pixel(min(first, last) - half)),
        _last_pixel(max(first, last) + half, right),
    )


@kernel
def add_splats(ground: Ground, values: Floats, line: Floats, count: int, weight: Floats) -> None:
    """Add a line of splats to pixels.

    `values`: (1 or 3, N). `line`: (ROWS, N); the first `count` are added. `weight`: (SIDE²,)
    scratch numbers.
    """
    sums, start, width, height = ground
    lanes = values.shape[0] + 1
    half = np.float32(0.5)
    for n in range(count):
        if not line[PEAK, n] > np.float32(0):
            continue
        x, y = line[X, n], line[Y, n]
        leftmost = _first_pixel(x - line[WIDE, n])
        rightmost = _last_pixel(x + line[WIDE, n], width)
        last = _last_pixel(y + line[HIGH, n], height)
        for top in range(_first_pixel(y - line[HIGH, n]), last, SIDE):
            bottom = min(top + SIDE, last)
            dy = np.float32(top) + half - y
            left, right = leftmost, rightmost
            if right - left > SIDE:
                left, right = _columns(line, n, dy, bottom - top, left, right)
            for column in range(left, right, SIDE):
                wide, high = min(SIDE, right - column), bottom - top
                _weigh(weight, wide * high, wide, np.float32(column) + half - x, dy, line, n)
                at = start + (top * width + column) * lanes
                _add_stamp(sums, at, width * lanes, weight, (wide, high), values, n)


FULL: Single = np.float32(1 - 1e-3)  # coverage beyond which nothing shows through

# Lanes of the surface at hand: three weighted channels, weight, weighted nearness and coverage.
WEIGHT, NEAR, COVER = 3, 4, 5
# Lanes of a surface: three channels, coverage, coverage × depth, nearness of the first surface.
DEPTH, FIRST = 4, 5
LANES = 6


class Surfaces(NamedTuple):
    """Number of surfaces behind each other, and of sub-pixels."""

    most: int  # surfaces
    subpixels: int  # per side of a pixel


class Block(NamedTuple):
    """The sub-pixels of one tile."""

    left: int  # px
    top: int  # px
    subpixels: int  # per side of a pixel
    floor: Floats  # (R, C) nearness by which a batch tells what belongs to the surface in front
    limit: Floats  # (R, C) nearness below which the next surface is looked for; 0: full
    sums: Floats  # (R, C, LANES) over the surface at hand
    visible: Floats  # (R, C, LANES)
    box: NDArray[np.int64]  # (4,) first and last row, first and last column that are not full
    step: NDArray[np.int64]  # (1,) of the sub-pixels of a row, one in how many is used


@kernel
def new_block(tile: int, tiles: Tiles, size: tuple[int, int], surfaces: Surfaces) -> Block:
    """An empty tile of a frame (height, width), cut at the frame."""
    row, column = divmod(int(np.int64(tile)), tiles.columns)
    left, top, fine = column * tiles.size, row * tiles.size, surfaces.subpixels
    rows, columns = min(tiles.size, size[0] - top) * fine, min(tiles.size, size[1] - left) * fine
    return Block(
        left,
        top,
        fine,
        np.zeros((rows, columns), np.float32),
        np.full((rows, columns), np.inf, np.float32),
        np.zeros((rows, columns, LANES), np.float32),
        np.zeros((rows, columns, LANES), np.float32),
        np.array([0, rows - 1, 0, columns - 1]),
        np.ones(1, np.int64),
    )


@kernel
def whole_within(value: float, least: int, most: int) -> int:
    """Whole number below a value, clamped to bounds, for any value."""
    return math.floor(max(float(least), min(float(most), value)))


@kernel
def row_shift(row: int, subpixels: int) -> float:
    """Shift of a row of sub-pixels to the right, sub-pixels.

    So upright edges pass the samples of a pixel one by one and not by columns.
    """
    return (row % subpixels + 0.5) / subpixels - 0.5


@kernel
def first_used(block: Block, row: int, column: int) -> int:
    """First used column from a given one on; few per pixel are the corners of a rotated square."""
    step = block.step[0]
    if step == 1:
        return column
    used = (2 * (row % step) + 1) % (step + 1)
    return int(column + (used - column % step) % step)


@kernel
def put_behind(block: Block, surface: int, surfaces: Surfaces) -> bool:
    """Composite the current surface behind the others; return whether more may show through."""
    floor, limit, sums, seen, box = block.floor, block.limit, block.sums, block.visible, block.box
    rows, columns = floor.shape
    top, bottom, left, right = rows, -1, columns, -1
    one, is_last = np.float32(1), surface + 1 == surfaces.most
    for row in range(box[0], box[1] + 1):
        for column in range(first_used(block, row, box[2]), box[3] + 1, block.step[0]):
            weight = sums[row, column, WEIGHT]
            if weight > 0:
                room = one - seen[row, column, 3]
                cover = room * min(one, sums[row, column, COVER])
                share = cover / weight
                seen[row, column, 0] += share * sums[row, column, 0]
                seen[row, column, 1] += share * sums[row, column, 1]
                seen[row, column, 2] += share * sums[row, column, 2]
                seen[row, column, 3] += cover
                near = sums[row, column, NEAR] / weight
                seen[row, column, DEPTH] += cover / near
                if seen[row, column, FIRST] == 0:
                    seen[row, column, FIRST] = near
            if is_last:
                continue
            # Found behind a full sub-pixel, or nothing at all: nothing more to come.
            is_open = seen[row, column, 3] < FULL and floor[row, column] > 0
            limit[row, column] = floor[row, column] if is_open else np.float32(0)
            if is_open:
                top, bottom = min(top, row), max(bottom, row)
                left, right = min(left, column), max(right, column)
    if is_last or bottom < 0:
        return False
    box[0], box[1], box[2], box[3] = top, bottom, left, right
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            floor[row, column] = 0
            for k in range(sums.shape[2]):
                sums[row, column, k] = 0
    return True


Weights = Floats | Doubles


@kernel
def _resolve_row(fine: Floats, weight: Weights, n: int, row: int, picture: Floats) -> None:
    """Filter the sub-pixels of one row of pixels, rows first: these are stretches of memory."""
    channels, line = picture.shape[2], np.zeros(fine.shape[1], weight.dtype)
    for down in range(weight.size):
        share, r = weight[down], row * n + down
        for k in range(line.size):
            line[np.uint64(k)] += share * fine[np.uint64(r), np.uint64(k)]
    for column in range(picture.shape[1]):
        for c in range(channels):
            total = weight.dtype.type(0)
            for right in range(weight.size):
                at = np.uint64((column * n + right) * channels + c)
                total += weight[right] * line[at]
            picture[row, column, c] = total


@kernel
def resolve_tile(fine: Floats, weight: Weights, n: int, pixels: Floats) -> None:
    """As `resolve_rows`, for the sub-pixels (R, C, channels) of a tile of pixels (h, w, channels).

    Numbers are summed in the precision of the weights.
    """
    flat = fine.reshape((fine.shape[0], fine.shape[1] * fine.shape[2]))
    for row in range(pixels.shape[0]):
        _resolve_row(flat, weight, n, row, pixels)


@parallel_kernel
def resolve_rows(counter: Counter, fine: Floats, weight: Floats, n: int, picture: Floats) -> None:
    """Filter sub-pixels to pixels.

    `fine`: ((H + 2 m) n, (W + 2 m) n C) sub-pixels of C channels side by side; m px of them lie
    around the picture. `weight`: ((2 m + 1) n,) of the sub-pixels along one axis that a pixel
    reads. `n`: Sub-pixels per side of a pixel. `picture`: (H, W, C), filled.
    """
    for row in tasks(counter, picture.shape[0]):
        _resolve_row(fine, weight, n, row, picture)


def nearest_of_rows(depth: Floats, n: int, margin: int, nearest: Floats) -> None:
    """Find the least depth (H, W) of the n² sub-pixels in each pixel's own square.

    These lie around the picture for `margin` px, too.
    """
    height, width = nearest.shape
    own = depth[margin * n : (margin + height) * n, margin * n : (margin + width) * n]
    own.reshape(height, n, width, n).min(axis=(1, 3), out=nearest)


@parallel_kernel
def middle_of_rows(
    counter: Counter, nearness: Floats, beside: Floats, n: int, middle: Floats,
    middle_beside: Floats,
) -> None:  # fmt: skip
    """Find the main surface in each pixel's own square: the median by nearness.

    `nearness`, `beside`: (H n, W n) of sub-pixels, 0 where empty; and other quantities of
    them. `middle`, `middle_beside`: (H, W) filled: both of the middle sub-pixel among those where
    something is.
    """
    for row in tasks(counter, middle.shape[0]):
        near, other = np.empty(n * n, np.float32), np.empty(n * n, np.float32)
        for column in range(middle.shape[1]):
            count = 0
            for part in range(n * n):
                r, c = row * n + part // n, column * n + part % n
                if nearness[r, c] <= np.float32(0):
                    continue
                k = count
                while k > 0 and near[k - 1] > nearness[r, c]:
                    near[k], other[k] = near[k - 1], other[k - 1]
                    k -= 1
                near[k], other[k] = nearness[r, c], beside[r, c]
                count += 1
            is_any = count > 0
            middle[row, column] = near[count // 2] if is_any else np.float32(0)
            middle_beside[row, column] = other[count // 2] if is_any else np.float32(0)


Members = Any  # a bundle of everything that may be painted
Picture = Any  # a bundle that pixels are written to
TileBlock = Any  # the sub-pixels of a tile; `sums` are what the surface at hand leaves there


@making_role
def begun(
    members: Members, tiles: Tiles, tile: int, size: tuple[int, int], surfaces: Surfaces
) -> TileBlock:
    """A new tile of a frame (height, width)."""
    raise NotImplementedError


@plays(begun, object)
def _begun(
    members: Members,  # noqa: ARG001
    tiles: Tiles,
    tile: int,
    size: tuple[int, int],
    surfaces: Surfaces,
) -> TileBlock:
    return new_block(tile, tiles, size, surfaces)


@called_role
def claim(members: Members, member: int, block: TileBlock) -> None:
    """Raise the floor of the sub-pixels where a member is in front."""
    raise NotImplementedError


@called_role
def add(members: Members, member: int, block: TileBlock) -> None:
    """Add a member's color where it belongs to the front surface."""
    raise NotImplementedError


@called_role
def claimed(members: Members, tiles: Tiles, tile: int, block: TileBlock) -> None:
    """Prepare a tile when its first surface is known, before anything is added."""
    raise NotImplementedError


@plays(claimed, object)
def _claimed(members: Members, tiles: Tiles, tile: int, block: TileBlock) -> None:
    pass


@called_role
def composed(members: Members, block: TileBlock, surface: int, surfaces: Surfaces) -> bool:
    """Composite the current surface behind the others; return whether more may show through."""
    raise NotImplementedError


@plays(composed, object)
def _composed(
    members: Members,  # noqa: ARG001
    block: TileBlock,
    surface: int,
    surfaces: Surfaces,
) -> bool:
    return put_behind(block, surface, surfaces)


@making_role
def write(picture: Picture, block: TileBlock) -> None:
    """Write the pixels of a tile with all surfaces composed."""
    raise NotImplementedError


@kernel
def paint_tile(
    members: Members, tiles: Tiles, tile: int, size: tuple[int, int], surfaces: Surfaces,
    picture: Picture,
) -> None:  # fmt: skip
    """Paint one tile of a frame (height, width); an empty one stays unchanged."""
    start, end = tiles.start[tile], tiles.start[tile + 1]
    if start == end:
        return
    block = begun(members, tiles, tile, size, surfaces)
    for surface in range(surfaces.most):
        for n in range(start, end):
            claim(members, tiles.member[n], block)
        if surface == 0:
            claimed(members, tiles, tile, block)
        for n in range(start, end):
            add(members, tiles.member[n], block)
        if not composed(members, block, surface, surfaces):
            break
    write(picture, block)
