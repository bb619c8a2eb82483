"""Show point clouds in a notebook's cell."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.view.views import controls_of
from resample_points.viewing import COMMAND, cloud_view

if TYPE_CHECKING:
    from resample.view.widgets import Viewer


def view(cloud: str | Path, /, **settings: Any) -> "Viewer":
    """Show a point cloud in a notebook's cell: navigate, copy the Python code.

    Parameters
    ----------
    cloud
        File of the cloud.
    settings
        Initial options of `resample-points render`: `color_by="z"`.

    Returns
    -------
    A widget with `settings`, `frame` and `to_python()`. It needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError
        An option is invalid, or the file cannot be read.

    Examples
    --------
    >>> import resample
    >>> from resample_points import view
    >>> view(resample.sample_path("sample:knot-points"), camera="top").settings["camera"]
    'top'
    """
    from resample.view.widgets import shown
    from resample_points.cli import app

    controls = controls_of(COMMAND, app["render"])
    return shown(cloud_view(Path(cloud), (), controls), settings)
