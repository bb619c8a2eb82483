"""Statistics of a volume's values: range, padding, outliers, units."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.classification.tomography import METAL, Units, resembles_ct, units_of
from resample_volume.data.memoization import memoized
from resample_volume.data.statistics.scanning import are_few, step_of
from resample_volume.data.thresholds import Counts, Histogram
from resample_volume.data.values import Stored, values_of
from resample_volume.types import Volume

STRAY_SHARE = 2e-5  # greatest share of voxels that are outliers, if far from all others
STRAY_GAP = 0.5  # distance of outliers, of the range of the others
PADDING_GAP = 1.0  # distance of padding, of the range of the others
CT_PADDING_GAP = 0.2  # the same where the others look like computed tomography
NO_LEVELS = Histogram(np.zeros(0), np.zeros(0, np.int64))
FEW = 16  # distinct values: fewer are labels without padding
PADDINGS = 4  # distinct values of padding, at most


class Survey(NamedTuple):
    """Statistics of a volume's values."""

    least: float  # finite, with padding and outliers
    greatest: float
    low: float  # finite, without padding and outliers: the robust range
    high: float
    padding: tuple[float, ...]  # values that mark missing ones
    padded: int  # voxels of these
    stray: int  # voxels outside the robust range other than padding
    infinite: int  # voxels
    units: Units
    levels: Histogram  # of the robust range

    @property
    def whole(self) -> tuple[float, float]:
        """Range of all finite values."""
        return self.least, self.greatest

    @property
    def span(self) -> tuple[float, float]:
        """Robust range."""
        return self.low, self.high

    @property
    def metal(self) -> int:
        """Number of voxels denser than any tissue, if known."""
        if self.units.added is None:
            return 0
        inside = self.levels.value > METAL + self.units.added
        return int(self.levels.number[inside].sum())

    @property
    def is_plain(self) -> bool:
        """Whether the robust range is that of all finite values."""
        return self.span == self.whole


@memoized(lambda volume: volume.values)
def survey(volume: Volume) -> Survey:
    """Compute the statistics of a volume's values.

    Padding is a frequent value far outside the range of all others: scanners and programs write it
    where nothing was measured. It is below 0 or on the volume's border: 0 below all others is the
    surroundings of a segmented object, and high values inside may be metal. Bytes have no padding.
    Outliers are a few voxels far from all others. Without any finite value, the range is 0 to 1.
    """
    levels, infinite = _levels(volume.values)
    if not levels.value.size:
        units = units_of(volume, NO_LEVELS)
        return Survey(0.0, 1.0, 0.0, 1.0, (), 0, 0, infinite, units, NO_LEVELS)
    total, most = int(levels.number.sum()), _most_strays(volume.values.size)
    is_byte = volume.values.dtype.itemsize == 1
    rest, padding = _without_padding(
        levels, values_of(volume.values).border(), most, 0 if is_byte else PADDINGS
    )
    first, last = ends(rest.value, rest.number, most, STRAY_GAP)
    bulk = rest.between(first, last)
    kept = int(rest.number.sum())
    return Survey(
        float(levels.value[0]),
        float(levels.value[-1]),
        float(bulk.value[0]),
        float(bulk.value[-1]),
        padding,
        total - kept,
        kept - int(bulk.number.sum()),
        infinite,
        units_of(volume, bulk),
        bulk,
    )


def findings(known: Survey) -> list[str]:
    """Return messages about a volume's values for the user, one line each."""
    lines = []
    if known.padding:
        values = " and ".join(f"{value:g}" for value in known.padding)
        lines.append(f"{known.padded} voxels of {values} are taken for padding and left out")
    if known.stray:
        lines.append(
            f"{known.stray} {'voxels are' if known.stray > 1 else 'voxel is'} far beyond "
            f"{known.low:g} to {known.high:g}, which looks are spread over"
        )
    if known.units.is_assumed:
        lines.append(
            f"values look like {known.units.name} and are taken for them (--units none: they "
            "are not)"
        )
    if metal := known.metal:
        lines.append(f"{metal} voxels above {METAL:g} HU are metal")
    return lines


def without_padding(volume: Volume, known: Survey) -> Volume:
    """Replace padding and infinite values by missing ones.

    Integers have no NaN: there padding becomes the least of the other values.
    """
    if not known.padding and not known.infinite:
        return volume
    is_whole = volume.values.dtype.kind in "iu"
    by = known.low if is_whole else np.nan
    values = values_of(volume.values).without(known.padding, by, volume.name)
    return volume._replace(values=values)


