"""Detect Hounsfield units, from the file or from the values."""

from typing import NamedTuple

from resample_volume.data.thresholds import Histogram
from resample_volume.types import Volume

STORED = 1024.0  # offset of Hounsfield units that are stored unsigned
KINDS = {"hu": 0.0, "hu+1024": STORED}  # offset from Hounsfield units, by name of the units

AIR, BETWEEN, TISSUE = (-1100.0, -850.0), (-800.0, -300.0), (-150.0, 150.0)  # HU
LEAST, GREATEST = (-1200.0, -850.0), (150.0, 33000.0)  # HU, ends of the range
LEAST_SHARE = 0.01  # shares of the voxels, of air and of tissue
PEAKED = 2.0  # ratio of the density in a peak to that between peaks


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
