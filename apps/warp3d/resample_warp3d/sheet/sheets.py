"""Sheets of cells that the hybrid method warps, and the layer behind silhouettes, once a source.

Every frame of a film shows the same layer, so the made-up content moves with the scene instead of
changing from frame to frame. Its depth extrapolates the far side of a silhouette along its slope;
its color spreads from the far side only, after the near side's light has been removed from its
samples.
"""

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.filling import inpainted
from resample_warp3d.types import (
    DOWN,
    LEFT,
    MARGIN,
    RIGHT,
    UP,
    DepthImage,
    Hole,
    Sheet,
    Source,
    Warped,
)

KEPT = 4  # sheets
PRECISION = 1e-6  # relative error of a float's nearness
REACH = 0.12  # of the longer side: how far the layer extends behind a silhouette
APART = 1.03  # ratio of nearness from which one surface hides another
RING = 3  # samples of the far side included in the layer
STEEP = 0.5  # of the nearness: largest change from a silhouette to the layer's end
AROUND = 10  # samples around the made-up ones used for their colors
CLASSES = 6  # of far sides by nearness, so that near ones do not hide farther ones

Mask = NDArray[np.bool_]
FarSides = tuple[Floats, Floats, Mask, Mask, NDArray[np.int64]]  # of `_one_class`
NEIGHBOURS = ((RIGHT, 0, 1), (DOWN, 1, 0), (LEFT, 0, -1), (UP, -1, 0))


class SheetCache:
    """Cache of the sheets of the last few sources."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, bool], tuple[Source, Sheet]] = {}

    def __call__(self, source: Source, *, is_label: bool = False) -> Sheet:
        """Return the sheet of a source; see `sheet_of`."""
        key = id(source), is_label
        if key not in self._made:
            while len(self._made) >= KEPT:
                del self._made[next(iter(self._made))]
            self._made[key] = source, sheet_of(source, is_label=is_label)  # keeps the id taken
        return self._made[key][1]


def sheet_of(source: Source, *, is_label: bool = False) -> Sheet:
    """Make the sheet of a prepared source."""
    from resample_warp3d.sheet.kernels import corners

    nearness, links = source.nearness, source.links
    height, width = nearness.shape
    color, edge = alone(source, is_label=is_label)
    vertex = np.empty((height + 1, width + 1), np.float32)
    corners.fill_vertices(nearness, links, vertex)
    index = np.empty((height, width), np.int32)
    corner = np.empty((corners.number_torn(nearness, vertex, index), 4, 3), np.float32)
    roundness = np.empty((len(corner), 4, 2), np.float32)
    error = error_of(source)
    corners.fill_torn(nearness, links, edge, error, index, corner, roundness)
    ends = np.argwhere(roundness.any(axis=2)).astype(np.int32, order="C")
    marked = np.empty_like(links)
    corners.mark_ends(nearness, links, error, marked)
    place = corner_places(source.place)
    if place.size:
        bend(corner, place)
    return Sheet(
        grouped(color), vertex, place, index, corner, np.pad(marked, MARGIN), ends,
        roundness[ends[:, 0], ends[:, 1]],
    )  # fmt: skip


def alone(source: Source, *, is_label: bool = False) -> tuple[Floats, Floats]:
    """Return unmixed colors (H, W, C) of surfaces, but of labels, and silhouettes (H, W, 2)."""
    from resample_warp3d.depth.kernels import outlines

    nearness, links = source.nearness, source.links
    edge = np.empty((*nearness.shape, 2), np.float32)
    error = error_of(source)
    if is_label:
        outlines.find_silhouettes(np.zeros_like(source.color), nearness, links, error, edge)
        return source.color, edge
    outlines.find_silhouettes(source.color, nearness, links, error, edge)
    color = np.empty_like(source.color)
    outlines.unmix(source.color, nearness, links, edge, color)
    return color, edge


def error_of(source: Source) -> Doubles:
    """Return the error (2,) of a source's nearness: relative, and absolute."""
    return np.array([max(source.noise, PRECISION), 0.3 * source.step])


