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
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Hole, Source, Warped

REACH = 0.12  # of the longer side: how far behind a silhouette the layer goes
APART = 1.03  # ratio of nearness from which one surface hides another
RING = 3  # samples of the far side itself that the layer begins with
STEEP = 0.5  # of the nearness: what it may change from a silhouette to the layer's end
MARGIN = 10  # samples around what is made up that are looked at
CLASSES = 6  # of far sides, by nearness: beside a near one a farther one is looked for, too

Mask = NDArray[np.bool_]
NEIGHBOURS = ((RIGHT, 0, 1), (DOWN, 1, 0), (LEFT, 0, -1), (UP, -1, 0))


class Beyond(NamedTuple):
    """Some far sides, gone on beyond their silhouettes."""

    distance: Floats  # (H, W) to the nearest sample at a silhouette
    nearness: Floats  # (H, W) of its surface
    hidden: Mask  # (H, W) that surface lies behind the sample, not too far from its silhouette
    same: Mask  # (H, W) the sample is of that surface
    start: NDArray[np.int64]  # (H, W) number of the nearest sample at a silhouette


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

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, background, prepare
    >>> color, nearness = np.ones((32, 32, 3), np.float32), np.full((32, 32), 0.25, np.float32)
    >>> nearness[8:24, 8:24] = 1.0  # a square before a wall
    >>> layer = background(prepare(DepthImage(color, nearness, np.empty((0, 0, 2)))))
    >>> layer.nearness[16, 6:14].tolist()  # goes on for 3 px
    [0.25, 0.25, 0.25, 0.25, 0.25, 0.0, 0.0, 0.0]
    """
    if not 0.0 < reach <= 1.0:
        raise ValueError(f"reach {reach:g}; give a share of the picture's side, above 0 up to 1")
    far = far_sides(source)
    if not far.any():
        return None
    classes = _classes(source, far, reach * max(far.shape))
    away = np.stack([np.where(each.hidden, each.distance, np.inf) for each in classes])
    first, hidden = away.argmin(axis=0), np.isfinite(away).any(axis=0)
    if not hidden.any():
        return None
    color, _ = alone(source)
    made, depth = color.copy(), np.zeros_like(source.nearness)
    for n, each in enumerate(classes):
        beside = each.same & (each.distance <= RING) & ~hidden
        depth = np.where(beside, source.nearness, depth)
        chosen = hidden & (first == n)
        if chosen.any():
            depth = np.where(chosen, each.nearness, depth)
            made[chosen] = _spread(color, each, chosen)[chosen]
    return prepare(DepthImage(made, depth, source.place), noise=0.0, step=0.0)


def behind(warped: Warped, layer: Warped) -> Warped:
    """Picture with the layer behind it where something was in the way.

    What is outside the source or without depth stays empty, as a layer knows nothing of it. Why the
    pixels are what they are stays on record.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, background, behind, of_rectified, prepare, render
    >>> color, disparity = np.ones((32, 32, 3), np.float32), np.full((32, 32), 1, np.float32)
    >>> disparity[8:24, 8:24] = 6  # a square before a wall
    >>> source = prepare(DepthImage(color, disparity, np.empty((0, 0, 2))))
    >>> way, size = of_rectified(1), (32, 32)
    >>> seen = render(source, way, size, "hybrid")
    >>> whole = behind(seen, render(background(source, 0.25), way, size, "hybrid"))
    >>> [round(float(view.coverage[16, :-1].mean()), 2) for view in (seen, whole)]
    [0.84, 1.0]
    """
    is_open = (warped.holes != Hole.OUTSIDE) & (warped.holes != Hole.NO_DEPTH)
    rest = is_open * (np.float32(1) - np.clip(warped.coverage, 0, 1))
    return warped._replace(
        image=warped.image + rest[..., None] * layer.image,
        coverage=warped.coverage + rest * layer.coverage,
        depth=np.where(is_open & (warped.coverage <= 0), layer.depth, warped.depth),
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


def _classes(source: Source, far: Mask, most: float) -> list[Beyond]:
    """Far sides by their nearness, each class for itself."""
    limits = np.quantile(source.nearness[far], np.linspace(0, 1, CLASSES + 1)[1:-1])
    member = np.searchsorted(limits, source.nearness, side="right")
    chosen = [far & (member == n) for n in range(CLASSES)]
    return [_one_class(source, each, most) for each in chosen if each.any()]


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
    same = np.abs(source.nearness - nearness) <= (APART - 1.0) * nearness
    hidden = (distance <= most) & (nearness > 0) & (source.nearness > APART * nearness)
    return Beyond(
        np.asarray(distance, np.float32), np.asarray(nearness, np.float32), hidden,
        same & (source.nearness > 0), start,
    )  # fmt: skip


def _spread(color: Floats, beyond: Beyond, chosen: Mask) -> Floats:
    """Colors (H, W, C) of far sides spread to the samples chosen.

    What is of other surfaces gives no color: it is as unknown, and has the color of the nearest
    sample at a silhouette where it is farther away than all that is chosen.
    """
    reach = float(beyond.distance[chosen].max()) + 1.0
    row, column = (np.flatnonzero(chosen.any(axis=axis)) for axis in (1, 0))
    part = (
        slice(max(int(row[0]) - MARGIN, 0), int(row[-1]) + MARGIN + 1),
        slice(max(int(column[0]) - MARGIN, 0), int(column[-1]) + MARGIN + 1),
    )
    unknown = chosen | (~beyond.same & (beyond.distance <= reach))
    nearest = color.reshape(-1, color.shape[2])[beyond.start]
    made = np.where(beyond.same[..., None], color, nearest)
    if not unknown[part].all():
        made[part] = inpainted(made[part], unknown[part])
    return made
