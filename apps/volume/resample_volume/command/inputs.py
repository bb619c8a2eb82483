"""Volumes as the command line's files and words give them."""

from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from resample import registry
from resample.command.workers import Hire
from resample.console.messages import progress_bar, say
from resample.memory import allow, amount, available_memory, bytes_of, give_back
from resample.memory.mapped import is_in_file
from resample.watching import told
from resample_volume.command.choices import Source
from resample_volume.data.bricks import Bricks, Values, as_array
from resample_volume.data.glances.looking import Helpers
from resample_volume.data.glances.shelves import SHARE
from resample_volume.data.recordings import SeveralTimesError, how, volume_at
from resample_volume.files.parsing.steps import three_numbers
from resample_volume.files.readers import Raw, Reader
from resample_volume.files.source import (
    find_reader,
    levels_of,
    open_recording,
    open_streamed,
    open_volume,
)
from resample_volume.files.stores import kept
from resample_volume.files.stores.chunks import Single
from resample_volume.files.stores.reader import with_level
from resample_volume.looks.scales import LINEAR, scaled
from resample_volume.looks.surveys import Survey, findings, survey, without_padding
from resample_volume.media.series import whole
from resample_volume.types import Recording, Volume


def opened(
    source: Source, name: str, *, streamed: bool = False, hire: Hire | None = None
) -> Volume:
    """Volume of that name, a file, a folder or what is generated.

    Parameters
    ----------
    source
        How it is read.
    name
        What it is.
    streamed
        Values stay in their file, as bricks, where it has chunks.
    hire
        Starts workers to look at these, if that was not done before.

    Raises
    ------
    ValueError, LookupError, OSError
        See `resample_volume.files.source.open_volume`.
    """
    return opened_of_several(source, name, streamed=streamed, hire=hire)[0]


def opened_of_several(
    source: Source, name: str, *, streamed: bool = False, hire: Hire | None = None
) -> tuple[Volume, tuple[int, int]]:
    """Volume of that name, and how many times and channels there are.

    Of several times the first is shown, which is said, unless another is chosen.

    Parameters
    ----------
    source, name, streamed, hire
        As of `opened`, whose errors are those of this, too.
    """
    place, reader = _named(source, name)
    allowed = allowed_memory(source)
    held = open_streamed(place, reader)
    if held is None and allowed is not None:
        allow(allowed)
    if held is not None:
        volume = with_memory(_chosen(held, source), allowed, hire)
        volume = volume if streamed else _as_array(volume)
    else:
        volume, held = _read(place, reader, source)
    parts = 1 if volume.colors is None else volume.colors.shape[-1]
    count = (1, parts) if held is None else held.values.shape[:2]
    return scaled(volume._replace(**_changes(source)), source.scale), count


def _read(
    place: Path | str, reader: Reader | None, source: Source
) -> tuple[Volume, Recording | None]:
    """Volume that is read as a whole, and all that it is one of; None: it is the only one."""
    if source.time is None and source.channel is None:
        try:
            return open_volume(place, reader), None
        except SeveralTimesError:
            pass
    recording = open_recording(place, reader)
    return _chosen(recording, source), recording


def _chosen(recording: Recording, source: Source) -> Volume:
    """Volume of a recording that is meant, at its first time where none is chosen."""
    times, parts = recording.values.shape[:2]
    if source.time is not None or times == 1 or (source.channel is not None and parts == 1):
        return volume_at(recording, source.time, source.channel)
    shown = volume_at(recording, 0, source.channel)
    say(f"{recording.name} has {times} times, 0 to {times - 1}; the first is shown (--time)")
    return shown


def _as_array(volume: Volume) -> Volume:
    """Volume whose values are an array; of one in a file the memory is a limit from here on."""
    bricks: Values = volume.values
    if not isinstance(bricks, Bricks):
        return volume
    with progress_bar("reading bricks", prod(bricks.count)) as progress, told(progress):
        found = as_array(volume)
    if bricks.memory is not None and is_in_file(found.values):
        allow(bricks.memory)
    return found


def allowed_memory(source: Source) -> int | None:
    """Bytes that a volume in chunks may take, where a user says it."""
    return None if source.memory is None else bytes_of(source.memory)


