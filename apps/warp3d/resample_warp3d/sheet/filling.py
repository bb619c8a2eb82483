"""Holes filled with what probably lies there: the background goes on behind what stood before it.

Not measured but made up, so nothing of it happens unless asked for. `cv2.inpaint` (Telea 2004)
spreads colors inward from a hole's rim; here the rim's near side is hidden from it, and put back
afterwards, so that what the source's foreground covered is filled from the far side alone.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.types import Hole, Warped

SOLID = 0.95  # coverage from which a pixel's own color will do
RADIUS = 3  # px that `cv2.inpaint` looks around itself
LARGE = 2.0**24  # what the largest value becomes for `cv2.inpaint`
APART = 1.05  # ratio of nearness from which a hole's rim has a near and a far side

Mask = NDArray[np.bool_]


class Rim(NamedTuple):
    """What lies around the holes."""

    unknown: Mask  # (H, W) to be filled, wholly or behind what covers them in part
    hidden: Mask  # (H, W) known, but on a hole's near side


def fill(warped: Warped) -> Warped:
    """Picture and depth without holes.

    Parameters
    ----------
    warped
        What is disoccluded is filled from the far side of its surroundings, what is outside the
        source or has no depth there from all sides. Pixels that are covered in part get the filling
        behind what covers them.

    Returns
    -------
    The same with coverage 1; the holes' types, magnification and confidence stay as they are. With
    nothing known at all, what was given.
    """
    nearness = np.zeros_like(warped.depth)
    np.divide(1.0, warped.depth, out=nearness, where=(warped.depth > 0) & (warped.coverage > 0))
    rim = rim_of(warped.coverage, nearness, warped.holes)
    if rim.unknown.all() or not rim.unknown.any():
        return warped
    behind = rim.unknown | rim.hidden
    part = np.clip(warped.coverage, 0.0, 1.0)[..., None]
    color = np.divide(
        warped.image, part, out=np.zeros_like(warped.image), where=~rim.unknown[..., None]
    )
    image = warped.image + (1.0 - part) * inpainted(color, behind)
    image = np.where(rim.unknown[..., None], image, color)
    far = inpainted(nearness[..., None], behind)[..., 0]
    is_empty = rim.unknown & (nearness <= 0)
    found = np.where(is_empty, far, nearness)
    depth = np.full_like(warped.depth, np.inf)
    np.divide(1.0, found, out=depth, where=found > 0)
    return warped._replace(
        image=image.astype(np.float32),
        coverage=np.ones_like(warped.coverage),
        depth=depth,
    )


def rim_of(coverage: Floats, nearness: Floats, holes: NDArray[np.uint8]) -> Rim:
    """What is unknown, and what of the known must not flow into it.

    A known pixel is hidden if it is nearer than the middle between the nearest and the farthest
    surface that the closest unknown pixel sees up, down, left and right of itself, and if it lies
    no farther from there than the far side lies from any pixel of the same hole, so that what
    spreads from behind the hidden comes too late.
    """
    unknown = coverage < SOLID
    nowhere = Rim(unknown, np.zeros_like(unknown))
    if unknown.all() or not unknown.any():
        return nowhere
    import cv2

    limit = _middle(nearness, unknown)
    limit[(holes == Hole.OUTSIDE) | (holes == Hole.NO_DEPTH)] = np.inf
    distance, label = cv2.distanceTransformWithLabels(
        (~unknown).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(int(label.max()) + 1, np.int64)  # of the unknown pixel that has a label
    place[label[unknown]] = np.flatnonzero(unknown)
    closest = place[label]
    is_near = ~unknown & (nearness > limit.flat[closest])
    is_far = ~unknown & ~is_near
    if not is_far.any():
        return nowhere
    reach = _reach(is_far, unknown & np.isfinite(limit))
    return Rim(unknown, is_near & (distance <= reach.flat[closest] + 2 * RADIUS + 2))


def _reach(is_far: Mask, is_hole: Mask) -> Floats:
    """Distance in px from the far side to the pixel of each hole that is farthest from it."""
    import cv2

    away = cv2.distanceTransform((~is_far).astype(np.uint8), cv2.DIST_L2, 5)
    count, label = cv2.connectedComponents(is_hole.astype(np.uint8))
    most = np.zeros(count, np.float32)
    np.maximum.at(most, label[is_hole], away[is_hole])
    return np.asarray(most[label], np.float32)


def _middle(nearness: Floats, unknown: Mask) -> Floats:
    """Nearness between the near and the far side of each unknown pixel; inf where it has one."""
    views = [
        _met(nearness, unknown),
        _met(nearness[:, ::-1], unknown[:, ::-1])[:, ::-1],
        _met(nearness.T, unknown.T).T,
        _met(nearness[::-1].T, unknown[::-1].T).T[::-1],
    ]
    met = np.stack(views)
    near = met.max(axis=0)
    far = np.where(met > 0, met, np.inf).min(axis=0)
    limit = np.full(nearness.shape, np.inf, np.float32)
    is_apart = unknown & (near > APART * far)
    limit[is_apart] = 0.5 * (near + far)[is_apart]
    return limit


def _met(nearness: Floats, unknown: Mask) -> Floats:
    """Nearness of the first known pixel to the left; 0 where there is none."""
    column = np.where(unknown, -1, np.arange(nearness.shape[1]))
    last = np.maximum.accumulate(column, axis=1)
    found = np.take_along_axis(nearness, np.maximum(last, 0), axis=1)
    return np.where(last >= 0, found, np.float32(0))


def inpainted(values: Floats, where: Mask) -> Floats:
    """Values (H, W, C) with the marked ones made up from the others; any range.

    OpenCV adds up to √2 to every value it makes up, in whatever unit: nothing where they are large.
    """
    import cv2

    mask = where.astype(np.uint8)
    filled = np.empty_like(values)
    for n in range(values.shape[2]):
        known = values[..., n][~where]
        low, high = float(known.min()), float(known.max())
        scale = LARGE / max(abs(low), abs(high), 1e-30)
        plane = cv2.inpaint(values[..., n] * np.float32(scale), mask, RADIUS, cv2.INPAINT_TELEA)
        filled[..., n] = np.clip(plane / np.float32(scale), low, high)
    return filled
