"""Samples that need not be splats of exact footprint: other models of these, and points."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.outlines import AMPLITUDE, BENT, FLAT
from resample.engine.ellipsoids.rows import CHORD, RAY, Limits, index_of
from resample.engine.jit import kernel
from resample.engine.roles import lane_role, plays
from resample.types import DISC, EXACT, Floats, Single, Style


class Mixture(NamedTuple):
    """What is known of samples that need not be splats of exact footprint."""

    is_plain: bool  # outlines and paddings tell where samples are painted
    least: float  # px, spacing of samples


class Bend(NamedTuple):
    """A splat of any model of footprints; see `resample.engine.mixtures.models`."""

    flat: Single
    bent: Single
    amplitude: Single


@lane_role
def bend_of(mixture: Mixture | None, room: Floats, s: np.uint64) -> Bend | None:
    """What a splat's model says, if it may be another than the exact one."""
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
) -> Limits:
    """What splats of a tile share, once rays have no part in what a mixture's do not take of them.

    A size is so many rows and columns; for `linear` see `Limits`.
    """
    if mixture is not None:
        _flatten_rays(rows, size[0], size[1], style.model)
        least_ray = least_ray if style.model in (EXACT, DISC) else np.float32(1.0)
    return Limits(
        np.float32(style.opaque),
        np.float32(1.0 / style.layer),
        np.float32(1.0) / least_ray,
        np.float32(linear),
    )


@kernel
def _flatten_rays(rows: Floats, height: int, width: int, model: int) -> None:
    if model == EXACT:
        return
    for row in range(height):
        for column in range(width):
            k = index_of(row, column)
            rows[k + CHORD] = np.float32(1.0)
            if model != DISC:
                rows[k + RAY] = np.float32(1.0)
