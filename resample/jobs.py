"""One call for all applications: the first argument selects one."""

from importlib import import_module
from os import PathLike
from pathlib import PurePath
from typing import Any

import numpy as np

from resample import registry
from resample.messages import shortly
from resample.showable import results

COLORS = (3, 4)  # channels of a picture
PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".avif", ".bmp")


def render(scene: Any, *choices: Any, **options: Any) -> Any:
    """Render a volume, points or 3D Gaussians.

    Parameters
    ----------
    scene
        A file; an array (Z, Y, X) of a volume or (N, 3) of points; or an application's own object.
    choices, options
        As `resample_volume.render` or `resample_points.render` takes them.

    Returns
    -------
    A `Frame`.

    Raises
    ------
    TypeError
        It is a picture, or cannot be rendered; the message says what to do instead.
    ValueError, LookupError, OSError
        As for the application.

    Examples
    --------
    >>> import numpy as np, resample
    >>> resample.render(np.arange(512).reshape(8, 8, 8), "bone", (30, 20), size=32)
    Frame(32 × 32 px, 32.6 % covered, depth from 24.94)
    """
    kind = _kind(scene)
    if kind == "texture":
        raise TypeError(
            "a picture has no depth to be rendered; resample.warp and resample.resize take it, and "
            "resample_warp3d.warp with its depth"
        )
    if kind not in ("volume", "points"):
        raise TypeError(
            f"{shortly(scene)} cannot be rendered; give a file, an array (Z, Y, X) or points (N, 3)"
        )
    return import_module(f"resample_{kind}").render(scene, *choices, **options)


def open(file: str | PathLike[str]) -> Any:  # noqa: A001
    """Open a file: as a volume, a cloud or 3D Gaussians, or as the array of a picture.

    Examples
    --------
    >>> import resample
    >>> resample.open(resample.sample_path("sample:knot-points"))
    Cloud(60000 points, normal, color)
    """
    kind = _kind(file)
    if kind == "texture":
        return results().as_picture(file)
    return import_module(f"resample_{kind}").open(file)


def warp(image: Any, *choices: Any, **options: Any) -> Any:
    """Warp a picture: `resample_texture.warp`; with depth and cameras `resample_warp3d.warp`.

    Parameters
    ----------
    image
        A picture or a file.
    choices, options
        As `resample_texture.warp` takes them; or, with a camera, `resample_warp3d.warp`.

    Examples
    --------
    >>> import numpy as np, resample
    >>> resample.warp(np.zeros((48, 64, 3), np.uint8), [[1, 0, 8], [0, 1, 0], [0, 0, 1]])
    Warped(48 × 64 × 3 uint8, 87.5 % covered)
    """
    given = [*choices, *options.values()]
    has_camera = any(callable(getattr(one, "view", None)) and hasattr(one, "near") for one in given)
    return import_module("resample_warp3d" if has_camera else "resample_texture").warp(
        image, *choices, **options
    )


def resize(image: Any, *choices: Any, **options: Any) -> Any:
    """Resize a picture: `resample_texture.resize`.

    Examples
    --------
    >>> import numpy as np, resample
    >>> resample.resize(np.zeros((48, 64, 3), np.uint8), 0.5)
    Warped(24 × 32 × 3 uint8, 100 % covered)
    """
    return import_module("resample_texture").resize(image, *choices, **options)


def stereo(picture: Any, *choices: Any, **options: Any) -> Any:
    """Make a stereo picture of a picture and its depth: `resample_warp3d.stereo`.

    Examples
    --------
    >>> import numpy as np, resample
    >>> picture, disparity = np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 2.0)
    >>> resample.stereo(picture, disparity, layout="sbs", depth_kind="pair").shape
    (24, 64, 3)
    """
    return import_module("resample_warp3d").stereo(picture, *choices, **options)


def view(scene: Any, /, **settings: Any) -> Any:
    """Show a volume, points, or a picture in a notebook's cell: the `view` of its application.

    Examples
    --------
    >>> import resample
    >>> resample.view("checker-box:size=16", camera="top").settings["camera"]
    'top'
    """
    kind = _kind(scene)
    if not kind:
        raise TypeError(f"{shortly(scene)} cannot be shown; give a file, a picture or a volume")
    return import_module(f"resample_{kind}").view(scene, **settings)


def _kind(scene: Any) -> str:
    """Return the application of a scene; empty if unknown."""
    if isinstance(scene, str | PathLike):
        if PurePath(scene).suffix.lower() in PICTURES:
            return "texture"
        is_points = registry.load("views", "points")([str(scene)])
        return "points" if is_points else "volume"  # which reports a file's errors
    home = type(scene).__module__.partition(".")[0]
    if home.startswith("resample_"):
        return home.removeprefix("resample_")
    if hasattr(scene, "points"):  # of Open3D or trimesh
        return "points"
    shape, kind = np.shape(scene), np.asarray(scene).dtype
    if len(shape) == 2:
        return "points" if shape[1] == 3 and kind.kind == "f" else "texture"
    is_picture = len(shape) == 3 and shape[-1] in COLORS and kind == np.uint8
    return "texture" if is_picture else "volume" if len(shape) in (3, 4) else ""
