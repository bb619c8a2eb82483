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
from resample.engine.jit import Counter, inner_kernel, parallel_kernel
from resample.engine.roles import plays
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.adding import DISTINCT, TwoLayers, add_boxes, add_parts
from resample_warp3d.sheet.kernels.colors import write_colors, write_means
from resample_warp3d.sheet.kernels.fragments import fill_depths
from resample_warp3d.sheet.kernels.screen import SEGMENT, SheetScreen
from resample_warp3d.sheet.kernels.segments import (
    AREA,
    BEGIN,
    COLUMNS,
    DEPTH,
    END,
    HALF,
    LEAST,
    NUMBERS,
    ONE,
    OPEN,
    PIXEL,
    PLACES,
    ROWS,
    SLACK,
    UPRIGHT,
    WAY,
    WHOLE,
    ZERO,
    BandFrame,
    SegmentCells,
    SheetStrip,
)
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, UP, Links

FULL: Single = np.float32(0.97)  # coverage of a full pixel; boxes only approximate cells
# Coverage from which gaps between a surface's parts begin to count as covered, and from which they
# do, where the surface does not end; it may where parts at open sides cover more than the last.
GAPPY, CLOSED, ENDING = np.float32(0.8), np.float32(0.88), np.float32(0.05)
SIDES = np.int32(LEFT | RIGHT | UP | DOWN)  # bits of links, without TURNS
TRACE: Single = np.float32(1e-4)  # coverage below which a pixel is empty
NEAREST_OF_ALL: Single = np.float32(np.inf)  # nearer than all


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
