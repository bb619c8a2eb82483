"""Add points to the open slabs of a tile, each to the slab of its center."""

import math

import numpy as np

from resample.engine.ellipsoids.outlines import (
    AREA,
    DEPTH,
    HOME,
    SPACING,
    X,
    Y,
)
from resample.engine.ellipsoids.rows import ALPHA, bounds_at, index_of, is_open
from resample.engine.ellipsoids.rows import WEIGHT as COVER
from resample.engine.jit import kernel
from resample.engine.points.adding import SpreadBox, box_around
from resample.engine.points.point_sheets import width_of
from resample.engine.roles import making_role, plays
from resample.types import Floats, Place, Single, Stage
from resample_comparisons.volume.kernels.slabs.blends import Blend, Mixed, Values, contribution_of
from resample_comparisons.volume.kernels.slabs.splats import OpenSlabs, Tools, touch_slabs
from resample_comparisons.volume.kernels.slabs.sums import Canvas, Ring, stride_of, sum_at


@making_role
def spread(
    blend: Blend,
    canvas: Canvas,
    room: Floats,
    s: np.uint64,
    box: SpreadBox,
    slot: tuple[Ring, int],
    tools: Tools,
    layer: Single,
) -> None:
    """Add a point to a slab's sums, under its filter."""
    raise NotImplementedError


@plays(spread, Values)
def _spread_values(blend, canvas, room, s, box, slot, tools, layer):  # type: ignore[no-untyped-def]
    _spread_integrals(blend, canvas, room, s, box, slot, tools, layer)


@kernel
def _spread_integrals(
    blend: Blend,
    canvas: Canvas,
    room: Floats,
    s: np.uint64,
    box: SpreadBox,
    slot: tuple[Ring, int],
    tools: Tools,
    layer: Single,
) -> None:
    """Add a point that has a line integral."""
    # Mass of the point: its area times its slanted way through a layer.
    oblique = _oblique(room[s + X], room[s + Y], tools)
    mass = np.float32(room[s + AREA] * layer * oblique)
    contribution = contribution_of(blend, room, s, np.float32(1.0))
    amount = (
        contribution.weight,
        contribution.first,
        contribution.second,
        contribution.third,
        contribution.fourth,
    )
    _spread(canvas, canvas.sums, box, slot, mass, amount, tools.limits.per_layer, tools)


@plays(spread, Mixed)
def _spread_colors(blend, canvas, room, s, box, slot, tools, layer):  # type: ignore[no-untyped-def]
    _spread_integrals(blend, canvas, room, s, box, slot, tools, layer)


@kernel
def _spread(
    canvas: Canvas,
    sums: Floats,
    box: SpreadBox,
    slot: tuple[Ring, int],
    mass: Single,
    amount: tuple[Single, Single, Single, Single, Single],
    per_mass: Single,
    tools: Tools,
) -> None:
    """Add amounts per mass under the filter, and coverage where sub-pixels are not opaque yet."""
    # The filter is separable: one weight per row times one per column.
    rows, ring, one, opaque = canvas.rows, slot[0], np.float32(1.0), tools.limits.opaque
    stride, across, down = stride_of(ring), canvas.across, canvas.down
    for row in range(box.top, box.bottom):
        seen = mass * down[row - box.first_row]
        for column in range(box.left, box.right):
            part = seen * across[column - box.first_column]
            at = sum_at(ring, slot[1], row >> 1, column) + np.uint64(row & 1)
            k = index_of(row, column)
            # Add to the five sums, then to the coverage.
            sums[at] += part * amount[0]
            sums[at + stride] += part * amount[1]
            sums[at + np.uint64(2) * stride] += part * amount[2]
            sums[at + np.uint64(3) * stride] += part * amount[3]
            sums[at + np.uint64(4) * stride] += part * amount[4]
            rows[k + COVER] += part * per_mass if one - rows[k + ALPHA] > opaque else 0.0


@kernel
def _oblique(x: Single, y: Single, tools: Tools) -> float:
    """Length of the ray at a screen point, px, through a slab of thickness 1."""
    camera = tools.cutting.camera
    if not camera.perspective:
        return 1.0
    # Diverging rays cross the slab at an angle.
    right = (x - camera.principal[0]) / camera.focal[0]
    below = (y - camera.principal[1]) / camera.focal[1]
    return math.sqrt(1.0 + right * right + below * below)


@kernel
def add_point(
    canvas: Canvas,
    room: Floats,
    s: np.uint64,
    span: OpenSlabs,
    tools: Tools,
    blend: Blend,
    stage: Stage,
    is_cutting: bool,
) -> tuple[int, int]:
    """Add a point to its slab; return 1 if it is at home in the tile and not hidden, and the slab.

    Under a filter as wide as the kernel's projection, points add up as splats do, whatever the
    slab's thickness.
    """
    # Cull by the open groups of sub-pixels.
    top, bottom, left, right = bounds_at(room, s)
    if left >= right or top >= bottom or not is_open(canvas.open_groups, top, bottom, left, right):
        return 0, span.front - 1
    # Find the slab of its center.
    place, number = tools.cutting.place, span.front
    if is_cutting:
        number = max(number, math.floor(room[s + DEPTH] / span.thickness))
    # Compute the filter's weights; a point may miss all centers of sub-pixels.
    box = _box_of(canvas, room, s, place, stage)
    if box.top >= box.bottom or box.left >= box.right:
        return int(room[s + HOME]), span.front - 1
    # Mark the slab as dirty, and add the point.
    columns, rows = (box.left, box.right), (box.top, box.bottom)
    slot = touch_slabs(canvas.dirty, span, number, number, rows, columns)
    spread(blend, canvas, room, s, box, (span.ring, slot), tools, np.float32(stage.style.layer))
    return int(room[s + HOME]), number


@kernel
def _box_of(canvas: Canvas, room: Floats, s: np.uint64, place: Place, stage: Stage) -> SpreadBox:
    """Compute a point's filter weights, in the canvas' `across` and `down`, and their extent."""
    # Center in sub-pixels, and the filter's radius.
    n, style = place.subpixels, stage.style
    x, y = (room[s + X] - place.x) * n, (room[s + Y] - place.y) * n
    reach = width_of(room[s + SPACING], n, style) * style.point_extent
    size = (canvas.height, canvas.width)
    return box_around(size, x, y, reach, stage.tables.point, canvas.across, canvas.down)
