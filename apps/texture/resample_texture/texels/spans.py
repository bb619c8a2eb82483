"""Offset and scale values that float32 does not resolve, and restore them.

Texels are float32, which rounds 10⁹ + 0.25 to 10⁹. So values of wide types are stored as
differences from each channel's smallest value if they lie far from 0, and in units of a power of
two if they are huge or tiny: errors are then some 10⁻⁷ of the values' range, not of their size.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles, Floats

WIDE = ("int32", "int64", "uint32", "uint64", "float64")
COMFORTABLE = 60  # exponents of two up to which sums and squares of values fit into float32


class ValueSpan(NamedTuple):
    """Offset and unit of each channel's values."""

    start: NDArray[Any]  # (C,) of the values' type
    unit: Doubles  # (C,) powers of two

    def reduced(self, planes: NDArray[Any]) -> Doubles:
        """Subtract the offset and divide by the unit, (H, W, C); only finite values count."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray((planes - self.start) / self.unit, np.float64)

    def restored(
        self, image: Floats, coverage: Floats, behind: ArrayLike, dtype: np.dtype[Any]
    ) -> NDArray[Any]:
        """Restore values of a type from an image (H, W, C) multiplied by its coverage.

        `behind`: background where the coverage, (H, W, 1) or (H, W, C), is below 1.
        """
        missing = np.broadcast_to(1.0 - coverage.astype(np.float64), image.shape)
        through = np.zeros(image.shape)
        with np.errstate(over="ignore", invalid="ignore"):
            beyond = np.asarray(behind, np.float64) - self.start.astype(np.float64)
            np.multiply(missing, beyond, out=through, where=missing > 0.0)
            distance = image * self.unit + through
            if dtype.kind == "f":
                return np.asarray(self.start + distance, dtype)
        return rounded(distance, dtype, self.start)


def span_of(
    planes: NDArray[Any], missing: NDArray[np.bool_] | None, *, from_zero: bool = False
) -> ValueSpan | None:
    """Return offset and unit for values (H, W, C); None if float32 resolves them."""
    if planes.dtype.name not in WIDE:
        return None
    start = np.zeros(planes.shape[2], planes.dtype)
    unit = np.ones(planes.shape[2])
    for c in range(planes.shape[2]):
        plane = planes[..., c]
        known = plane if missing is None else plane[~missing[..., c]]
        if known.size:
            low, high = known.min().item(), known.max().item()
            first = 0 if from_zero else _start(low, high)
            start[c], unit[c] = first, _unit(max(high - first, first - low))
    if not start.any() and (unit == 1.0).all():
        return None
    return ValueSpan(start, unit)


def rounded(
    distance: Doubles, dtype: np.dtype[Any], start: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Round `start` + `distance` (H, W, C) to integers or booleans, within their range."""
    whole = np.rint(distance)
    if dtype.kind == "b":
        return np.asarray(whole > 0.0)
    native = dtype.newbyteorder("=")
    limits = np.iinfo(native)
    if start is None or not start.any():
        return _saturated(whole, limits.min, limits.max, native).astype(dtype, copy=False)
    result = np.empty(whole.shape, native)
    for c, first in enumerate(start.tolist()):
        low, high = max(limits.min - first, -(2**63)), min(limits.max - first, 2**63 - 1)
        steps = _saturated(whole[..., c], low, high, np.dtype(np.int64))
        result[..., c] = steps.astype(native) + np.array(first, native)  # overflow wraps back
    return result.astype(dtype, copy=False)


def _saturated(whole: Doubles, low: int, high: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Convert whole numbers to integers, limited to `low`..`high` beyond float64's precision."""
    is_low, is_high = whole <= low, whole >= high
    result = np.where(is_low | is_high, 0.0, whole).astype(dtype)
    result[is_low], result[is_high] = low, high
    return result


def _start(low: float, high: float) -> float:
    """Return the offset: the smallest value if 0 is far from the range, else 0."""
    is_far = low > high / 2 if low > 0 else high < low / 2
    return low if is_far else 0


def _unit(largest: float) -> float:
    """Return the power of two in which the largest distance is neither huge nor tiny."""
    exponent = math.frexp(largest)[1] - 1 if largest else 0
    return math.ldexp(1.0, exponent) if abs(exponent) > COMFORTABLE else 1.0
