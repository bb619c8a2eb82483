"""Holes of a warped picture: narrow gaps closed, the rest classified, and filled by inpainting.

The filling is made up, not measured, so it is only done on request. `cv2.inpaint` (Telea 2004)
spreads colors inward from a hole's border. Here the border's near side is masked during that, so
that what the source's foreground covered is filled from the far side only.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.equation import inverse
from resample_warp3d.types import Equation, Hole, Rendered, Source, Warped

SOLID = 0.95  # coverage from which a pixel keeps its own color
RADIUS = 3  # px, radius of `cv2.inpaint`
LARGE = 2.0**24  # largest value passed to `cv2.inpaint`
APART = 1.05  # ratio of nearness from which a hole's border has a near and a far side

Mask = NDArray[np.bool_]


class HoleOutline(NamedTuple):
    """Masks for filling holes."""

    unknown: Mask  # (H, W) to be filled, fully or behind a partial cover
    hidden: Mask  # (H, W) known, but on the near side of a hole


def fill(warped: Warped, *, with_depth: bool = True) -> Warped:
    """Fill the holes of a picture, and its depth if requested.

    `warped`: the warped picture. Disoccluded pixels are filled from the far side of their
    surroundings, pixels outside the source or without depth from all sides. Partly covered pixels
    get the filling behind their cover. Result: the same with coverage 1; the causes of holes,
    magnification and confidence are unchanged. If nothing at all is known, the input.
    """
    nearness = np.zeros_like(warped.depth)
    np.divide(1.0, warped.depth, out=nearness, where=(warped.depth > 0) & (warped.coverage > 0))
    rim = hole_outline(warped.coverage, nearness, warped.holes)
    if rim.unknown.all() or not rim.unknown.any():
        return warped
    behind, image = rim.unknown | rim.hidden, warped.image.copy()
    is_part = ~rim.unknown & (warped.coverage < 1.0)
    image[is_part] /= warped.coverage[is_part][:, None]
    image[rim.unknown] = 0.0
    left = np.float32(1.0) - np.clip(warped.coverage[rim.unknown], 0.0, 1.0)[:, None]
    beside = inpainted(image, behind)[rim.unknown]
    image[rim.unknown] = warped.image[rim.unknown] + left * beside
    coverage = np.ones_like(warped.coverage)
    if not with_depth:
        return warped._replace(image=image, coverage=coverage)
    far = inpainted(nearness[..., None], behind)[..., 0]
    is_empty = rim.unknown & (nearness <= 0)
    found = np.where(is_empty, far, nearness)
    depth = np.full_like(warped.depth, np.inf)
    np.divide(1.0, found, out=depth, where=found > 0)
    return warped._replace(image=image, coverage=coverage, depth=depth)


def hole_outline(coverage: Floats, nearness: Floats, holes: NDArray[np.uint8]) -> HoleOutline:
    """Return the unknown pixels, and the known ones that must not flow into them.

    A known pixel is hidden if it is nearer than the midpoint between the nearest and the farthest
    surface that the closest unknown pixel sees up, down, left and right, and if its distance to
    that pixel is at most the largest distance of the hole's pixels to the far side, so that colors
    from beyond the hidden pixels arrive too late.
    """
    unknown = coverage < SOLID
    nowhere = HoleOutline(unknown, np.zeros_like(unknown))
    if unknown.all() or not unknown.any():
        return nowhere
    import cv2

    limit = _middle(nearness, unknown)
    limit[(holes == Hole.OUTSIDE) | (holes == Hole.NO_DEPTH)] = np.inf
    distance, label = cv2.distanceTransformWithLabels(
        (~unknown).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(int(label.max()) + 1, np.int64)  # of the unknown pixel with a label
    place[label[unknown]] = np.flatnonzero(unknown)
    closest = place[label]
    is_near = ~unknown & (nearness > limit.flat[closest])
    is_far = ~unknown & ~is_near
    if not is_far.any():
        return nowhere
    # Measure how far each hole's pixels are from the far side, at most.
    away = cv2.distanceTransform((~is_far).astype(np.uint8), cv2.DIST_L2, 5)
    is_hole = unknown & np.isfinite(limit)
    count, hole = cv2.connectedComponents(is_hole.astype(np.uint8))
    most = np.zeros(count, np.float32)
    np.maximum.at(most, hole[is_hole], away[is_hole])
    return HoleOutline(unknown, is_near & (distance <= most[hole.flat[closest]] + 2 * RADIUS + 2))


def _middle(nearness: Floats, unknown: Mask) -> Floats:
    """Return the nearness between near and far side of unknown pixels; inf if only one."""
    at = np.nonzero(unknown)
    met = []
    for axis, size in enumerate(nearness.shape):
        # Find the last known pixel before each unknown one and the first behind it, or itself.
        number = np.arange(size, dtype=np.int32).reshape((-1, 1) if axis == 0 else (1, -1))
        before = np.maximum.accumulate(np.where(unknown, np.int32(-1), number), axis)[at]
        back = np.flip(np.where(unknown, np.int32(size), number), axis)
        after = np.flip(np.minimum.accumulate(back, axis), axis)[at]
        for place, is_there in ((before, before >= 0), (after, after < size)):
            other = np.where(is_there, place, 0)
            found = nearness[(other, at[1]) if axis == 0 else (at[0], other)]
            met.append(np.where(is_there, found, np.float32(0)))
    near = np.maximum.reduce(met)
    far = np.minimum.reduce([np.where(each > 0, each, np.inf) for each in met])
    limit = np.full(nearness.shape, np.inf, np.float32)
    limit[at] = np.where(near > APART * far, 0.5 * (near + far), np.inf)
    return limit


def inpainted(values: Floats, where: Mask) -> Floats:
    """Inpaint the marked values of (H, W, C) from the others; for any range.

    OpenCV adds up to √2 to every inpainted value, so values are scaled up to make that negligible.
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


