"""Render and film arrays, clouds, 3D Gaussians and files in one call."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import FilmOptions, takes, understood
from resample.cameras.pixels import Equirectangular
from resample.cameras.poses import UpAxis
from resample.cameras.viewpoints import Orbit, Spelled, orbit_of, viewpoint_of
from resample.colors import from_srgb
from resample.console import linear_color
from resample.messages import check_kind, shape_of, shortly
from resample.profiles.filters import PixelFilter
from resample.types import Floats, Frame
from resample_points.data.cloud import Cloud, columns_of
from resample_points.data.columns import colored, join_clouds, select_points
from resample_points.data.gaussians import DOWN, Gaussians
from resample_points.files.gaussians.formats import is_gaussians, read_gaussians, write_gaussians
from resample_points.files.readers import SNAPSHOTS, read_cloud
from resample_points.geometry.framing import FIELD
from resample_points.geometry.spacing import LARGEST, Surfels, prepare_cloud
from resample_points.painting.bending import CloudView, ProjectedCamera
from resample_points.painting.gaussians import GaussianStyle, render_gaussians, shown_part
from resample_points.painting.rendering import CloudStyle
from resample_points.scenes import CloudScene, camera_of

if TYPE_CHECKING:
    from resample.command.settings import Choices

SCENES = "a path, positions (N, 3) or with colors (N, 6), a Cloud or Gaussians"

RenderOptions = TypedDict("RenderOptions", {  # noqa: UP013 - as a class one line each
    "background": str, "fov": float, "up": UpAxis, "clim": tuple[float, float],
    "point_size": float, "light": str, "edl": float, "one_sided": bool, "crop": str,
    "only": str | Sequence[str], "disc_limit": float, "look": str, "order": str,
    "trained_focal": str, "subpixels": int, "nearest": float, "least_opacity": float,
    "largest": float,
}, total=False)  # fmt: skip
DensityOptions = TypedDict("DensityOptions", {  # noqa: UP013 - of snapshots of particles
    "axis": str, "quantity": str, "log": bool, "slice": Any, "smoothing_kernel": str, "type": Any,
    "bits": int,
}, total=False)  # fmt: skip


class AnimateOptions(RenderOptions, DensityOptions, FilmOptions, total=False):
    """Options of `animate`."""

    camera: Any
    size: str | int | tuple[int, int]
    color_by: str
    colormap: str
    color_bar: bool
    range: str
    steady: bool
    also: str | Sequence[str]
    level: int
    no_cache: bool
    eyes: float
    deep: Any
    filter: str
    threads: int


@takes()
def render(
    scene: str | PathLike[str] | ArrayLike | Cloud | Surfels | CloudScene | Gaussians,
    camera: Spelled | CloudView = None,
    *,
    colors: ArrayLike | str | None = None,
    colormap: str = "viridis",
    normals: ArrayLike | None = None,
    size: tuple[int, int] | int = (640, 480),
    style: CloudStyle | GaussianStyle | None = None,
    filter: str | PixelFilter | None = None,  # noqa: A002
    threads: int | None = None,
    **given: Unpack[RenderOptions],
) -> Frame:
    """Render points or 3D Gaussians.

    Parameters
    ----------
    scene
        A file of a cloud or of 3D Gaussians; positions (N, 3), scene units; a `Cloud` or the result
        of `prepare_cloud`; `Gaussians`; or an open `CloudScene`, which saves time for further
        pictures.
    camera
        Any camera; or a viewpoint around the scene, which fits it into the picture: an `Orbit`,
        (azimuth, elevation) with or without a zoom and a pan, a name such as `front` or `top`;
        None: `Orbit()`.
    colors
        Of points, in place of their own: (N, 3) levels, whole numbers of 8 bits or floats from 0 to
        1, encoded as sRGB; numbers (N,), or the name of a column, or x, y or z, for a colormap; or
        one color for all: a name or #rrggbb.
    colormap
        One of matplotlib's, for numbers.
    normals
        Of points, in place of their own: (N, 3), outward.
    size
        Width and height, px, or both of a square.
    style
        `CloudStyle` of clouds, `GaussianStyle` of Gaussians.
    filter
        Pixel filter of clouds; see `render_cloud`.
    threads
        Most threads to use; the picture does not depend on it.
    given
        `clim`, numbers at the ends of the colormap; and options of `resample-points render`:
        `background`, `fov`, `up`, and of clouds `point_size`, `light`, `edl`, `one_sided`, `crop`,
        `only` and `disc_limit`, in place of a style; of Gaussians `look`, `order`,
        `trained_focal`, `subpixels` and `nearest`.

    Raises
    ------
    ValueError, TypeError
        The scene is empty, or a choice does not go with it.
    OSError
        The file is missing or damaged.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import render
    >>> place = np.random.default_rng(1).normal(size=(2000, 3))
    >>> place /= np.linalg.norm(place, axis=1)[:, None]  # of a ball
    >>> render(place, (30, 20), colors=place[:, 2], size=(64, 48))
    Frame(64 × 48 px, 56.5 % covered, depth from 2.079)
    """
    options: dict[str, Any] = {**given}
    found, behind, largest, span = opened(scene), None, LARGEST, None
    if {"vmin", "vmax"} <= options.keys():
        options["clim"] = options.pop("vmin"), options.pop("vmax")
    if normals is not None:
        check_kind("scene with normals", found, Cloud, "a Cloud, a file or positions of a cloud")
        found = cast("Cloud", found)._replace(normal=np.asarray(normals, np.float32))
    width, height = size = shape_of(size)[::-1]
    view: Any = camera
    if not isinstance(view, tuple) and np.ndim(view) == 2 and np.shape(view) != (3, 3):
        if colors is not None:
            raise TypeError(f"the camera {shortly(camera)}; it comes after the scene: (30, 20)")
        camera, colors, view = None, view, None
    if not isinstance(camera, Equirectangular | ProjectedCamera):
        if isinstance(camera, str) and orbit_of(camera) is None and Path(camera).suffix:
            from resample.cameras.files import viewpoint

            camera = viewpoint(camera)
        view = viewpoint_of(camera)
    if isinstance(view, Orbit) and view is not camera:
        view = replace(view, fov=FIELD)
        if isinstance(found, Gaussians):
            view = replace(view, up=found.up or DOWN)
    if options:
        from resample_points.command.choices import CloudOptions
        from resample_points.command.gaussians import GaussianOptions

        span = options.pop("clim", None)
        look, start, form = _chosen(
            options, GaussianOptions if isinstance(found, Gaussians) else CloudOptions
        )
        behind = form.behind()
        if isinstance(view, Orbit) and start.model_fields_set:
            view = replace(view, **{name: getattr(start, name) for name in start.model_fields_set})
        if look.model_fields_set and style is not None:
            raise ValueError("give a style or its options, not both")
        style = style or look.style()
        if isinstance(found, Cloud):
            found = select_points(found, look.only, look.crop)
            largest = LARGEST if look.disc_limit is None else look.disc_limit
    if isinstance(found, Gaussians):
        if colors is not None or filter is not None or isinstance(style, CloudStyle):
            raise ValueError("3D Gaussians have colors and a filter of their own; leave these out")
        if isinstance(view, Orbit):
            view = camera_of(shown_part(found), (height, width), view)
        frame = render_gaussians(found, view, size=size, style=style, threads=threads)
    else:
        if isinstance(style, GaussianStyle):
            raise ValueError("a GaussianStyle is for 3D Gaussians; give a CloudStyle")
        if colors is not None:
            if not isinstance(found, Cloud):
                raise ValueError(
                    "colors are for a Cloud, a file or positions, not a prepared scene"
                )
            found = _colored(found, colors, colormap, span)
        if isinstance(found, Cloud):
            found = prepare_cloud(found, largest=largest, threads=threads)
        found = found if isinstance(found, CloudScene) else CloudScene(found)
        frame = found.render(view, size=size, style=style, filter=filter, threads=threads)
    return frame.over(behind)


def _chosen(options: Mapping[str, Any], look: type["Choices"]) -> list[Any]:
    """Return the models of a look's options, of the camera's and of the picture's."""
    from resample.command.settings import FrameFormat, chosen, option_of
    from resample_points.command.choices import CloudStart

    models = (look, CloudStart, FrameFormat)
    known = [
        name
        for model in models
        for field in model.model_fields
        if (name := option_of(model, field).replace("-", "_")) in RenderOptions.__annotations__
    ]
    return chosen(understood("render", dict(options), known), models)


