"""Paint cells into two layers per pixel: the nearest surface, and the next.

A band of the target's rows belongs to one thread, which makes three passes over the source's cells:
for the nearest surface of every pixel, for the nearest one behind it, and to add colors. A
cell adds to a pixel by the area that it covers; the sum is the layer's coverage. Where the nearest
surface leaves a pixel partly uncovered, at silhouettes, the second one shows.

Functions are called per run of cells, never per cell.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import bands, overlapping, skips, take, walk
from resample.engine.jit import Counter, inner_kernel, parallel_kernel, plays
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.screen import SEGMENT, SheetScreen
from resample_warp3d.sheet.kernels.segments import (
    AREA,
    BEGIN,
    BLUE,
    COLUMN,
    COLUMNS,
    DEPTH,
    EAST,
    END,
    FINE,
    GREEN,
    HALF,
    LEAST,
    MASS,
    NORTH,
    NUMBERS,
    ONE,
    OPEN,
    PARTS_U,
    PARTS_V,
    PIXEL,
    PLACES,
    RED,
    ROW,
    ROWS,
    SLACK,
    SOUTH,
    U_X,
    UPRIGHT,
    V_Y,
    WAY,
    WEST,
    WHOLE,
    ZERO,
    BandFrame,
    SegmentCells,
    SheetStrip,
    count_parts,
    fill_depths,
    fill_from_boxes,
    fill_from_parts,
    set_boxes,
    set_parts,
    write_colors,
    write_means,
)
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, UP, Links

DISTINCT: Single = np.float32(0.99)  # of the nearness: what is nearer than that is the same surface
FULL: Single = np.float32(0.97)  # coverage of a full pixel; boxes only approximate cells
# Coverage from which gaps between a surface's parts begin to count as covered, and from which they
# do, where the surface does not end; it may where parts at open sides cover more than the last.
GAPPY, CLOSED, ENDING = np.float32(0.8), np.float32(0.88), np.float32(0.05)
SIDES = np.int32(LEFT | RIGHT | UP | DOWN)  # bits of links, without TURNS
TRACE: Single = np.float32(1e-4)  # coverage below which a pixel is empty
NEAREST_OF_ALL: Single = np.float32(np.inf)  # nearer than all


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
    """Add a run of upright cells as boxes, slot by slot; of some, surfaces end if `is_open`."""
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


class CellColors(NamedTuple):
    """Colors of cells."""

    color: Floats  # (G, 3, H, W) channels in groups of three
    links: Links  # (H, W) which neighbours a color may be interpolated with


class LayerPicture(NamedTuple):
    """Pictures that layers are written to."""

    image: Floats  # (height, width, C), premultiplied by the coverage
    coverage: Floats  # (height, width)
    nearness: Floats  # (height, width)
    magnification: Floats  # (height, width)


class FrontPass(NamedTuple):
    """The pass that finds the nearest surface over each pixel of a band."""

    front: Floats  # (pixels,) its nearness
    area: Floats  # (pixels,) px², of its cell
    least: Floats  # (members,) nearness of the farthest corner of each member


class BackPass(NamedTuple):
    """The pass that finds the nearest surface behind the front."""

    front: Floats
    behind: Floats
    least: Floats


class Adding(NamedTuple):
    """The pass that adds the color of covered areas to the two layers of pixels."""

    colors: CellColors
    group: int  # of channels
    layers: TwoLayers


@plays(skips, FrontPass)
def _skips_none(look: FrontPass, strip: SheetStrip, member: int, nth: int) -> bool:  # noqa: ARG001
    """Skip nothing in the first pass; start each member's farthest corner at infinity."""
    look.least[nth] = NEAREST_OF_ALL
    return False


