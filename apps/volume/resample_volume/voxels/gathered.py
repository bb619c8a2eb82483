"""Volumes as fields for ray casting."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample import types
from resample.memory.mapped import array_like, is_in_file
from resample.outofcore.passes import DIGIT, counts_by_digit, memoized, ranked
from resample.painting.choices import MAXIMA, MEASURING, Projection
from resample.painting.rays import bricks_to_next, thickest, visible_cells
from resample.painting.splines import FIELD, levels_of_samples, spline_of
from resample.profiles.orders import MONOTONE
from resample.resampler import Resampler
from resample.types import Doubles, Flags, Floats
from resample_volume.classification.transfer import (
    Transfer,
    TransferTable,
    tabulated,
    visible_places,
)
from resample_volume.classification.value_statistics import counted, survey
from resample_volume.data.scanning import are_few
from resample_volume.data.values import require_memory, slabs
from resample_volume.types import Volume
from resample_volume.voxels.shading import (
    PAD,
    Light,
    field_transmittance,
    lamp_of,
    numbered,
    tint_of,
)
from resample_volume.voxels.thin import (
    EXTREMES,
    SAME,
    Thin,
    of_samples,
    thin_that_fits,
    thinned,
    with_true_thickness,
)
from resample_volume.voxels.visible import (
    finite_range,
    gradients_at,
    lattice_of,
    max_gradient,
    steep_of,
    unit_of,
)

if TYPE_CHECKING:
    from resample_volume.classification.labels import Labels

BYTES_PER_SLOPE = 40  # bytes per voxel, until the max_gradient of a full surface is known
NOTHING = -1  # in place of an index, see `kernels.voxels`
BESIDE = 0.1  # fraction of the way between two values that the field of one does not reach
OPAQUE = 4.0  # optical depth of a voxel beyond a surface
COLUMNS = 4096  # columns of a table of looks; integer values fall on columns
MOST_COLUMNS = 1 << 16
MARGIN = 64  # values compared with each end of the robust range, beyond it

UNLIT = Light(ambient=1.0, diffuse=0.0, specular=0.0)


class Gathered(NamedTuple):
    """A volume as a field on its lattice."""

    spline: types.SplineField
    bounds: types.Bounds  # data units
    known: Flags  # as in `LatticeField`
    lattice: Doubles  # (3, 3) columns are the steps from a voxel to its neighbours, scene units
    origin: Doubles  # (3,) scene position of the first voxel
    table: TransferTable
    steepest: float  # data units per scene unit, approximate greatest gradient
    visible: int  # visible voxels, regardless of labels
    each: int = 1  # looks side by side in the table: of voxels, and of labels
    tint: types.Tint = types.UNTINTED
    reached: types.Reached = types.UNBLOCKED
    thin: Thin = SAME  # samples of the field for each voxel
    cells: NDArray[np.uint64] = types.UNKNOWN  # as in `LatticeField`
    apart: Flags = types.UNMEASURED  # as in `LatticeField`
    levels: types.BlockLevels = types.UNBOUNDED  # as in `LatticeField`


def gathered(
    volume: Volume, transfer: Transfer, resampler: Resampler, gradient: str,
    labels: "Labels | None" = None,
) -> Gathered:  # fmt: skip
    """Prepare a volume as a field on its lattice, with its look by value and slope."""
    lattice = lattice_of(volume)
    data_range, unit = finite_range(volume.values), unit_of(transfer, volume)
    check_iso(resampler.iso, volume, data_range)
    is_composite = resampler.projection is Projection.COMPOSITE
    two, kind = np.zeros(0), volume.values.dtype  # the only values, if there are two
    if is_composite and are_few(kind):
        two = counted(volume.values).value
    elif is_composite:
        two = np.unique(data_range)
        parts = (np.isin(part, two) | ~np.isfinite(part) for part in slabs(volume.values))
        two = two if all(part.all() for part in parts) else two[:0]
    if not transfer.normalized and resampler.iso is None:
        data_range = _table_range(volume, transfer, data_range)
    is_plain = getattr(resampler.order, "interpolation", MONOTONE) != MONOTONE
    thin = thin_that_fits(volume, resampler.projection, stays=is_plain or labels is not None)
    samples = of_samples(volume, thin)
    is_within = thin.parts > 1 and resampler.projection in EXTREMES
    sharpness = getattr(resampler.order, "sharpness", 1.0)
    is_cut = two.size == 2 and volume.colors is None and thin.parts == 1 and sharpness == 1
    cut = tuple(two.tolist()) if is_cut else ()
    spline, bounds, known = _on_lattice(volume.values, sharpness, thin, cut, is_within=is_within)
    levels, is_whole = types.UNBOUNDED, thin.parts == 1 and sharpness == 1 and known.size == 0
    if resampler.projection in EXTREMES and is_whole and not is_plain:
        levels = _levels(volume.values, resampler.projection is Projection.MINIMUM)
    columns, steep, span = COLUMNS, 1.0, data_range[1] - data_range[0]
    if kind.kind in "iu" and 1 <= span < MOST_COLUMNS:  # integers fall on columns
        columns = int(span) * max(1, COLUMNS // int(span)) + 1
    visible_of = partial(_visible_places, transfer, data_range, resampler)
    if are_few(kind):
        every = counted(volume.values)
        count = int(every.number[visible_of(every.value.astype(kind))].sum())
    else:
        count = sum(visible_of(chunk.reshape(-1)).size for chunk in slabs(volume.values))
    if transfer.needs_gradient:
        steep = _max_gradient_of(volume, visible_of, gradient, count)
    shape = (64 if transfer.needs_gradient else 1, columns)
    table_of = partial(tabulated, transfer, data_range, steep, unit, shape)
    rules = () if labels is None else labels.rules.values()
    tables = [table_of(), *(table_of(rule.applied) for rule in rules)]
    table = np.concatenate([one.table for one in tables], axis=1)
    looks, beside = tables[0]._replace(table=table), len(tables)
    known = known if labels is None else numbered(known, labels.numbers, volume.values)
    tint = types.UNTINTED if volume.colors is None else tint_of(volume, looks, labels)
    if two.size == 2 and volume.colors is not None and labels is None:
        looks, beside, values = _of_either(looks, two), 2, volume.values
        known = numbered(known, lambda at: 1 + (values[at] == two[1]).astype(np.uint8), values)
    elif two.size == 2:
        looks = _cut_between(looks, two, beside)
    steepest = (data_range[1] - data_range[0]) / float(np.linalg.norm(lattice, axis=0).min())
    cells, apart = types.UNKNOWN, types.UNMEASURED
    if is_composite and resampler.iso is None:
        ends = looks.low, looks.high
        cells = visible_cells(spline, bounds, thickest(looks.table, beside), ends)
        apart = bricks_to_next(cells > 0)
    return Gathered(
        *(spline, bounds, known, lattice_of(samples), np.asarray(samples.origin, np.float64)),
        *(looks, steepest, count, beside, tint), thin=thin, cells=cells, apart=apart, levels=levels,
    )  # fmt: skip


def check_iso(iso: float | None, volume: Volume, data_range: tuple[float, float]) -> None:
    """Reject an isosurface of a value that the data do not cross."""
    low, high = data_range
    if iso is not None and not low < iso <= high and np.isfinite(volume.values).any():
        raise ValueError(
            f"there is no surface of the value {iso:g}: {volume.name} holds {low:g} to {high:g}"
        )


def _table_range(
    volume: Volume, transfer: Transfer, data_range: tuple[float, float]
) -> tuple[float, float]:
    """Return the range of a table of looks: without outliers if these look like its ends."""
    (low, high), (least, greatest) = survey(volume).span, data_range
    if (low, high) == data_range:
        return data_range
    value = np.concatenate([np.linspace(least, low, MARGIN), np.linspace(high, greatest, MARGIN)])
    flat = np.zeros(value.size, np.float32) if transfer.needs_gradient else None
    color, opacity = transfer.classify(value, flat, data_range, 1.0)
    look = np.column_stack([color, opacity]).reshape(2, MARGIN, 4)
    same = (look[0] == look[0, -1]).all() and (look[1] == look[1, 0]).all()
    return (low, high) if same else data_range


def _cut_between(looks: TransferTable, two: Doubles, count: int) -> TransferTable:
    """Return looks that switch halfway between the only two values."""
    table = looks.table.reshape(len(looks.table), count, -1, 4)
    value = np.linspace(looks.low, looks.high, table.shape[2])
    low, high = (int(np.abs(value - one).argmin()) for one in two)
    is_high = (value >= two.mean())[:, np.newaxis]
    cut = np.where(is_high, table[:, :, high, np.newaxis], table[:, :, low, np.newaxis])
    return looks._replace(table=np.ascontiguousarray(cut.reshape(looks.table.shape)))


def _of_either(looks: TransferTable, two: Doubles) -> TransferTable:
    """Return the looks of two values side by side, each over the field's range."""
    value = np.linspace(looks.low, looks.high, looks.table.shape[1])
    margin = BESIDE * (two[1] - two[0])
    parts = []
    for one, is_near in ((two[0], value <= two[1] - margin), (two[1], value >= two[0] + margin)):
        own = looks.table[:, int(np.abs(value - one).argmin()), np.newaxis]
        part = np.repeat(own, value.size, axis=1)
        part[:, ~is_near, 3] = 0
        parts.append(part)
    return looks._replace(table=np.ascontiguousarray(np.concatenate(parts, axis=1)))