@takes()
def animate(
    scene: Any,
    output: str | PathLike[str] | None = None,
    *more: str,
    **options: Unpack[AnimateOptions],
) -> NDArray[np.uint8] | None:
    """Film points or 3D Gaussians as `resample-points animate` does: a camera goes around them.

    Snapshots of particles are filmed as `resample-points density` does.

    Parameters
    ----------
    scene
        A file; or positions (N, 3), a `Cloud` or `Gaussians`, which are written
        to a temporary file.
    output
        Film to write: `.mp4`, `.webm`, `.gif`, `.webp`, `.apng`, or a folder of pictures; None:
        return the frames (N, H, W, 3).
    more
        Further files, a frame each.
    options
        Options of the command: `frames`, `fps`, `path`, `camera`, `size`, `color_by`, ...

    Raises
    ------
    ValueError, TypeError, OSError
        As for `render`; or the film cannot be written.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> from resample_points import animate
    >>> film = pathlib.Path(tempfile.mkdtemp()) / "turn.webp"
    >>> animate(np.random.default_rng(1).normal(size=(50, 3)), film, frames=2, size="64x48")
    >>> film.stat().st_size > 0
    True
    """
    from resample.command.applications import film

    with TemporaryDirectory() as folder:
        file = scene
        if not isinstance(scene, str | PathLike):
            found = opened(scene)
            file = Path(folder) / "points.ply"
            if isinstance(found, Gaussians):
                write_gaussians(file, found)
            elif isinstance(found, Cloud):
                file = file.with_suffix(".npz")
                arrays: dict[str, Any] = {**found.columns, **found._asdict()}
                del arrays["columns"]
                np.savez(file, **arrays)
            else:
                raise TypeError(f"a film of {shortly(scene)}; give {SCENES}")
        is_snapshot = Path(file).suffix.lower() in SNAPSHOTS
        command = "density" if is_snapshot else "animate"
        return film("points", command, Path(file), *map(Path, more), output=output, **options)