def grouped(color: Floats) -> Floats:
    """Group channels by three, (G, 3, H + 4, W + 4), padded with zeros."""
    height, width, channels = color.shape
    shape = -(-channels // 3), 3, height + 2 * MARGIN, width + 2 * MARGIN
    groups = np.zeros(shape, np.float32)
    inside = slice(MARGIN, MARGIN + height), slice(MARGIN, MARGIN + width)
    for c in range(channels):
        groups[c // 3, c % 3][inside] = color[..., c]
    return groups


def corner_places(place: Doubles) -> Doubles:
    """Interpolate the positions of the lattice's corners from the samples'."""
    if not place.size:
        return place
    ahead = np.pad(place, ((1, 1), (1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    return 0.25 * (ahead[:-1, :-1] + ahead[1:, :-1] + ahead[:-1, 1:] + ahead[1:, 1:])


def bend(corner: Floats, place: Doubles) -> None:
    """Move corners (N, 4, 3) from the lattice to their undistorted positions."""
    height, width = place.shape[0] - 1, place.shape[1] - 1
    column = np.clip(np.floor(corner[..., 0]).astype(np.int64), 0, width - 1)
    row = np.clip(np.floor(corner[..., 1]).astype(np.int64), 0, height - 1)
    u, v = (corner[..., 0] - column)[..., None], (corner[..., 1] - row)[..., None]
    above = (1 - u) * place[row, column] + u * place[row, column + 1]
    below = (1 - u) * place[row + 1, column] + u * place[row + 1, column + 1]
    corner[..., :2] = (1 - v) * above + v * below


def background(source: Source, reach: float = REACH) -> Source | None:
    """Return the background layer behind the silhouettes of a source.

    Parameters
    ----------
    source
        A prepared depth image.
    reach
        Extent of the layer behind a silhouette, as a share of the picture's longer side.

    Returns
    -------
    A source of the same size, with depth where something is hidden and for a few samples around;
    None if nothing is hidden.

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
    >>> layer = background(prepare(DepthImage(color, nearness)))
    >>> layer.nearness[16, 6:14].tolist()  # goes on for 3 px
    [0.25, 0.25, 0.25, 0.25, 0.25, 0.0, 0.0, 0.0]
    """
    if not 0.0 < reach <= 1.0:
        raise ValueError(f"reach {reach:g}; give a share of the picture's side, above 0 up to 1")
    far = far_sides(source)
    if not far.any():
        return None
    classes = _classes(source, far, reach * max(far.shape))
    away = np.stack([np.where(behind, distance, np.inf) for distance, _, behind, *_ in classes])
    first, hidden = away.argmin(axis=0), np.isfinite(away).any(axis=0)
    if not hidden.any():
        return None
    color, _ = alone(source)
    made, depth = color.copy(), np.zeros_like(source.nearness)
    for n, (distance, nearness, _, same, start) in enumerate(classes):
        depth = np.where(same & (distance <= RING) & ~hidden, source.nearness, depth)
        chosen = hidden & (first == n)
        if chosen.any():
            depth = np.where(chosen, nearness, depth)
            made[chosen] = _spread(color, distance, same, start, chosen)[chosen]
    return prepare(DepthImage(made, depth, source.place), noise=0.0, step=0.0)


def behind(warped: Warped, layer: Warped) -> Warped:
    """Composite a picture over the layer where the source is occluded.

    Pixels outside the source or without depth stay empty, as the layer has nothing there. The
    causes of holes are kept.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, background, behind, of_rectified, prepare, render
    >>> color, disparity = np.ones((32, 32, 3), np.float32), np.full((32, 32), 1, np.float32)
    >>> disparity[8:24, 8:24] = 6  # a square before a wall
    >>> source = prepare(DepthImage(color, disparity))
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
    """Return the samples (H, W) beside a nearer surface."""
    nearness, links = source.nearness, source.links
    padded = np.pad(nearness, 1)
    height, width = nearness.shape
    found = np.zeros(nearness.shape, np.bool_)
    for bit, down, right in NEIGHBOURS:
        other = padded[1 + down : 1 + down + height, 1 + right : 1 + right + width]
        found |= ((links & bit) == 0) & (nearness > 0) & (other > APART * nearness)
    return found


def _classes(source: Source, far: Mask, most: float) -> list[FarSides]:
    """Split far sides into classes by nearness."""
    limits = np.quantile(source.nearness[far], np.linspace(0, 1, CLASSES + 1)[1:-1])
    member = np.searchsorted(limits, source.nearness, side="right")
    chosen = [far & (member == n) for n in range(CLASSES)]
    return [_one_class(source, each, most) for each in chosen if each.any()]


def _one_class(source: Source, far: Mask, most: float) -> FarSides:
    """Extrapolate the far sides of one class behind their silhouettes.

    Returns (H, W) each: the distance to the nearest sample at a silhouette; the nearness of its
    surface; whether that lies behind the sample, close enough to its silhouette; whether the sample
    belongs to it; and the number of the sample at the silhouette.
    """
    import cv2

    width = far.shape[1]
    distance, label = cv2.distanceTransformWithLabels(
        (~far).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    place = np.zeros(int(label.max()) + 1, np.int64)  # of the far side with a label
    place[label[far]] = np.flatnonzero(far)
    start = place[label]
    row, column = np.indices(far.shape)
    slope = source.slope.reshape(-1, 2)[start]
    change = slope[..., 0] * (column - start % width) + slope[..., 1] * (row - start // width)
    first = source.nearness.reshape(-1)[start]
    nearness = first + np.clip(change, -STEEP * first, STEEP * first)
    same = np.abs(source.nearness - nearness) <= (APART - 1.0) * nearness
    hidden = (distance <= most) & (nearness > 0) & (source.nearness > APART * nearness)
    same &= source.nearness > 0
    return np.asarray(distance, np.float32), np.asarray(nearness, np.float32), hidden, same, start


def _spread(
    color: Floats, distance: Floats, same: Mask, start: NDArray[np.int64], chosen: Mask
) -> Floats:
    """Spread the colors (H, W, C) of far sides to the chosen samples.

    Samples of other surfaces give no color: they count as unknown, or, where they are farther away
    than all chosen samples, get the color of the nearest sample at a silhouette.
    """
    reach = float(distance[chosen].max()) + 1.0
    row, column = (np.flatnonzero(chosen.any(axis=axis)) for axis in (1, 0))
    part = (
        slice(max(int(row[0]) - AROUND, 0), int(row[-1]) + AROUND + 1),
        slice(max(int(column[0]) - AROUND, 0), int(column[-1]) + AROUND + 1),
    )
    unknown = chosen | (~same & (distance <= reach))
    nearest = color.reshape(-1, color.shape[2])[start]
    made = np.where(same[..., None], color, nearest)
    if not unknown[part].all():
        made[part] = inpainted(made[part], unknown[part])
    return made
