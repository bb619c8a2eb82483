"""Sub-pixels to pixels: composited first, filtered after."""

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats

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


@kernel
def _middle_of_row(
    nearness: Floats, beside: Floats, n: int, row: int, middle: Floats, middle_beside: Floats
) -> None:
    """Middle sub-pixels of one row of pixels."""
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


def nearest_of_rows(depth: Floats, n: int, margin: int, nearest: Floats) -> None:
    """Find the least depth (H, W) in each pixel's own square, of those of n² sub-pixels each.

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
    """Find the surface that shows most in each pixel's own square: the middle one by nearness.

    `nearness`, `beside`: (H n, W n) of sub-pixels, 0 where nothing is; and what else is known of
    them. `middle`, `middle_beside`: (H, W) filled: both of the middle sub-pixel among those where
    something is.
    """
    for row in tasks(counter, middle.shape[0]):
        _middle_of_row(nearness, beside, n, row, middle, middle_beside)