@plays(take, FrontPass)
def _take_nearest(
    look: FrontPass,
    strip: SheetStrip,
    member: int,  # noqa: ARG001
    nth: int,
    run: int,
    cells: SegmentCells,
) -> None:
    """Find the nearest surface: depth-test all fragments of a run."""
    k, least, front, area = np.uint64(run), look.least[nth], look.front, look.area
    numbers, places = cells
    # Note the member's farthest corner, by which the second pass skips it.
    begin, end = int(places[BEGIN + k]), int(places[END + k])
    for n in range(begin, end):
        least = min(least, numbers[LEAST + np.uint64(n)])
    look.least[nth] = least
    # Test slot by slot: keep the nearest of each pixel, and the area of its cell.
    for j in range(places[ROWS + k]):
        for i in range(places[COLUMNS + k]):
            found = fill_depths(begin, end, i, j, strip.frame, numbers, places)
            # Scatter one by one, as cells share pixels; select instead of branching on the depth.
            for n in range(begin if found else end, end):
                m = np.uint64(n)
                if places[PIXEL + m] >= 0:
                    at, near = np.uint64(places[PIXEL + m]), numbers[DEPTH + m]
                    nearest, largest, covered = front[at], area[at], abs(numbers[AREA + m])
                    front[at] = near if near > nearest else nearest
                    area[at] = covered if near > nearest else largest


@plays(skips, BackPass)
def _skips_front(look: BackPass, strip: SheetStrip, member: int, nth: int) -> bool:
    """Skip segments of cells that lie in front everywhere."""
    row, segment = divmod(member, strip.screen.bounds.shape[1])
    bounds, frame, least = strip.screen.bounds[row, segment], strip.frame, look.least[nth]
    left, right = max(0, bounds[0]), min(frame.width, bounds[2])
    top, bottom = max(frame.first, bounds[1]), min(frame.last, bounds[3])
    # Count hidden pixels without a branch.
    hidden = 0
    for y in range(top, bottom):
        at = np.uint64((y - frame.first) * frame.width)
        for x in range(left, right):
            hidden += int(least < look.front[at + np.uint64(x)] * DISTINCT)
    return hidden == 0


@plays(take, BackPass)
def _take_behind(
    look: BackPass,
    strip: SheetStrip,
    member: int,  # noqa: ARG001
    nth: int,  # noqa: ARG001
    run: int,
    cells: SegmentCells,
) -> None:
    """Find the second surface: depth-test a run's fragments behind the front."""
    k, front, behind, (numbers, places) = np.uint64(run), look.front, look.behind, cells
    begin, end = int(places[BEGIN + k]), int(places[END + k])
    for j in range(places[ROWS + k]):
        for i in range(places[COLUMNS + k]):
            found = fill_depths(begin, end, i, j, strip.frame, numbers, places)
            for n in range(begin if found else end, end):
                m = np.uint64(n)
                if places[PIXEL + m] >= 0:
                    at, near = np.uint64(places[PIXEL + m]), numbers[DEPTH + m]
                    # A sloped cell's nearness may err by its slack: the front is not behind itself.
                    if near + numbers[SLACK + m] < front[at] * DISTINCT and near > behind[at]:
                        behind[at] = near


@plays(take, Adding)
def _take_colors(
    look: Adding,
    strip: SheetStrip,
    member: int,
    nth: int,  # noqa: ARG001
    run: int,
    cells: SegmentCells,
) -> None:
    """Add the colors of a run of cells to the layers."""
    (color, links), group, (numbers, places) = look.colors, look.group, cells
    k, frame = np.uint64(run), strip.frame
    row, segment = divmod(member, strip.screen.bounds.shape[1])
    begin, end, start = int(places[BEGIN + k]), int(places[END + k]), segment * SEGMENT
    # Note the sides at which surfaces end.
    found = 0
    for n in range(begin, end):
        bits = links[np.uint64(row + MARGIN), np.uint64(start + n + MARGIN)]
        places[OPEN + np.uint64(n)] = SIDES & ~np.int32(bits)
        found |= places[OPEN + np.uint64(n)]
    # Prepare the colors: means are enough for cells of one color.
    way = places[WAY + np.uint64(begin)]
    if way == WHOLE or frame.is_label:
        write_means(color, group, row, start, begin, end, numbers)
    else:
        write_colors(color, links, group, row, start, begin, end, numbers)
    # Add cells as boxes or as parts, as they were classified.
    if way == UPRIGHT:
        add_boxes(begin, end, found != 0, frame, cells, look.layers)
    else:
        add_parts(begin, end, found != 0, int(way), frame, cells, look.layers)


