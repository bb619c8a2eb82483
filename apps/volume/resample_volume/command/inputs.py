"""Open volumes named on the command line."""

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from resample import registry
from resample.console import note, progress_bar, say
from resample.memory import allow, amount, available_memory, bytes_of, return_freed_memory
from resample.memory.mapped import is_in_file
from resample.messages import choices_in
from resample.outofcore.bricks import SHARE
from resample.outofcore.passes import PassContext
from resample.painting.choices import Projection
from resample.progress import told
from resample.resampler import Resampler
from resample_volume.appearance import Appearance, VolumeLayer
from resample_volume.classification.presets import BETWEEN, PRESETS
from resample_volume.classification.scales import LINEAR, scaled
from resample_volume.classification.value_statistics import (
    findings,
    label_count,
    survey,
    without_padding,
)
from resample_volume.command.choices import Added, AppearanceChoices, ReadOptions
from resample_volume.data import recordings
from resample_volume.data.values import as_array, bricks_of, is_streamed
from resample_volume.files.readers import Raw, Reader
from resample_volume.files.source import (
    find_reader,
    levels_of,
    open_recording,
    open_streamed,
    open_volume,
)
from resample_volume.files.texts import spacing_of
from resample_volume.types import Recording, Volume

if TYPE_CHECKING:
    from resample.command.workers import StartWorkers
    from resample_volume.series import Series

Opened = TypeVar("Opened", Volume, Recording)
Found = TypeVar("Found")


