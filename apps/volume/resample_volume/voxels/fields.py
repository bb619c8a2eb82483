"""Voxels of fields: values are interpolated, then classified or projected."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.choices import SUMS, Projection
from resample.resampler import Resampler
from resample.types import Classifier, Doubles, Field, Floats
from resample_volume.classification.surveys import survey
from resample_volume.classification.transfer import Transfer, TransferTable, tabulated
from resample_volume.data.memory import require_memory
from resample_volume.types import Placed, Volume
from resample_volume.voxels.shading import Light, lamp_of
from resample_volume.voxels.visible import (
    BYTES_PER_VOXEL,
    finite_range,
    gradients_at,
    lattice_of,
    positions_at,
    reachable,
    steepness,
    unit_of,
)

COLUMNS = 4096  # columns of a table of looks; integer values fall on columns
MOST_COLUMNS = 1 << 16
MARGIN = (
    64  # values beyond each end of the robust range whose looks are compared with those of the ends
)

# Projections under which transparent voxels do not count; others sum all.
CLASSIFYING = (Projection.COMPOSITE, Projection.MAXIMUM, Projection.FIRST_HIT)

UNLIT = Light(ambient=1.0, diffuse=0.0, specular=0.0)

Indices = NDArray[np.int64]


class FieldVoxels(NamedTuple):
    """The N voxels that a picture of a field depends on."""

    position: Floats  # (N, 3) scene units
    value: Floats  # (N,) data units
    gradient: Floats  # (N, 3) data units per scene unit, along the scene's axes; or (0, 3)
    lattice: Doubles  # (3, 3) columns are the steps from a voxel to its neighbours, scene units
    table: TransferTable  # what values look like


def field_voxels(
    volume: Volume, transfer: Transfer, resampler: Resampler, gradient: str | None
) -> FieldVoxels:
    """Return the voxels that a renderer needs to interpolate the visible field.

    `resampler`: renderer, for its projection: an X-ray needs values other than 0, a mean all of
    them, and others those near visible voxels. `gradient`: one of
    `resample_volume.voxels.visible.GRADIENTS`; None without shading.
    """
    lattice = lattice_of(volume)
    data_range, unit = finite_range(volume.values), unit_of(transfer, volume)
    check_iso(resampler.iso, volume, data_range)
    if not transfer.normalized and resampler.iso is None:
        data_range = table_range(volume, transfer, data_range)
    shape = (64 if transfer.needs_gradient else 1, columns_of(volume, data_range))
    looks = tabulated(transfer, data_range, 1.0, unit, shape)
    voxel = _needed_voxels(volume, looks, resampler)
    require_memory(BYTES_PER_VOXEL * voxel.size, f"{volume.name} with {voxel.size} voxels")
    value = volume.values.reshape(-1)[voxel].astype(np.float32)
    slope = np.empty((0, 3), np.float32)
    if gradient is not None:
        slope = gradients_at(volume, voxel, gradient)
    if transfer.needs_gradient:
        visible = transfer.opacities(value, data_range) > 0
        steep = steepness(np.linalg.norm(slope[visible], axis=1))
        looks = tabulated(transfer, data_range, steep, unit, shape)
    return FieldVoxels(positions_at(volume, voxel), value, slope, lattice, looks)


def framed(voxels: Placed, resampler: Resampler) -> Placed:
    """Return the voxels that are visible themselves, not only by interpolation.

    A camera frames these. If there are none, all are returned, and so are classified ones.
    """
    if not isinstance(voxels, FieldVoxels):
        return voxels
    looks, iso = voxels.table, resampler.iso
    if iso is not None:
        seen = voxels.value >= iso
    elif resampler.projection in CLASSIFYING:
        last = looks.table.shape[1] - 1
        place = (voxels.value.astype(np.float64) - looks.low) / (looks.high - looks.low)
        column = np.rint(np.clip(place, 0, 1) * last).astype(np.int64)
        seen = (looks.table[..., 3].max(axis=0) > 0)[column]
    else:
        return voxels
    return voxels._replace(position=voxels.position[seen]) if seen.any() else voxels


def lit_field(
    voxels: FieldVoxels,
    light: Light | None,
    viewer: Doubles,
    cue: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> Field:
    """Shade a field.

    `voxels`: with gradients, unless `light` is None. `light`: None leaves the colors as they are.
    `viewer`: (4,) position and 1, or direction to the viewer and 0; scene axes.
    """
    lamp = lamp_of(light or UNLIT, viewer, voxels.gradient)
    classifier = Classifier(*voxels.table, lamp, *cue)
    return Field(voxels.position, voxels.value, voxels.gradient, voxels.lattice, classifier)


def check_iso(iso: float | None, volume: Volume, data_range: tuple[float, float]) -> None:
    """Reject an isosurface of a value that the data do not cross."""
    low, high = data_range
    if iso is not None and not low < iso <= high and np.isfinite(volume.values).any():
        raise ValueError(
            f"there is no surface of the value {iso:g}: {volume.name} holds {low:g} to {high:g}"
        )


def table_range(
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


def columns_of(volume: Volume, data_range: tuple[float, float]) -> int:
    """Return the number of columns of a table of looks, such that integers fall on columns."""
    span = data_range[1] - data_range[0]
    if volume.values.dtype.kind not in "iu" or not 1 <= span < MOST_COLUMNS:
        return COLUMNS
    return int(span) * max(1, COLUMNS // int(span)) + 1


def _needed_voxels(volume: Volume, looks: TransferTable, resampler: Resampler) -> Indices:
    """Return flat indices of the voxels that a projection depends on."""
    values, projection = volume.values, resampler.projection
    if projection in CLASSIFYING:
        if resampler.iso is not None:
            looks = looks._replace(table=_opaque_from(looks, resampler.iso))
        # Values are means over a ray's path through a slab, up to √3 times its thickness.
        radius = resampler.reconstruction.radius + resampler.order.thickness
        return reachable(volume, looks, radius)
    needed = np.isfinite(values)
    if projection in SUMS:
        needed &= values != 0
    return np.flatnonzero(needed)


def _opaque_from(looks: TransferTable, value: float) -> Floats:
    """Return the table of a function that is opaque at and above a value."""
    column = np.linspace(looks.low, looks.high, looks.table.shape[1])
    table = np.zeros_like(looks.table)
    table[..., 3] = column >= value
    return table
