"""Interactive page of a volume, and its picture without a page."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any

import numpy as np

from resample.command.settings import height_and_width
from resample.registry import missing, names
from resample.scene import LITTLE
from resample.types import Frame
from resample.view.files import FileView
from resample.view.views import ORBITING, Settings, is_free, settings_of
from resample_volume.calls import render
from resample_volume.classification import PRESETS, TISSUES
from resample_volume.classification.scales import scale_named
from resample_volume.classification.value_statistics import survey
from resample_volume.command.choices import ReadOptions
from resample_volume.command.inputs import of_first_channel, prepared
from resample_volume.data.spacings import unit_of_space
from resample_volume.slicing import slice_planes
from resample_volume.types import Volume
from resample_volume.viewing.painter import VTK, VolumePainter
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
    name: str, source: ReadOptions | None = None, begin: Sequence[Any] = ()
) -> FileView:
    """Return what pages show of a volume, which they share.

    `name`: of the volume, as the command takes it. `source`: how it is read. `begin`: options to
    begin with.
    """
    volume, source = of_first_channel(
        source or ReadOptions(), lambda chosen: prepared(chosen, name)
    )
    first = VolumePainter(volume)

    def described() -> dict[str, Any]:
        settings = {"fit": "volume", "camera": "30,20,1", **settings_of(begin)}
        first.check(settings)
        known, absence = survey(volume), missing("peers", VTK)
        if not absence and find_spec("vtkmodules") is None:
            absence = "VTK is not installed: pip install 'hybrid-resample[peers]'"
        size = volume.values.shape[::-1]
        return {
            "title": volume.name,
            "subtitle": f"{' × '.join(map(str, size))}, {volume.values.dtype}",
            "command": COMMAND,
            "film": {"command": FILM, **ORBITING},
            "package": "resample_volume",
            "inputs": [name],
            "fixed": settings_of([source]),
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
            "histogram": histogram(volume, known.span),
        }

    def little() -> VolumePainter:
        values = np.resize(np.arange(LITTLE), (LITTLE,) * 3).astype(volume.values.dtype)
        return VolumePainter(volume._replace(values=values))

    return FileView(first, described, first.check, KINDS, LEFT_OUT, little)


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
    return render(volume, camera=given.pop("camera", None), size=(width, height), **given)
