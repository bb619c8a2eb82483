"""Statistics of a volume's values: range, padding, outliers, units.

Air is at -1000, lung at -900 to -500, fat at -100, muscle and organs at 20 to 80, vessels with a
contrast agent at 150 to 450, spongy bone at 150 to 400 and compact bone from 500 on; metal is
above 2500.
"""

from typing import Any, NamedTuple

import numpy as np

from resample.outofcore.passes import memoized
from resample.types import Doubles
from resample_volume.classification.transfer import Point, TransferFunction, from_points
from resample_volume.data.scanning import Counts, Histogram, are_few, step_of
from resample_volume.data.values import Stored, values_of
from resample_volume.types import Volume

METAL = 2500.0  # HU; denser than any tissue

FLESH, MUSCLE, FAT = (0.85, 0.6, 0.48), (0.72, 0.25, 0.2), (0.92, 0.8, 0.5)
BLOOD, RUST = (0.8, 0.12, 0.1), (0.85, 0.6, 0.4)
IVORY, WHITE, STEEL = (0.95, 0.9, 0.8), (1.0, 1.0, 1.0), (0.75, 0.82, 0.9)
SKY, ROSE = (0.55, 0.7, 0.85), (0.9, 0.55, 0.5)

BONE: list[Point] = [(350.0, RUST, 0.35), (600.0, IVORY, 0.7), (1500.0, WHITE, 0.95)]

# fmt: off
POINTS: dict[str, list[Point]] = {
    # Bone in translucent flesh: the default for CT.
    "ct": [(-350.0, FLESH, 0.0), (-150.0, FLESH, 0.02), (60.0, FLESH, 0.03), (150.0, MUSCLE, 0.06),
           *BONE],
    "bone": [(150.0, RUST, 0.0), *BONE],
    "soft-tissue": [(-160.0, FAT, 0.0), (-90.0, FAT, 0.06), (-20.0, FAT, 0.08),
                    (30.0, MUSCLE, 0.35), (120.0, FLESH, 0.45), *BONE],
    "muscle": [(0.0, MUSCLE, 0.0), (40.0, MUSCLE, 0.5), (120.0, ROSE, 0.6), *BONE[1:]],
    "skin": [(-400.0, FLESH, 0.0), (-200.0, FLESH, 0.6), (0.0, FLESH, 0.9)],
    "lung": [(-880.0, SKY, 0.0), (-820.0, SKY, 0.03), (-650.0, SKY, 0.05), (-500.0, ROSE, 0.2),
             (-400.0, ROSE, 0.25), (-250.0, ROSE, 0.0)],
    "vessels": [(120.0, BLOOD, 0.0), (200.0, BLOOD, 0.4), (400.0, ROSE, 0.7), (550.0, IVORY, 0.75),
                (1500.0, WHITE, 0.95)],
    "metal": [(METAL - 300.0, STEEL, 0.0), (METAL, STEEL, 0.9)],
}
# fmt: on


LUNG, LUNG_VEIL = (-930.0, -550.0), 0.05  # HU where lungs have their peak, and their opacity
THINNER = 0.4  # of the flesh before lungs
STORED = 1024.0  # offset of Hounsfield units that are stored unsigned
KINDS = {"hu": 0.0, "hu+1024": STORED}  # offset from Hounsfield units, by name of the units
AIR, BETWEEN, TISSUE = (-1100.0, -850.0), (-800.0, -300.0), (-150.0, 150.0)  # HU
LEAST, GREATEST = (-1200.0, -850.0), (150.0, 33000.0)  # HU, ends of the range
LEAST_SHARE = 0.01  # shares of the voxels, of air and of tissue
PEAKED = 2.0  # ratio of the density in a peak to that between peaks
STRAY_SHARE = 2e-5  # greatest share of voxels that are outliers, if far from all others
STRAY_GAP = 0.5  # distance of outliers, of the range of the others
PADDING_GAP = 1.0  # distance of padding, of the range of the others
CT_PADDING_GAP = 0.2  # the same where the others look like computed tomography
NO_LEVELS = Histogram(np.zeros(0), np.zeros(0, np.int64))
FEW = 16  # distinct values: fewer are labels without padding
MOST_LABELS, SHARE_EQUAL = 255, 0.8  # values, and equal neighbours, of possible labels
PADDINGS = 4  # distinct values of padding, at most


def with_lungs(before: float, peak: float, after: float, added: float) -> TransferFunction:
    """Return the look `ct` with thinner flesh and visible lungs."""
    lungs = [(before, SKY, 0.0), (peak, SKY, LUNG_VEIL), (after, SKY, 0.0)]
    flesh, bone = POINTS["ct"][: -len(BONE)], POINTS["ct"][-len(BONE) :]
    thin = [(value, color, THINNER * opacity) for value, color, opacity in flesh]
    body = [(value + added, color, opacity) for value, color, opacity in thin + bone]
    return from_points([*lungs, *(point for point in body if point[0] > after)])


def tissue(name: str, added: float = 0.0) -> TransferFunction:
    """Return a look of `POINTS` by name."""
    return from_points([(value + added, color, opacity) for value, color, opacity in POINTS[name]])


class Units(NamedTuple):
    """Units of values."""

    added: float | None = None  # offset from Hounsfield units; None: other units
    is_assumed: bool = False  # whether guessed from the values

    @property
    def name(self) -> str:
        """Name for messages."""
        if self.added is None:
            return "unknown"
        return "Hounsfield units" + (f" + {self.added:g}" if self.added else "")


