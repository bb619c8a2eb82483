"""Point clouds and 3D Gaussians for `resample-points view`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.view.widgets import Viewer
    from resample_points.viewing.pages import cloud_view, picture, view_of

__all__ = ["cloud_view", "picture", "suits", "view", "view_of"]
HOMES = {
    **dict.fromkeys(("cloud_view", "picture", "view_of"), "pages"),
    "map_of": "particles",  # old home, until the next release
}
__getattr__ = attributes(__name__, HOMES)


def view(cloud: str | Path, /, **settings: Any) -> "Viewer":
    """Show points, 3D Gaussians or particles in a notebook's cell: navigate, copy the Python code.

    Parameters
    ----------
    cloud
        File of a cloud, of 3D Gaussians, or of a simulation's particles.
    settings
        Initial options of `resample-points render` or `density`: `color_by="z"`.

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
    from resample.view.widgets import Viewer, named
    from resample_points.viewing.pages import view_of

    return Viewer(view_of(Path(cloud)), named(settings))


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file of a cloud, of 3D Gaussians or of particles."""
    from resample_points.files.gaussians.formats import is_gaussians
    from resample_points.files.readers import SNAPSHOTS, is_cloud

    if len(names) != 1 or not Path(names[0]).exists():
        return False
    path = Path(names[0])
    is_file = path.is_file()
    return is_gaussians(path) or (is_file and (is_cloud(path) or path.suffix.lower() in SNAPSHOTS))
