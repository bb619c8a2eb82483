"""Prepare depth images for warping: links, slopes, noise, smoothing.

Done once per source; the result serves every target.
"""

import math

import numpy as np

from resample.calling import takes
from resample.messages import number
from resample.types import Floats
from resample_warp3d.depth.refining.conditioning import Refine, Refined
from resample_warp3d.depth.refining.conditioning import refine as conditioned
from resample_warp3d.depth.refining.inspecting import known, linked, noise_of
from resample_warp3d.types import AS_GIVEN, DepthImage, Links, Source

CLEAN = 1e-4  # relative nearness: smaller noise is ignored
SMOOTH = 1e-3  # relative nearness: larger noise is smoothed
LARGEST_REACH = 4  # most samples on each side to which a slope is fitted


@takes(
    instead="prepare(DepthImage(color, 1 / depth)) prepares a picture with depth; warp(color, "
    "depth, source, target) prepares and warps it"
)
def prepare(
    image: DepthImage,
    *,
    noise: float | None = None,
    step: float | None = None,
    refine: Refine = "auto",
) -> Source:
    """Prepare a depth image.

    Parameters
    ----------
    image
        Color and nearness. Nearness that is not finite or not above 0 is unknown, and so are
        samples with a color that is not finite.
    noise
        Relative standard deviation of the nearness. Default: estimated.
    step
        Smallest step of nearness. Default: estimated.
    refine
        Refinement of the depth, as `refining.conditioning.refine` takes it: `auto`, `none`...

    Returns
    -------
    The source: links between neighbours on one surface, slopes, smoothed nearness, and the trust of
    refined depth.

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
    >>> source = prepare(DepthImage(color, disparity))
    >>> source.noise
    0.0
    >>> render(source, of_rectified(0.5), (24, 32), "hybrid")
    Warped(24 × 32 × 3 float32, 90.6 % covered)
    """
    for name, given in (("noise", noise), ("step", step)):
        if given is not None and not 0.0 <= number(name, given) < math.inf:
            raise ValueError(f"{name} {given:g}; give a number of 0 or more, or leave it out")
    refined = conditioned(image, refine, noise=noise, step=step)
    return sourced(refined, noise=noise)


def sourced(refined: Refined, *, noise: float | None) -> Source:
    """Prepare a refined depth image, as `prepare` does."""
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
    """Return the number of samples on each side to which slopes are fitted."""
    return 1 if noise <= SMOOTH else min(LARGEST_REACH, 2 + int(noise / 1e-3))


def fit(nearness: Floats, links: Links, reach: int) -> tuple[Floats, Floats]:
    """Fit a plane around each sample on its surface; return nearness and slope.

    With a reach of 1 the nearness is unchanged.
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
