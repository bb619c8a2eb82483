"""Scenes of several volumes, as named on the command line."""

import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from resample.console import note, say
from resample.messages import choices_in
from resample.painting.choices import Projection
from resample.resampler import Resampler
from resample_volume.classification.presets import BETWEEN, PRESETS
from resample_volume.classification.scales import scaled
from resample_volume.classification.value_statistics import findings, label_count
from resample_volume.command.choices import Added, AppearanceChoices, ReadOptions
from resample_volume.command.inputs import (
    allowed_memory,
    announced,
    channels_of,
    note_assumed,
    padding_removed,
    prepared,
    require_linear,
    with_memory,
)
from resample_volume.data.recordings import SeveralChannelsError, volume_at, with_times_first
from resample_volume.multivolume.appearance import Appearance, SceneObjects, VolumeLayer
from resample_volume.types import Recording

if TYPE_CHECKING:
    from resample.command.workers import StartWorkers
    from resample_volume.multivolume.series import Series

KEYS = ("time", "channel", "level", "units", "spacing", "scale", "window", "transfer")
START = re.compile(rf":(?=(?:{'|'.join(KEYS)})=)")  # of what is said of a file
HIDDEN = "none"
LABELS = "--labels FILE --label 1:color=red colors them"


class Other(NamedTuple):
    """A further volume of the scene."""

    name: str
    source: ReadOptions
    appearance: dict[str, str]  # what of the look is its own


def others(texts: tuple[str, ...], source: ReadOptions | None = None) -> list[Other]:
    """Parse further volumes such as `pet.nrrd:window=5,10,transfer=hot:opacity=0.3`.

    Chunked volumes get the memory limit of `source`.
    """
    memory = {"memory": None if source is None else source.memory}
    found = [_other(text) for text in texts]
    return [one._replace(source=one.source.model_copy(update=memory)) for one in found]


def can_stream(resampler: Resampler) -> bool:
    """Return whether a look needs no array of a volume's values."""
    return resampler.projection is Projection.COMPOSITE


def media(
    source: ReadOptions,
    name: str,
    look: AppearanceChoices,
    added: Added,
    resampler: Resampler,
    *,
    recording: Recording | None = None,
    start_workers: "StartWorkers | None" = None,
) -> list[VolumeLayer]:
    """Read the volumes of a scene with their looks, each file once.

    Workers scan a store without cached statistics.
    """
    further = others(added.also, source)
    if added.channels is not None:
        first = _channels(source, name, look, added.channels, resampler)
        return first + beside(further, look, resampler)
    if recording is None:
        is_streamed = can_stream(resampler)
        try:
            volume = prepared(source, name, streamed=is_streamed, start_workers=start_workers)
        except SeveralChannelsError:
            if resampler.projection is not Projection.COMPOSITE or look.transfer != "auto":
                raise
            first = _channels(source, name, look, None, resampler)
            return first + beside(further, look, resampler)
    else:
        volume = padding_removed(scaled(volume_at(recording, None, source.channel), source.scale))
    if look.labels is None and (count := label_count(volume)):
        note(f"{count} whole numbers in regions, as labels, are drawn as amounts ({LABELS})")
    return [(volume, look.appearance(volume, resampler)), *beside(further, look, resampler)]


def beside(
    further: list[Other], look: AppearanceChoices, resampler: Resampler
) -> list[VolumeLayer]:
    """Read the further volumes with their looks."""
    found = []
    for other in further:
        volume = prepared(other.source, other.name, streamed=can_stream(resampler))
        own = _alone(look, other.appearance.get("transfer", "auto"), other.appearance.get("window"))
        found.append((volume, own.appearance(volume, resampler)))
    return found


def with_objects(shown: list[VolumeLayer], objects: SceneObjects) -> list[VolumeLayer]:
    """Add meshes and planes to the look of the first volume."""
    (volume, look), *others = shown
    return [(volume, objects.beside(look)), *others]