def opened(
    source: ReadOptions, name: str, *, streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> Volume:  # fmt: skip
    """Open a volume: a file, a folder or a generated one."""
    return opened_of_several(source, name, streamed=streamed, start_workers=start_workers)[0]


def opened_of_several(
    source: ReadOptions, name: str, *, streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> tuple[Volume, Recording | None]:  # fmt: skip
    """Open a volume and its recording; the first time is shown if none is chosen."""
    place, reader = _named(source, name)
    allowed = allowed_memory(source)
    if (held := open_streamed(place, reader)) is not None:
        volume = with_memory(_chosen(held, source), allowed, start_workers)
        volume = volume if streamed else _as_array(volume)
        return scaled(changed(source, volume), source.scale), held
    if allowed is not None:
        allow(allowed)
    if source.time is None and source.channel is None:
        with suppress(recordings.SeveralTimesError):
            return scaled(changed(source, open_volume(place, reader)), source.scale), None
    held = open_recording(place, reader)
    return scaled(changed(source, _chosen(held, source)), source.scale), held


def of_first_channel(
    source: ReadOptions, read: Callable[[ReadOptions], Found]
) -> tuple[Found, ReadOptions]:
    """Read a single volume; of several channels the first, with a message."""
    try:
        return read(source), source
    except recordings.SeveralChannelsError:
        say("the first of several channels is shown (--channel)")
        source = source.model_copy(update={"channel": 0})
        return read(source), source


def _chosen(recording: Recording, source: ReadOptions) -> Volume:
    """Return the chosen volume of a recording, by default of the first time."""
    times, parts = recording.values.shape[:2]
    if source.time is not None or times == 1 or (source.channel is not None and parts == 1):
        return recordings.volume_at(recording, source.time, source.channel)
    shown = recordings.volume_at(recording, 0, source.channel)
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
    """Set the memory limit of a chunked volume, by default half of the free memory.

    Workers scan a large one, unless its statistics are cached.
    """
    if is_streamed(volume):
        from resample_volume.data.scanning import LEAST

        values = bricks_of(volume)
        return_freed_memory()
        free = available_memory()
        values.memory = allowed if allowed or free is None else free // 2
        if values.memory is not None:
            values.pin_bricks(values.memory // SHARE)
        if start_workers is not None and values.size >= LEAST:

            def helpers() -> PassContext | None:
                crew = start_workers()
                if crew is None:
                    return None
                values.pin_bricks((values.memory or 0) // SHARE // crew.tasks)
                values.share_bricks()
                return PassContext(crew.executor, crew.threads)

            values.helpers = helpers
    return volume


def levels(source: ReadOptions, name: str) -> list[dict[str, Any]]:
    """Return the levels of a multiscale file, otherwise none; see `Streamer.levels`."""
    return levels_of(*_named(source, name))


def over_time(source: ReadOptions, name: str) -> Recording | None:
    """Open all times and channels of a name, by default unread; None for one chunked volume."""
    found = open_streamed(*_named(source, name))
    if found is None or (found.is_color and source.channel is None):
        return held(source, name)
    if found.values.shape[:2] == (1, 1):
        return None
    return changed(source, found)


def read_as_whole(recording: Recording, source: ReadOptions) -> Recording:
    """Read a store's times into an array: in memory or, if they do not fit, in a mapped file."""
    from resample_volume.series import whole

    shape = recording.values.shape
    every = _as_array(with_memory(whole(recording), allowed_memory(source)))
    return recording._replace(values=every.values.reshape(shape))


def held(source: ReadOptions, name: str, *, streamed: bool = False) -> Recording:
    """Open all times and channels of a name; chunked files stay unread if `streamed`."""
    place, reader = _named(source, name)
    if streamed and (found := open_streamed(place, reader)) is not None:
        return changed(source, found)
    if (allowed := allowed_memory(source)) is not None:
        allow(allowed)
    return changed(source, open_recording(place, reader))


def _named(source: ReadOptions, name: str) -> tuple[Path | str, Reader | None]:
    """Return the file or generated volume of a name, and its reader."""
    if not name:
        raise ValueError("the volume has no name; give a file, a folder or checker-box")
    reader = None if source.reader is None else registry.build("readers", source.reader)
    given = {name: getattr(source, name) for name in ("shape", "dtype", "endian")}
    told = {name: word for name, word in given.items() if word}
    if told:
        reader = Raw() if reader is None else reader
        # The reader of raw files, with shape and type from the options
        if not isinstance(reader, Raw):
            names = " and ".join(told)
            raise ValueError(f"{names} are for raw files: take the reader raw, or leave them out")
        twice = [name for name in told if getattr(reader, name)]
        if twice:
            raise ValueError(f"give {' and '.join(twice)} once, not to the reader as well")
        reader = replace(reader, **told)
    if source.level is not None:
        reader = reader or find_reader(name)
        if "level" not in registry.parameters(type(reader)):
            raise ValueError(
                "level chooses a size of an OME-Zarr; this file has one size, leave it out"
            )
        of_levels: Any = reader
        reader = replace(of_levels, level=source.level)
    return (Path(name) if Path(name).exists() else name), reader


def changed(source: ReadOptions, found: Opened) -> Opened:
    """Return a volume with the properties that override its file's."""
    if source.spacing is not None:
        spacing, unit = spacing_of(source.spacing)
        unit = unit or recordings.unit_of_space(found)
        found = found._replace(spacing=np.array(spacing), thickness=0.0, length=unit)
    return found if source.units is None else found._replace(units=source.units)


def prepared(
    source: ReadOptions, name: str, *, streamed: bool = False,
    start_workers: "StartWorkers | None" = None,
) -> Volume:  # fmt: skip
    """Open a volume, remove its padding and print its statistics."""
    return padding_removed(opened(source, name, streamed=streamed, start_workers=start_workers))


def note_assumed(found: Volume | Recording) -> None:
    """Report once per command the assumptions about lengths, if any."""
    if line := recordings.assumed(found):
        note(line)


def padding_removed(volume: Volume) -> Volume:
    """Remove a volume's padding and print its statistics."""
    if is_streamed(volume):
        values = bricks_of(volume)
        size, count = " x ".join(map(str, values.shape[::-1])), prod(values.count)
        limit = "" if values.memory is None else f", within {amount(values.memory)} of memory"
        say(f"{volume.name}: {size} voxels are read brick by brick ({count}){limit}")
        with progress_bar("scanning bricks", count) as progress, told(progress):
            survey(volume)
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
            + recordings.how("channel", volume.colors.shape[-1])
        )


KEYS = ("time", "channel", "level", "units", "spacing", "scale", "window", "transfer")
START = re.compile(rf":(?=(?:{'|'.join(KEYS)})=)")  # before the settings of a file
HIDDEN = "none"
LABELS = "--labels FILE --label 1:color=red colors them"
UNLABELLED: dict[str, Any] = {"labels": None, "label": ()}  # options of further volumes' looks
Other = tuple[str, ReadOptions, dict[str, str]]  # name, how it is read, what of its look is its own


def others(texts: tuple[str, ...], source: ReadOptions | None = None) -> list[Other]:
    """Parse further volumes such as `pet.nrrd:window=5,10,transfer=hot:opacity=0.3`."""
    memory = {"memory": None if source is None else source.memory}
    return [(name, own.model_copy(update=memory), look) for name, own, look in map(_other, texts)]


def media(
    source: ReadOptions, name: str, look: AppearanceChoices, added: Added, resampler: Resampler, *,
    recording: Recording | None = None, start_workers: "StartWorkers | None" = None,
) -> list[VolumeLayer]:  # fmt: skip
    """Read the volumes of a scene with their looks, each file once; workers scan a store."""
    further, channels = others(added.also, source), added.channels
    is_composite, volume = resampler.projection is Projection.COMPOSITE, None
    if recording is not None and channels is None:
        volume = recordings.volume_at(recording, None, source.channel)
        volume = padding_removed(scaled(volume, source.scale))
    elif channels is None:
        try:
            volume = prepared(source, name, streamed=is_composite, start_workers=start_workers)
        except recordings.SeveralChannelsError:
            if not is_composite or look.transfer != "auto":
                raise
    if volume is None:
        first = _channels(source, name, look, channels, resampler)
    else:
        if look.labels is None and (count := label_count(volume)):
            note(f"{count} whole numbers in regions, as labels, are drawn as amounts ({LABELS})")
        first = [(volume, look.appearance(volume, resampler))]
    return first + further_layers(further, look, resampler)


def further_layers(
    further: list[Other], look: AppearanceChoices, resampler: Resampler
) -> list[VolumeLayer]:
    """Read the further volumes with their looks."""
    found = []
    for name, source, own in further:
        volume = prepared(source, name, streamed=resampler.projection is Projection.COMPOSITE)
        changes = {"transfer": own.get("transfer", "auto"), "window": own.get("window")}
        alone = look.model_copy(update={**changes, **UNLABELLED})
        found.append((volume, alone.appearance(volume, resampler)))
    return found


def with_objects(shown: list[VolumeLayer], objects: Mapping[str, Any]) -> list[VolumeLayer]:
    """Add meshes, planes and surfaces to the look of the first volume."""
    (volume, look), *others = shown
    return [(volume, replace(look, **objects)), *others]


def times_of(source: ReadOptions, recording: Recording) -> Recording | None:
    """Return the times of a recording's chosen channel; None if there is only one."""
    from resample_volume.series import chunked

    values = recording.values
    if source.channel is not None:
        if 1 in values.shape[:2]:
            return None  # a single channel is chosen, or the channels are times
        recordings.volume_at(recording, 0, source.channel)  # rejects missing times and channels
        at = source.channel % values.shape[1]
        in_file = chunked(recording)
        one = values[:, at : at + 1] if in_file is None else in_file.only(at)
        recording = recording._replace(values=one, is_color=False)
    ordered = recordings.with_times_first(recording)
    if ordered.values.shape[0] > 1:
        require_linear(
            source, "a scale needs a single time (--time); without one all times are shown"
        )
    if ordered.values.shape[1] > 1 and not ordered.is_color:
        recordings.volume_at(ordered, 0, None)  # says that one has to be chosen
    return ordered if ordered.values.shape[0] > 1 else None


def appearance_over_time(
    series: "Series", look: AppearanceChoices, resampler: Resampler
) -> Appearance:
    """Return one look for all times of a series, without labels; print the statistics."""
    every = series.all()
    for line in findings(series.known):
        say(line)
    note_assumed(every)
    bare = look.model_copy(update=UNLABELLED)
    chosen = bare.appearance(every, resampler)
    return series.appearance(chosen, resampler.projection)


def _channels(
    source: ReadOptions, name: str, look: AppearanceChoices, text: str | None, resampler: Resampler
) -> list[VolumeLayer]:
    """Return the channels of a file, each with its look from the text or the file."""
    if source.channel is not None:
        raise ValueError(
            "channels sets the looks of all channels and channel shows one; give one of both"
        )
    if look.transfer != "auto":
        raise ValueError("channels give each channel its look; leave transfer out")
    recording = held(source, name, streamed=resampler.projection is Projection.COMPOSITE)
    if recording.values.shape[1] == 1 and source.time is None:
        recording = recording._replace(values=recording.values.swapaxes(0, 1))
    count = recording.values.shape[1]
    words: list[tuple[str, str | None]] = []
    if text is None:  # as the file says
        if len(recording.looks) != count or not any(file.color for file in recording.looks):
            recordings.volume_at(recording, None, None)  # says that one has to be chosen
        for file in recording.looks:
            ends = file.window and f"{file.window[0]:.17g}..{file.window[1]:.17g}"
            words.append((file.color or "white" if file.is_active else HIDDEN, ends))
        shown = [f"{file.label or n} {words[n][0]}" for n, file in enumerate(recording.looks)]
        note(f"channels are shown as their file says: {', '.join(shown)} (--channels)")
    else:
        words = [(word.strip(), None) for word in BETWEEN.split(text)]
    if len(words) != count or count == 1:
        raise ValueError(
            f"{recording.name} has {count} channels, channels gives {len(words)} looks; give one "
            f"for each, {HIDDEN} for one that is hidden"
        )

    found: list[VolumeLayer] = []
    for channel, (word, window) in enumerate(words):
        if word != HIDDEN:
            volume = recordings.volume_at(recording, source.time, channel)
            volume = scaled(with_memory(volume, allowed_memory(source)), source.scale)
            volume = padding_removed(volume)
            if len(recording.looks) == count and (label := recording.looks[channel].label):
                volume = volume._replace(name=f"{recording.name} ({label})")
            changes = {"transfer": channel_transfer(word), "window": window or look.window}
            own = look.model_copy(update={**changes, **(UNLABELLED if found else {})})
            found.append((volume, own.appearance(volume, resampler)))
    if not found:
        raise ValueError("all channels are hidden; give one a look, such as red")
    return found


def channel_transfers(channels: str) -> list[str]:
    """Return the transfer functions of the channels that a text shows."""
    words = [word.strip() for word in BETWEEN.split(channels)]
    return [channel_transfer(word) for word in words if word != HIDDEN]


def channel_transfer(word: str) -> str:
    """Return the transfer function of a channel's look, which may be a color."""
    from matplotlib.colors import is_color_like

    return f"auto:color={word}" if word not in PRESETS and is_color_like(word) else word


def _other(text: str) -> Other:
    name, *rest = START.split(text, maxsplit=1)
    choices, by, transfer = (rest[0] if rest else "").partition("transfer=")
    parts = [*choices_in(choices), *([("transfer", transfer)] if by else [])]
    given = dict(parts)
    if not all(given.values()) or not given.keys() <= set(KEYS) or len(given) < len(parts):
        raise ValueError(
            f"also {text!r}; give a file, and after a colon its settings, separated by commas, the "
            f"transfer last: pet.nrrd:window=5,10,transfer=hot ({', '.join(KEYS)})"
        )
    if not name:
        raise ValueError(f"also {text!r} names no file; give one, as in pet.nrrd:transfer=hot")
    of_look: dict[str, str] = {key: given[key] for key in ("window", "transfer") if key in given}
    given = {key: value for key, value in given.items() if key not in of_look}
    try:
        return name, ReadOptions.model_validate(given), of_look
    except ValueError:
        raise ValueError(
            f"also {text!r}: time, channel and level are whole numbers; units are hu, "
            "hu+1024 or none"
        ) from None
