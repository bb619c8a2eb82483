"""Whether values are Hounsfield units, as the file says or as the values look."""

from typing import NamedTuple

from resample_volume.data.thresholds import Levels
from resample_volume.types import Volume

STORED = 1024.0  # what is added to Hounsfield units where they are kept without a sign
KINDS = {"hu": 0.0, "hu+1024": STORED}  # names of units: what is added to Hounsfield units

AIR, BETWEEN, TISSUE = (-1100.0, -850.0), (-800.0, -300.0), (-150.0, 150.0)  # HU
LEAST, GREATEST = (-1200.0, -850.0), (150.0, 33000.0)  # HU, where the range begins and ends
LEAST_SHARE = 0.01  # of the voxels, of air and of tissue
PEAKED = 2.0  # times as many values per unit in a peak as in what lies between


class Units(NamedTuple):
    """What values are measured in."""

    added: float | None = None  # to Hounsfield units; None: these are none
    is_assumed: bool = False  # by the values alone

    @property
    def name(self) -> str:
        """For messages."""
        if self.added is None:
            return "unknown"
        return "Hounsfield units" + (f" + {self.added:g}" if self.added else "")


def units_of(volume: Volume, levels: Levels) -> Units:
    """Units that a volume says it has, or that its values look like.

    Parameters
    ----------
    volume
        Whose `units` may be empty.
    levels
        Its values without padding and strays.
    """
    if volume.units:
        return Units(KINDS.get(volume.units))
    kind = volume.values.dtype
    if kind.itemsize == 1 or not levels.value.size:
        return Units()
    if looks_like_ct(levels, 0.0):
        return Units(0.0, is_assumed=True)
    # What has no sign may be anything: there, tissue must stand out.
    if kind.kind in "iu" and looks_like_ct(levels, STORED, 2 * PEAKED):
        return Units(STORED, is_assumed=True)
    return Units()


def looks_like_ct(levels: Levels, added: float, peaked: float = PEAKED) -> bool:
    """Whether there is a peak of air and one of tissue where these are in Hounsfield units."""
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
