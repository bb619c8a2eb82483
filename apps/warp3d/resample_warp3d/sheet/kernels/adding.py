"""Add fragments to the two layers of pixels: colors, labels, and mass.

What is added at torn cells is counted by itself: there surfaces end, and nowhere else.
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
    DEPTH,
    GREEN,
    MASS,
    PIXEL,
    RED,
    TORN,
    ZERO,
    BandFrame,
    SegmentCells,
)

DISTINCT: Single = np.float32(0.99)  # of the nearness: what is nearer than that is the same surface


class TwoLayers(NamedTuple):
    """The two layers of a band."""

    front: Floats  # (pixels,) nearness
    behind: Floats
    sums: Floats  # (8 pixels,) red, green, blue and mass of both
    voted: Floats  # (2 pixels,) mass of all votes, for labels
    rims: Floats  # (2 pixels,) mass of torn cells of both, at which surfaces end


@inner_kernel
def _vote(sums: Floats, at: np.uint64, a: Single, b: Single, c: Single, d: Single) -> None:
    """Vote for a label with the covered area as weight; the label that leads stays.

    Boyer and Moore's majority vote with weights: a vote for another label reduces the leader's.
    """
    if sums[at] == a and sums[at + np.uint64(1)] == b and sums[at + np.uint64(2)] == c:
        sums[at + np.uint64(3)] += d
    elif sums[at + np.uint64(3)] >= d:
        sums[at + np.uint64(3)] -= d
    else:
        sums[at], sums[at + np.uint64(1)], sums[at + np.uint64(2)] = a, b, c
        sums[at + np.uint64(3)] = d - sums[at + np.uint64(3)]


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
            _vote(sums, at, red, green, blue, mass)
        else:
            sums[at] += red
            sums[at + np.uint64(1)] += green
            sums[at + np.uint64(2)] += blue
            sums[at + np.uint64(3)] += mass


@inner_kernel
def _add_rims(begin: int, end: int, cells: SegmentCells, layers: TwoLayers) -> None:
    """Add the mass of torn cells' fragments to the layers of their pixels."""
    numbers, places = cells
    for n in range(begin, end):
        m = np.uint64(n)
        if places[PIXEL + m] >= 0:
            pixel = np.uint64(places[PIXEL + m])
            layer = np.uint64(numbers[DEPTH + m] < layers.front[pixel] * DISTINCT)
            layers.rims[np.uint64(2) * pixel + layer] += numbers[TORN + m] * numbers[MASS + m]


@inner_kernel
def _is_torn(begin: int, end: int, numbers: Floats) -> bool:
    """Whether any cell of a run is torn."""
    torn = ZERO
    for n in range(begin, end):
        torn = max(torn, numbers[TORN + np.uint64(n)])
    return bool(torn > ZERO)


@inner_kernel
def add_boxes(
    begin: int, end: int, frame: BandFrame, cells: SegmentCells, layers: TwoLayers
) -> None:
    """Add a run of upright cells as boxes, slot by slot."""
    numbers, places = cells
    is_torn = _is_torn(begin, end, numbers)
    rows, columns = set_boxes(begin, end, frame, numbers, places)
    for j in range(rows):
        for i in range(columns):
            if fill_from_boxes(begin, end, i, j, frame, numbers, places):
                _add(begin, end, frame.is_label, cells, layers)
                if is_torn:
                    _add_rims(begin, end, cells, layers)


@inner_kernel
def add_parts(
    begin: int, end: int, is_whole: bool, frame: BandFrame, cells: SegmentCells, layers: TwoLayers
) -> None:
    """Add a run of cells that are cut into parts, or have one color each."""
    numbers, places = cells
    most_u, most_v = count_parts(begin, end, frame, numbers, places)
    is_flat, is_torn = is_whole or frame.is_label, _is_torn(begin, end, numbers)
    # Cut one part out of all cells at a time.
    for part in range(1 if is_whole else most_u * most_v):
        v, u = divmod(part, most_u)
        if set_parts(begin, end, u, v, is_whole, frame, numbers, places):
            # Add it to the 2 × 2 pixels that it may meet.
            for slot in range(4):
                i, j = slot % 2, slot // 2
                if fill_from_parts(begin, end, i, j, is_flat, frame, numbers, places):
                    _add(begin, end, frame.is_label, cells, layers)
                    if is_torn:
                        _add_rims(begin, end, cells, layers)