def bridged(rendered: Rendered) -> Rendered:
    """Close gaps of up to two pixels from their sides, the farther one first.

    Gaps at which no surface ends open between samples that a view pulls apart; and where a sample
    covers many pixels, the end of its surface is only known to a part of a sample. The input is
    overwritten.
    """
    from resample_warp3d.sheet.kernels.bridging import GROWN, bridge_rows, reach_of_rows

    closed = np.zeros(rendered.coverage.shape, np.bool_)
    coverage = rendered.coverage.copy()
    reach = np.zeros([length + 2 * GROWN for length in coverage.shape], np.uint8)
    reach_of_rows(rendered.coverage, rendered.magnification, reach)
    bridge_rows(
        rendered.image, rendered.coverage, rendered.nearness, rendered.magnification, reach,
        coverage, closed,
    )  # fmt: skip
    return rendered._replace(coverage=coverage, bridged=closed)


def explained(rendered: Rendered, source: Source, equation: Equation) -> NDArray[np.uint8]:
    """Classify each pixel, (H, W) values of `Hole`.

    A hole is assumed to be as far as the farther of its neighbours in its row; an empty row as far
    as the farthest point of the nearest row that is not empty.
    """
    from resample_warp3d.sheet.kernels.bridging import explain_holes

    holes = np.empty(rendered.coverage.shape, np.uint8)
    explain_holes(
        rendered.coverage, rendered.nearness, inverse(equation), source.place,
        source.nearness > 0, farthest_of_rows(rendered), holes,
    )  # fmt: skip
    holes[rendered.bridged] = Hole.CRACK
    return holes


def trusted(rendered: Rendered, source: Source, equation: Equation) -> Floats:
    """Return the trust of the pixels' depth (H, W): 1 where it was not refined.

    Refined depth has the share of votes for it; filled depth half as much.
    """
    from resample_warp3d.sheet.kernels.bridging import sample_map

    found = np.ones(rendered.nearness.shape, np.float32)
    if source.trust.size:
        sample_map(rendered.nearness, inverse(equation), source.place, source.trust, found)
    return found


def farthest_of_rows(rendered: Rendered) -> Floats:
    """Return the nearness (H,) of each row's farthest point, or the nearest row's; 0: none."""
    nearness = np.where(rendered.coverage > 0, rendered.nearness, np.inf).min(axis=1)
    full = np.flatnonzero(np.isfinite(nearness))
    if not full.size:
        return np.zeros(nearness.shape, np.float32)
    rows = np.arange(nearness.size)
    after = np.clip(np.searchsorted(full, rows), 0, full.size - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(full[before] - rows) < np.abs(full[after] - rows)
    return np.asarray(nearness[np.where(is_before, full[before], full[after])], np.float32)
