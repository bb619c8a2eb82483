"""Add fragments to the two layers of pixels: colors, labels, and mass.

Contributions at open sides of cells are counted separately: surfaces end only there.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.fragments import (
    count_parts,
    fill_from_boxes,
    fill_from_parts,
    set_boxes,
    set_parts,
)
from resample_warp3d.sheet.kernels.segments import (
    BLUE,
    COLUMN,
    DEPTH,
    EAST,
    FINE,
    GREEN,
    MASS,
    NORTH,
    OPEN,
    PARTS_U,
    PARTS_V,
    PIXEL,
    RED,
    ROW,
    SOUTH,
    U_X,
    V_Y,
    WEST,
    WHOLE,
    ZERO,
    BandFrame,
    SegmentCells,
)
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP

DISTINCT: Single = np.float32(0.99)  # of the nearness: nearer fragments are on the same surface


class TwoLayers(NamedTuple):
    """The two layers of a band."""

    front: Floats  # (pixels,) nearness
    behind: Floats
    sums: Floats  # (8 pixels,) red, green, blue and mass of both
    voted: Floats  # (2 pixels,) mass of all votes, for labels
    rims: Floats  # (2 pixels,) mass of parts at open sides of cells of both, where surfaces end


@inner_kernel
def _add(begin: int, end: int, is_label: bool, cells: SegmentCells, layers: TwoLayers) -> None:
    """Add fragments to the visible layers of their pixels; labels are voted for."""
    numbers, places = cells
    front, behind, sums, voted, _ = layers
    for n in range(begin, end):
        m = np.uint64(n)
        if places[PIXEL + m] < 0:
            continue
        # Choose the layer by depth; skip fragments behind both.
        pixel, near = np.uint64(places[PIXEL + m]), numbers[DEPTH + m]
        layer = np.uint64(0)
        if near < front[pixel] * DISTINCT:
            if near < behind[pixel] * DISTINCT:
                continue
            layer = np.uint64(1)
        at = np.uint64(8) * pixel + np.uint64(4) * layer
        red, green, blue = numbers[RED + m], numbers[GREEN + m], numbers[BLUE + m]
        mass = numbers[MASS + m]
        # Vote for labels, and add colors and mass.
        if is_label:
            voted[np.uint64(2) * pixel + layer] += mass
            # Boyer and Moore's majority vote: the label that leads stays, others reduce its mass.
            one, two, three = at + np.uint64(1), at + np.uint64(2), at + np.uint64(3)
            if sums[at] == red and sums[one] == green and sums[two] == blue:
                sums[three] += mass
            elif sums[three] >= mass:
                sums[three] -= mass
            else:
                sums[at], sums[one], sums[two] = red, green, blue
                sums[three] = mass - sums[three]
        else:
            sums[at] += red
            sums[at + np.uint64(1)] += green
            sums[at + np.uint64(2)] += blue
            sums[at + np.uint64(3)] += mass


@inner_kernel
def _add_rim(n: int, sides: int, cells: SegmentCells, layers: TwoLayers) -> None:
    """Add the mass of a cell's fragment to its layer's rim, if one of its sides is open."""
    numbers, places = cells
    m = np.uint64(n)
    if places[PIXEL + m] >= 0 and places[OPEN + m] & sides:
        pixel = np.uint64(places[PIXEL + m])
        layer = np.uint64(numbers[DEPTH + m] < layers.front[pixel] * DISTINCT)
        layers.rims[np.uint64(2) * pixel + layer] += numbers[MASS + m]


@inner_kernel
def add_boxes(
    begin: int, end: int, is_open: bool, frame: BandFrame, cells: SegmentCells, layers: TwoLayers
) -> None:
    """Add a run of upright cells as boxes, slot by slot; `is_open`: surfaces end at some."""
    numbers, places = cells
    rows, columns = set_boxes(begin, end, frame, numbers, places)
    for j in range(rows):
        for i in range(columns):
            if fill_from_boxes(begin, end, i, j, frame, numbers, places):
                _add(begin, end, frame.is_label, cells, layers)
                # Which sides of each box lie in the pixel depends on how it is turned.
                for n in range(begin if is_open else end, end):
                    m = np.uint64(n)
                    left, top = float(places[COLUMN + m] + i), float(places[ROW + m] + j)
                    west, east = numbers[WEST + m] >= left, numbers[EAST + m] <= left + 1
                    north, south = numbers[NORTH + m] >= top, numbers[SOUTH + m] <= top + 1
                    if numbers[U_X + m] < ZERO:
                        west, east = east, west
                    if numbers[V_Y + m] < ZERO:
                        north, south = south, north
                    sides = west * LEFT | east * RIGHT | north * UP | south * DOWN
                    _add_rim(n, sides, cells, layers)


@inner_kernel
def add_parts(
    begin: int, end: int, is_open: bool, way: int, frame: BandFrame, cells: SegmentCells,
    layers: TwoLayers,
) -> None:  # fmt: skip
    """Add a run of cells that are cut into parts, or have one color each."""
    numbers, places = cells
    is_whole, quality = way == WHOLE, frame.quality * np.float32(2 if way == FINE else 1)
    most_u, most_v = count_parts(begin, end, quality, numbers, places)
    is_flat = is_whole or frame.is_label
    # Cut one part out of all cells at a time.
    for part in range(1 if is_whole else most_u * most_v):
        v, u = divmod(part, most_u)
        if set_parts(begin, end, u, v, is_whole, frame, numbers, places):
            # Add it to the 2 × 2 pixels that it may meet.
            for slot in range(4):
                i, j = slot % 2, slot // 2
                if fill_from_parts(begin, end, i, j, is_flat, frame, numbers, places):
                    _add(begin, end, frame.is_label, cells, layers)
                    for n in range(begin if is_open else end, end):
                        m = np.uint64(n)
                        last_u = is_whole or u + 1 == places[PARTS_U + m]
                        last_v = is_whole or v + 1 == places[PARTS_V + m]
                        sides = (u == 0) * LEFT | last_u * RIGHT | (v == 0) * UP | last_v * DOWN
                        _add_rim(n, sides, cells, layers)
