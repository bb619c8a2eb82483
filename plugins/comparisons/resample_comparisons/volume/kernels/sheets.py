"""A blend of `resample.hybrid`: the samples of a sheet are summed, and sheets are composited."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step, plays
from resample.engine.lookup import absorbed
from resample.hybrid.roles import finish, is_open, sample_of, sweeps, touch
from resample.types import Film, Floats, Record, Single

OPAQUE = np.float32(1.0 - 1e-4)  # opacity that counts as all
ZERO, ONE = np.float32(0.0), np.float32(1.0)

# What a pixel has got of a sheet that is not composited yet; optical depths.
SUM = np.dtype(
    [
        ("sheet", np.int32),
        ("red", np.float32),
        ("green", np.float32),
        ("blue", np.float32),
        ("thick", np.float32),  # 0: nothing waits
        ("depth", np.float32),
    ],
    align=True,
)


class SheetBlend(NamedTuple):
    """Composite sums of sheets, which come from near to far."""

    color: Floats  # (N, 3) not multiplied by the opacity
    density: Floats  # (N,) optical depth per unit of a sample's amount
    film: Film  # empty, with depths of 0; image, mean depth, nearest depth and coverage
    waiting: Record  # (H, W) of SUM, 0


class Summed(NamedTuple):
    """A sample, as it is summed."""

    sheet: int
    density: Single
    red: Single
    green: Single
    blue: Single
    depth: Single


@plays(sweeps, SheetBlend)
def _front_to_back(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 1


@plays(is_open, SheetBlend)
def _is_transparent(blend, row, column):  # type: ignore[no-untyped-def]
    return blend.film.rgba[row, column, 3] < OPAQUE


@plays(sample_of, SheetBlend)
def _sample_to_sum(blend, s, n):  # type: ignore[no-untyped-def]
    red, green, blue = blend.color[n, 0], blend.color[n, 1], blend.color[n, 2]
    return Summed(s["layer"], blend.density[n], red, green, blue, s["depth"])


@plays(touch, SheetBlend)
def _sum(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]  # noqa: ARG001
    waiting = blend.waiting[row, column]
    if waiting["thick"] != ZERO and sample.sheet != waiting["sheet"]:
        _composite(blend, row, column)
        if blend.film.rgba[row, column, 3] >= OPAQUE:
            return 1
    thick = amount * sample.density
    waiting["sheet"] = sample.sheet
    waiting["thick"] += thick
    waiting["red"] += thick * sample.red
    waiting["green"] += thick * sample.green
    waiting["blue"] += thick * sample.blue
    waiting["depth"] += thick * sample.depth
    return 0


@inner_step
def _composite(blend: SheetBlend, row: np.uint64, column: np.uint64) -> None:
    """Composite the sum that waits, and begin another."""
    waiting, film, rgba = blend.waiting[row, column], blend.film, blend.film.rgba
    thick, before = waiting["thick"], rgba[row, column, 3]
    if thick > ZERO:
        share = (ONE - before) * absorbed(thick) / thick
        rgba[row, column, 0] += share * waiting["red"]
        rgba[row, column, 1] += share * waiting["green"]
        rgba[row, column, 2] += share * waiting["blue"]
        rgba[row, column, 3] = before + share * thick
        film.depth[row, column] += share * waiting["depth"]
        film.coverage[row, column] = ONE
        if before == ZERO:
            film.first_depth[row, column] = waiting["depth"] / thick
    waiting["red"] = waiting["green"] = waiting["blue"] = ZERO
    waiting["thick"] = waiting["depth"] = ZERO


@plays(finish, SheetBlend)
def _finish(blend, row, column):  # type: ignore[no-untyped-def]
    _composite(blend, row, column)
    film, opacity = blend.film, blend.film.rgba[row, column, 3]
    mean = film.depth[row, column] / opacity if opacity > ZERO else np.float32(np.inf)
    film.depth[row, column] = mean
