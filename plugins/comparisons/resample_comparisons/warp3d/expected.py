"""What another view shows of a depth image, as its samples predict: nearness and edges."""

import numpy as np

from resample.types import Doubles, Floats
from resample_comparisons.warp3d.scoring import NEAR_EDGE, Mask, widened
from resample_warp3d.depth.equation import places, warp_places
from resample_warp3d.types import DepthImage, Equation, Source

FAR_OFF = 1e6  # px: positions farther out are dropped
CUT = 0.03  # of the nearness: larger steps between neighbours are edges


def expected_nearness(
    image: DepthImage | Source, equation: Equation, shape: tuple[int, int]
) -> Doubles:
    """Return the nearness in another view that a depth image predicts.

    `image`: depth image; each sample is spread over the 2 × 2 pixels around its position, or fewer
    if it hits pixel centers. `shape`: height and width of the view, px. Result: (H, W) of the
    nearest sample; 0 where none arrives: hidden, outside, or where neighbours are more than about 2
    pixels apart.
    """
    place, nearness = _warped(image, equation)
    found = np.zeros(shape)
    before, after = (rounded(place - 0.5).astype(np.int64) for rounded in (np.floor, np.ceil))
    for column in (before[:, 0], after[:, 0]):
        for row in (before[:, 1], after[:, 1]):
            inside = (column >= 0) & (row >= 0) & (column < shape[1]) & (row < shape[0])
            np.maximum.at(found, (row[inside], column[inside]), nearness[inside])
    return found


def edges_in_view(image: DepthImage | Source, equation: Equation, shape: tuple[int, int]) -> Mask:
    """Return the pixels of a view within 2 px of the near side of a depth edge."""
    nearness = np.where(_is_border(image.nearness), image.nearness, np.float32(0))
    rims = DepthImage(image.color, np.asarray(nearness, np.float32), image.place)
    return widened(expected_nearness(rims, equation, shape) > 0, NEAR_EDGE)


def _is_border(nearness: Floats) -> Mask:
    """Return the samples that are clearly nearer than one of their four neighbours."""
    around = np.pad(nearness, 1, mode="edge")
    farther = np.minimum(
        np.minimum(around[:-2, 1:-1], around[2:, 1:-1]),
        np.minimum(around[1:-1, :-2], around[1:-1, 2:]),
    )
    return np.asarray(farther < (1.0 - CUT) * nearness)


def _warped(image: DepthImage | Source, equation: Equation) -> tuple[Doubles, Doubles]:
    """Warp the samples with depth; return px (N, 2) and nearness (N,)."""
    where = places(DepthImage(image.color, image.nearness, image.place)).reshape(-1, 2)
    nearness = image.nearness.reshape(-1).astype(np.float64)
    known = nearness > 0
    place, there = warp_places(equation, where[known], nearness[known])
    valid = (np.abs(place) < FAR_OFF).all(axis=1)
    return place[valid], there[valid]