def units_of(volume: Volume, levels: Histogram) -> Units:
    """Return the units of a volume, as stated or guessed from its values."""
    if volume.units:
        return Units(KINDS.get(volume.units))
    kind = volume.values.dtype
    if kind.itemsize == 1 or not levels.value.size:
        return Units()
    if resembles_ct(levels, 0.0):
        return Units(0.0, is_assumed=True)
    # Unsigned values may be anything: there, tissue must stand out.
    if kind.kind in "iu" and resembles_ct(levels, STORED, 2 * PEAKED):
        return Units(STORED, is_assumed=True)
    return Units()


def resembles_ct(levels: Histogram, added: float, peaked: float = PEAKED) -> bool:
    """Return whether there are peaks of air and tissue at their Hounsfield units."""
    low, high = levels.value[0] - added, levels.value[-1] - added
    if not (LEAST[0] <= low <= LEAST[1] and GREATEST[0] <= high <= GREATEST[1]):
        return False
    share = [levels.share(a + added, b + added) for a, b in (AIR, BETWEEN, TISSUE)]
    air, between, tissue = share
    per_unit = between / (BETWEEN[1] - BETWEEN[0])
    return (
        min(air, tissue) >= LEAST_SHARE
        and air / (AIR[1] - AIR[0]) >= PEAKED * per_unit
        and tissue / (TISSUE[1] - TISSUE[0]) >= peaked * per_unit
    )


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
    def is_plain(self) -> bool:
        """Whether the robust range is the range of all finite values."""
        return self.span == self.whole


@memoized(lambda volume: volume.values)
def survey(volume: Volume) -> Survey:
    """Compute the statistics of a volume's values; the range is 0 to 1 if none is finite.

    Padding is a frequent value far outside the range of all others, below 0 or on the volume's
    border, where nothing was measured. (0 below all others surrounds a segmented object; high
    values inside may be metal.) Bytes have no padding. Outliers are a few voxels far from all
    others.
    """
    levels, infinite = _levels(volume.values)
    if not levels.value.size:
        units = units_of(volume, NO_LEVELS)
        return Survey(0.0, 1.0, 0.0, 1.0, (), 0, 0, infinite, units, NO_LEVELS)
    total, size = int(levels.number.sum()), volume.values.size
    most = max(min(8, size // 500), int(STRAY_SHARE * size))  # voxels that may be outliers
    is_byte = volume.values.dtype.itemsize == 1
    rest, padding = levels, list[float]()
    rim = values_of(volume.values).border()
    for _ in range(0 if is_byte else PADDINGS):
        marks = [0] * bool(rest.value[0] < 0) + [-1] * bool((rim == rest.value[-1]).any())
        mark = next((end for end in marks if _is_padding(rest, end, most)), None)
        if mark is None:
            break
        padding.append(float(rest.value[mark]))
        rest = rest.between(1, -1) if mark == 0 else rest.between(0, -2)
    first, last = ends(rest.value, rest.number, most, STRAY_GAP)
    bulk = rest.between(first, last)
    kept = int(rest.number.sum())
    least, greatest, low, high = map(float, (*levels.value[[0, -1]], *bulk.value[[0, -1]]))
    counts = (total - kept, kept - int(bulk.number.sum()), infinite)
    units = units_of(volume, bulk)
    return Survey(least, greatest, low, high, tuple(padding), *counts, units, bulk)


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
        name = known.units.name
        lines.append(f"values look like {name}, so they are assumed to be; if not, --units none")
    if known.units.added is not None:
        inside = known.levels.value > METAL + known.units.added
        if metal := int(known.levels.number[inside].sum()):
            lines.append(f"{metal} voxels above {METAL:g} HU are metal")
    return lines


def label_count(volume: Volume) -> int:
    """Return the number of labels that values seem to be; 0 if they are measured values.

    Labels are few whole numbers in regions. In scans of 8 bits, at most 6 in 10 neighbours off the
    most frequent value are equal.
    """
    levels = survey(volume).levels
    if not 2 < levels.value.size <= MOST_LABELS or volume.colors is not None or volume.scale:
        return 0
    some = values_of(volume.values).sample()
    if some.dtype.kind == "f" and not (some == np.rint(some)).all():
        return 0
    inside = some != levels.value[levels.number.argmax()]
    equal = pairs = 0
    for axis in range(3):
        first, last = (np.moveaxis(some, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        counted = np.moveaxis(inside, axis, 0)
        both = counted[:-1] & counted[1:]
        equal += int((both & (first == last)).sum())
        pairs += int(both.sum())
    return levels.value.size if equal >= SHARE_EQUAL * max(1, pairs) else 0


def without_padding(volume: Volume, known: Survey) -> Volume:
    """Replace padding and infinite values by NaN, or the least other value of integers."""
    if not known.padding and not known.infinite:
        return volume
    is_whole = volume.values.dtype.kind in "iu"
    by = known.low if is_whole else np.nan
    values: Any = values_of(volume.values).without(known.padding, by, volume.name)
    return volume._replace(values=values)


def ends(value: Doubles, count: Counts, most: int, gap: float) -> tuple[int, int]:
    """Return the indices of the first and last of ascending values (K,) that are not outliers."""
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
    """Count each of few possible values, see `scanning.are_few`."""
    bits, size = values.dtype.itemsize * 8, 1 << (values.dtype.itemsize * 8)
    total = values_of(values).codes()
    if values.dtype.kind == "i":
        total = np.roll(total, size // 2)
    present = np.flatnonzero(total)
    least = -(1 << (bits - 1)) if values.dtype.kind == "i" else 0
    return Histogram(present.astype(np.float64) + least, total[present])
