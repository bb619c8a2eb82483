"""Section 3, depth images: what lies on the nearest surface is added.

"Visibility is calculated using depth, normal, as well as detected boundary discontinuity
information; samples within the same boundary are assumed to be on the same surface."
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step
from resample.engine.roles import plays
from resample.hybrid.roles import finish, is_open, sample_of, sweeps, touch
from resample.types import Floats, Single

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


class SurfaceRule(NamedTuple):
    """When two samples are on one surface."""

    close: np.float32  # part of the nearness that they may differ by, whatever else is known
    loose: np.float32  # likewise, if no boundary lies between them
    turn: np.float32  # least cosine between their normals then


class NearestSurface(NamedTuple):
    """Mean of the samples on the nearest surface.

    Surfaces are found first and summed after, so that neither order nor threads matter. Where no
    sample's core has been, everything that reaches is added, lest there be pinholes.
    """

    color: Floats  # (N, C)
    slope: Floats  # (N, 2) change of nearness per px, to the right and down
    core: Floats  # (N,) squared index up to which the sample hides what is behind
    label: NDArray[np.int32]  # (N,) samples with no boundary between them have the same
    normal: Floats  # (N, 3) unit
    surface: SurfaceRule
    image: Floats  # (H, W, C) empty; the mean
    weight: Floats  # (H, W) empty
    nearness: Floats  # (H, W) 0; of the surface, 1 / depth; negative: no core has been there
    found: NDArray[np.int32]  # (H, W) sample that it was found by


@plays(sweeps, NearestSurface)
def _find_then_add(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 2


@plays(is_open, NearestSurface)
def _always(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return True


class SamplePlane(NamedTuple):
    """The plane around a sample, as it is compared."""

    x: Single  # px, where the sample is
    y: Single
    nearness: Single  # there
    across: Single  # change per px to the right
    downward: Single
    core: Single


@plays(sample_of, NearestSurface)
def _plane_of(blend, s, n):  # type: ignore[no-untyped-def]
    across, downward = blend.slope[n, 0], blend.slope[n, 1]
    return SamplePlane(s["x"], s["y"], ONE / s["depth"], across, downward, blend.core[n])


@plays(touch, NearestSurface)
def _touch(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]
    nearness, nearest = _nearness_at(sample, row, column), blend.nearness[row, column]
    if sweep == 0:
        # The nearest core wins.
        if index2 <= sample.core and nearness > nearest:
            blend.nearness[row, column], blend.found[row, column] = nearness, n
        return 0
    if nearest > ZERO and not _is_same_surface(blend, n, row, column, nearness):
        return 0
    if -nearness < nearest <= ZERO:
        blend.nearness[row, column], blend.found[row, column] = -nearness, n
    for channel in range(blend.color.shape[1]):
        k = np.uint64(channel)
        blend.image[row, column, k] += amount * blend.color[n, k]
    blend.weight[row, column] += amount
    return 0


@inner_step
def _nearness_at(sample: SamplePlane, row: np.uint64, column: np.uint64) -> Single:
    """Nearness of a sample's plane in the direction of a pixel."""
    dx, dy = np.float32(column) + HALF - sample.x, np.float32(row) + HALF - sample.y
    return sample.nearness + sample.across * dx + sample.downward * dy


@inner_step
def _is_same_surface(
    blend: NearestSurface, n: np.uint64, row: np.uint64, column: np.uint64, nearness: Single
) -> bool:
    """Whether sample n, of this nearness at a pixel, is on the surface that was found there."""
    behind = ONE - nearness / blend.nearness[row, column]
    if behind <= blend.surface.close:
        return True
    m = np.uint64(blend.found[row, column])
    if behind > blend.surface.loose or blend.label[n] != blend.label[m]:
        return False
    normal = blend.normal
    cosine = normal[n, 0] * normal[m, 0] + normal[n, 1] * normal[m, 1] + normal[n, 2] * normal[m, 2]
    return bool(cosine >= blend.surface.turn)


@plays(finish, NearestSurface)
def _divide(blend, row, column):  # type: ignore[no-untyped-def]
    weight = blend.weight[row, column]
    if weight > ZERO:
        share = ONE / weight
        for channel in range(blend.color.shape[1]):
            blend.image[row, column, np.uint64(channel)] *= share
