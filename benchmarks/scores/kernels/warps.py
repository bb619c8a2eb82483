"""Warps of pictures with depth, rewritten from their published rules."""

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.scores.kernels.compiling import kernel

Floats = NDArray[np.float64]

CUT = 0.03  # steps of depth by which a mesh is cut
ROUNDING = 1e-9


@kernel
def draw_triangles(
    color: Floats,  # (h, w, 3)
    u: Floats,  # (h, w) places in the new view, px, corner convention
    v: Floats,
    z: Floats,  # (h, w) depths there; 0 for unknown
    samples: int,  # along a side of a pixel
    by_rvs: bool,
    picture: Floats,  # (H samples, W samples, 3)
    best: Floats,  # (H samples, W samples), 0 at first
) -> None:
    """Draw a mesh over px centers: the nearest surface at samples, or RVS's rule.

    RVS draws stretched triangles too, and prefers short edges, then near depth.
    """
    height, width = best.shape
    for top in range(z.shape[0] - 1):
        for left in range(z.shape[1] - 1):
            for half in range(2):
                a = (top, left) if half == 0 else (top + 1, left + 1)
                b, c = (top, left + 1), (top + 1, left)
                least, most = min(z[a], z[b], z[c]), max(z[a], z[b], z[c])
                if least <= 0 or (not by_rvs and most > least * (1 + CUT)):
                    continue
                ax, ay = u[a] * samples - 0.5, v[a] * samples - 0.5
                bx, by = u[b] * samples - 0.5, v[b] * samples - 0.5
                cx, cy = u[c] * samples - 0.5, v[c] * samples - 0.5
                area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
                if area == 0 or (area > 0) != (half == 0):  # a back
                    continue
                longest = math.sqrt(
                    max(
                        (ax - bx) ** 2 + (ay - by) ** 2,
                        (ax - cx) ** 2 + (ay - cy) ** 2,
                        (bx - cx) ** 2 + (by - cy) ** 2,
                    )
                )
                quality = min(max(10000 - 1000 * longest, 1.0), 10000.0)
                last_row = min(height - 1, math.floor(max(ay, by, cy)))
                last_column = min(width - 1, math.floor(max(ax, bx, cx)))
                for row in range(max(0, math.ceil(min(ay, by, cy))), last_row + 1):
                    for column in range(max(0, math.ceil(min(ax, bx, cx))), last_column + 1):
                        x, y = column - ax, row - ay
                        p = (x * (cy - ay) - y * (cx - ax)) / area
                        q = ((bx - ax) * y - (by - ay) * x) / area
                        if min(p, q) < -ROUNDING or p + q > 1 + ROUNDING:
                            continue
                        near = (1 - p - q) / z[a] + p / z[b] + q / z[c]
                        rank = quality * near**3 if by_rvs else near
                        if rank > best[row, column]:
                            best[row, column] = rank
                            for m in range(3):
                                mixed = p * color[b[0], b[1], m] + q * color[c[0], c[1], m]
                                mixed += (1 - p - q) * color[a[0], a[1], m]
                                picture[row, column, m] = mixed


@kernel
def add_softly(
    color: Floats,  # (h, w, 3)
    u: Floats,
    v: Floats,
    z: Floats,
    sharpness: float,
    nearest: float,  # depth
    total: Floats,  # (H, W, 3)
    weight: Floats,  # (H, W)
) -> None:
    """Softmax splatting: bilinear shares, weighted by an exponential of the nearness."""
    height, width = weight.shape
    for row in range(z.shape[0]):
        for column in range(z.shape[1]):
            if z[row, column] <= 0:
                continue
            left = math.floor(u[row, column] - 0.5)
            top = math.floor(v[row, column] - 0.5)
            p, q = u[row, column] - 0.5 - left, v[row, column] - 0.5 - top
            importance = math.exp(sharpness * (nearest / z[row, column] - 1))
            for k in range(4):
                x, y = left + k % 2, top + k // 2
                if 0 <= x < width and 0 <= y < height:
                    share = (p if k % 2 else 1 - p) * (q if k // 2 else 1 - q) * importance
                    weight[y, x] += share
                    for m in range(3):
                        total[y, x, m] += share * color[row, column, m]
