"""Units of lengths of volumes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.lengths import SCALES, ratio, times
from resample.types import Floats
from resample_volume.data.values import slabs
from resample_volume.types import ASSUMED, UNKNOWN, Part, Recording, Volume


def unit_of_space(volume: Volume | Recording) -> str:
    """Return the symbol of a volume's scene unit; empty if unknown."""
    return volume.length if volume.length in SCALES else "mm" if volume.space == "lps" else ""


def in_unit(volume: Volume, unit: str) -> Volume:
    """Return a volume in another scene unit, if both are known."""
    own = unit_of_space(volume)
    if not (own and unit) or own == unit:
        return volume
    names = ("spacing", "origin", "thickness")
    lengths = {name: times(getattr(volume, name), ratio(own, unit)) for name in names}
    return volume._replace(**lengths, length=unit)


def assumed(volume: Volume | Recording) -> str:
    """Return assumptions about a volume's lengths, for messages; empty if stated."""
    if volume.length == UNKNOWN and volume.space == "lps":
        return "no unit of length is stated; mm are assumed"
    return ASSUMED.get(volume.length, "")


def mm_of(volume: Volume) -> float:
    """Return the millimeters of a scene unit; 1 if it is unknown."""
    unit = unit_of_space(volume)
    return ratio(unit, "mm") if unit else 1.0


COLORED = ("uint8", "uint16", "float32", "float64")  # types of colors
UNTOLD = (("#ffffff", None), ("", None))  # colors and windows of a single channel
PARTS = (3, 4)  # numbers of a color: red, green, blue and perhaps opacity


class SeveralTimesError(ValueError):
    """There are several times and none was chosen."""


class SeveralChannelsError(ValueError):
    """There are several channels and none was chosen."""


def how(what: str, count: int) -> str:
    """Return a hint how to choose one of several.

    >>> how("time", 3)
    'choose one by time, 0 to 2 (--time 0; in Python open_volume(..., time=0))'
    """
    last = count - 1
    return f"choose one by {what}, 0 to {last} (--{what} 0; in Python open_volume(..., {what}=0))"


def check_whole(part: Part, what: str) -> None:
    """Reject a part of an object without parts."""
    if part:
        raise ValueError(f"{what} is one volume, without a part {part!r:.60}; leave part out")


def alone(recording: Recording) -> Volume:
    """Return the only volume of a recording; see `volume_at`."""
    return volume_at(recording, None, None)


def volume_at(recording: Recording, time: int | None, channel: int | None) -> Volume:
    """Return the volume at a time and channel; None where there is one, or for colors."""
    chosen, (times, parts) = recording, recording.values.shape[:2]
    if (time is not None and times == 1 < parts and channel is None) or (
        channel is not None and parts == 1 < times and time is None
    ):
        chosen = chosen._replace(values=chosen.values.swapaxes(0, 1), is_color=False)
    at = _number(chosen, 0, time)
    if chosen.is_color and channel is None:
        colors = np.moveaxis(chosen.values[at], 0, -1)
        return in_color(colors, volume_of(chosen, colors[..., 0], chosen.name))
    values = chosen.values[at, _number(chosen, 1, channel)]
    # The time and the channel follow the name.
    told = {"time": time, "channel": channel} if times * parts > 1 else {}
    words = [f"{name} {number}" for name, number in told.items() if number is not None]
    return volume_of(chosen, values, chosen.name + (f" ({', '.join(words)})" if words else ""))


def with_times_first(recording: Recording) -> Recording:
    """Return the recording with its several channels as times, unless these are colors."""
    times, parts = recording.values.shape[:2]
    if times == 1 < parts and not recording.is_color:
        return recording._replace(values=recording.values.swapaxes(0, 1))
    return recording


def is_color(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
    """Return whether the last axis may be the components of colors."""
    return shape[-1] in PARTS and dtype.newbyteorder("=").name in COLORED


def in_color(values: NDArray[Any], volume: Volume) -> Volume:
    """Make a volume of colors (Z, Y, X, 3 or 4), not premultiplied, in sRGB if integers.

    Its values are their opacity, or else the greatest of red, green and blue, so that opacities do
    not depend on hue. A color with NaN is missing.
    """
    if values.dtype.kind == "f" and any(bool((slab < 0).any()) for slab in slabs(values)):
        raise ValueError(
            f"{volume.name} has numbers below 0, which are not colors; "
            + how("channel", values.shape[-1])
        )
    if values.shape[-1] == 4:
        shown = values[..., 3]
    else:
        shown, start = np.empty(values.shape[:3], values.dtype), 0
        for slab in slabs(values):
            slab.max(axis=3, out=shown[start : start + len(slab)])
            start += len(slab)
    return volume._replace(values=shown, units="none", colors=values)


def linear_colors(colors: NDArray[Any]) -> Floats:
    """Convert colors (see `in_color`) to linear light (N, 3), without opacity."""
    if colors.dtype.kind == "f":
        return np.nan_to_num(np.asarray(colors[..., :3], np.float32))
    most = np.iinfo(colors.dtype).max
    every = np.asarray(from_srgb(np.arange(most + 1) / most), np.float32)  # table of levels
    return np.asarray(np.take(every, colors[..., :3]))


def volume_of(recording: Recording, values: Any, name: str) -> Volume:
    """Return a volume of values, placed as a recording."""
    note = recording.note
    if len(recording.looks) == 1 and recording.looks[0][1:3] not in UNTOLD:
        _, color, window, _ = recording.looks[0]
        told = f"color {color}" if window is None else f"color {color} and window {window}"
        note = "; ".join(filter(None, [note, f"{told} of its channel: not used (--transfer)"]))
    found = Volume(values, *recording[1:4], name, recording.units, note=note, space=recording.space)
    return found._replace(thickness=recording.thickness, length=recording.length)


def _number(recording: Recording, axis: int, given: int | None) -> int:
    """Return the index among times (axis 0) or channels (axis 1)."""
    what, count = ("time", "channel")[axis], int(recording.values.shape[axis])
    listed = f"{recording.name} has {count} {what}s"
    if given is None and count > 1:
        kind = SeveralChannelsError if axis else SeveralTimesError
        raise kind(f"{listed}; a volume is one of them: {how(what, count)}")
    if given is not None and not -count <= given < count:
        raise ValueError(f"{listed}, 0 to {count - 1}; there is no {what} {given}")
    return (given or 0) % count