def ends(value: Doubles, count: Counts, most: int, gap: float) -> tuple[int, int]:
    """Return the first and last value that is not an outlier.

    `value`: (K,) values, ascending. `count`: (K,) voxels of each. Result: indices; all values if
    the others are equal.
    """
    total = np.cumsum(count)
    middle = value[np.searchsorted(total, total[-1] / 2)]
    last = _last(value, total[-1] - total, most, gap, middle)
    backward = total[-1] - total + count  # number at or beyond a value
    first = _last(-value[::-1], (total[-1] - backward)[::-1], most, gap, -middle)
    return value.size - 1 - first, last


def _last(value: Doubles, above: Counts, most: int, gap: float, middle: float) -> int:
    """Return the last value that is not an outlier; `above` (K,) counts those above each."""
    start = int(np.searchsorted(-above, -most))
    place = np.arange(start, value.size - 1)
    # From the first percent on, which outliers at the other end do not move.
    few = above[0] * 0.99
    foot = min(value[int(np.searchsorted(-above, -few))], middle)
    reach = value[place] - foot
    far = (np.diff(value)[start:] > gap * reach) & (reach > 0)
    return int(place[far][0]) if far.any() else value.size - 1


def _most_strays(size: int) -> int:
    """Return how many voxels may be outliers."""
    return max(min(8, size // 500), int(STRAY_SHARE * size))


def _without_padding(
    levels: Histogram, rim: NDArray[Any], most: int, paddings: int
) -> tuple[Histogram, tuple[float, ...]]:
    """Split levels into values and padding; see `survey`."""
    padding: list[float] = []
    for _ in range(paddings):
        ends_ = []
        if levels.value[0] < 0:
            ends_.append(0)
        if (rim == levels.value[-1]).any():
            ends_.append(-1)
        found = [end for end in ends_ if _is_padding(levels, end, most)]
        if not found:
            break
        padding.append(float(levels.value[found[0]]))
        levels = _without(levels, found[0])
    return levels, tuple(padding)


def _without(levels: Histogram, end: int) -> Histogram:
    """Return the levels without the first or the last."""
    return levels.between(1, -1) if end == 0 else levels.between(0, -2)


def _is_padding(levels: Histogram, end: int, most: int) -> bool:
    """Return whether the first or last value is far from the others, and frequent."""
    if levels.value.size <= FEW + 1 or levels.number[end] <= most:
        return False
    rest = levels.between(1, -2)  # there may be padding at the other end, too
    bulk = rest.between(*ends(rest.value, rest.number, most, STRAY_GAP))
    if bulk.value.size < FEW:
        return False
    low, high = bulk.value[0], bulk.value[-1]
    gap = low - levels.value[0] if end == 0 else levels.value[-1] - high
    least = CT_PADDING_GAP if resembles_ct(bulk, 0.0) else PADDING_GAP
    return bool(gap > least * (high - low))


def _levels(stored: Stored) -> tuple[Histogram, int]:
    """Return the distribution of finite values, exact at its ends, and the number of infinite."""
    if are_few(stored.dtype):
        return counted(stored), 0
    values, step = values_of(stored), step_of(stored.size)
    some = np.asarray(values.sample(), np.float64)
    some = some[np.isfinite(some)]
    low, high = (some.min(), some.max()) if some.size else (np.inf, -np.inf)
    value, count = np.unique(some, return_counts=True)
    beyond, infinite = values.outside(low, high)
    more, often = np.unique(beyond, return_counts=True)
    order = np.argsort(np.concatenate([value, more]), kind="stable")
    counts = np.concatenate([count * step**3, often])
    return Histogram(np.concatenate([value, more])[order], counts[order].astype(np.int64)), infinite


@memoized(lambda values: values)
def counted(values: Stored) -> Histogram:
    """Count each of few possible values, see `bricks.are_few`."""
    bits, size = values.dtype.itemsize * 8, 1 << (values.dtype.itemsize * 8)
    total = values_of(values).codes()
    if values.dtype.kind == "i":
        total = np.roll(total, size // 2)
    present = np.flatnonzero(total)
    least = -(1 << (bits - 1)) if values.dtype.kind == "i" else 0
    return Histogram(present.astype(np.float64) + least, total[present])
