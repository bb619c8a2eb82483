"""Units of lengths of volumes."""

from resample.lengths import SCALES, ratio, times
from resample_volume.types import ASSUMED, UNKNOWN, Recording, Volume


def unit_of_space(volume: Volume | Recording) -> str:
    """Return the symbol of a volume's scene unit; empty if unknown."""
    return volume.length if volume.length in SCALES else "mm" if volume.space == "lps" else ""


def in_unit(volume: Volume, unit: str) -> Volume:
    """Return a volume in another scene unit, if both are known."""
    own = unit_of_space(volume)
    if not (own and unit) or own == unit:
        return volume
    lengths = [
        times(length, ratio(own, unit))
        for length in (volume.spacing, volume.origin, volume.thickness)
    ]
    return volume._replace(spacing=lengths[0], origin=lengths[1], thickness=lengths[2], length=unit)


def assumed(volume: Volume | Recording) -> str:
    """Return what was assumed of a volume's lengths, for messages; empty if they are stated."""
    if volume.length == UNKNOWN and volume.space == "lps":
        return "no unit of length is stated; mm are assumed"
    return ASSUMED.get(volume.length, "")


def mm_of(volume: Volume) -> float:
    """Return the millimeters of a scene unit; 1 if it is unknown."""
    unit = unit_of_space(volume)
    return ratio(unit, "mm") if unit else 1.0
