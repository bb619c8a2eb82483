"""Computed tomography: Hounsfield units detected, and transfer functions in them.

Air is at -1000, lung at -900 to -500, fat at -100, muscle and organs at 20 to 80, vessels with a
contrast agent at 150 to 450, spongy bone at 150 to 400 and compact bone from 500 on; metal is
above 2500.
"""

from typing import NamedTuple

from resample_volume.classification.transfer import Point, TransferFunction, from_points
from resample_volume.data.thresholds import Histogram
from resample_volume.types import Volume

METAL = 2500.0  # HU; denser than any tissue

FLESH, MUSCLE, FAT = (0.85, 0.6, 0.48), (0.72, 0.25, 0.2), (0.92, 0.8, 0.5)
BLOOD, RUST = (0.8, 0.12, 0.1), (0.85, 0.6, 0.4)
IVORY, WHITE, STEEL = (0.95, 0.9, 0.8), (1.0, 1.0, 1.0), (0.75, 0.82, 0.9)
SKY, ROSE = (0.55, 0.7, 0.85), (0.9, 0.55, 0.5)

BONE: list[Point] = [(350.0, RUST, 0.35), (600.0, IVORY, 0.7), (1500.0, WHITE, 0.95)]

POINTS: dict[str, list[Point]] = {
    # Bone in translucent flesh: the default for CT.
    "ct": [
        (-350.0, FLESH, 0.0),
        (-150.0, FLESH, 0.02),
        (60.0, FLESH, 0.03),
        (150.0, MUSCLE, 0.06),
        *BONE,
    ],
    "bone": [(150.0, RUST, 0.0), *BONE],
    "soft-tissue": [
        (-160.0, FAT, 0.0),
        (-90.0, FAT, 0.06),
        (-20.0, FAT, 0.08),
        (30.0, MUSCLE, 0.35),
        (120.0, FLESH, 0.45),
        *BONE,
    ],
    "muscle": [(0.0, MUSCLE, 0.0), (40.0, MUSCLE, 0.5), (120.0, ROSE, 0.6), *BONE[1:]],
    "skin": [(-400.0, FLESH, 0.0), (-200.0, FLESH, 0.6), (0.0, FLESH, 0.9)],
    "lung": [
        (-880.0, SKY, 0.0),
        (-820.0, SKY, 0.03),
        (-650.0, SKY, 0.05),
        (-500.0, ROSE, 0.2),
        (-400.0, ROSE, 0.25),
        (-250.0, ROSE, 0.0),
    ],
    "vessels": [
        (120.0, BLOOD, 0.0),
        (200.0, BLOOD, 0.4),
        (400.0, ROSE, 0.7),
        (550.0, IVORY, 0.75),
        (1500.0, WHITE, 0.95),
    ],
    "metal": [(METAL - 300.0, STEEL, 0.0), (METAL, STEEL, 0.9)],
}


LUNG, LUNG_VEIL = (-930.0, -550.0), 0.05  # HU where lungs have their peak, and their opacity
THINNER = 0.4  # of the flesh before lungs
STORED = 1024.0  # offset of Hounsfield units that are stored unsigned
KINDS = {"hu": 0.0, "hu+1024": STORED}  # offset from Hounsfield units, by name of the units
AIR, BETWEEN, TISSUE = (-1100.0, -850.0), (-800.0, -300.0), (-150.0, 150.0)  # HU
LEAST, GREATEST = (-1200.0, -850.0), (150.0, 33000.0)  # HU, ends of the range
LEAST_SHARE = 0.01  # shares of the voxels, of air and of tissue
PEAKED = 2.0  # ratio of the density in a peak to that between peaks


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
