"""Grids of subsamples between linked samples, drawn to nearest sub-pixels."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Single
from resample_comparisons.warp3d.kernels.mcmillan import expansion, tangents
from resample_comparisons.warp3d.kernels.meshing import (
    INVERSE,
    NEARNESS,
    Bands,
    Fine,
    U,
    V,
    at,
    include,
    new_fine,
    resolve,
    twice_area,
)
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Equation, Links, Rendered, Source

Corner = tuple[float, float, float, float]  # x, y, w and δ
Kinds = NDArray[np.uint8]

# Bits of a sample: the quad right and below of it is filled; the sample itself is drawn.
QUAD, ALONE = 1, 2


@kernel
def _is_linked(links: Links, row: int, column: int) -> bool:
    """Whether the quad right and below of a sample is linked on all four sides."""
    if row < 0 or column < 0 or row + 1 >= links.shape[0] or column + 1 >= links.shape[1]:
        return False
    here, opposite = links[row, column], links[row + 1, column + 1]
    return bool(here & RIGHT and here & DOWN and opposite & LEFT and opposite & UP)


@kernel
def _area(vertex: Floats, row: int, column: int) -> float:
    """Area of a quad in the target, px², signed as in the source."""
    a, b = at(vertex, row, column), at(vertex, row, column + 1)
    c, d = at(vertex, row + 1, column), at(vertex, row + 1, column + 1)
    return 0.5 * (twice_area(a, b, c) + twice_area(d, c, b))


@kernel
def _is_drawn(links: Links, vertex: Floats, place: tuple[int, int], orientation: float) -> bool:
    """Whether a quad (row, column) is linked, in front of the camera and a front face."""
    row, column = place
    if not _is_linked(links, row, column):
        return False
    for n in range(4):
        if vertex[row + n // 2, column + n % 2, INVERSE] <= 0.0:
            return False
    return bool(_area(vertex, row, column) * orientation > 0.0)


@kernel
def _is_interior(links: Links, row: int, column: int) -> bool:
    """Whether all four quads around a sample are linked on all sides."""
    above = _is_linked(links, row - 1, column - 1) and _is_linked(links, row - 1, column)
    return above and _is_linked(links, row, column - 1) and _is_linked(links, row, column)


@kernel
def _sort_row(
    source: Source,
    equation: Equation,
    vertex: Floats,
    orientation: float,
    row: int,
    kind: Kinds,
    box: Floats,
) -> None:
    """Sort a row; see `sort_rows`."""
    links = source.links
    for column in range(kind.shape[1]):
        kind[row, column] = 0
        box[row, column, 0], box[row, column, 2] = np.inf, -np.inf
        box[row, column, 1], box[row, column, 3] = np.inf, -np.inf
        # Fill whole quads.
        if _is_drawn(links, vertex, (row, column), orientation):
            kind[row, column] |= QUAD
            for n in range(4):
                include(vertex, row + n // 2, column + n % 2, box[row, column])
        # Draw samples at the border of a surface alone, if they face the camera.
        if vertex[row, column, INVERSE] > 0.0 and not _is_interior(links, row, column):
            point, across, down = tangents(source, equation, row, column)
            if expansion(point, across, down) * orientation > 0.0:
                kind[row, column] |= ALONE
                include(vertex, row, column, box[row, column])


@parallel_kernel
def sort_rows(
    counter: Counter,
    source: Source,
    equation: Equation,
    vertex: Floats,
    orientation: float,
    kind: Kinds,
    box: Floats,
) -> None:
    """Find the quads that are filled and the samples that are drawn alone.

    `vertex`: (H, W, 4) as in `meshing.project_rows`. `orientation`: sign of the area of front
    faces. `kind`: (H, W) filled: the bits QUAD and ALONE. `box`: (H, W, 4) filled: left, top,
    right, bottom of the drawn part of the target, px.
    """
    for row in tasks(counter, kind.shape[0]):
        _sort_row(source, equation, vertex, orientation, row, kind, box)


@kernel
def _extent(vertex: Floats, row: int, column: int, axis: int) -> float:
    """Extent of a quad's sides along an axis, px: the longer of each two, added up."""
    a, b = vertex[row, column, axis], vertex[row, column + 1, axis]
    c, d = vertex[row + 1, column, axis], vertex[row + 1, column + 1, axis]
    return float(max(abs(b - a), abs(d - c)) + max(abs(c - a), abs(d - b)))


@kernel
def _may_show(fine: Fine, x: float, y: float, nearness: Single) -> bool:
    """Depth test: whether a place in sub-pixels is inside, and nothing is nearer."""
    rows, columns = fine.nearness.shape
    if not (0.0 <= x < columns and 0.0 <= y < rows):
        return False
    return bool(nearness > fine.nearness[int(y), int(x)])


