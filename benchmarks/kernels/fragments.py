"""Count the fragments of splats by plain loops that share no code with the painters."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.types import Doubles, Ellipsoid, Floats, View


@kernel
def count_fragments(
    place: Doubles,
    extinction: Floats,
    view: View,
    ellipsoid: Ellipsoid,
    profile: Floats,
    opaque: float,
    light: Doubles,
) -> tuple[int, int]:
    """Sub-pixels in splats' footprints, and those among them that were not opaque yet.

    Samples (N, 3) are in camera axes, sorted front to back. `profile` holds line integrals over
    the squared distance from the center in radii. `light` (H, W), initially 1, is each sub-pixel's
    transmittance; at `opaque` and below it takes no more.
    """
    inside, painted = 0, 0
    height, width = light.shape
    half = (
        math.sqrt(ellipsoid.covariance[0, 0]),
        math.sqrt(ellipsoid.covariance[1, 1]),
        math.sqrt(ellipsoid.covariance[2, 2]),
    )
    unit, steps = ellipsoid.to_unit, profile.size - 1
    for n in range(place.shape[0]):
        x, y, z = place[n, 0], place[n, 1], place[n, 2]
        nearest, farthest = z - half[2], z + half[2]
        if nearest <= view.near:
            continue
        left = min((x - half[0]) / nearest, (x - half[0]) / farthest)
        right = max((x + half[0]) / nearest, (x + half[0]) / farthest)
        top = min((y - half[1]) / nearest, (y - half[1]) / farthest)
        bottom = max((y + half[1]) / nearest, (y + half[1]) / farthest)
        first_column = max(0, math.floor(left * view.focal[0] + view.principal[0]))
        last_column = min(width, math.ceil(right * view.focal[0] + view.principal[0]))
        first_row = max(0, math.floor(top * view.focal[1] + view.principal[1]))
        last_row = min(height, math.ceil(bottom * view.focal[1] + view.principal[1]))
        cx = unit[0, 0] * x + unit[0, 1] * y + unit[0, 2] * z
        cy = unit[1, 0] * x + unit[1, 1] * y + unit[1, 2] * z
        cz = unit[2, 0] * x + unit[2, 1] * y + unit[2, 2] * z
        for row in range(first_row, last_row):
            down = (row + 0.5 - view.principal[1]) / view.focal[1]
            for column in range(first_column, last_column):
                across = (column + 0.5 - view.principal[0]) / view.focal[0]
                wx = unit[0, 0] * across + unit[0, 1] * down + unit[0, 2]
                wy = unit[1, 0] * across + unit[1, 1] * down + unit[1, 2]
                wz = unit[2, 0] * across + unit[2, 1] * down + unit[2, 2]
                length = wx * wx + wy * wy + wz * wz
                px, py, pz = cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx
                squared = (px * px + py * py + pz * pz) / length
                if squared >= 1.0:
                    continue
                inside += 1
                if light[row, column] <= opaque:
                    continue
                painted += 1
                position = squared * steps
                entry = np.int64(position)
                share = profile[entry] + (position - entry) * (profile[entry + 1] - profile[entry])
                chord = ellipsoid.scale * math.sqrt((1.0 + across * across + down * down) / length)
                light[row, column] *= math.exp(-extinction[n] * chord * share)
    return inside, painted
