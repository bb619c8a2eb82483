"""Depth images made ready for warping: surfaces, their slopes, and how noisy they are.

Done once per source; the result serves every target.
"""

import math

import numpy as np

from resample.types import Doubles, Floats
from resample_warp3d.types import DepthImage, Links, Source

USUAL = 0.5587  # mean of the lower 80 % of |x|, x normal with deviation 1
CLEAN = 1e-4  # of the nearness: noise below this is none
SMOOTH = 1e-3  # of the nearness: noise above this is smoothed
FLAT = 2e-3  # of the nearness: a jump of less is no edge
FEWEST, MOST = 8, 4096  # values of a coarse map; fewer are a scene of few flat things
MANY = 1 << 16  # samples; of more, a quarter is looked at
LEVEL = 0.2  # share of neighbours, along both axes, that have one value in a coarse map
COARSEST = 0.02  # of the largest nearness: a larger step is between things
LARGEST_REACH = 4  # samples on each side that a slope is fitted to


def prepare(image: DepthImage, *, noise: float | None = None, step: float | None = None) -> Source:
    """Prepare a depth image.

    Parameters
    ----------
    image
        Color and nearness; values that are no finite number above 0 are unknown, and so are samples
        whose color is not finite.
    noise
        Standard deviation of the nearness relative to it; measured if left out.
    step
        Smallest difference of nearness that is told apart; measured if left out.

    Returns
    -------
    The source: links between neighbours on one surface, slopes, and smoothed nearness.

    Raises
    ------
    ValueError
        Color and nearness differ in size, or there is no depth at all.
    """
    for name, given in (("noise", noise), ("step", step)):
        if given is not None and not 0.0 <= given < math.inf:
            raise ValueError(f"{name} {given:g}; give a number of 0 or more, or leave it out")
    nearness = known(image)
    quantum = quantum_of(nearness) if step is None else step
    links = linked(nearness, quantum, 0.0 if noise is None else noise)
    if noise is None:
        noise = noise_of(nearness, links)
        if noise > CLEAN:
            links = linked(nearness, quantum, noise)
            noise = noise_of(nearness, links)
    reach = reach_for(noise)
    fitted, slope = fit(nearness, links, reach)
    color = np.nan_to_num(np.ascontiguousarray(image.color, np.float32), posinf=0.0, neginf=0.0)
    return Source(color, fitted, slope, links, image.place, noise, quantum)


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


def reach_for(noise: float) -> int:
    """Samples on each side that slopes are fitted to."""
    return 1 if noise <= SMOOTH else min(LARGEST_REACH, 2 + int(noise / 1e-3))


def fit(nearness: Floats, links: Links, reach: int) -> tuple[Floats, Floats]:
    """Nearness and slope of planes fitted to the samples around each on its surface.

    With a reach of 1 the nearness stays as it is.
    """
    from resample_warp3d.depth.kernels.linking import fit_rows, slope_rows

    if reach == 1:
        slope = np.empty((*nearness.shape, 2), np.float32)
        slope_rows(nearness, links, slope)
        return nearness, slope
    along, x = np.empty_like(nearness), np.empty_like(nearness)
    fit_rows(nearness, links, False, reach, along, x)
    fitted, y = np.empty_like(nearness), np.empty_like(nearness)
    fit_rows(along, links, True, reach, fitted, y)
    return fitted, np.stack([x, y], axis=2)
