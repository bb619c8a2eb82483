"""Triangles between neighbouring samples, rasterized band by band into sub-pixels.

A band of the target belongs to one thread, which draws its items in the order of the source: the
same bits for any number of threads.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_comparisons.warp3d.kernels.mcmillan import place_of, projected
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Equation, Rendered, Source

Parts = NDArray[np.uint16]
Vertex = tuple[float, float]

U, V, INVERSE, NEARNESS = range(4)  # of a vertex: px, px, 1 / w (0: not visible), and δ / w

# A quad's triangles are named after their right-angled corner, 2 × row + column: the lowest four
# bits are those drawn, the next four those of them that bridge a cut.
CUT = 4
WHOLE = 256  # all its four sides are links

FARTHEST = 1e6  # px; corners farther outside are not drawn


class Bands(NamedTuple):
    """Rows of the target that are drawn at once, and the items that touch them (CSR)."""

    start: NDArray[np.int64]  # (bands + 1,)
    item: NDArray[np.int32]  # (M,) row × width + column of the source, ascending in every band
    height: int  # px
    samples: int  # sub-pixels per side of a pixel


class Fine(NamedTuple):
    """Sub-pixels of a band."""

    color: Floats  # (R, S, C)
    nearness: Floats  # (R, S) 0: nothing
    magnification: Floats  # (R, S)
    bridged: NDArray[np.bool_]  # (R, S)
    top: int  # px, the band's first row
    samples: int  # per side of a pixel


@kernel
def new_fine(bands: Bands, band: int, rendered: Rendered) -> Fine:
    """Allocate an empty band of sub-pixels."""
    height, width, channels = rendered.image.shape
    top = band * bands.height
    rows, columns = min(bands.height, height - top) * bands.samples, width * bands.samples
    return Fine(
        np.zeros((rows, columns, channels), np.float32),
        np.zeros((rows, columns), np.float32),
        np.zeros((rows, columns), np.float32),
        np.zeros((rows, columns), np.bool_),
        top,
        bands.samples,
    )


@kernel
def _project_row(source: Source, equation: Equation, row: int, vertex: Floats) -> None:
    """Project a row of samples; see `project_rows`."""
    for column in range(vertex.shape[1]):
        nearness = np.float64(source.nearness[row, column])
        x, y, w = projected(equation, place_of(source.place, row, column), nearness)
        # Mark samples without depth, behind the camera or far outside as not visible.
        inverse = 1.0 / w if w > 0.0 and nearness > 0.0 else 0.0
        if not (abs(x * inverse) < FARTHEST and abs(y * inverse) < FARTHEST):
            inverse = 0.0
        vertex[row, column, U] = x * inverse if inverse > 0.0 else 0.0
        vertex[row, column, V] = y * inverse if inverse > 0.0 else 0.0
        vertex[row, column, INVERSE] = inverse
        vertex[row, column, NEARNESS] = nearness * inverse if inverse > 0.0 else 0.0


@parallel_kernel
def project_rows(counter: Counter, source: Source, equation: Equation, vertex: Floats) -> None:
    """Project all samples: fill (H, W, 4) with U, V, INVERSE and NEARNESS."""
    for row in tasks(counter, vertex.shape[0]):
        _project_row(source, equation, row, vertex)


@kernel
def corners(row: int, column: int, part: int) -> tuple[int, int, int, int]:
    """Row and column of a triangle's right-angled corner, and the opposite ones."""
    down, right = part // 2, part % 2
    return row + down, column + right, row + 1 - down, column + 1 - right


@kernel
def twice_area(a: Vertex, b: Vertex, c: Vertex) -> float:
    """Twice the area of a triangle, positive if it turns from +x to +y."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@kernel
def at(vertex: Floats, row: int, column: int) -> Vertex:
    """Place of a sample in the target, px."""
    return np.float64(vertex[row, column, U]), np.float64(vertex[row, column, V])


@kernel
def turn(vertex: Floats, row: int, column: int, part: int) -> float:
    """Twice the area of a quad's triangle in the target, signed as in the source."""
    r, c, other_r, other_c = corners(row, column, part)
    area = twice_area(at(vertex, r, c), at(vertex, r, other_c), at(vertex, other_r, c))
    return area if (r < other_r) == (c < other_c) else -area


