"""Render whatever holds points: one call for arrays, clouds, 3D Gaussians and their files."""

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.panoramic import Equirectangular
from resample.cameras.viewpoints import Orbit, Spelled, viewpoint_of
from resample.colors import from_srgb
from resample.painting.scenes.plans import shape_of
from resample.profiles.filters import PixelFilter
from resample.types import Floats, Frame
from resample.words import shortly
from resample_points.data.cloud import Cloud
from resample_points.data.coloring import colored
from resample_points.data.gaussians import Gaussians
from resample_points.data.joining import DOWN
from resample_points.files.gaussians.reading import is_gaussians, read_gaussians
from resample_points.files.particles import is_snapshot
from resample_points.files.readers import read_cloud
from resample_points.geometry.framing import FIELD
from resample_points.geometry.spacing import Surfels
from resample_points.painting.bending import CloudView, ProjectedCamera
from resample_points.painting.gaussians import GaussianStyle, render_gaussians, shown_part
from resample_points.painting.rendering import CloudStyle
from resample_points.scenes import CloudScene, camera_of

SCENES = "a path, positions (N, 3), a Cloud or Gaussians"


def render(
    scene: str | PathLike[str] | ArrayLike | Cloud | Surfels | CloudScene | Gaussians,
    camera: Spelled | CloudView = None,
    *,
    colors: ArrayLike | str | None = None,
    colormap: str = "viridis",
    size: tuple[int, int] = (640, 480),
    style: CloudStyle | GaussianStyle | None = None,
    filter: str | PixelFilter | None = None,  # noqa: A002
    threads: int | None = None,
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
        1, encoded as sRGB; numbers (N,), or the name of a column, or x, y or z, for a colormap.
    colormap
        One of matplotlib's, for numbers.
    size
        Width and height, px.
    style
        `CloudStyle` of clouds, `GaussianStyle` of Gaussians.
    filter
        Pixel filter of clouds; see `render_cloud`.
    threads
        Most threads to use; the picture does not depend on it.

    Raises
    ------
    ValueError, TypeError
        The scene holds nothing that can be drawn, or a choice does not go with it.
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
    found = _opened(scene)
    if isinstance(found, Gaussians):
        if colors is not None or filter is not None or isinstance(style, CloudStyle):
            raise ValueError("3D Gaussians have colors and a filter of their own; leave these out")
        view: Any = camera
        if not isinstance(camera, Equirectangular | ProjectedCamera):
            view = viewpoint_of(camera)
        if isinstance(view, Orbit):
            up: Any = found.up or DOWN if view.up == Orbit.up else view.up
            around = replace(view, fov=FIELD, up=up)
            view = camera_of(shown_part(found), shape_of(size), around)
        return render_gaussians(found, view, size=size, style=style, threads=threads)
    if isinstance(style, GaussianStyle):
        raise ValueError("a GaussianStyle is for 3D Gaussians; give a CloudStyle")
    if colors is not None:
        if not isinstance(found, Cloud):
            raise ValueError("colors are for a Cloud, a file or positions, not a prepared scene")
        found = _colored(found, colors, colormap)
    opened = found if isinstance(found, CloudScene) else CloudScene(found, threads=threads)
    return opened.render(camera, size=size, style=style, filter=filter, threads=threads)


def _opened(scene: Any) -> Cloud | Surfels | CloudScene | Gaussians:
    """Return what is to be rendered, read from a file or made of positions if need be."""
    if isinstance(scene, Cloud | Surfels | CloudScene | Gaussians):
        return scene
    if isinstance(scene, str | PathLike):
        from pathlib import Path

        path = Path(scene)
        if is_snapshot(path):
            raise ValueError(f"{path.name} holds particles, of which column_density makes maps")
        return read_gaussians(path) if is_gaussians(path) else read_cloud(path)
    place: Any = np.asarray(getattr(scene, "points", scene))  # of Open3D or a trimesh.PointCloud
    if place.dtype.kind not in "iuf" or place.ndim != 2 or place.shape[1] != 3:
        raise TypeError(f"a scene of {shortly(scene)}; give {SCENES}")
    return Cloud(place.astype(np.float32 if place.dtype == np.float32 else np.float64))


def _colored(cloud: Cloud, colors: ArrayLike | str, colormap: str) -> Cloud:
    """Return a cloud in other colors."""
    if isinstance(colors, str):
        return colored(cloud, colors, colormap=colormap)[0]
    given, count = np.asarray(colors), len(cloud.position)
    if given.shape == (count,) and given.dtype.kind in "iufb":
        columns = {**cloud.columns, "colors": given}
        return colored(cloud._replace(columns=columns), "colors", colormap=colormap)[0]
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
