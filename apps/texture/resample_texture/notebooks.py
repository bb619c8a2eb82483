"""Show a picture in a notebook's cell."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resample.view.views import Size
    from resample.view.widgets import Viewer

MARGIN = 0.8  # share of the target that a picture takes at first


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
    from resample.view.views import controls_of
    from resample.view.widgets import SIZE, kept, shown
    from resample_texture.cli import app
    from resample_texture.viewing import COMMAND, PLACES, PictureView

    path, folder = kept("picture.png", image)
    opened = PictureView(path, (), controls_of(COMMAND, app["warp"]))
    if not PLACES & settings.keys():
        settings["corners"] = fitted(opened.about["extent"], SIZE)
    return shown(opened, settings, folder)


def fitted(extent: "Size", size: "Size") -> str:
    """Return corners, px, that fit a picture into a target with a margin."""
    (across, down), (width, height) = extent, size
    scale = MARGIN * min(width / across, height / down)
    left, top = (width - scale * across) / 2, (height - scale * down) / 2
    right, bottom = left + scale * across, top + scale * down
    return f"{left:g},{top:g} {right:g},{top:g} {right:g},{bottom:g} {left:g},{bottom:g}"