@kernel
def _joined(source: Source, row: int, column: int, part: int, step: float) -> int:
    """Kind of a triangle: 0 none, 1 part of a surface, 2 a bridge across a cut."""
    r, c, other_r, other_c = corners(row, column, part)
    values, links = source.nearness, source.links
    a, b, d = values[r, c], values[r, other_c], values[other_r, c]
    # Skip triangles with a corner without depth.
    least = min(a, b, d)
    if least <= 0.0:
        return 0
    # Look up the links along both of its sides.
    sideward, upright = RIGHT if other_c > c else LEFT, DOWN if other_r > r else UP
    is_linked = (links[r, c] & sideward) > 0 and (links[r, c] & upright) > 0
    # Without a limit of steps, only linked triangles are drawn.
    if step < 0.0:
        return 1 if is_linked else 0
    # Cut where the depth steps too much; within the limit, bridge unlinked neighbours.
    if max(a, b, d) > (1.0 + step) * least:
        return 0
    return 1 if is_linked else 2


@kernel
def _divide_quad(
    source: Source, vertex: Floats, row: int, column: int, rule: tuple[float, float]
) -> int:
    """Bits of a quad's triangles to draw, by the diagonal that keeps more surface."""
    step, orientation = rule

    # Classify the four possible triangles.
    state = (
        _joined(source, row, column, 0, step),
        _joined(source, row, column, 1, step),
        _joined(source, row, column, 2, step),
        _joined(source, row, column, 3, step),
    )
    values = source.nearness

    # Choose the diagonal with more triangles, or the one with the smaller step of depth.
    rising = (state[0] > 0) + (state[3] > 0)
    falling = (state[1] > 0) + (state[2] > 0)
    is_rising = rising > falling
    if rising == falling:
        up = abs(values[row, column + 1] - values[row + 1, column])
        is_rising = up <= abs(values[row, column] - values[row + 1, column + 1])
    bits = 0

    # Visit the two triangles of that diagonal.
    for part in range(4):
        if (part % 3 == 0) != is_rising or state[part] == 0:
            continue
        # Cull triangles behind the camera, and back faces.
        r, c, other_r, other_c = corners(row, column, part)
        is_ahead = vertex[r, c, INVERSE] > 0.0 and vertex[r, other_c, INVERSE] > 0.0
        is_ahead = is_ahead and vertex[other_r, c, INVERSE] > 0.0
        if is_ahead and turn(vertex, row, column, part) * orientation > 0.0:
            bits |= 1 << part
            bits |= 1 << (part + CUT) if state[part] == 2 else 0

    # Mark quads that are linked on all sides: their color is bilinear.
    if state[0] == 1 and state[1] == 1 and state[2] == 1 and state[3] == 1:
        bits |= WHOLE
    return bits


@kernel
def include(vertex: Floats, row: int, column: int, box: Floats) -> None:
    """Extend a box (left, top, right, bottom) to a sample, if it is visible."""
    if vertex[row, column, INVERSE] > 0.0:
        box[0] = min(box[0], vertex[row, column, U])
        box[1] = min(box[1], vertex[row, column, V])
        box[2] = max(box[2], vertex[row, column, U])
        box[3] = max(box[3], vertex[row, column, V])


