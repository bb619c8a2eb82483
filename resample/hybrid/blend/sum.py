"""Section 3, texture mapping: everything is added, and divided by its weights."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.roles import plays
from resample.hybrid.roles import finish, is_open, sample_of, sweeps, touch
from resample.types import Floats


class WeightedSum(NamedTuple):
    """Weighted sums, to which samples are added batch by batch."""

    color: Floats  # (N, C) of the batch
    image: Floats  # (H, W, C) sums of weights times colors; empty at first
    weight: Floats  # (H, W) sums of weights, 1 where samples cover the pixel; empty at first


def mean_of(blend: WeightedSum, is_inner: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Image, multiplied by its coverage, and coverage (H, W): 1 in pixels that see samples alone.

    Elsewhere the weight is the coverage, as long as it is no more than 1.
    """
    is_full = (blend.weight > 0.0) & (is_inner | (blend.weight > 1.0))
    coverage = np.where(is_full, np.float32(1.0), np.maximum(blend.weight, np.float32(0.0)))
    share = np.divide(1.0, blend.weight, out=np.ones_like(coverage), where=is_full)
    return blend.image * share[..., None], coverage


@plays(sweeps, WeightedSum)
def _once(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 1


@plays(is_open, WeightedSum)
def _always(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return True


@plays(sample_of, WeightedSum)
def _none(blend, s, n):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 0


@plays(touch, WeightedSum)
def _add(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]  # noqa: ARG001
    for channel in range(blend.color.shape[1]):
        k = np.uint64(channel)
        blend.image[row, column, k] += amount * blend.color[n, k]
    blend.weight[row, column] += amount
    return 0


@plays(finish, WeightedSum)
def _leave(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return
