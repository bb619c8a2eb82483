"""What a depth map's numbers are like: known or not, in steps, noisy, of one surface."""

import math

import numpy as np

from resample.types import Doubles, Floats
from resample_warp3d.types import DepthImage, Links

USUAL = 0.5587  # mean of the lower 80 % of |x|, x normal with deviation 1
FLAT = 2e-3  # of the nearness: a jump of less is no edge
FEWEST, MOST = 8, 4096  # values of a coarse map; fewer are a scene of few flat things
MANY = 1 << 16  # samples; of more, a quarter is looked at
LEVEL = 0.2  # share of neighbours, along both axes, that have one value in a coarse map
COARSEST = 0.02  # of the largest nearness: a larger step is between things


def known(image: DepthImage) -> Floats:
    """Nearness in float32, 0 where it, its place or its color is unknown."""
    nearness = np.ascontiguousarray(image.nearness, np.float32)
    if image.color.ndim != 3 or nearness.shape != image.color.shape[:2]:
        height, width = nearness.shape[:2]
        raise ValueError(
            f"color of {image.color.shape[1]} × {image.color.shape[0]} px does not fit depth of "
            f"{width} × {height} px"
        )
    is_known = np.isfinite(nearness) & (nearness > 0)
    for c in range(image.color.shape[2]):  # ten times as fast as all channels at once
        is_known &= np.isfinite(image.color[..., c])
    if image.place.size:
        is_known &= np.isfinite(image.place).all(axis=2)
    nearness = np.where(is_known, nearness, np.float32(0))
    if not nearness.any():
        raise ValueError("no pixel has a depth; check its unit and its file")
    return nearness


def quantum_of(nearness: Floats) -> float:
    """Smallest step between values of nearness where they are few, as of 8-bit maps; else 0."""
    some = nearness if nearness.size < MANY else nearness[::2, ::2]
    values = np.unique(some[some > 0])
    if not FEWEST <= values.size <= MOST:
        return 0.0
    smallest = float(np.min(np.diff(values)))
    is_flat = min(
        np.mean(nearness[::8, 1:] == nearness[::8, :-1]),
        np.mean(nearness[1:, ::8] == nearness[:-1, ::8]),
    )
    is_coarse = is_flat > LEVEL and smallest < COARSEST * float(values[-1])
    return smallest if is_coarse else 0.0


def linked(nearness: Floats, quantum: float, noise: float) -> Links:
    """Links between neighbours on one surface."""
    from resample_warp3d.depth.kernels.linking import join_rows, link_rows

    links = np.zeros(nearness.shape, np.uint8)
    tolerance = np.array([1.5 * quantum, max(FLAT, 6.0 * math.sqrt(2.0) * noise)])
    link_rows(nearness, tolerance, links)
    join_rows(links)
    return links


def noise_of(nearness: Floats, links: Links) -> float:
    """Standard deviation of the nearness about its surfaces, relative to it.

    From the mean of all but the largest fifth of absolute second differences, of which noise has √6
    times its own deviation. A median would not see that a surface goes in steps.
    """
    from resample_warp3d.depth.kernels.linking import curvatures

    sparse = max(1, math.isqrt(nearness.size // 65536))
    curvature: Doubles = np.full([max(1, n // sparse) for n in nearness.shape], np.nan)
    curvatures(nearness, links, sparse, curvature)
    found = np.sort(np.abs(curvature[np.isfinite(curvature)]))
    usual = found[: math.ceil(0.8 * found.size)]
    return float(usual.mean() / USUAL / math.sqrt(6.0)) if usual.size else 0.0