@kernel
def _divide_row(
    source: Source,
    vertex: Floats,
    rule: tuple[float, float],
    row: int,
    parts: Parts,
    box: Floats,
) -> None:
    """Divide a row of quads; see `divide_rows`."""
    for column in range(parts.shape[1]):
        parts[row, column] = _divide_quad(source, vertex, row, column, rule)
        box[row, column, 0], box[row, column, 2] = np.inf, -np.inf
        box[row, column, 1], box[row, column, 3] = np.inf, -np.inf
        # Bound the visible quads; others keep an empty box.
        if parts[row, column] & 15:
            for n in range(4):
                include(vertex, row + n // 2, column + n % 2, box[row, column])


@parallel_kernel
def divide_rows(
    counter: Counter,
    source: Source,
    vertex: Floats,
    rule: tuple[float, float],
    parts: Parts,
    box: Floats,
) -> None:
    """Divide the quads between samples into triangles.

    `vertex`: (H, W, 4) as in `project_rows`. `rule`: largest step of nearness within a triangle,
    relative to the farthest (below 0: only where samples are linked), and the sign of the area of
    front faces. `parts`: (H − 1, W − 1) filled: which triangles are drawn. `box`: (H − 1, W − 1, 4)
    filled: left, top, right, bottom of them in the target, px.
    """
    for row in tasks(counter, parts.shape[0]):
        _divide_row(source, vertex, rule, row, parts, box)


@kernel
def deal(
    box: Floats,
    shape: tuple[int, int],
    height: int,
    position: NDArray[np.int64],
    item: NDArray[np.int32],
    width: int,
) -> None:
    """Sort items into bands, each from its `position` on, which moves to their end.

    Items are numbered as samples of a source that is `width` wide; one that is not drawn has a box
    with left above right. With an empty `item` only positions move: that counts the items.
    """
    last = len(position) - 1
    for row in range(box.shape[0]):
        for column in range(box.shape[1]):
            left, right = box[row, column, 0], box[row, column, 2]
            top, bottom = box[row, column, 1], box[row, column, 3]
            # Skip items that are empty or outside the picture.
            if not (left <= right and right >= 0 and left <= shape[1]):
                continue
            if bottom < 0 or top > shape[0]:
                continue
            # Append the item to every band that it touches.
            first = int(max(top, np.float32(0))) // height
            for band in range(
                first, min(int(min(bottom, np.float32(shape[0]))) // height, last) + 1
            ):
                if len(item) > 0:
                    item[position[band]] = row * width + column
                position[band] += 1


@kernel
def _draw_triangle(
    source: Source, vertex: Floats, item: tuple[int, int, int], bits: int, fine: Fine
) -> None:
    """Rasterize one triangle of a quad, (row, column, part), into a band."""
    # Scale the corners to the band's sub-pixels.
    row, column, part = item
    r, c, other_r, other_c = corners(row, column, part)
    scale, top = float(fine.samples), float(fine.top)
    ax, ay = scale * vertex[r, c, U], scale * (vertex[r, c, V] - top)
    bx, by = scale * vertex[r, other_c, U], scale * (vertex[r, other_c, V] - top)
    dx, dy = scale * vertex[other_r, c, U], scale * (vertex[other_r, c, V] - top)
    area = twice_area((ax, ay), (bx, by), (dx, dy))

    # Bound the triangle within the band.
    rows, columns = fine.nearness.shape
    first_row = math.ceil(max(min(ay, by, dy) - 0.5, 0.0))
    last_row = math.floor(min(max(ay, by, dy) - 0.5, rows - 1.0))
    first_column = math.ceil(max(min(ax, bx, dx) - 0.5, 0.0))
    last_column = math.floor(min(max(ax, bx, dx) - 0.5, columns - 1.0))

    # Load nearness and perspective weights of the corners.
    near_a, near_b = vertex[r, c, NEARNESS], vertex[r, other_c, NEARNESS]
    near_d = vertex[other_r, c, NEARNESS]
    weight_a, weight_b = vertex[r, c, INVERSE], vertex[r, other_c, INVERSE]
    weight_d = vertex[other_r, c, INVERSE]
    magnification = abs(area) / (scale * scale)
    is_bridge = (bits >> (part + CUT)) & 1 > 0
    color, total = source.color, fine.color

    # Visit the sub-pixels within the bounds.
    for i in range(first_row, last_row + 1):
        for j in range(first_column, last_column + 1):
            # Test the center by barycentric coordinates.
            place = (j + 0.5, i + 0.5)
            share_a = twice_area((bx, by), (dx, dy), place) / area
            share_b = twice_area((dx, dy), (ax, ay), place) / area
            share_d = twice_area((ax, ay), (bx, by), place) / area
            if share_a < 0.0 or share_b < 0.0 or share_d < 0.0:
                continue
            # Depth test; nearness is linear on the screen.
            nearness = np.float32(share_a * near_a + share_b * near_b + share_d * near_d)
            if nearness <= fine.nearness[i, j]:
                continue
            fine.nearness[i, j], fine.magnification[i, j] = nearness, magnification
            fine.bridged[i, j] = is_bridge
            # Weigh by 1 / w: barycentric coordinates in the source, corrected for perspective.
            share_a, share_b, share_d = share_a * weight_a, share_b * weight_b, share_d * weight_d
            inverse = 1.0 / (share_a + share_b + share_d)
            along, across = share_b * inverse, share_d * inverse
            # Interpolate the color, bilinearly in quads that are linked on all sides.
            twist = along * across if bits & WHOLE else 0.0
            a, b = np.float32(1.0 - along - across + twist), np.float32(along - twist)
            d, e = np.float32(across - twist), np.float32(twist)
            for channel in range(color.shape[2]):
                total[i, j, channel] = (
                    a * color[r, c, channel]
                    + b * color[r, other_c, channel]
                    + d * color[other_r, c, channel]
                    + e * color[other_r, other_c, channel]
                )


@kernel
def _resolve_pixel(fine: Fine, row: int, column: int, rendered: Rendered) -> None:
    """Average a pixel's sub-pixels; the nearest gives depth and magnification."""
    n, image = fine.samples, rendered.image
    share = np.float32(1.0 / (n * n))
    i, covered = fine.top + row, 0
    # Clear the pixel.
    rendered.nearness[i, column], rendered.magnification[i, column] = 0.0, 0.0
    rendered.bridged[i, column] = False
    for channel in range(image.shape[2]):
        image[i, column, channel] = 0.0
    # Average over the sub-pixels that show something.
    for r in range(row * n, (row + 1) * n):
        for c in range(column * n, (column + 1) * n):
            if fine.nearness[r, c] <= 0.0:
                continue
            covered += 1
            for channel in range(image.shape[2]):
                image[i, column, channel] += share * fine.color[r, c, channel]
            # Keep the nearest one's depth.
            if fine.nearness[r, c] > rendered.nearness[i, column]:
                rendered.nearness[i, column] = fine.nearness[r, c]
                rendered.magnification[i, column] = fine.magnification[r, c]
                rendered.bridged[i, column] = fine.bridged[r, c]
    rendered.coverage[i, column] = share * covered


@kernel
def resolve(fine: Fine, rendered: Rendered) -> None:
    """Reduce a band's sub-pixels to pixels."""
    for row in range(fine.nearness.shape[0] // fine.samples):
        for column in range(rendered.coverage.shape[1]):
            _resolve_pixel(fine, row, column, rendered)


@kernel
def _draw_band(
    source: Source, vertex: Floats, parts: Parts, bands: Bands, band: int, rendered: Rendered
) -> None:
    """Draw one band of the picture."""
    width = vertex.shape[1]
    fine = new_fine(bands, band, rendered)
    # Draw the band's items in the order of the source.
    for n in range(bands.start[band], bands.start[band + 1]):
        row, column = divmod(bands.item[n], width)
        bits = int(parts[row, column])
        for part in range(4):
            if bits & (1 << part):
                _draw_triangle(source, vertex, (row, column, part), bits, fine)
    resolve(fine, rendered)


@parallel_kernel
def draw_bands(
    counter: Counter, source: Source, vertex: Floats, parts: Parts, bands: Bands, rendered: Rendered
) -> None:
    """Draw the triangles of `divide_rows` into a picture, band by band."""
    for band in tasks(counter, len(bands.start) - 1):
        _draw_band(source, vertex, parts, bands, band, rendered)