def with_memory(volume: Volume, allowed: int | None, hire: Hire | None = None) -> Volume:
    """Volume in chunks that may take so many bytes, or half of what is free.

    Who can be hired looks at a large one, if that was not done before.
    """
    values: Values = volume.values
    if isinstance(values, Bricks):
        give_back()
        free = available_memory()
        values.memory = allowed if allowed or free is None else free // 2
        if values.memory is not None:
            values.shelve(values.memory // SHARE)
        if hire is not None and values.size >= kept.LEAST:
            values.helpers = partial(_helpers, hire, values)
    return volume


def _helpers(hire: Hire, bricks: Bricks) -> Helpers | None:
    """Workers, to look at a volume in chunks; None if nobody asks for them."""
    crew = hire()
    if crew is None:
        return None
    bricks.shelve((bricks.memory or 0) // SHARE // crew.tasks)
    return Helpers(crew.executor, crew.threads)


def announced(volume: Volume) -> Volume:
    """Volume, of which is said how it is read, if that is brick by brick."""
    values: Values = volume.values
    if isinstance(values, Bricks):
        size = " x ".join(map(str, values.shape[::-1]))
        limit = "" if values.memory is None else f", within {amount(values.memory)} of memory"
        say(f"{volume.name}: {size} voxels are read brick by brick ({prod(values.count)}){limit}")
    return volume


def levels(source: Source, name: str) -> list[dict[str, Any]]:
    """Sizes that a file has several of; none where it has but one, see `Streamer.levels`."""
    return levels_of(*_named(source, name))


def over_time(source: Source, name: str) -> Recording | None:
    """All times and channels of that name; None of a single volume in chunks.

    Those of a store stay in their file, unless channels are colors, which are read as a whole.
    """
    found = open_streamed(*_named(source, name))
    if found is None or (found.is_color and source.channel is None):
        return held(source, name)
    if found.values.shape[:2] == (1, 1):
        return None
    return found._replace(**_changes(source))


def read_as_whole(recording: Recording, source: Source) -> Recording:
    """Times of a store as an array: in memory or, where that does not hold them, in a file.

    Raises
    ------
    ValueError, OSError
        As of `opened`.
    """
    shape = recording.values.shape
    every = _as_array(with_memory(whole(recording), allowed_memory(source)))
    return recording._replace(values=every.values.reshape(shape))


def held(source: Source, name: str) -> Recording:
    """All times and channels of that name; errors as of `opened`."""
    allowed = allowed_memory(source)
    if allowed is not None:
        allow(allowed)
    return open_recording(*_named(source, name))._replace(**_changes(source))


def channels_in_chunks(source: Source, name: str) -> Recording | None:
    """All times and channels of that name, which stay in their file; None: it has no chunks."""
    found = open_streamed(*_named(source, name))
    return None if found is None else found._replace(**_changes(source))


def stored(source: Source, name: str) -> Recording:
    """What `source` chooses of that name, whose values stay in their file where it has chunks."""
    require_linear(source, "what is converted keeps its values")
    if source.time is not None or source.channel is not None:
        volume = opened(source, name, streamed=True)
        if volume.colors is None:
            values: Any = Single(volume.values)
            return Recording(values, *volume[1:6], note=volume.note, space=volume.space)
    streamed = open_streamed(*_named(source, name))
    return held(source, name) if streamed is None else streamed._replace(**_changes(source))


def _named(source: Source, name: str) -> tuple[Path | str, Reader | None]:
    """File or generated volume of that name, and what reads it."""
    if not name:
        raise ValueError("the volume has no name; give a file, a folder or checker-box")
    reader = None if source.reader is None else registry.build("readers", source.reader)
    of_raw = {
        "shape": source.shape or "",
        "dtype": source.dtype or "",
        "endian": source.endian or "",
    }
    told = {name: word for name, word in of_raw.items() if word}
    if told:
        reader = _told(Raw() if reader is None else reader, told)
    if source.level is not None:
        reader = with_level(reader or find_reader(name), source.level)
    return (Path(name) if Path(name).exists() else name), reader


def _changes(source: Source) -> dict[str, Any]:
    """What is said of a volume in place of what its file says."""
    changes: dict[str, Any] = {}
    if source.spacing is not None:
        changes["spacing"] = np.array(three_numbers("spacing", source.spacing))
        changes["thickness"] = 0.0
    if source.units is not None:
        changes["units"] = source.units
    return changes


def prepared(
    source: Source, name: str, *, streamed: bool = False, hire: Hire | None = None
) -> Volume:
    """Volume of that name without its padding; what was found in it is said.

    Parameters
    ----------
    source, name, streamed, hire
        As of `opened`.

    Raises
    ------
    ValueError, LookupError, OSError
        See `opened`.
    """
    return said(announced(opened(source, name, streamed=streamed, hire=hire)))


def said(volume: Volume) -> Volume:
    """Volume without its padding; what was found in it is said."""
    known = _surveyed(volume)
    for line in [volume.note] * bool(volume.note) + findings(known):
        say(line)
    return without_padding(volume, known)


def _surveyed(volume: Volume) -> Survey:
    """What is known of a volume's values, with a bar while its bricks are read."""
    values: Values = volume.values
    if not isinstance(values, Bricks):
        return survey(volume)
    with progress_bar("looking at bricks", prod(values.count)) as progress, told(progress):
        return survey(volume)


def require_linear(source: Source, why: str) -> None:
    """Refuse a scale where values are taken as they are."""
    if source.scale != LINEAR:
        raise ValueError(f"{why}; leave the scale {source.scale} out")


def require_values(volume: Volume, what: str) -> None:
    """Refuse colors where values are shown."""
    if volume.colors is not None:
        raise ValueError(
            f"{what} is of values, but {volume.name} has colors; "
            + how("channel", volume.colors.shape[-1])
        )


def _told(reader: Reader, told: dict[str, str]) -> Reader:
    """Reader of raw files that is told what their names do not say."""
    if not isinstance(reader, Raw):
        names = " and ".join(told)
        raise ValueError(f"{names} are for raw files: take the reader raw, or leave them out")
    twice = [name for name in told if getattr(reader, name)]
    if twice:
        raise ValueError(f"give {' and '.join(twice)} once, not to the reader as well")
    whole = {name: getattr(reader, name) for name in ("shape", "dtype", "endian")} | told
    return replace(reader, shape=whole["shape"], dtype=whole["dtype"], endian=whole["endian"])
