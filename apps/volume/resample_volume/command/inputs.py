"""Volumes as the command line's files and words give them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from resample import registry
from resample.command.console import say
from resample_volume.command.choices import Source
from resample_volume.files.readers import Raw, Reader, three_numbers
from resample_volume.files.source import open_recording, open_volume
from resample_volume.looks.surveys import findings, survey, without_padding
from resample_volume.media.recordings import volume_at
from resample_volume.types import Recording, Volume


def opened(source: Source, name: str) -> Volume:
    """Volume of that name, a file, a folder or what is generated.

    Raises
    ------
    ValueError, LookupError, OSError
        See `resample_volume.files.source.open_volume`.
    """
    place, reader = _named(source, name)
    if source.time is None and source.channel is None:
        volume = open_volume(place, reader)
    else:
        volume = volume_at(open_recording(place, reader), source.time, source.channel)
    return volume._replace(**_changes(source))


def held(source: Source, name: str) -> Recording:
    """All times and channels of that name; errors as of `opened`."""
    return open_recording(*_named(source, name))._replace(**_changes(source))


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
    return (Path(name) if Path(name).exists() else name), reader


def _changes(source: Source) -> dict[str, Any]:
    """What is said of a volume in place of what its file says."""
    changes: dict[str, Any] = {}
    if source.spacing is not None:
        changes["spacing"] = np.array(three_numbers("spacing", source.spacing))
    if source.units is not None:
        changes["units"] = source.units
    return changes


def prepared(source: Source, name: str) -> Volume:
    """Volume of that name without its padding; what was found in it is said.

    Raises
    ------
    ValueError, LookupError, OSError
        See `opened`.
    """
    return said(opened(source, name))


def said(volume: Volume) -> Volume:
    """Volume without its padding; what was found in it is said."""
    known = survey(volume)
    for line in [volume.note] * bool(volume.note) + findings(known):
        say(line)
    return without_padding(volume, known)


def require_values(volume: Volume, what: str) -> None:
    """Refuse colors where values are shown."""
    if volume.colors is not None:
        raise ValueError(
            f"{what} is of values, but {volume.name} has colors; choose one of its channels"
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
