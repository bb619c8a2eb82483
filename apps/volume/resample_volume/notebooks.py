"""Interactive volumes in a notebook."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from resample.view.views import chosen, controls_of
from resample_volume.command.choices import ReadOptions
from resample_volume.files.source import write_volume
from resample_volume.inputs import as_volume
from resample_volume.viewing import COMMAND, VolumeView

if TYPE_CHECKING:
    from resample.view.widgets import Viewer


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
    from resample.view.widgets import shown
    from resample_volume.cli import app

    folder = None
    if not isinstance(volume, str | Path):
        folder = TemporaryDirectory(prefix="view-")
        path = Path(folder.name) / "volume.nrrd"
        write_volume(path, as_volume(volume, "volume"))
        volume = path
    named = {key.replace("_", "-"): value for key, value in settings.items()}
    of_source = {key: named.pop(key) for key in list(named) if key in ReadOptions.model_fields}
    (source,) = chosen(of_source, (ReadOptions,))
    opened = VolumeView(str(volume), source, (), controls_of(COMMAND, app["render"]))
    return shown(opened, named, folder)