def lit_lattice(
    field: Gathered, light: Light | None, viewer: Doubles, cue: tuple[float, float, float]
) -> types.LatticeField:
    """Shade a field for a viewer (4,); `cue`: near, far and dimmed, as in `Classifier`."""
    steepest = np.full((1, 3), field.steepest, np.float32)
    lamp = lamp_of(light or UNLIT, viewer, steepest)
    classifier = types.Classifier(*field.table, lamp, *cue)
    same = ("spline", "bounds", "known", "lattice", "origin", "reached", "tint", "cells", "apart")
    parts = {name: getattr(field, name) for name in (*same, "levels")}
    return types.LatticeField(classifier=classifier, classifiers=field.each, **parts)


def with_shadows(
    fields: Sequence[Gathered], volumes: Sequence[Volume], scene: Volume, resampler: Resampler,
    clip: Doubles, light: Light,
) -> list[Gathered]:  # fmt: skip
    """Add shadows and ambient occlusion by all fields of a scene, outside clip planes."""
    pairs = list(zip(fields, volumes, strict=True))
    parts = [(volume, _extinctions(field, volume, resampler.iso)) for field, volume in pairs]
    lit = []
    for field, reached in zip(fields, field_transmittance(scene, parts, clip, light), strict=True):
        axis, count, found = field.thin.axis, field.thin.parts, reached
        if count > 1:  # interpolate cells over voxels at cells over samples
            last = reached.share.shape[axis] - 1
            cell = np.arange(-(-field.spline.shape[axis] // reached.per))
            at = np.clip((cell + 0.5) / count - 0.5, 0, last)
            before = at.astype(np.int64)
            share = (at - before).reshape([-1 if n == axis else 1 for n in range(4)])
            one = np.take(reached.share, before, axis)
            two = np.take(reached.share, np.minimum(before + 1, last), axis)
            mixed = np.rint(one + share * (two - one.astype(np.float64))).astype("u1")
            found = reached._replace(share=mixed)
        lit.append(field._replace(reached=found))
    return lit


def _extinctions(field: Gathered, volume: Volume, iso: float | None) -> Iterator[Floats]:
    """Yield optical depths per scene unit of voxels, some slices at a time."""
    looks, voxel = field.table, float(np.cbrt(abs(np.linalg.det(field.lattice))))
    first, plane = 0, volume.values[0].size
    padded = [count + 2 * PAD for count in volume.values.shape]
    known = field.known.reshape(padded) if field.known.size else field.known
    for chunk in slabs(volume.values):
        if iso is not None:
            yield np.where(chunk >= iso, np.float32(OPAQUE / voxel), np.float32(0))
            continue
        place = (chunk.astype(np.float64) - looks.low) / (looks.high - looks.low)
        place = np.nan_to_num(place, nan=0.0)
        last = looks.table.shape[1] // field.each - 1
        column = np.rint(np.clip(place, 0, 1) * last).astype(np.int64)
        row: NDArray[np.int64] | int = 0
        if len(looks.table) > 1:
            index = np.arange(first, first + chunk.size)
            slope = np.linalg.norm(gradients_at(volume, index, "central"), axis=1)
            of_row = slope.reshape(chunk.shape) * ((len(looks.table) - 1) / looks.steep)
            of_row = np.nan_to_num(of_row, nan=0.0)
            row = np.minimum(np.rint(of_row), len(looks.table) - 1).astype(np.int64)
        if field.each > 1:
            planes = slice(PAD + first // plane, PAD + (first + chunk.size) // plane)
            number = known[planes, PAD:-PAD, PAD:-PAD].astype(np.int64)
            column += (last + 1) * np.maximum(number - 1, 0)
        seen = np.isfinite(chunk)
        yield np.where(seen, looks.table[row, column, 3], np.float32(0))
        first += chunk.size


@memoized(lambda values: values)
def _on_lattice(
    values: NDArray[np.generic], sharpness: float, thin: Thin, cut: tuple[float, ...], *,
    is_within: bool,
) -> tuple[types.SplineField, types.Bounds, Flags]:  # fmt: skip
    """Return the field of values, its bounds, and which are known, if not all.

    `cut`: the only two values, if the field is cut between them, as it is unless it has colors.
    """
    filled, known = _without_gaps(values)
    if thin.parts == 1 and not cut:
        return *spline_of(filled, sharpness), known
    if cut:
        level, zero, scale = with_true_thickness(filled, np.array(cut))
        spline, bounds = spline_of(level)
    else:
        scale, (samples, zero) = 1.0, thinned(filled, thin, is_within=is_within)
        spline, bounds = spline_of(samples, sharpness, values.dtype)
    least, greatest = (scale * bound + zero for bound in bounds)
    spline = spline._replace(
        scale=scale * spline.scale,
        zero=scale * spline.zero + zero,
        floor=scale * spline.floor + zero,
        ceiling=scale * spline.ceiling + zero,
    )
    if known.size and not cut:  # of voxels, repeated for samples
        inner = known.reshape([count + 2 * PAD for count in values.shape])[(slice(PAD, -PAD),) * 3]
        known = np.pad(np.repeat(inner, thin.parts, thin.axis), PAD, "edge").ravel()
    return spline, types.Bounds(least, greatest), known


@memoized(lambda values: values)
def _levels(values: NDArray[np.generic], is_least: bool) -> types.BlockLevels:
    """Return the bounds of maxima or minima of a field, once per volume."""
    return levels_of_samples(values, is_least)


def _without_gaps(values: NDArray[np.generic]) -> tuple[NDArray[np.generic], Flags]:
    """Fill missing values with the nearest known; return flags of known ones unless all are."""
    from resample_volume.kernels.voxels import nearest_in_columns, nearest_in_rows

    if values.dtype.kind != "f":
        return values, np.zeros(0, np.uint8)
    if all(np.isfinite(part).all() for part in slabs(values)):
        return values, np.zeros(0, np.uint8)
    depth, height, width = values.shape
    deep = array_like(values, values.shape, np.int32, FIELD)
    padded = (depth + 2 * PAD, height + 2 * PAD, width + 2 * PAD)
    known = array_like(values, padded, np.uint8, FIELD)
    last = np.full((height, width), NOTHING, np.int32)
    for z, plane in enumerate(values):
        is_known = np.isfinite(plane)
        last[is_known] = z
        deep[z] = last
        known[z + PAD] = np.pad(is_known, PAD, mode="edge")
    known[:PAD], known[-PAD:] = known[PAD], known[-PAD - 1]
    if (last == NOTHING).all():
        nothing = array_like(values, values.shape, np.float32, FIELD)
        nothing[...] = 0
        return nothing, known.reshape(-1)
    inner = known[PAD:-PAD, PAD:-PAD, PAD:-PAD]
    # Fill gaps with the nearest known value, plane by plane
    filled = array_like(values, values.shape, values.dtype, FIELD)
    behind, down, across = (np.full(values.shape[1:], NOTHING, np.int32) for _ in range(3))
    for z in reversed(range(len(values))):
        is_known, front = inner[z] > 0, deep[z]
        behind[is_known] = z
        filled[z] = values[z]
        if is_known.all():
            continue
        is_nearer = (front == NOTHING) | ((behind != NOTHING) & (behind - z < z - front))
        near = np.where(is_nearer, behind, front)
        nearest_in_columns(near, z, down)
        nearest_in_rows(near, down, z, is_known, across)
        y, x = np.nonzero(~is_known)
        from_x = across[y, x]
        from_y = down[y, from_x]
        filled[z, y, x] = values[near[from_y, from_x], from_y, from_x]
    return filled, known.reshape(-1)


def _max_gradient_of(
    volume: Volume, visible_of: Callable[[NDArray[Any]], NDArray[np.int64]], gradient: str,
    count: int,
) -> float:  # fmt: skip
    """Return `max_gradient` of visible voxels; of values in a file not all gradients are held."""

    def parts() -> Iterator[NDArray[np.int64]]:
        """Yield flat indices of the voxels visible themselves, not only by interpolation."""
        start = 0
        for chunk in slabs(volume.values):
            yield visible_of(chunk.reshape(-1)) + start
            start += chunk.size

    if not is_in_file(volume.values):
        require_memory(BYTES_PER_SLOPE * count, f"slopes of {count} voxels of {volume.name}")
        every = np.concatenate(list(parts()))
        return max_gradient(np.linalg.norm(gradients_at(volume, every, gradient), axis=1))
    if not count:
        return 0.0

    def counts(prefix: int, digit: int) -> NDArray[np.int64]:
        """Count lengths by a digit of their bits: not negative, they sort as these do."""
        total = np.zeros(1 << DIGIT, np.int64)
        for seen in parts():
            length = np.linalg.norm(gradients_at(volume, seen, gradient), axis=1)
            total += counts_by_digit(length.astype(np.float32).view(np.uint32), prefix, digit)
        return total

    return steep_of(
        count, lambda at: np.array(ranked(at, counts, 2), np.uint32).view(np.float32).tolist()
    )


def _visible_places(
    transfer: Transfer, data_range: tuple[float, float], resampler: Resampler, value: NDArray[Any],
) -> NDArray[np.int64]:  # fmt: skip
    """Return flags of visible values (N,)."""
    if resampler.iso is not None:
        return np.flatnonzero(value >= resampler.iso)
    if resampler.projection in MEASURING and resampler.projection not in MAXIMA:
        return np.flatnonzero(np.isfinite(value))
    return visible_places(transfer, value, data_range)
