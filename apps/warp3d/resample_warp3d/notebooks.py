"""Show depth images in a notebook's cell."""

from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from resample.files.writing import save_array
from resample.lazy import warn_of_old_name
from resample.view.views import chosen, controls_of
from resample_warp3d.viewing import depths

if TYPE_CHECKING:
    from resample.view.widgets import Viewer


def view(color: Any, depth: Any = None, /, **settings: Any) -> "Viewer":
    """Show a depth image in a notebook's cell: navigate, copy the Python code.

    Parameters
    ----------
    color
        Picture of a depth image: a file, or 8 or 16 bits as `as_picture` takes them. Arrays are
        written to temporary files that live as long as the widget. For one release also, alone,
        the file of a cloud, as `resample_points.view` takes it.
    depth
        Depth of the picture: a file, or an array (H, W).
    settings
        Initial options of `resample-warp3d render`: `fov=60`.

    Returns
    -------
    A widget with `settings`, `frame` and `to_python()`. It needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError, TypeError
        An option is invalid, or a file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import view
    >>> shown = view(np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 2.0), fov=60)
    >>> shown.frame.size
    (480, 360)
    """
    if depth is None:
        warn_of_old_name("resample_warp3d.view of a cloud", "resample_points.view")
        seen: Viewer = import_module("resample_points").view(color, **settings)
        return seen
    from resample.view.widgets import kept, shown
    from resample_warp3d.cli import app

    picture, folder = kept("color.png", color)
    if not isinstance(depth, str | Path):
        folder = folder or TemporaryDirectory(prefix="view-")
        array, depth = np.asarray(depth), Path(folder.name) / "depth.npy"
        save_array(depth, array)
    controls = controls_of(depths.COMMAND, app["render"])
    begin = {key.replace("_", "-"): value for key, value in settings.items()}
    opened = depths.depth_view(str(picture), str(depth), chosen(begin, depths.SHOWN), (), controls)
    return shown(opened, begin, folder)