@kernel
def _corner(vertex: Floats, row: int, column: int) -> Corner:
    """A sample in the target before the division."""
    w = 1.0 / np.float64(vertex[row, column, INVERSE])
    return (
        w * vertex[row, column, U],
        w * vertex[row, column, V],
        w,
        w * vertex[row, column, NEARNESS],
    )


@kernel
def _between(a: Corner, b: Corner, share: float) -> Corner:
    """Interpolate between two points, a `share` of the way."""
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
        a[3] + share * (b[3] - a[3]),
    )


@kernel
def _put_between(
    color: Floats, row: int, column: int, share: tuple[float, float], target: Floats
) -> None:
    """Interpolate color bilinearly, at shares of a column and a row in a quad."""
    s, t = share
    a, b = np.float32((1.0 - s) * (1.0 - t)), np.float32(s * (1.0 - t))
    c, d = np.float32((1.0 - s) * t), np.float32(s * t)
    for channel in range(color.shape[2]):
        target[channel] = (
            a * color[row, column, channel]
            + b * color[row, column + 1, channel]
            + c * color[row + 1, column, channel]
            + d * color[row + 1, column + 1, channel]
        )


@kernel
def _fill_quad(
    source: Source, vertex: Floats, row: int, column: int, most: int, fine: Fine
) -> None:
    """Write a quad's subsamples.

    Color and homogeneous place are bilinear between its corners. Of the n × n cells around the
    subsamples none is wider or higher than a sub-pixel, so that no sub-pixel inside is missed.
    """
    # Choose the number of subsamples by the quad's extent.
    scale = float(fine.samples)
    extent = scale * max(_extent(vertex, row, column, U), _extent(vertex, row, column, V))
    n = max(1, math.ceil(min(float(most), extent)))
    magnification = np.float32(abs(_area(vertex, row, column)))

    # Undo the division at the corners, so that bilinear interpolation is in perspective.
    a, b = _corner(vertex, row, column), _corner(vertex, row, column + 1)
    c, d = _corner(vertex, row + 1, column), _corner(vertex, row + 1, column + 1)

    # Visit the subsamples row by row.
    for i in range(n):
        t = (i + 0.5) / n
        left, right = _between(a, c, t), _between(b, d, t)
        for j in range(n):
            s = (j + 0.5) / n
            # Divide, and write the subsample if it passes the depth test.
            point = _between(left, right, s)
            inverse = 1.0 / point[2]
            x, y = scale * (point[0] * inverse), scale * (point[1] * inverse - fine.top)
            nearness = np.float32(point[3] * inverse)
            if _may_show(fine, x, y, nearness):
                r, k = int(y), int(x)
                fine.nearness[r, k], fine.magnification[r, k] = nearness, magnification
                _put_between(source.color, row, column, (s, t), fine.color[r, k])


@kernel
def _put_sample(
    source: Source, equation: Equation, vertex: Floats, row: int, column: int, fine: Fine
) -> None:
    """Write one sample to its nearest sub-pixel."""
    x = fine.samples * float(vertex[row, column, U])
    y = fine.samples * (float(vertex[row, column, V]) - fine.top)
    nearness = vertex[row, column, NEARNESS]
    # Skip samples outside the band or hidden.
    if not _may_show(fine, x, y, nearness):
        return
    # Write depth, magnification and color.
    point, across, down = tangents(source, equation, row, column)
    fine.nearness[int(y), int(x)] = nearness
    fine.magnification[int(y), int(x)] = abs(expansion(point, across, down))
    for channel in range(source.color.shape[2]):
        fine.color[int(y), int(x), channel] = source.color[row, column, channel]


@kernel
def _fill_band(
    source: Source,
    equation: Equation,
    vertex: Floats,
    kind: Kinds,
    bands: Bands,
    band: int,
    rendered: Rendered,
    most: int,
) -> None:
    """Draw one band of the picture."""
    width = vertex.shape[1]
    fine = new_fine(bands, band, rendered)
    # Draw the band's items in the order of the source.
    for n in range(bands.start[band], bands.start[band + 1]):
        row, column = divmod(bands.item[n], width)
        if kind[row, column] & QUAD:
            _fill_quad(source, vertex, row, column, most, fine)
        if kind[row, column] & ALONE:
            _put_sample(source, equation, vertex, row, column, fine)
    resolve(fine, rendered)


@parallel_kernel
def fill_bands(
    counter: Counter,
    source: Source,
    equation: Equation,
    vertex: Floats,
    kind: Kinds,
    bands: Bands,
    most: int,
    rendered: Rendered,
) -> None:
    """Draw what `sort_rows` found, with at most `most` × `most` subsamples per quad."""
    for band in tasks(counter, len(bands.start) - 1):
        _fill_band(source, equation, vertex, kind, bands, band, rendered, most)
