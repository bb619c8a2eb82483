"""Make the sheet of cells that the hybrid method warps, once per source."""

import numpy as np

from resample.types import Doubles, Floats
from resample_warp3d.types import MARGIN, Sheet, Source

KEPT = 4  # sheets
PRECISION = 1e-6  # relative error of a float's nearness


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
    from resample_warp3d.sheet.kernels.limbs import Silhouettes, mark_ends

    nearness, links = source.nearness, source.links
    height, width = nearness.shape
    color, edge = alone(source, is_label=is_label)
    vertex = np.empty((height + 1, width + 1), np.float32)
    corners.fill_vertices(nearness, links, vertex)
    index = np.empty((height, width), np.int32)
    corner = np.empty((corners.number_torn(nearness, vertex, index), 4, 3), np.float32)
    roundness = np.empty((len(corner), 4, 2), np.float32)
    silhouettes = Silhouettes(edge, error_of(source))
    corners.fill_torn(nearness, links, silhouettes, index, corner, roundness)
    ends = np.argwhere(roundness.any(axis=2)).astype(np.int32, order="C")
    marked = np.empty_like(links)
    mark_ends(nearness, links, silhouettes.error, marked)
    place = corner_places(source.place)
    if place.size:
        bend(corner, place)
    return Sheet(
        grouped(color), vertex, place, index, corner, np.pad(marked, MARGIN), ends,
        roundness[ends[:, 0], ends[:, 1]],
    )  # fmt: skip


def alone(source: Source, *, is_label: bool = False) -> tuple[Floats, Floats]:
    """Return unmixed colors (H, W, C) of surfaces, and silhouettes (H, W, 2).

    Silhouettes are those of `outlines.find_silhouettes`; labels are not unmixed.
    """
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
    """Interpolate the positions of the lattice's corners from those of the samples."""
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
