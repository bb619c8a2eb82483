"""Measure depth maps: valid samples, quantization, noise, links between samples."""

import math

import numpy as np

from resample.types import Doubles, Floats
from resample_warp3d.types import DepthImage, Links

USUAL = 0.5587  # mean of the lower 80 % of |x|, x normal with deviation 1
FLAT = 2e-3  # relative nearness: smaller jumps are not edges
FEWEST, MOST = 8, 4096  # distinct values of a coarse map; fewer are a scene of few flat objects
MANY = 1 << 16  # samples; of larger maps a quarter is examined
LEVEL = 0.2  # share of neighbours, along both axes, with equal values in a coarse map
COARSEST = 0.02  # of the largest nearness: larger steps are between objects


def known(image: DepthImage) -> Floats:
    """Return the nearness in float32, 0 where it, its position or its color is unknown."""
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
    """Return the quantization step of nearness if values are few, as in 8-bit maps; else 0."""
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
    """Return the links between neighbours on one surface."""
    from resample_warp3d.depth.kernels.linking import join_rows, link_rows

    links = np.zeros(nearness.shape, np.uint8)
    tolerance = np.array([1.5 * quantum, max(FLAT, 6.0 * math.sqrt(2.0) * noise)])
    link_rows(nearness, tolerance, links)
    join_rows(links)
    return links


def noise_of(nearness: Floats, links: Links) -> float:
    """Return the relative standard deviation of the nearness about its surfaces.

    From the mean of all but the largest fifth of absolute second differences, whose deviation is √6
    times that of the noise. A median would miss surfaces that are quantized.
    """
    from resample_warp3d.depth.kernels.linking import curvatures

    sparse = max(1, math.isqrt(nearness.size // 65536))
    curvature: Doubles = np.full([max(1, n // sparse) for n in nearness.shape], np.nan)
    curvatures(nearness, links, sparse, curvature)
    found = np.sort(np.abs(curvature[np.isfinite(curvature)]))
    usual = found[: math.ceil(0.8 * found.size)]
    return float(usual.mean() / USUAL / math.sqrt(6.0)) if usual.size else 0.0