def times_of(source: ReadOptions, recording: Recording) -> Recording | None:
    """Return the times of a recording's chosen channel; None if there is only one."""
    from resample_volume.multivolume.series import chunked

    values = recording.values
    if source.channel is not None:
        if 1 in values.shape[:2]:
            return None  # channels alone, of which one is chosen, or times that are meant by them
        volume_at(recording, 0, source.channel)  # refuses what there is not
        at = source.channel % values.shape[1]
        in_file = chunked(recording)
        one = values[:, at : at + 1] if in_file is None else in_file.only(at)
        recording = recording._replace(values=one, is_color=False)
    ordered = with_times_first(recording)
    if ordered.values.shape[0] > 1:
        require_linear(
            source, "a scale needs a single time (--time); without one all times are shown"
        )
    if ordered.values.shape[1] > 1 and not ordered.is_color:
        volume_at(ordered, 0, None)  # says that one has to be chosen
    return ordered if ordered.values.shape[0] > 1 else None


def appearance_over_time(
    series: "Series", look: AppearanceChoices, resampler: Resampler
) -> Appearance:
    """Return one look for all times of a series, without labels; print the statistics."""
    every = series.all()
    for line in findings(series.known):
        say(line)
    note_assumed(every)
    bare = look.model_copy(update={"labels": None, "label": ()})
    chosen = bare.appearance(every, resampler)
    return series.appearance(chosen, resampler.projection)


def labelled(own: Appearance, series: "Series", look: AppearanceChoices) -> Appearance:
    """Return the look of all times with the labels of another look, if it has some."""
    return own if look.labels is None else replace(own, labels=look.labels_of(series[0]))


def _channels(
    source: ReadOptions, name: str, look: AppearanceChoices, text: str | None, resampler: Resampler
) -> list[VolumeLayer]:
    """Return the channels of a file, each with its look; without a text with those of the file."""
    if source.channel is not None:
        raise ValueError(
            "channels sets the looks of all channels and channel shows one; give one of both"
        )
    if look.transfer != "auto":
        raise ValueError("channels give each channel its look; leave transfer out")
    recording = channels_of(source, name, streamed=can_stream(resampler))
    if recording.values.shape[1] == 1 and source.time is None:
        recording = recording._replace(values=recording.values.swapaxes(0, 1))
    count = recording.values.shape[1]
    words: list[tuple[str, str | None]] = []
    if text is None:
        words = _looks_in(recording)
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
            volume = volume_at(recording, source.time, channel)
            volume = scaled(with_memory(volume, allowed_memory(source)), source.scale)
            volume = padding_removed(announced(volume))
            transfer = f"auto:color={word}" if _is_color(word) else word
            own = look if not found else _alone(look, transfer, look.window)
            own = own.model_copy(update={"transfer": transfer, "window": window or look.window})
            found.append((volume, own.appearance(volume, resampler)))
    if not found:
        raise ValueError("all channels are hidden; give one a look, such as red")
    return found


def _looks_in(recording: Recording) -> list[tuple[str, str | None]]:
    """Return look and window of each channel, as its file says."""
    if len(recording.looks) != recording.values.shape[1]:
        volume_at(recording, None, None)  # says that one has to be chosen
    shown, words = [], []
    for n, look in enumerate(recording.looks):
        window = look.window and f"{look.window[0]:.17g}..{look.window[1]:.17g}"
        words.append((look.color or "white" if look.is_active else HIDDEN, window))
        shown.append(f"{look.label or n} {words[-1][0]}")
    note(f"channels are shown as their file says: {', '.join(shown)} (--channels)")
    return words


def _alone(look: AppearanceChoices, transfer: str, window: str | None) -> AppearanceChoices:
    """Return the look of a further volume: without labels, with its own colors."""
    own = {"transfer": transfer, "window": window, "labels": None, "label": ()}
    return look.model_copy(update=own)


def _is_color(word: str) -> bool:
    from resample_volume.classification.files import displayed_color

    if word in PRESETS:
        return False
    try:
        displayed_color(word)
    except ValueError:
        return False
    return True


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
    of_look: dict[str, str] = {}
    for key in ("window", "transfer"):
        if key in given:
            of_look[key] = given.pop(key)
    try:
        source = ReadOptions.model_validate(given)
    except ValueError:
        raise ValueError(
            f"also {text!r}: time, channel and level are whole numbers; units are hu, "
            "hu+1024 or none"
        ) from None
    return Other(name, source, of_look)
