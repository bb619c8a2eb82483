"""Point clouds and 3D Gaussians for `resample-points view`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.command.settings import Choices
    from resample.view.files import FileView
    from resample.view.widgets import Viewer
    from resample_points.viewing.clouds import cloud_view

__all__ = ["cloud_view", "picture", "suits", "view", "view_of"]
HOMES = {"cloud_view": "clouds", "picture": "pictures", "map_of": "particles"}
__getattr__ = attributes(__name__, HOMES)


def view_of(path: Path, begin: "Sequence[Choices]" = ()) -> "FileView":
    """Return what pages show of a file: a cloud, 3D Gaussians, or a snapshot's particles."""
    from resample_points.files.gaussians.reading import is_gaussians
    from resample_points.files.readers import SNAPSHOTS

    if path.suffix.lower() in SNAPSHOTS:
        from resample import registry

        particles: FileView = registry.load("pages", "points.density")(path, begin)
        return particles
    if is_gaussians(path):
        from resample_points.viewing.gaussians import gaussian_view

        return gaussian_view(path, begin)
    from resample_points.viewing.clouds import cloud_view

    return cloud_view(path, begin)


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

    return Viewer(view_of(Path(cloud)), named(settings))


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file of a cloud, of 3D Gaussians or of particles."""
    from resample_points.files.gaussians.reading import is_gaussians
    from resample_points.files.readers import SNAPSHOTS, is_cloud

    if len(names) != 1 or not Path(names[0]).exists():
        return False
    path = Path(names[0])
    is_file = path.is_file()
    return is_gaussians(path) or (is_file and (is_cloud(path) or path.suffix.lower() in SNAPSHOTS))
