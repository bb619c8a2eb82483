"""Mixtures: samples that may be points, or splats of other than exact footprints."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.outlines import AMPLITUDE, BENT, FLAT
from resample.engine.ellipsoids.rows import CHORD, RAY, SplatLimits, index_of
from resample.engine.jit import kernel
from resample.engine.roles import lane_role, plays
from resample.types import DISC, EXACT, Floats, Single, Style


class Mixture(NamedTuple):
    """Properties of samples that need not be splats of exact footprint."""

    is_plain: bool  # outlines and margins alone tell where samples are painted
    least: float  # px, smallest spacing of samples


class Bend(NamedTuple):
    """Index correction of a splat's model; see `resample.engine.mixtures.models`."""

    flat: Single
    bent: Single
    amplitude: Single


@lane_role
def bend_of(mixture: Mixture | None, room: Floats, s: np.uint64) -> Bend | None:
    """Index correction of a splat, if its model may be another than the exact one."""
    raise NotImplementedError


@plays(bend_of, type(None))
def _not_bent(mixture, room, s):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return None


@plays(bend_of, Mixture)
def _bent(mixture, room, s):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return Bend(room[s + FLAT], room[s + BENT], room[s + AMPLITUDE])


@kernel
def limits_of(
    mixture: Mixture | None,
    rows: Floats,
    size: tuple[int, int],
    style: Style,
    least_ray: Single,
    linear: float,
) -> SplatLimits:
    """Limits that all splats of a tile share; rays lose what a mixture's model does not use.

    `size` is rows and columns; for `linear` see `SplatLimits`.
    """
    # Quadratic forms of other models are not multiplied by the ray's own factor.
    if mixture is not None:
        _flatten_rays(rows, size[0], size[1], style.model)
        least_ray = least_ray if style.model in (EXACT, DISC) else np.float32(1.0)
    # `widest` bounds the form at the rim over all rays of the tile.
    return SplatLimits(
        np.float32(style.opaque),
        np.float32(1.0 / style.layer),
        np.float32(1.0) / least_ray,
        np.float32(linear),
    )


@kernel
def _flatten_rays(rows: Floats, height: int, width: int, model: int) -> None:
    # Exact footprints keep the rays; discs keep their distances, not their chords.
    if model == EXACT:
        return
    for row in range(height):
        for column in range(width):
            k = index_of(row, column)
            rows[k + CHORD] = np.float32(1.0)
            if model != DISC:
                rows[k + RAY] = np.float32(1.0)
