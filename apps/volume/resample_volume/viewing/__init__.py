"""Volumes for `resample-volume view`: pages, notebook widgets and pictures."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.view.widgets import Viewer
    from resample_volume.viewing.volumes import VolumePainter, picture, volume_view

__all__ = ["VolumePainter", "picture", "suits", "view", "volume_view"]
HOMES = dict.fromkeys(("VolumePainter", "picture", "volume_view"), "volumes")
__getattr__ = attributes(__name__, HOMES)


def view(volume: Any, /, **settings: Any) -> "Viewer":
    """Show a volume in a notebook: rotate it, change its look, copy the view as Python.

    Parameters
    ----------
    volume
        What `as_volume` takes. Anything but a file or a name is written to a temporary file, which
        lives as long as the widget.
    settings
        Options of `resample-volume render` to begin with: `transfer="bone"`, `opacity_unit=2`.

    Returns
    -------
    Widget with `settings`, `frame` and `to_python()`; needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError, TypeError
        An option is not allowed, or the volume cannot be read.

    Examples
    --------
    >>> from resample_volume import view
    >>> shown = view("checker-box:size=16", camera="top")
    >>> shown.settings["camera"]
    'top'
    """
    from resample.calling import understood
    from resample.command.settings import PictureFormat, Resampling, chosen
    from resample.view import widgets
    from resample_volume.calls import spelled
    from resample_volume.command.choices import AppearanceChoices, Extras, ReadOptions
    from resample_volume.viewing.volumes import volume_view

    file, folder = widgets.kept("volume.nrrd", volume, _write)
    models = (AppearanceChoices, Resampling, Extras, ReadOptions, PictureFormat)
    known = [field for model in models for field in model.model_fields]
    named = widgets.named(understood("view", spelled(settings), known))
    of_source = {key: named.pop(key) for key in list(named) if key in ReadOptions.model_fields}
    (source,) = chosen(of_source, (ReadOptions,))
    return widgets.Viewer(volume_view(file, source), named, folder)


def _write(path: Path, volume: Any) -> None:
    """Write what `as_volume` takes."""
    from resample_volume.files.source import write_volume
    from resample_volume.inputs import as_volume

    write_volume(path, as_volume(volume, "volume"))


def suits(names: Sequence[str]) -> bool:
    """Return whether these name one volume: a file, a folder or a generated one."""
    from resample import registry
    from resample.files.stores import is_address
    from resample_volume.files.generated import GENERATED
    from resample_volume.files.source import OWN, find_reader

    if len(names) != 1 or is_address(names[0]):
        return len(names) == 1
    if not Path(names[0]).exists():
        return names[0].partition(":")[0] in GENERATED
    with suppress(ValueError, OSError):
        find_reader(Path(names[0]))
        return True
    read = (reader for reader, ends in OWN.items() if names[0].lower().endswith(ends))
    return any(registry.missing("readers", reader) for reader in read)  # which the page says
