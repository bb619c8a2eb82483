"""What silhouettes hide, made up once per source: a second depth image behind the first.

Every frame of a film shows the same layer, so what is made up moves with the scene instead of
changing from frame to frame. Its depth goes on from the far side of a silhouette, in the direction
that the far surface has there; its color spreads from the far side alone, whose samples have been
rid of the near side's light.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.filling import inpainted
from resample_warp3d.sheet.sheets import alone
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Source, Warped

REACH = 0.12  # of the longer side: how far behind a silhouette the layer goes
APART = 1.03  # ratio of nearness from which one surface hides another
RING = 3  # samples of the far side itself that the layer begins with
STEEP = 0.5  # of the nearness: what it may change from a silhouette to the layer's end
CLASSES = 6  # of far sides, by nearness: beside a near one a farther one is looked for, too

Mask = NDArray[np.bool_]
NEIGHBOURS = ((RIGHT, 0, 1), (DOWN, 1, 0), (LEFT, 0, -1), (UP, -1, 0))


class Beyond(NamedTuple):
    """Far sides, gone on beyond their silhouettes."""

    distance: Floats  # (H, W) to the nearest sample at a silhouette
    nearness: Floats  # (H, W) of its surface; 0 where none is near enough
    hidden: Mask  # (H, W) that surface lies behind the sample


def background(source: Source, reach: float = REACH) -> Source | None:
    """Layer behind the silhouettes of a source.

    Parameters
    ----------
    source
        A prepared depth image.
    reach
        How far the layer goes behind a silhouette, as a share of the picture's longer side.

    Returns
    -------
    A source of the same size, with depth where something is hidden and a few samples around; None
    if nothing hides anything.

    Raises
    ------
    ValueError
        The reach is not above 0.
    """
    if not 0.0 < reach <= 1.0:
        raise ValueError(f"reach {reach:g}; give a share of the picture's side, above 0 up to 1")
    far = far_sides(source)
    if not far.any():
        return None
    beyond = _beyond(source, far, reach * max(far.shape))
    if not beyond.hidden.any():
        return None
    nearness = source.nearness
    is_beside = (beyond.distance <= RING) & ~beyond.hidden & (nearness > 0)
    is_beside &= np.abs(nearness - beyond.nearness) <= (APART - 1.0) * beyond.nearness
    depth = np.where(beyond.hidden, beyond.nearness, np.where(is_beside, nearness, 0))
    color, _ = alone(source)
    spread = inpainted(color, _nearer(source, far, beyond, reach))
    color = np.where(beyond.hidden[..., None], spread, color).astype(np.float32)
    return prepare(DepthImage(color, depth, source.place), noise=0.0, step=0.0)


def behind(warped: Warped, layer: Warped) -> Warped:
    """Picture with another behind it; why its own pixels are what they are stays on record."""
    rest = np.float32(1) - np.clip(warped.coverage, 0, 1)
    return warped._replace(
        image=warped.image + rest[..., None] * layer.image,
        coverage=warped.coverage + rest * layer.coverage,
        depth=np.where(warped.coverage > 0, warped.depth, layer.depth),
    )


def far_sides(source: Source) -> Mask:
    """Samples (H, W) that have something nearer, of another surface, beside them."""
    nearness, links = source.nearness, source.links
    padded = np.pad(nearness, 1)
    height, width = nearness.shape
    found = np.zeros(nearness.shape, np.bool_)
    for bit, down, right in NEIGHBOURS:
        other = padded[1 + down : 1 + down + height, 1 + right : 1 + right + width]
        found |= ((links & bit) == 0) & (nearness > 0) & (other > APART * nearness)
    return found


def _beyond(source: Source, far: Mask, most: float) -> Beyond:
    """Nearest far side of each sample; of those that lie behind it, where there are any."""
    limits = np.quantile(source.nearness[far], np.linspace(0, 1, CLASSES + 1)[1:-1])
    member = np.searchsorted(limits, source.nearness, side="right")
    best = _one_class(source, far, most)
    for n in range(CLASSES):
        chosen = far & (member == n)
        if not chosen.any():
            continue
        other = _one_class(source, chosen, most)
        is_better = other.hidden & (~best.hidden | (other.distance < best.distance))
        best = Beyond(*(np.where(is_better, o, b) for o, b in zip(other, best, strict=True)))
    return best


def _one_class(source: Source, far: Mask, most: float) -> Beyond:
    """The nearest of some far sides, wherever it lies."""
    import cv2

    width = far.shape[1]
    distance, label = cv2.distanceTransformWithLabels(
        (~far).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(int(label.max()) + 1, np.int64)  # of the far side that has a label
    place[label[far]] = np.flatnonzero(far)
    start = place[label]
    row, column = np.indices(far.shape)
    slope = source.slope.reshape(-1, 2)[start]
    change = slope[..., 0] * (column - start % width) + slope[..., 1] * (row - start // width)
    first = source.nearness.reshape(-1)[start]
    nearness = first + np.clip(change, -STEEP * first, STEEP * first)
    nearness = np.where(distance <= most, nearness, 0).astype(np.float32)
    hidden = (nearness > 0) & (source.nearness > APART * nearness)
    return Beyond(np.asarray(distance, np.float32), nearness, hidden)


def _nearer(source: Source, far: Mask, beyond: Beyond, reach: float) -> Mask:
    """Samples whose color must not spread: the hidden ones, what is nearer further in, and gaps."""
    wide = _one_class(source, far, 2.0 * reach * max(far.shape) + 10.0)
    return beyond.hidden | wide.hidden | (source.nearness <= 0)
