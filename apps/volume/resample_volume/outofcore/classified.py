"""Classify the voxels of volumes in bricks, a brick at a time."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from resample.outofcore.bricks import Box
from resample.types import Indices
from resample_volume.classification.transfer import DataRange, Transfer, extinction
from resample_volume.data.bricks import Bricks
from resample_volume.data.recordings import linear_colors
from resample_volume.data.values import bricks_of
from resample_volume.types import Volume
from resample_volume.voxels.streaming import (
    BrickClassifier,
    Candidates,
    OnGrid,
    brick_by_brick,
    near_to_each_other,
    visible_bricks,
)
from resample_volume.voxels.visible import (
    Voxels,
    classify_values,
    extinctions_of,
    finite_range,
    lattice_of,
    positions_at,
    to_scene_of,
    unit_of,
)

if TYPE_CHECKING:
    from resample_volume.classification.labels import Labels

R = TypeVar("R")


class Classifying(NamedTuple):
    """Parameters of a volume's classification."""

    transfer: Transfer
    gradient: str | None  # as of `classify`
    steep: float = 0.0  # data units per scene unit, see `steepness`; unused without gradient
    labels: "Labels | None" = None

    @property
    def sifts(self) -> bool:
        """Whether voxels visible by their value may turn out to be transparent."""
        return self.transfer.needs_gradient or self.labels is not None


def candidates_by_bricks(
    volume: Volume,
    transfer: Transfer,
    gradient: str | None,
    finish: Callable[[Candidates, Box], R],
) -> Iterator[R]:
    """Run a job on the voxels of each brick whose value may be visible, as `brick_by_brick`."""
    return brick_by_brick(*on_grid(bricks_of(volume), volume, transfer, gradient), finish)


def on_grid(bricks: Bricks, volume: Volume, transfer: Transfer, gradient: str | None) -> OnGrid:
    """Return bricks of a volume, of which those that may be visible are chosen."""
    data_range = range_for(transfer, volume)
    wanted = BrickClassifier(transfer, data_range, gradient, to_scene_of(volume))
    return OnGrid(bricks, wanted, visible_bricks(bricks, transfer, data_range))


def range_for(transfer: Transfer, volume: Volume) -> DataRange:
    """Return the least and greatest finite value, if a transfer function needs them."""
    return finite_range(volume.values) if transfer.normalized else (0.0, 1.0)


def classified(
    volume: Volume, by: Classifying, data_range: DataRange, found: Candidates, box: Box
) -> tuple[Indices, Voxels]:
    """Return flat indices (N,) of a brick's visible voxels, and the voxels, as of `classify`."""
    transfer, unit = by.transfer, unit_of(by.transfer, volume)
    seen = near_to_each_other(found, box, volume.values.shape)
    length = np.linalg.norm(seen.slope, axis=1) if transfer.needs_gradient else None
    color, opacity = classify_values(transfer, seen.value, length, data_range, by.steep)
    if volume.colors is not None:
        color = linear_colors(volume.colors.reshape(-1, volume.colors.shape[-1])[seen.place])
    if by.labels is not None:
        color, opacity = by.labels.applied(seen.place, color, opacity)
    kept = np.flatnonzero(opacity > 0)
    if kept.size < opacity.size:
        slope = seen.slope[kept] if len(seen.slope) else seen.slope
        seen = Candidates(seen.place[kept], seen.value[kept], slope)
        color, opacity = color[kept], opacity[kept]
    if by.sifts:
        thickness = extinction(opacity, unit)
    else:
        thickness = extinctions_of(transfer, seen.value, data_range, unit)
    position = positions_at(volume, seen.place)
    return seen.place, Voxels(position, color, thickness, seen.slope, lattice_of(volume))
