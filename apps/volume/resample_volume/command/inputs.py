"""Open volumes named on the command line."""

from collections.abc import Callable
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from resample import registry
from resample.console import note, progress_bar, say
from resample.memory import allow, amount, available_memory, bytes_of, return_freed_memory
from resample.memory.mapped import is_in_file
from resample.outofcore.bricks import SHARE
from resample.outofcore.passes import PassContext
from resample.progress import told
from resample_volume.classification.scales import LINEAR, scaled
from resample_volume.classification.value_statistics import findings, survey, without_padding
from resample_volume.command.choices import ReadOptions
from resample_volume.data.recordings import SeveralChannelsError, SeveralTimesError, how, volume_at
from resample_volume.data.spacings import assumed, unit_of_space
from resample_volume.data.values import as_array, bricks_of, is_streamed
from resample_volume.files.parsing.texts import spacing_of
from resample_volume.files.readers import Raw, Reader
from resample_volume.files.source import (
    find_reader,
    levels_of,
    open_recording,
    open_streamed,
    open_volume,
)
from resample_volume.types import Recording, Volume

Opened = TypeVar("Opened", Volume, Recording)
Found = TypeVar("Found")

if TYPE_CHECKING:
    from resample.command.workers import StartWorkers


def opened(
    source: ReadOptions,
    name: str,
    *,
    streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> Volume:
    """Open a volume: a file, a folder or a generated one."""
    return opened_of_several(source, name, streamed=streamed, start_workers=start_workers)[0]


def opened_of_several(
    source: ReadOptions,
    name: str,
    *,
    streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> tuple[Volume, Recording | None]:
    """Open a volume, and return its recording, if there are several times or channels.

    Of several times the first is taken, with a message, unless another is chosen.
    """
    place, reader = _named(source, name)
    allowed = allowed_memory(source)
    held = open_streamed(place, reader)
    if held is None and allowed is not None:
        allow(allowed)
    if held is not None:
        volume = with_memory(_chosen(held, source), allowed, start_workers)
        volume = volume if streamed else _as_array(volume)
    else:
        volume, held = _read(place, reader, source)
    return scaled(changed(source, volume), source.scale), held


def of_first_channel(
    source: ReadOptions, read: Callable[[ReadOptions], Found]
) -> tuple[Found, ReadOptions]:
    """Read what shows one volume; of several channels the first, with a message."""
    try:
        return read(source), source
    except SeveralChannelsError:
        say("the first of several channels is shown (--channel)")
        source = source.model_copy(update={"channel": 0})
        return read(source), source


def _read(
    place: Path | str, reader: Reader | None, source: ReadOptions
) -> tuple[Volume, Recording | None]:
    """Read a volume as a whole, and its recording; None if it is the only one."""
    if source.time is None and source.channel is None:
        try:
            return open_volume(place, reader), None
        except SeveralTimesError:
            pass
    recording = open_recording(place, reader)
    return _chosen(recording, source), recording


def _chosen(recording: Recording, source: ReadOptions) -> Volume:
    """Return the chosen volume of a recording, by default of the first time."""
    times, parts = recording.values.shape[:2]
    if source.time is not None or times == 1 or (source.channel is not None and parts == 1):
        return volume_at(recording, source.time, source.channel)
    shown = volume_at(recording, 0, source.channel)
    say(f"{recording.name} has {times} times, 0 to {times - 1}; the first is shown (--time)")
    return shown


def _as_array(volume: Volume) -> Volume:
    """Read a volume's values into an array; from a file, within the memory limit."""
    if not is_streamed(volume):
        return volume
    bricks = bricks_of(volume)
    with progress_bar("reading bricks", prod(bricks.count)) as progress, told(progress):
        found = as_array(volume)
    if bricks.memory is not None and is_in_file(found.values):
        allow(bricks.memory)
    return found


def allowed_memory(source: ReadOptions) -> int | None:
    """Return the memory limit of a chunked volume in bytes, if given."""
    return None if source.memory is None else bytes_of(source.memory)


def with_memory(
    volume: Volume, allowed: int | None, start_workers: "StartWorkers | None" = None
) -> Volume:
    """Return a chunked volume with a memory limit in bytes, or half of the free memory.

    Workers scan a large one, unless its statistics are cached.
    """
    if is_streamed(volume):
        from resample_volume.files.stores import statistics_cache

        values = bricks_of(volume)
        return_freed_memory()
        free = available_memory()
        values.memory = allowed if allowed or free is None else free // 2
        if values.memory is not None:
            values.pin_bricks(values.memory // SHARE)
        if start_workers is not None and values.size >= statistics_cache.LEAST:

            def helpers() -> PassContext | None:
                crew = start_workers()
                if crew is None:
                    return None
                values.pin_bricks((values.memory or 0) // SHARE // crew.tasks)
                values.share_bricks()
                return PassContext(crew.executor, crew.threads)

            values.helpers = helpers
    return volume


def announced(volume: Volume) -> Volume:
    """Print how a volume is read if that is brick by brick, and return it."""
    if is_streamed(volume):
        values = bricks_of(volume)
        size = " x ".join(map(str, values.shape[::-1]))
        limit = "" if values.memory is None else f", within {amount(values.memory)} of memory"
        say(f"{volume.name}: {size} voxels are read brick by brick ({prod(values.count)}){limit}")
    return volume


def levels(source: ReadOptions, name: str) -> list[dict[str, Any]]:
    """Return the levels of a multiscale file, otherwise none; see `Streamer.levels`."""
    return levels_of(*_named(source, name))


def over_time(source: ReadOptions, name: str) -> Recording | None:
    """Open all times and channels of a name; None for a single chunked volume.

    In a store they stay in their file, unless channels are colors, which are read as a whole.
    """
    found = open_streamed(*_named(source, name))
    if found is None or (found.is_color and source.channel is None):
        return held(source, name)
    if found.values.shape[:2] == (1, 1):
        return None
    return changed(source, found)


def read_as_whole(recording: Recording, source: ReadOptions) -> Recording:
    """Read a store's times into an array: in memory or, if they do not fit, in a mapped file."""
    from resample_volume.multivolume.series import whole

    shape = recording.values.shape
    every = _as_array(with_memory(whole(recording), allowed_memory(source)))
    return recording._replace(values=every.values.reshape(shape))


def channels_of(source: ReadOptions, name: str, *, streamed: bool) -> Recording:
    """Open all times and channels of a name; of a chunked file unread, where `streamed`."""
    found = open_streamed(*_named(source, name)) if streamed else None
    return held(source, name) if found is None else changed(source, found)


def held(source: ReadOptions, name: str) -> Recording:
    """Read all times and channels of a name; errors as for `opened`."""
    allowed = allowed_memory(source)
    if allowed is not None:
        allow(allowed)
    return changed(source, open_recording(*_named(source, name)))


def stored(source: ReadOptions, name: str) -> Recording:
    """Open what `source` chooses of a name; values of chunked files stay in their file."""
    from resample_volume.files.stores.chunks import Single

    require_linear(source, "convert keeps values as they are")
    if source.time is not None or source.channel is not None:
        volume = opened(source, name, streamed=True)
        if volume.colors is None:
            values = Single(volume.values)
            found = Recording(values, *volume[1:6], note=volume.note, space=volume.space)
            return found._replace(length=volume.length)
    return channels_of(source, name, streamed=True)


def _named(source: ReadOptions, name: str) -> tuple[Path | str, Reader | None]:
    """Return the file or generated volume of a name, and its reader."""
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
        reader = _with_raw_options(Raw() if reader is None else reader, told)
    if source.level is not None:
        from resample_volume.files.stores.reader import Zarr

        reader = reader or find_reader(name)
        if not isinstance(reader, Zarr):
            raise ValueError(
                "level chooses a size of an OME-Zarr; this file has one size, leave it out"
            )
        reader = replace(reader, level=source.level)
    return (Path(name) if Path(name).exists() else name), reader


def changed(source: ReadOptions, found: Opened) -> Opened:
    """Return a volume with the properties that override its file's."""
    if source.spacing is not None:
        spacing, length = spacing_of(source.spacing)
        length = length or unit_of_space(found)
        found = found._replace(spacing=np.array(spacing), thickness=0.0, length=length)
    return found if source.units is None else found._replace(units=source.units)


def prepared(
    source: ReadOptions,
    name: str,
    *,
    streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> Volume:
    """Open a volume, remove its padding and print its statistics."""
    return padding_removed(
        announced(opened(source, name, streamed=streamed, start_workers=start_workers))
    )


def note_assumed(found: Volume | Recording) -> None:
    """Say once in a command what was assumed of lengths, if anything was."""
    if line := assumed(found):
        note(line)


def padding_removed(volume: Volume) -> Volume:
    """Remove a volume's padding and print its statistics."""
    if is_streamed(volume):
        count = prod(bricks_of(volume).count)
        with progress_bar("scanning bricks", count) as progress, told(progress):
            known = survey(volume)
    else:
        known = survey(volume)
    for line in [volume.note] * bool(volume.note) + findings(known):
        say(line)
    note_assumed(volume)
    return without_padding(volume, known)


def require_linear(source: ReadOptions, why: str) -> None:
    """Reject a scale where values must be unscaled."""
    if source.scale != LINEAR:
        raise ValueError(f"{why}; leave the scale {source.scale} out")


def require_values(volume: Volume, what: str) -> None:
    """Reject a volume of colors where values are needed."""
    if volume.colors is not None:
        raise ValueError(
            f"{what} is of values, but {volume.name} has colors; "
            + how("channel", volume.colors.shape[-1])
        )


def _with_raw_options(reader: Reader, told: dict[str, str]) -> Reader:
    """Return the reader of raw files, with shape and type from the options."""
    if not isinstance(reader, Raw):
        names = " and ".join(told)
        raise ValueError(f"{names} are for raw files: take the reader raw, or leave them out")
    twice = [name for name in told if getattr(reader, name)]
    if twice:
        raise ValueError(f"give {' and '.join(twice)} once, not to the reader as well")
    whole = {name: getattr(reader, name) for name in ("shape", "dtype", "endian")} | told
    return replace(reader, shape=whole["shape"], dtype=whole["dtype"], endian=whole["endian"])