@inner_kernel
def _closed(mass: Single, rim: Single) -> Single:
    """Share of a pixel's missing coverage that gaps between a surface's parts explain.

    `mass`: coverage by the surface. `rim`: coverage by their parts at open sides.
    """
    within = min(max((mass - GAPPY) / (CLOSED - GAPPY), ZERO), ONE)
    return within * max(ONE - rim / ENDING, ZERO)


@inner_kernel
def _resolve(look: Adding, area: Floats, frame: BandFrame, picture: LayerPicture) -> None:
    """Composite a band's two layers, front over behind, into the picture."""
    image, coverage, nearness, magnification = picture
    group, (front, behind, sums, voted, rims) = look.group, look.layers
    channels = min(3, image.shape[2] - 3 * group)
    for y in range(frame.first, frame.last):
        for x in range(frame.width):
            pixel = (y - frame.first) * frame.width + x
            at = np.uint64(8 * pixel)
            near_mass, far_mass = sums[at + np.uint64(3)], sums[at + np.uint64(7)]
            # Boxes only approximate cells: count nearly full and overfull pixels as full.
            filled = min(max(near_mass + far_mass, FULL), ONE)
            share = min(near_mass / filled, ONE)
            total = min((near_mass + far_mass) / filled, ONE)
            near_rim, both_rims = rims[2 * pixel], rims[2 * pixel] + rims[2 * pixel + 1]
            share += (ONE - share) * _closed(near_mass, near_rim)
            total += (ONE - total) * _closed(near_mass + far_mass, both_rims)
            total = max(total, share)
            if near_mass + far_mass < TRACE:
                share, total = ZERO, ZERO
            # Normalize both layers' sums by their mass.
            by_near = share / max(near_mass, np.float32(1e-20))
            by_far = (total - share) / max(far_mass, np.float32(1e-20))
            # A pixel has the label of the nearer layer unless the farther one covers more.
            if frame.is_label:
                near_mass, far_mass = voted[2 * pixel], voted[2 * pixel + 1]
                total = ONE if near_mass + far_mass >= HALF else ZERO
                share = total if near_mass >= min(HALF, far_mass) else ZERO
                by_near, by_far = share, total - share
            # Composite the colors.
            for c in range(channels):
                k = at + np.uint64(c)
                image[y, x, 3 * group + c] = by_near * sums[k] + by_far * sums[k + np.uint64(4)]
            # Take the depth of the layer that covers more of the pixel.
            if group == 0:
                is_near = share >= total - share
                near = front[pixel] if is_near else behind[pixel]
                coverage[y, x] = total
                nearness[y, x] = near if total > ZERO else ZERO
                magnification[y, x] = area[pixel] if total > ZERO else ZERO


@parallel_kernel
def paint_layers(
    counter: Counter,
    screen: SheetScreen,
    colors: CellColors,
    band: int,
    like: BandFrame,
    picture: LayerPicture,
) -> None:
    """Paint a source's cells; each band of rows belongs to one thread.

    `band`: rows of a band. `like`: a frame with all rows; bands of it are painted.
    """
    bounds = screen.bounds.reshape((-1, 4))
    for first, last in bands(counter, like.last, band):
        # Allocate the band, and find the segments that meet it.
        frame = BandFrame(first, last, like.width, like.orientation, like.quality, like.is_label)
        strip, size = SheetStrip(screen, frame), (last - first) * like.width
        members = overlapping(bounds, (first, last), like.width)
        cells = SegmentCells(np.zeros(NUMBERS, np.float32), np.zeros(PLACES, np.int32))
        front, behind = np.zeros(size, np.float32), np.zeros(size, np.float32)
        area, least = np.zeros(size, np.float32), np.empty(members.size, np.float32)
        # Find the nearest surface, then the one behind it.
        walk(FrontPass(front, area, least), strip, members, cells)
        walk(BackPass(front, behind, least), strip, members, cells)
        # Add colors in groups of three channels, and composite them.
        for group in range(colors.color.shape[0]):
            sums = np.zeros(size * 8, np.float32)
            voted = np.zeros(2 * size if like.is_label else 0, np.float32)
            rims = np.zeros(2 * size, np.float32)
            adding = Adding(colors, group, TwoLayers(front, behind, sums, voted, rims))
            walk(adding, strip, members, cells)
            _resolve(adding, area, frame, picture)
