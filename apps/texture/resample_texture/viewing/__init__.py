"""Pictures for `resample-texture view`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample.view.widgets import Viewer
    from resample_texture.viewing.pictures import picture, picture_view

__all__ = ["MESHES", "picture", "picture_view", "suits", "view"]
PICTURES, TIFF = (".png", ".jpg", ".jpeg", ".exr", ".webp", ".bmp"), (".tif", ".tiff")
MESHES = (".obj", ".glb", ".gltf")  # files of meshes; another package has their page
__getattr__ = attributes(__name__, {"picture": "pictures", "picture_view": "pictures"})


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file with one picture or one mesh."""
    if len(names) != 1 or not Path(names[0]).is_file():
        return False
    suffix = Path(names[0]).suffix.lower()
    if suffix in TIFF:
        import cv2

        return bool(cv2.imcount(names[0]) == 1)  # several pages may be a volume
    return suffix in (*PICTURES, *MESHES)


def view(image: Any, /, **settings: Any) -> "Viewer":
    """Show a picture in a notebook's cell: drag its corners, copy the Python code.

    Parameters
    ----------
    image
        A file, or an 8- or 16-bit picture as `as_picture` takes it, which is written to a temporary
        file that lives as long as the widget.
    settings
        Options of `resample-texture warp` to begin with: `method="bilinear"`.

    Returns
    -------
    A widget with `settings`, `frame` and `to_python()`. It needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError, TypeError
        An option is not allowed, or the picture cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import view
    >>> view(np.zeros((24, 32, 3), np.uint8), method="bilinear").settings["method"]
    'bilinear'
    """
    from resample.view import widgets
    from resample_texture.viewing.pictures import PLACES, fitted, picture_view

    file, folder = widgets.kept("picture.png", image, widgets.write_levels)
    opened = picture_view(Path(file))
    if not PLACES & settings.keys():
        settings["corners"] = fitted(opened.about["extent"], widgets.SIZE)
    return widgets.Viewer(opened, widgets.named(settings), folder)