def opened(scene: Any) -> Cloud | Surfels | CloudScene | Gaussians:
    """Open an input of `render`: a file of points or of 3D Gaussians, or positions (N, 3).

    Raises
    ------
    ValueError, TypeError, OSError
        The file holds neither, is missing or damaged; or positions are not numbers (N, 3).

    Examples
    --------
    >>> import resample
    >>> import resample_points
    >>> len(resample_points.open(resample.sample_path("sample:knot-points")).position)
    60000
    """
    if isinstance(scene, Cloud | Surfels | CloudScene | Gaussians):
        return scene
    if isinstance(scene, str | PathLike):
        path = Path(scene)
        return read_gaussians(path) if is_gaussians(path) else read_cloud(path)
    if isinstance(scene, list | tuple) and scene and all(isinstance(one, Cloud) for one in scene):
        return join_clouds(scene)
    place: Any = np.asarray(getattr(scene, "points", scene))  # of Open3D or a trimesh.PointCloud
    if place.ndim == 2 and place.shape[1] == 6 and place.dtype.kind in "iuf":
        colors = place[:, 3:]  # levels from 0 to 1 or to 255; normals have negative parts
        if colors.min(initial=0) >= 0 and colors.max(initial=0) <= 255:
            levels = colors if colors.max(initial=0) <= 1 else colors / 255
            return _colored(Cloud(place[:, :3]), levels, "", None)
    if place.dtype.kind not in "iuf" or place.ndim != 2 or place.shape[1] != 3:
        raise TypeError(f"a scene of {shortly(scene)}; give {SCENES}")
    return Cloud(place.astype(np.float32 if place.dtype == np.float32 else np.float64))


def _colored(cloud: Cloud, colors: ArrayLike | str, colormap: str, span: Any) -> Cloud:
    """Return a cloud in other colors."""
    if isinstance(colors, str) and colors not in columns_of(cloud):
        with suppress(ValueError):
            same = np.array(linear_color(colors), np.float32)
            return cloud._replace(color=np.tile(same, (len(cloud.position), 1)))
    if isinstance(colors, str):
        return colored(cloud, colors, colormap=colormap, span=span)[0]
    given, count = np.asarray(colors), len(cloud.position)
    if given.shape == (count,) and given.dtype.kind in "iufb":
        columns = {**cloud.columns, "colors": given}
        named = cloud._replace(columns=columns)
        return colored(named, "colors", colormap=colormap, span=span)[0]
    if given.shape != (count, 3) or given.dtype.kind not in "iuf":
        raise ValueError(
            f"colors have the shape {given.shape}; give ({count}, 3) of levels or ({count},) of "
            "numbers"
        )
    white = 1.0 if given.dtype.kind == "f" else 255.0
    if given.size and not 0 <= given.min() <= given.max() <= white:
        raise ValueError(
            f"colors go from {given.min():g} to {given.max():g}; 0 to {white:g} is all"
        )
    light: Floats = from_srgb(given.astype(np.float32) / np.float32(white))
    return cloud._replace(color=light)
