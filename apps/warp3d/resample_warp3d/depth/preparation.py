"""Depth images made ready for warping: surfaces, their slopes, and how noisy they are.

Done once per source; the result serves every target.
"""

import math

import numpy as np

from resample.types import Floats
from resample_warp3d.depth.refining.conditioning import Refined
from resample_warp3d.depth.refining.conditioning import refine as conditioned
from resample_warp3d.depth.refining.measuring import known, linked, noise_of
from resample_warp3d.types import AS_GIVEN, DepthImage, Links, Source

CLEAN = 1e-4  # of the nearness: noise below this is none
SMOOTH = 1e-3  # of the nearness: noise above this is smoothed
LARGEST_REACH = 4  # samples on each side that a slope is fitted to


def prepare(
    image: DepthImage,
    *,
    noise: float | None = None,
    step: float | None = None,
    refine: str = "auto",
) -> Source:
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
    refine
        How the depth is conditioned, as of `refining.conditioning.refine`: `auto`, `none`...

    Returns
    -------
    The source: links between neighbours on one surface, slopes, smoothed nearness, and how sure
    depth is that was refined.

    Raises
    ------
    ValueError
        Color and nearness do not fit, or there is no depth at all.
    LookupError
        `refine` is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, of_rectified, prepare, render
    >>> color, disparity = np.ones((24, 32, 3), np.float32), np.full((24, 32), 8, np.float32)
    >>> source = prepare(DepthImage(color, disparity, np.empty((0, 0, 2))))
    >>> source.noise
    0.0
    >>> render(source, of_rectified(0.5), (24, 32), "hybrid")
    Warped(24 × 32 × 3 float32, 90.6 % covered)
    """
    for name, given in (("noise", noise), ("step", step)):
        if given is not None and not 0.0 <= given < math.inf:
            raise ValueError(f"{name} {given:g}; give a number of 0 or more, or leave it out")
    refined = conditioned(image, refine, noise=noise, step=step)
    return sourced(refined, noise=noise)


def sourced(refined: Refined, *, noise: float | None) -> Source:
    """Prepare a depth image that was conditioned; otherwise as `prepare`."""
    image, quantum = refined.image, refined.step
    nearness = known(image)
    links = linked(nearness, quantum, 0.0 if noise is None else noise)
    if noise is None:
        noise = noise_of(nearness, links)
        if noise > CLEAN:
            links = linked(nearness, quantum, noise)
            noise = noise_of(nearness, links)
    reach = reach_for(noise)
    fitted, slope = fit(nearness, links, reach)
    color = np.nan_to_num(np.ascontiguousarray(image.color, np.float32), posinf=0.0, neginf=0.0)
    trust = AS_GIVEN if refined.chosen == "none" else refined.confidence
    return Source(color, fitted, slope, links, image.place, noise, quantum, trust)


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
