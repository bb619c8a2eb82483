"""Interactive page of a volume, and its picture without a page."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any

import numpy as np

from resample.command.settings import chosen, height_and_width, option_of
from resample.profiles.orders import Rays
from resample.registry import missing, names
from resample.resampler import Resampler
from resample.scene import LITTLE
from resample.types import Frame
from resample.view.files import FileView
from resample.view.views import ORBITING, Settings, is_free, settings_of
from resample_volume.appearance import transfer_of
from resample_volume.calls import render
from resample_volume.classification import PRESETS, TISSUES
from resample_volume.classification.scales import scale_named
from resample_volume.classification.value_statistics import survey
from resample_volume.command.choices import Added, AppearanceChoices, ReadOptions
from resample_volume.command.inputs import looks_of, media, of_first_channel, prepared
from resample_volume.data.recordings import SeveralChannelsError, unit_of_space
from resample_volume.data.values import as_array
from resample_volume.slicing import slice_planes
from resample_volume.types import Volume
from resample_volume.viewing.painter import SHOWN, VTK, VolumePainter
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import lattice_of

BINS = 256  # of a histogram
COMMAND, FILM = "resample-volume render", "resample-volume animate"
NAMED = {"order": "orders", "filter": "filters", "kernel": "reconstructions"}  # plugins of options
LEFT_OUT = (
    *("reader", "shape", "dtype", "endian", "spacing", "level", "units", "time"),
    *("channel", "channels", "scale", "size", "bits", "deep", "zoom-in"),
)
KINDS: Sequence[Settings] = (  # with kernels of their own
    {"classify": "pre"},  # also of previews
    {"projection": "maximum"},
    {"projection": "average"},
    {"projection": "first-hit", "iso": LITTLE / 2},
)


def volume_view(
    name: str,
    source: ReadOptions | None = None,
    begin: Sequence[Any] = (),
    added: Added | None = None,
) -> FileView:
    """Return what pages show of a volume, which they share.

    `name`: of the volume, as the command takes it. `source`: how it is read. `begin`: options to
    begin with. `added`: volumes and channels that are shown together with it.
    """
    first, source = painter_of(name, source or ReadOptions(), begin, added or Added())
    volume, is_own = first.volume, first.first is None

    def described() -> dict[str, Any]:
        settings = {"fit": "volume", "camera": "30,20,1", **settings_of(begin)}
        first.check(settings)
        known, absence = survey(volume), missing("peers", VTK)
        if not absence and find_spec("vtkmodules") is None:
            absence = "VTK is not installed: pip install 'hybrid-resample[peers]'"
        if first.others:
            absence = "VTK gets a single volume; open the page without the others"
        size = volume.values.shape[::-1]
        return {
            "title": volume.name,
            "subtitle": f"{' × '.join(map(str, size))}, {volume.values.dtype}",
            "command": COMMAND,
            "film": {"command": FILM, **ORBITING},
            "package": "resample_volume",
            "inputs": [name],
            "fixed": settings_of([source, *([] if added is None else [added])]),
            "settings": settings,
            "fills": is_free(begin),
            "rivals": {VTK: absence},
            "names": {
                "transfer": [*PRESETS, *(TISSUES if known.units.added is not None else ())],
                **{option: names(group) for option, group in NAMED.items()},
            },
            "box": {
                "voxels": size,
                "lattice": lattice_of(volume).tolist(),
                "middle": centered(volume)[1].tolist(),
            },
            "slices": [asdict(plane) for plane in slice_planes(volume)],
            "spacing": np.asarray(volume.spacing).tolist(),
            "unit": unit_of_space(volume),
            "measures": True,
            **({"histogram": histogram(volume, known.span)} if is_own else {}),
        }

    def little() -> VolumePainter:
        values = np.resize(np.arange(LITTLE), (LITTLE,) * 3).astype(volume.values.dtype)
        return VolumePainter(volume._replace(values=values))

    left_out = LEFT_OUT if is_own else (*LEFT_OUT, "transfer")
    left_out = left_out if is_own or isinstance(first.first, str) else (*left_out, "window")
    return FileView(first, described, first.check, KINDS, left_out, little)


def painter_of(
    name: str, source: ReadOptions, begin: Sequence[Any], added: Added
) -> tuple[VolumePainter, ReadOptions]:
    """Return the painter of a volume, or of several; and how the first is read."""
    look = next((one for one in begin if isinstance(one, AppearanceChoices)), AppearanceChoices())
    try:
        if not (added.also or added.channels):
            return VolumePainter(prepared(source, name)), source
    except SeveralChannelsError:  # of which the file may say the looks
        pass
    try:
        shown = media(source, name, look, added, Resampler(order=Rays()))
    except SeveralChannelsError:
        if added.also:
            raise
        volume, source = of_first_channel(source, lambda chosen: prepared(chosen, name))
        return VolumePainter(volume), source
    (volume, transfer), *others = [(as_array(one), transfer_of(one, own)) for one, own in shown]
    in_channels = added.channels or len(others) > len(added.also)
    if added.channels and not added.also:
        own, *rest = looks_of(added.channels)
        beside = [(one, text) for (one, _), text in zip(others, rest, strict=True)]
        return VolumePainter(volume, own, beside), source
    return VolumePainter(volume, transfer if in_channels else None, others), source


def histogram(volume: Volume, span: tuple[float, float]) -> dict[str, Any]:
    """Return the histogram of values in the robust range."""
    low, high = span
    values = np.asarray(volume.values)
    count, _ = np.histogram(values[np.isfinite(values)], BINS, (low, max(high, low + 1e-30)))
    by = scale_named(volume.scale)
    scale = {} if by is None else {"scale": "log" if by.linear is None else "symlog"}
    linear = {} if by is None or by.linear is None else {"linear": by.linear}
    return {"low": low, "high": high, "counts": count.tolist(), **scale, **linear}


def picture(volume: str, settings: Mapping[str, Any]) -> Frame:
    """Render a volume with the options of `resample-volume render`.

    Parameters
    ----------
    volume
        As the command takes it.
    settings
        Options by name, as settings files have them: `{"transfer": "bone", "size": "640x480"}`.

    Raises
    ------
    ValueError, LookupError, OSError
        As of the command.

    Examples
    --------
    >>> picture("checker-box:size=16", {"camera": "top", "size": "32x24"})
    Frame(32 × 24 px, 25.5 % covered, depth from 54.9)
    """
    given = {option: value for option, value in settings.items() if option not in ("size", "bits")}
    height, width = height_and_width(str(settings.get("size", "400")))
    if not given.keys() & {"also", "channels"}:
        with suppress(SeveralChannelsError):  # of which the file may say the looks
            return render(volume, size=(width, height), **{"camera": None, **given})
    of_inputs = {
        option_of(model, key) for model in (ReadOptions, Added) for key in model.model_fields
    }
    inputs = {option: given.pop(option) for option in of_inputs & given.keys()}
    source, added = chosen(inputs, (ReadOptions, Added))
    begin = chosen(given, SHOWN)
    painter, _ = painter_of(volume, source, begin, added)
    return painter.frame(given, (width, height), ".exr").over(begin[-1].behind(".exr"))
