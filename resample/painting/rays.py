"""Paint lattice fields by ray casting; see `resample.engine.rays`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.memory.mapped import array_like
from resample.painting.scenes import (
    Clock,
    PaintTarget,
    ellipsoid_of,
    nothing_painted,
    planes_of,
)
from resample.painting.splines import FIELD, levels_of
from resample.profiles.orders import MONOTONE
from resample.progress import Progress, told
from resample.types import (
    ADDITIVE,
    ATTENUATED,
    AVERAGE,
    COMPOSITE,
    FIRST_HIT,
    MAXIMUM,
    MINIMUM,
    UNKNOWN,
    Bounds,
    Classifier,
    Doubles,
    Flags,
    Floats,
    LatticeField,
    SplineField,
    Statistics,
    Style,
    Tables,
    View,
)

if TYPE_CHECKING:
    from resample.engine.rays.extremes import Blocks
    from resample.engine.rays.media import BrickBounds, Medium, SummedClassifier
    from resample.engine.rays.meshes import Way
    from resample.engine.rays.painting import Output

LARGE_TILE, TILE, SMALL_TILE, LEAST_TILE = 128, 32, 16, 8  # px, side of a tile
MANY = 8  # large tiles, enough for all threads
FEW_RAYS = 3  # per side of a pixel, at most
LEAST_APART, MOST_APART = 2, 16  # sub-pixels between two that are sampled first
BENDS = 0.01  # fraction of the values' range; largest bend where sub-pixels are interpolated
LARGE = 0.9  # px per voxel above which one ray through the pixel's center suffices
SPREAD = 0.6  # px per voxel below which sub-pixels are not on a grid
OF_SPREAD, MOST_SPREAD = 1.75, 16  # rays per side of a pixel then, times px per voxel; at most
FIRST_RAYS = 3  # per side of a pixel that are cast first, at least
STEEP = 0.3  # of the largest extinction, between neighbouring columns
OF_EXTREMES = 0.2  # rays per side of a pixel, times px per voxel, of extremes
SPARSE = 1.5  # px per voxel below which no pixel is interpolated
FEWEST_RAYS = 2  # per side of a pixel, for voxels smaller than `LARGE`
NEAREST = 1e-30  # scene units from the eye; smallest distance
EDGE, OF_EDGES = 0.3, 2  # second difference in linear light of an edge, and rays per side there
OF_STEEP_EDGES = 3  # rays per side there where looks become opaque at once
OF_ROWS = 2  # px beyond some rows on which their edges and means depend
MESH_RAYS = 4  # the same at edges of meshes
BRICK_PLANES = 16  # planes of bricks that are projected together
MOST_BRICKS = 255  # longest skip to the next visible brick
HIGHLIGHTS = 2049  # entries of a table of highlights
EXTREMES = (MAXIMUM, MINIMUM)
MEASURED = (MAXIMUM, MINIMUM, AVERAGE, ADDITIVE, ATTENUATED)


class _Effort(NamedTuple):
    """Number of rays for a quality."""

    step: float  # along a ray that composites, of the step that is asked for
    opaque: float  # transmittance at which rays end
    per_sample: float  # between neighbouring samples
    most: int  # per side of a pixel
    spared: float  # largest distance in samples between rays, if sub-pixels are closer
    bend: float  # tolerance in colors; larger bends are edges
    share: float  # relative tolerance, added to `bend`
    bent: float  # fraction of the range of values by which a field may bend within a step
    slack: float  # fraction of the range by which extremes may fall short from afar


EFFORTS = {
    "best": _Effort(1 / 3, 1e-3, 1.25, 16, 1 / 3, 0.01, 0.06, 0.01, 0.0),
    "usual": _Effort(1.0, 3e-3, 0.7, 4, 2 / 3, 0.05, 0.15, 0.012, 1 / 256),
    "fast": _Effort(1.0, 1e-2, 0.0, 1, 2 / 3, 0.05, 0.15, 0.06, 1 / 64),
}


@dataclass(frozen=True)
class RayPainter:
    """Paints fields on a lattice: pixels gather them along rays."""

    style: Style
    tables: Tables
    step: float  # samples, longest step along a ray
    quality: str  # key of `EFFORTS`
    interpolation: str  # one of `resample.profiles.orders.INTERPOLATIONS`
    clip: ArrayLike | None  # as in `Resampler`

    def paint(
        self,
        fields: Sequence[LatticeField],
        view: View,
        size: tuple[int, int],
        progress: Progress | None,
        rows: tuple[int, int],
    ) -> tuple[PaintTarget, Statistics]:
        """Paint rows of a picture (height, width) of fields, with the first one's meshes."""
        from resample.engine.rays.painting import GOLDEN, Evenness, Output

        clock, style = Clock(), self.style
        fields, media = _visible_fields(fields, [_medium(field, view, self) for field in fields])
        cast, _kept = _caster(fields, media, view, self)
        clock.lap("look")
        grids = [_rays_of(field, view, self) for field in fields]
        fineness, apart = max(n for n, _ in grids), min(apart for _, apart in grids)
        effort, looks = EFFORTS[self.quality], [field.classifier for field in fields]
        is_spread = any(_is_spread(field, view, self) for field in fields)
        # Rays at the edges of tiles are never interpolated, so large tiles need fewer.
        tile = LARGE_TILE if math.prod(size) >= MANY * LARGE_TILE**2 else TILE
        if fineness > FEW_RAYS or (style.projection in EXTREMES and fineness > 1):
            tile = LEAST_TILE if is_spread and fineness > FEW_RAYS else SMALL_TILE
        left, top, right, bottom = _tiles_of(media, view, size, self.tables.pixel_margin, tile)
        top = max(top, (rows[0] - OF_ROWS) // tile)
        bottom = max(top, min(bottom, -(-(rows[1] + OF_ROWS) // tile)))
        count = (right - left) * (bottom - top)
        painted = nothing_painted(*size, max(1, count), has_values=style.projection in MEASURED)
        box = (left * tile, top * tile, right * tile, bottom * tile)
        which, shown = np.arange(count), np.zeros((0, 0), np.uint8)
        if is_spread and not any(len(field.mesh.face) for field in fields):
            apart = 1 << max(0, int(math.log2(fineness / FIRST_RAYS)))
        per_square = fineness / apart if is_spread else 1.0
        if style.projection == COMPOSITE and count:
            shown = _squares_shown(media, view, box, per_square, self.tables.pixel_margin)
            row, column = (at // round(tile * per_square) for at in np.nonzero(shown))
            which = np.unique(row * (right - left) + column)
        output = Output(
            view,
            self.tables,
            painted.film,
            painted.value,
            style.projection == ADDITIVE,
            Evenness(
                effort.bend,
                effort.share,
                (effort.bend if style.projection in EXTREMES else BENDS)
                * max(look.high - look.low for look in looks),
            ),
            GOLDEN if is_spread else 0.0,
            apart,
            shown,
            per_square,
            tile,
            right - left,
            which,
            left * tile,
            top * tile,
        )
        painted.tally[:, 3] = fineness
        with told(progress):
            cast(which.size, fineness, output)
        rays = which.size * (tile * fineness) ** 2
        if fineness == 1 and self.quality != "best" and self.tables.pixel_margin == 0:
            rays += self._paint_edges(fields, cast, output, rows)
        clock.lap("paint")
        samples = sum(math.prod(field.spline.shape) for field in fields)
        counts = painted.statistics(samples, clock.seconds)
        return painted, counts._replace(rays=rays)

    def _paint_edges(
        self,
        fields: Sequence[LatticeField],
        cast: "Callable[[int, int, Output], None]",
        output: "Output",
        rows: tuple[int, int],
    ) -> int:
        """Replace centers of pixels by means, at edges by means of several rays; count these."""
        width = output.film.depth.shape[1]
        from resample.engine.rays.painting import weigh_neighbours

        # Edge pixels (N,), row by row: those at which light bends much along rows or columns.
        rgba, found = output.film.rgba, np.zeros(output.film.depth.shape, bool)
        for lines in (rgba.reshape(1, len(rgba), -1), rgba):
            bend = np.empty_like(lines)
            weigh_neighbours(lines, -2.0, 1.0, bend)
            found |= (np.abs(bend.reshape(rgba.shape)) > EDGE).any(axis=-1)
        edges = np.flatnonzero(found)
        of_rows = (edges >= rows[0] * width) & (edges < rows[1] * width)
        edges = edges[of_rows] if self.quality != "fast" else edges[:0]
        # Means over pixels are, to third order, their centers and 1/24 of the second differences.
        for picture in (rgba, output.film.coverage):
            for lines in (picture.reshape(1, len(picture), -1), picture.reshape(*found.shape, -1)):
                weigh_neighbours(lines, 22 / 24, 1 / 24, lines)
        again = output._replace(
            apart=1, shown=output.shown[:0], size=1, columns=width, which=edges, left=0, top=0
        )
        is_light = self.style.projection not in MEASURED
        n = OF_STEEP_EDGES if is_light and any(map(_is_steep, fields)) else OF_EDGES
        cast(edges.size, n, again)
        return edges.size * n**2


def _visible_fields(
    fields: Sequence[LatticeField], media: "Sequence[Medium]"
) -> "tuple[list[LatticeField], list[Medium]]":
    """Fields with a visible part or with meshes; at least one."""
    pairs = [
        (field, medium)
        for field, medium in zip(fields, media, strict=True)
        if len(field.mesh.face) or not medium.bricks.empty.all()
    ]
    shown, those = zip(*pairs or [(fields[0], media[0])], strict=True)
    return list(shown), list(those)


def _caster(
    fields: Sequence[LatticeField], media: "Sequence[Medium]", view: View, how: RayPainter
) -> "tuple[Callable[[int, int, Output], None], list[Any]]":
    """Paint tiles: a function of their number, of the rays, and of the output.

    Also returns the arrays that it needs, to be kept.
    """
    from resample.engine.bundles import rows_of
    from resample.engine.rays.painting import paint_rays

    ways = [_way(field, view, how) for field in fields]
    if len(fields) == 1:
        return lambda count, n, output: paint_rays(count, n, ways[0], media[0], output), []
    from resample.engine.rays.several_fields import Fields, paint_several

    rows, kept = rows_of(media)
    _, is_lit, has_regions = np.array(ways, np.int64).T.copy()
    every = Fields(EFFORTS[how.quality].opaque, rows, is_lit, has_regions)
    return lambda count, n, output: paint_several(count, n, every, media[0], output), kept


def _squares_shown(
    media: "Sequence[Medium]", view: View, box: tuple[int, int, int, int], per: float, margin: int
) -> Flags:
    """Squares of the screen, `per` per px, within `margin` px of visible content.

    `box`: left, top, right and bottom of the result, px.
    """
    from resample.engine.rays.coefficients import BRICK

    shape = np.rint([(box[3] - box[1]) * per, (box[2] - box[0]) * per]).astype(int)
    shown = np.zeros(shape, np.uint8)
    for medium in media:
        bricks, turn = medium.bricks, BRICK * view.rotation @ medium.lattice
        seen = bricks.empty.reshape(bricks.deep, bricks.down, bricks.across) == 0
        start, reach = view.rotation @ medium.origin + view.translation, np.abs(turn).sum(axis=1)
        if len(medium.mesh.face):
            return np.ones_like(shown)
        if not seen.any():
            continue
        # Find how far the nearest brick, and the filter of pixels, reach from a brick's center.
        near = float((_corners_seen(medium) @ view.rotation[2] + view.translation[2]).min())
        if view.perspective and near <= max(view.near, NEAREST):
            return np.ones_like(shown)
        away = near if view.perspective else 1.0
        wide = np.ceil(per * (np.abs(view.focal) * 0.5 * reach[:2] / away + margin) + 1).astype(int)
        if wide.max() > max(shape):
            return np.ones_like(shown)
        # Mark the squares of the centers, some planes of bricks at a time, and all within reach.
        marked = np.zeros(shape + 2 * wide[::-1], np.uint8)
        for first in range(0, bricks.deep, BRICK_PLANES):
            k, j, i = np.nonzero(seen[first : first + BRICK_PLANES])
            x, y, z = turn @ (np.stack([i, j, k + first]) + 0.5) + start[:, None]
            x, y = (x / z, y / z) if view.perspective else (x, y)
            right = (per * (view.focal[0] * x + view.principal[0] - box[0]) + wide[0]).astype(int)
            down = (per * (view.focal[1] * y + view.principal[1] - box[1]) + wide[1]).astype(int)
            is_in = (
                (down >= 0) & (down < marked.shape[0]) & (right >= 0) & (right < marked.shape[1])
            )
            marked[down[is_in], right[is_in]] = 1
        total = np.pad(marked.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        across, down = 2 * wide + 1
        within = total[down:] - total[:-down]
        shown |= within[:, across:] > within[:, :-across]
    return shown


def _corners_seen(medium: "Medium") -> Doubles:
    """Corners (8, 3), in the scene, of the box around the bricks that are visible."""
    from resample.engine.rays.coefficients import BRICK

    bricks = medium.bricks
    seen = bricks.empty.reshape(bricks.deep, bricks.down, bricks.across) == 0
    axes = [np.flatnonzero(seen.any(axis=others)) for others in ((0, 1), (0, 2), (1, 2))]
    ends = np.array([[axis[0] * BRICK, (axis[-1] + 1) * BRICK] for axis in axes])
    place = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 3)
    return np.asarray(medium.origin + place @ medium.lattice.T)


def _tiles_of(
    media: "Sequence[Medium]", view: View, size: tuple[int, int], margin: int, tile: int
) -> tuple[int, int, int, int]:
    """Range of tiles of a picture (height, width) that may be non-empty.

    Result: first column and row, and those after the last.
    """
    whole, ends = np.array([-(-size[1] // tile), -(-size[0] // tile)]), []
    for medium in media:
        if len(medium.mesh.face):
            return 0, 0, int(whole[0]), int(whole[1])
        if medium.bricks.empty.all():
            ends.append((0, 0, 0, 0))
            continue
        x, y, z = (_corners_seen(medium) @ view.rotation.T + view.translation).T
        away = z if view.perspective else np.ones_like(z)
        if away.min() <= max(view.near, NEAREST):
            return 0, 0, int(whole[0]), int(whole[1])
        place = view.focal[:, None] * np.stack([x, y]) / away + view.principal[:, None]
        low = np.floor((place.min(axis=1) - margin - 1) / tile).clip(0, whole)
        high = np.ceil((place.max(axis=1) + margin + 1) / tile).clip(low, whole)
        ends.append((*low, *high))
    left, top, right, bottom = np.array(ends, int).T
    return int(left.min()), int(top.min()), int(right.max()), int(bottom.max())


def spacing_of(lattice: Doubles, middle: Doubles, view: View) -> float:
    """Pixels between neighbouring voxels at a field's center, averaged over the axes.

    `lattice`: (3, 3) columns are the steps to the neighbours, scene units. `middle`: (3,) center of
    the field, scene units.
    """
    voxel = float(np.cbrt(abs(np.linalg.det(lattice))))
    depth = float(view.rotation[2] @ middle + view.translation[2])
    away = max(depth, view.near, NEAREST) if view.perspective else 1.0
    return voxel * float(view.focal.min()) / away


def _mean_spacing(field: LatticeField, view: View) -> float:
    """Pixels between neighbouring samples at the field's center."""
    return spacing_of(field.lattice, _corners(field).mean(axis=0), view)


def _rays_of(field: LatticeField, view: View, how: RayPainter) -> tuple[int, int]:
    """Rays per side of a pixel, and sub-pixels between two that are sampled first."""
    if how.style.subpixels:
        return how.style.subpixels, 1
    effort, is_best = EFFORTS[how.quality], how.quality == "best"
    if how.style.projection in EXTREMES and not is_best:
        effort = effort._replace(per_sample=OF_EXTREMES)
    if _is_spread(field, view, how):
        effort = effort._replace(per_sample=OF_SPREAD, most=MOST_SPREAD)
    spacing = _mean_spacing(field, view)
    if is_best:  # the least distance between samples, where they are farthest
        depth = _corners(field) @ view.rotation[2] + view.translation[2]
        far = max(float(depth.max()), view.near, NEAREST) if view.perspective else 1.0
        spacing = np.linalg.norm(field.lattice, axis=0).min() * float(view.focal.min()) / far
    fewest = 1 if spacing >= LARGE and not is_best else FEWEST_RAYS
    if len(field.mesh.face):
        fewest = MESH_RAYS
    n = min(effort.most, max(fewest, math.ceil(effort.per_sample / spacing)))
    is_dense = _is_spread(field, view, how) or (n == 1 and spacing < SPARSE)
    apart = 1 if is_dense else LEAST_APART
    while not is_dense and 2 * apart <= min(MOST_APART, effort.spared * n * spacing):
        apart *= 2
    return n, apart


def _is_spread(field: LatticeField, view: View, how: RayPainter) -> bool:
    """Whether sub-pixels are off the grid, which would miss thin structures along an axis.

    On a grid smooth pictures have smaller errors, so it is left where values become opaque at once.
    """
    if how.style.subpixels or how.style.projection in MEASURED or how.quality == "best":
        return False
    if _mean_spacing(field, view) >= SPREAD:
        return False
    return _is_steep(field)


def _is_steep(field: LatticeField) -> bool:
    """Whether values become opaque at once."""
    extinction = thickest(field.classifier.table, field.classifiers)
    return bool(np.abs(np.diff(extinction)).max(initial=0.0) > STEEP * extinction.max())


def _corners(field: LatticeField) -> Doubles:
    """Corners (8, 3) of the field, scene units."""
    ends = np.array(field.spline.shape[::-1]) - 0.5
    corner = np.stack(np.meshgrid(*np.stack([np.full(3, -0.5), ends], axis=1)), axis=-1)
    return np.asarray(field.origin + corner.reshape(-1, 3) @ field.lattice.T)


def _way(field: LatticeField, view: View, how: RayPainter) -> "Way":
    from resample.engine.rays.integrators import (
        AttenuatedMaximum,
        Composite,
        IsoSurfaceHit,
        Mean,
    )

    classifier, style = field.classifier, how.style
    voxel = float(np.cbrt(abs(np.linalg.det(field.lattice))))
    if style.projection in EXTREMES:
        is_far = _mean_spacing(field, view) < LARGE
        # Search for extremes of a field; `voxel` in scene units, `slack` as in `_Effort`.
        slack = EFFORTS[how.quality].slack if is_far else 0.0
        from resample.engine.rays.coefficients import BRICK
        from resample.engine.rays.extremes import BLOCK, Extreme

        classifier, is_least = field.classifier, how.style.projection == MINIMUM
        levels = field.levels
        if levels.leaf.size == 0:
            bound = -field.bounds.least if is_least else field.bounds.greatest
            levels = levels_of(
                bound, BRICK.bit_length() - 1, (float(bound.min()), float(bound.max()))
            )
        columns = classifier.table.shape[1] // field.classifiers - 1
        per_column = (classifier.high - classifier.low) / columns
        low = -classifier.low if is_least else classifier.low
        return Extreme(
            voxel,
            is_least,
            how.interpolation == MONOTONE,
            slack * (classifier.high - classifier.low) * levels.per_value,
            (levels.low - low) / per_column,
            per_column * levels.per_value,
            _blocks(levels.leaf, levels.shift),
            _blocks(levels.block, BLOCK),
        )
    if style.projection in (AVERAGE, ADDITIVE):
        return Mean(voxel, style.projection == ADDITIVE)
    if style.projection == FIRST_HIT:
        return IsoSurfaceHit(style.iso * (classifier.table.shape[1] // field.classifiers - 1))
    if style.projection == ATTENUATED:
        columns = classifier.table.shape[1] // field.classifiers - 1
        return AttenuatedMaximum(voxel, style.attenuation / (columns * voxel))
    is_lit = bool(
        classifier.lamp.diffuse > 0 or classifier.lamp.specular > 0 or field.reached.share.size
    )
    has_regions = classifier.table.shape[0] > 1
    return Composite(EFFORTS[how.quality].opaque, is_lit, has_regions)


def _blocks(most: Flags, shift: int) -> "Blocks":
    from resample.engine.rays.extremes import Blocks

    _, down, across = most.shape
    return Blocks(np.ascontiguousarray(most).reshape(-1), across, down, shift)


def _medium(field: LatticeField, view: View, how: RayPainter) -> "Medium":
    """Field with its classifier, in the classifier's columns."""
    from resample.engine.rays.coefficients import PAD, bundled
    from resample.engine.rays.media import Medium, SampleSpace

    classifier, spline, lattice = field.classifier, field.spline, field.lattice
    columns = classifier.table.shape[1] // field.classifiers - 1
    per_value = columns / (classifier.high - classifier.low)
    to_nodes = np.linalg.inv(lattice)
    origin = field.origin - lattice @ np.full(3, PAD - 1.0)
    eye, viewer = -view.rotation.T @ view.translation, classifier.lamp.viewer
    cuts = np.asarray([] if how.clip is None else how.clip, np.float64).reshape(-1, 4)
    space = SampleSpace(
        to_nodes @ (eye - origin),
        np.ascontiguousarray(to_nodes @ view.rotation.T),
        np.array(spline.shape[::-1], np.float64) + 1.0,
        how.step * (EFFORTS[how.quality].step if how.style.projection == COMPOSITE else 1.0),
        planes_of(how.clip, view, ellipsoid_of(lattice, view, 1.0)),
    )
    coefficient: Any = bundled(spline.coefficient)  # kernels take both types
    scaled = spline._replace(
        coefficient=coefficient,
        scale=spline.scale * per_value,
        zero=(spline.zero - classifier.low) * per_value,
        floor=(spline.floor - classifier.low) * per_value,
        ceiling=(spline.ceiling - classifier.low) * per_value,
    )
    if how.interpolation != MONOTONE:
        scaled = scaled._replace(floor=-math.inf, ceiling=math.inf)
    columnwise = [np.zeros((0, 0, 0), np.float32)] * 2
    if how.style.projection not in (COMPOSITE, *EXTREMES):
        columnwise = [_columnwise(bound, classifier.low, per_value) for bound in field.bounds]
    return Medium(
        scaled,
        _bricks(Bounds(*columnwise), field, how.style),
        space,
        _summed_classifier(classifier, field.classifiers),
        np.ascontiguousarray(lattice),
        origin,
        np.ascontiguousarray(to_nodes.T / per_value),
        float(1.0 / np.cbrt(abs(np.linalg.det(lattice)))),
        np.asarray(cuts / np.linalg.norm(cuts[:, :3] @ lattice, axis=1)[:, None]),
        field.known,
        field.tint,
        EFFORTS[how.quality].bent * columns,
        # Whether the lamp's viewer is the eye, so that a ray has one direction for it.
        bool(viewer[3] == 0 or (view.perspective and np.allclose(viewer[:3], eye, 1e-9, 1e-9))),
        field.reached,
        field.mesh,
    )


def _columnwise(bound: NDArray[Any], low: float, per_value: float) -> Floats:
    """Bounds of bricks in columns, computed plane by plane to save memory."""
    columns = array_like(bound, bound.shape, np.float32, FIELD)
    for n, plane in enumerate(bound):
        columns[n] = per_value * (plane - low)
    return columns


def _summed_classifier(classifier: Classifier, count: int) -> "SummedClassifier":
    from resample.engine.rays.media import SummedClassifier

    table = np.ascontiguousarray(classifier.table)
    product = table[0].astype(np.float64)
    if len(table) > 1:  # the largest extinction over all gradients, without color
        product = np.zeros(table.shape[1:])
        product[:, 3] = table[..., 3].max(axis=0)
    product[:, :3] *= product[:, 3:]
    total, bend = np.zeros((2, *product.shape))
    np.cumsum(0.5 * (product[1:] + product[:-1]), axis=0, out=total[1:])
    bend[:-1] = 0.5 * np.diff(product, axis=0)
    per_slope = (len(table) - 1) / classifier.steep
    return SummedClassifier(
        np.ascontiguousarray(np.hstack([total, product, bend])),
        len(product) // count,
        np.concatenate([[0], np.cumsum(thickest(table, count) > 0)]),
        classifier.lamp.specular * np.linspace(0.0, 1.0, HIGHLIGHTS) ** classifier.lamp.shininess,
        table,
        classifier.low,
        (classifier.high - classifier.low) / (len(product) // count - 1),
        per_slope,
        classifier.lamp,
        classifier.near,
        classifier.far,
        classifier.dimmed,
    )


def thickest(table: Floats, count: int) -> Floats:
    """Largest extinction (K,) of each value over all gradients, and looks side by side."""
    return np.asarray(table[..., 3].max(axis=0).reshape(count, -1).max(axis=0))


def visible_cells(
    spline: SplineField, bounds: Bounds, extinction: Floats, ends: tuple[float, float]
) -> NDArray[np.uint64]:
    """Cells of a field that may be visible, as bits in bricks (z, y, x), x fastest.

    `bounds`: as in `spline_of`. `extinction`: (K,) of values between two `ends`.
    """
    from resample.engine.rays.coefficients import VisibleValues, bundled, find_visible_cells

    per_value = (extinction.size - 1) / (ends[1] - ends[0])
    # A cell or brick is visible if a column within its bounds is.
    count = np.concatenate([[0], np.cumsum(extinction > 0)])
    columnwise = Bounds(*(_columnwise(bound, ends[0], per_value) for bound in bounds))
    seen = _visible(columnwise, count)
    cells = array_like(spline.coefficient, seen.shape, np.uint64, FIELD)
    cells[...] = 0
    zero = (spline.zero - ends[0]) * per_value
    values = VisibleValues(zero, spline.scale * per_value, count)
    flat = bundled(spline.coefficient)
    find_visible_cells(flat, spline.shape, values, seen.view(np.uint8), cells)
    return cells


def _bricks(bounds: Bounds, field: LatticeField, style: Style) -> "BrickBounds":
    """Bricks for ray casting; bounds are in columns."""
    from resample.engine.rays.media import BrickBounds

    classifier, cells, apart = field.classifier, UNKNOWN, field.apart
    if style.projection == COMPOSITE:
        cells = field.cells
        if cells.size == 0:
            most = thickest(classifier.table, field.classifiers)
            ends = (classifier.low, classifier.high)
            cells = visible_cells(field.spline, field.bounds, most, ends)
        if apart.size == 0:
            apart = bricks_to_next(cells > 0)
    elif style.projection == FIRST_HIT:
        columns = classifier.table.shape[1] // field.classifiers
        apart = bricks_to_next(bounds.greatest >= style.iso * (columns - 1))
    else:
        apart = np.zeros(field.bounds.least.shape, np.uint8)
    deep, down, across = apart.shape
    return BrickBounds(
        apart.reshape(-1),
        np.asarray(bounds.least.reshape(-1), np.float32),
        np.asarray(bounds.greatest.reshape(-1), np.float32),
        cells.reshape(-1),
        across,
        down,
        deep,
    )


def bricks_to_next(seen: NDArray[np.bool_]) -> Flags:
    """Bricks (z, y, x) from each to the next one that is seen, along any axis; at most 255."""
    from resample.engine.rays.coefficients import find_next_bricks

    away = np.where(seen, 0, MOST_BRICKS).astype(np.uint8)
    find_next_bricks(away)
    return away


def _visible(bounds: Bounds, count: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Visible bricks, by prefix counts (K + 1,) of visible columns."""
    last = count.size - 2
    seen = np.empty(bounds.least.shape, bool)
    for n, (least, greatest) in enumerate(zip(*bounds, strict=True)):
        first = np.clip(np.floor(least), 0, last).astype(np.int64)
        end = np.clip(np.ceil(greatest), 0, last).astype(np.int64)
        seen[n] = count[end + 1] > count[first]
    return seen
