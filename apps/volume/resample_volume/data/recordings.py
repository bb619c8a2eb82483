"""What of a file that holds more than one volume is shown: one time, one channel, or colors."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.types import Floats
from resample_volume.data.parts import slabs
from resample_volume.types import Recording, Volume

COLORED = ("uint8", "uint16", "float32", "float64")  # types that colors may have
PARTS = (3, 4)  # numbers of a color: red, green, blue and perhaps opacity


class SeveralTimesError(ValueError):
    """There are several times, and none is chosen."""


def how(what: str, count: int) -> str:
    """How one of so many is chosen.

    >>> how("time", 3)
    'choose one by time, 0 to 2 (--time 0; in Python open_volume(..., time=0))'
    """
    last = count - 1
    return f"choose one by {what}, 0 to {last} (--{what} 0; in Python open_volume(..., {what}=0))"


def alone(recording: Recording) -> Volume:
    """Volume that a recording is the only one of; see `volume_at`."""
    return volume_at(recording, None, None)


def volume_at(recording: Recording, time: int | None, channel: int | None) -> Volume:
    """One volume of a recording.

    Parameters
    ----------
    recording
        Where it has times alone, or channels alone, either word chooses among them.
    time, channel
        Which, from 0 on, or from the end where negative; None where there is but one, or where
        channels are the parts of a color.

    Raises
    ------
    ValueError
        There are several and none is chosen, or there is none of that number.
    """
    chosen = recording
    times, parts = chosen.values.shape[:2]
    if (time is not None and times == 1 < parts and channel is None) or (
        channel is not None and parts == 1 < times and time is None
    ):
        chosen = chosen._replace(values=chosen.values.swapaxes(0, 1), is_color=False)
    at = _number(chosen, 0, time)
    if chosen.is_color and channel is None:
        return _colored(chosen, at)
    values = chosen.values[at, _number(chosen, 1, channel)]
    return _volume(chosen, values, chosen.name + _named(recording, time, channel))


def with_times_first(recording: Recording) -> Recording:
    """Recording whose times are what there are several of, if channels are no colors."""
    times, parts = recording.values.shape[:2]
    if times == 1 < parts and not recording.is_color:
        return recording._replace(values=recording.values.swapaxes(0, 1))
    return recording


def is_color(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
    """Whether numbers of voxels, the last axis, may be the parts of colors."""
    return shape[-1] in PARTS and dtype.newbyteorder("=").name in COLORED


def in_color(values: NDArray[Any], volume: Volume) -> Volume:
    """Volume of colors: its values are their opacity, or else how bright they are.

    How bright is the greatest of red, green and blue, so that opacities do not depend on hues.

    Parameters
    ----------
    values
        (Z, Y, X, 3 or 4) red, green, blue and perhaps opacity, which colors are not multiplied by:
        integers as displayed (sRGB), floats in linear light. A color with NaN is not there.
    volume
        Its place and name.

    Raises
    ------
    ValueError
        A part is less than 0.
    """
    if values.dtype.kind == "f" and any(bool((slab < 0).any()) for slab in slabs(values)):
        raise ValueError(
            f"{volume.name} has numbers below 0, which are no colors; "
            + how("channel", values.shape[-1])
        )
    shown = values[..., 3] if values.shape[-1] == 4 else _brightness(values)
    return volume._replace(values=shown, units="none", colors=values)


def linear_colors(colors: NDArray[Any]) -> Floats:
    """Colors (N, 3) in linear light, of the first parts of colors as `in_color` takes them."""
    if colors.dtype.kind == "f":
        return np.nan_to_num(np.asarray(colors[..., :3], np.float32))
    every = _linear(colors.dtype)
    return np.asarray(np.take(every, colors[..., :3]))


def _linear(dtype: np.dtype[Any]) -> Floats:
    """Linear light of all values that are displayed."""
    most = np.iinfo(dtype).max
    return np.asarray(from_srgb(np.arange(most + 1) / most), np.float32)


def _brightness(values: NDArray[Any]) -> NDArray[Any]:
    """Greatest part (Z, Y, X) of colors: the same for all hues, and a gray's own value."""
    found = np.empty(values.shape[:3], values.dtype)
    start = 0
    for slab in slabs(values):
        slab.max(axis=3, out=found[start : start + len(slab)])
        start += len(slab)
    return found


def _colored(recording: Recording, time: int) -> Volume:
    values = np.moveaxis(recording.values[time], 0, -1)
    return in_color(values, _volume(recording, values[..., 0], recording.name))


def _volume(recording: Recording, values: NDArray[Any], name: str) -> Volume:
    place = (recording.spacing, recording.origin, recording.direction)
    units, note = recording.units, recording.note
    found = Volume(values, *place, name, units, note=note, space=recording.space)
    return found._replace(thickness=recording.thickness)


def _number(recording: Recording, axis: int, given: int | None) -> int:
    """Which of the times (axis 0) or of the channels (axis 1) is meant."""
    what, count = ("time", "channel")[axis], int(recording.values.shape[axis])
    listed = f"{recording.name} has {count} {what}s"
    if given is None and count > 1:
        kind = ValueError if axis else SeveralTimesError
        raise kind(f"{listed}; a volume is one of them: {how(what, count)}")
    if given is not None and not -count <= given < count:
        raise ValueError(f"{listed}, 0 to {count - 1}; there is no {what} {given}")
    return (given or 0) % count


def _named(recording: Recording, time: int | None, channel: int | None) -> str:
    """What is added to a name."""
    times, parts = recording.values.shape[:2]
    words = [] if time is None or times * parts == 1 else [f"time {time}"]
    words += [] if channel is None or times * parts == 1 else [f"channel {channel}"]
    return f" ({', '.join(words)})" if words else ""
