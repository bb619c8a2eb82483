"""Render and film volumes in one call, with the options of the commands by their names."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from resample.calling import REMEDIES, FilmOptions, choice_meant, takes, understood
from resample.cameras.poses import UpAxis
from resample.cameras.viewpoints import Orbit, Spelled, orbit_of, viewpoint_of
from resample.messages import check_kind, shape_of, shortly
from resample.painting.choices import Projection
from resample.progress import Progress
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume.appearance import Appearance, resampler_for
from resample_volume.classification.scales import scaled
from resample_volume.classification.transfer import TransferFunction
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.inputs import as_volume
from resample_volume.rendering import Fitted, pictured
from resample_volume.types import Volume

if TYPE_CHECKING:
    from resample.command.settings import Choices

PAIRS = "give several volumes as a list of pairs (volume, appearance), without another appearance"
RANGES = ("clim", "contrast_limits")  # what others call the ends of a window
# Views along an axis of an array (Z, Y, X) that numpy.max(axis) shows; the last two upside down.
ALONG = {"0": "bottom", "1": "front", "2": "right", "z": "bottom", "y": "front", "x": "right"}
RAMPS = ("sigmoid", "linear_r", "geom")
CAMERA = ("camera", "fov", "up", "fit")  # the look's options for the camera
Numbers = float | str | Sequence[float]
Some = str | Sequence[str]  # as the command takes it once, or several times
RenderOptions = TypedDict("RenderOptions", {  # noqa: UP013 - as a class one line each
    "transfer": str, "window": Numbers, "clim": tuple[float, float], "iso": float,
    "projection": str, "spacing": Numbers, "background": str, "method": str, "fov": float,
    "up": UpAxis, "fit": str, "opacity_unit": float, "opacity": str, "attenuation": float,
    "shading": bool, "light": Numbers, "ambient": float, "diffuse": float, "specular": float,
    "shininess": float, "shadows": bool, "ambient_occlusion": bool, "depth_cue": float,
    "gradient": str, "gradient_opacity": str, "classify": str, "labels": str, "label": Some,
    "crop": str, "clip": Some, "slab": Numbers, "mu_water": float, "invert": bool,
    "color_by": str, "footprint": str, "threshold": float, "subpixels": int, "filter": str,
    "kernel": str, "order": str, "axes": bool, "box": bool, "cube": bool, "scale_bar": bool,
    "color_bar": bool, "mesh": Some, "plane": Some, "surface": Some, "zoom_in": bool,
    "reader": str, "shape": Numbers, "dtype": str, "endian": str, "memory": str, "level": int,
    "units": str, "scale": str, "time": int, "channel": int, "threads": int,
}, total=False)  # fmt: skip


class AnimateOptions(RenderOptions, FilmOptions, total=False):
    """Options of `animate`."""

    also: Some
    channels: str


@takes()
def render(
    volume: Any,
    appearance: Appearance | str = "auto",
    camera: Spelled = None,
    *,
    size: tuple[int, int] | int = (400, 400),
    resampler: Resampler | None = None,
    progress: Progress | None = None,
    **given: Unpack[RenderOptions],
) -> Frame:
    """Render a volume.

    Parameters
    ----------
    volume
        What `as_volume` takes: a volume, an array (Z, Y, X), a path, an image of other libraries;
        NaN is transparent. Or several, as a list of pairs (volume, appearance): see
        `Subject.of_several`.
    appearance
        Look of the voxels, or the name of a transfer function. None for a list of pairs.
    camera
        Any camera; a `Spot` with an eye and a target; or a viewpoint around the volume: an `Orbit`,
        (azimuth, elevation) with or without a zoom and a pan, a name such as `front`, `top` or
        `corner`; or a file of cameras, such as `cameras.json:3`. None: `Orbit()`, zoomed so that
        the visible part fills most of the picture.
    size
        Width and height, px, or both of a square.
    resampler
        Renderer; None: casts rays, or paints voxels where rays cannot be used (`decided`).
    progress
        Called with the fraction of the work done, 0 to 1.
    given
        Options of `resample-volume render`, such as `transfer`, `window`, `projection`, `iso`,
        `spacing` along x, y and z, `background`, `method`, `shading`, `clip`, `labels`, `fov`,
        `scale_bar` or `color_bar`. Values are texts as the command takes them, or numbers, also
        several: `window=(40, 400)` is a center and a width, `window="-160..240"` a range.

    Returns
    -------
    Premultiplied linear RGBA with depth and coverage; fully transparent if no voxel is visible.

    Raises
    ------
    ValueError
        The array is not a volume, or a choice is not allowed.
    TypeError
        There is no such option; it says what to give instead.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import render
    >>> z, y, x = np.indices((16, 16, 16)) - 7.5
    >>> ball = np.hypot(np.hypot(x, y), z).astype(np.float32)
    >>> frame = render(-ball, "-6..0", (30, 20), size=(32, 32))
    >>> frame
    Frame(32 × 32 px, 45.7 % covered, depth from 26.07)
    >>> round(float(frame.coverage[16, 16]), 2), float(frame.coverage[0, 0])
    (1.0, 0.0)
    >>> render(-ball, projection="maximum", spacing=(1, 1, 2), background="white", size=32)
    Frame(32 × 32 px, 56.2 % covered, depth from 63.1)
    """
    options, shape = dict[str, Any](given), shape_of(size)
    if isinstance(appearance, int | float):  # isosurface(volume, 0.5)
        appearance, options = "auto", {"iso": appearance, **options}
    if "axis" in options:
        camera = ALONG[str(options.pop("axis"))]
        options.setdefault("fov", 0)
    opacities = options.get("opacity")  # a list, or the name of a ramp, of PyVista
    is_ramp = np.ndim(opacities) == 1 or str(opacities).startswith(RAMPS)  # type: ignore[arg-type]
    opacities = options.pop("opacity") if is_ramp else None
    shown = choice_meant(appearance, list(Projection)) if isinstance(appearance, str) else ""
    if shown in list(Projection):  # a projection where a look is expected
        appearance, options = "auto", {"projection": shown, **options}
    if isinstance(camera, str) and orbit_of(camera) is None and Path(camera).suffix:
        from resample.cameras.files import viewpoint

        camera = viewpoint(camera)
    view = viewpoint_of(camera)
    fit: Fitted = "most" if camera is None else "visible"
    pairs = _pairs(volume, appearance)
    if not options:
        media = []
        for one, each in pairs:
            scene = as_volume(one)
            whole = each if isinstance(each, Appearance) else Appearance(each)
            media.append((without_padding(scene, survey(scene)), whole))
        paint = resampler or resampler_for(media[0][1])
        check_kind("resampler", paint, Resampler, "a Resampler, or None for the look's own")
        return pictured(media, view, shape, paint, fit, progress=progress)[0]
    from resample_volume.command.inputs import changed, opened, with_objects
    from resample_volume.command.rendering import annotated_picture

    look, resampling, extras, source, form = _chosen("render", options)
    own, first = look.model_fields_set - set(CAMERA), pairs[0][1]
    if own and any(isinstance(each, Appearance) for _, each in pairs):
        raise ValueError(f"an Appearance is a whole look; leave {', '.join(sorted(own))} out")
    if resampler is not None and resampling.model_fields_set:
        also = ", ".join(sorted(resampling.model_fields_set))
        raise ValueError(f"a Resampler holds all choices of the renderer; leave {also} out")
    paint = resampler or look.renderer(resampling, source.scale)
    if isinstance(first, Appearance) and not resampling.model_fields_set:
        paint = resampler or resampler_for(first)
    media = []
    for one, each in pairs:
        read = isinstance(one, str | PathLike)
        scene = opened(source, str(one)) if read else changed(source, as_volume(one))
        scene = scene if read else scaled(scene, source.scale)
        if not isinstance(each, Appearance):
            named = look if each == "auto" else look.model_copy(update={"transfer": each})
            each = named.appearance(scene, paint)  # noqa: PLW2901
            if opacities is not None:
                each = _faded(each, opacities)  # noqa: PLW2901
        media.append((without_padding(scene, survey(scene)), each))
    media = with_objects(media, extras.scene_objects(look, paint))
    if isinstance(view, Orbit) and look.model_fields_set & {"fov", "up"}:
        view = replace(view, fov=look.fov, up=look.up)
    if extras.zoom_in or camera is not None or "fit" in look.model_fields_set:
        fit = "picture" if extras.zoom_in else look.fit
    frame, subject, eye = pictured(media, view, shape, paint, fit, form.threads, progress)
    behind = form.behind(".exr")  # transparent unless a background is given
    return annotated_picture(subject, eye, frame, media, paint, extras, behind).over(behind)


@takes()
def animate(
    volume: Any,
    output: str | PathLike[str] | None = None,
    appearance: str = "auto",
    camera: Sequence[float] | str | None = None,
    *,
    size: tuple[int, int] | int = (400, 400),
    **options: Unpack[AnimateOptions],
) -> NDArray[np.uint8] | None:
    """Film a volume as `resample-volume animate` does: along a camera path, or over time.

    Parameters
    ----------
    volume
        A path or name; other inputs of `as_volume` are written to a temporary file.
    output
        Film to write: `.mp4`, `.webm`, `.gif`, `.webp`, `.apng`, or a folder of pictures; None:
        return the frames (N, H, W, 3).
    appearance, camera, size
        As for `render`, but texts and numbers only.
    options
        Options of the command: `frames`, `fps`, `path`, and the options of `render`.

    Raises
    ------
    ValueError, TypeError, OSError
        As for `render`; or the film cannot be written.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> from resample_volume import animate
    >>> film = pathlib.Path(tempfile.mkdtemp()) / "turn.webp"
    >>> animate(np.ones((8, 8, 8), np.uint8), film, "bone", frames=2, size=(32, 24))
    >>> film.stat().st_size > 0
    True
    """
    from resample.command.applications import film

    height, width = shape_of(size)
    given = {"transfer": appearance, "camera": camera, "size": f"{width}x{height}", **options}
    with TemporaryDirectory() as folder:
        name = str(volume)
        if not isinstance(volume, str | PathLike):
            from resample_volume.files.source import write_volume

            name = str(Path(folder) / "volume.nrrd")
            write_volume(Path(name), as_volume(volume, "volume"))
        return film("volume", "animate", name, output=output, **spelled(given))


def _is_ramp(given: Any) -> bool:
    """Whether an opacity is one of PyVista: a list, or the name of a ramp."""
    ramps = ("sigmoid", "linear_r", "geom")
    return isinstance(given, list | tuple | np.ndarray) or str(given).startswith(ramps)


def _pairs(volume: Any, appearance: Appearance | str) -> list[tuple[Any, Appearance | str]]:
    """Return volumes with their looks, also for a single one."""
    if isinstance(volume, list | tuple) and not isinstance(volume, Volume):
        is_pair = [
            isinstance(one, tuple) and len(one) == 2 and isinstance(one[1], str | Appearance)
            for one in volume
        ]
        if any(is_pair) or any(isinstance(one, Volume) or np.ndim(one) == 3 for one in volume):
            if appearance != "auto" or not all(is_pair):
                raise ValueError(PAIRS)
            return list(volume)
    return [(volume, appearance)]


def _faded(look: Appearance, given: Any) -> Appearance:
    """Return a look with opacities spread over its window."""
    transfer = look.transfer
    if not isinstance(transfer, TransferFunction):
        raise TypeError(f"opacity {shortly(given)}; give it with a colormap, such as cmap='gray'")
    if isinstance(given, str):
        steep = float(given.partition("_")[2]) if given.startswith("sigmoid_") else 10.0
        ramps = {"linear_r": np.linspace(1, 0, 65), "geom": np.geomspace(4e-9, 1, 65)}
        given = ramps.get(given, 1 / (1 + np.exp(-np.linspace(-steep, steep, 65))))
    value = np.linspace(transfer.value[0], transfer.value[-1], max(65, len(given)))
    color = np.column_stack([np.interp(value, transfer.value, part) for part in transfer.color.T])
    opacity = np.interp(value, np.linspace(value[0], value[-1], len(given)), given)
    return replace(look, transfer=replace(transfer, value=value, color=color, opacity=opacity))


def spelled(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with other libraries' window translated, and an iso value's projection."""
    given = dict(options)
    if np.shape(given.get("scale", "")) == (3,):  # of napari: along z, y and x
        given["spacing"] = tuple(given.pop("scale"))[::-1]
    for name in RANGES:
        if name in given:
            low, high = given.pop(name)
            given["window"] = f"{low}..{high}"
    if {"vmin", "vmax"} <= given.keys():
        given["window"] = f"{given.pop('vmin')}..{given.pop('vmax')}"
    if given.get("parallel_projection") is True:
        given["fov"] = 0 * given.pop("parallel_projection")
    if given.get("opacity", "exact") not in ("exact", "linear"):
        raise TypeError(f"opacity {shortly(given['opacity'])}: {REMEDIES['opacity']}")
    if "iso" in given:
        given.setdefault("projection", "first-hit")
    return given


def _chosen(call: str, options: Mapping[str, Any]) -> "list[Any]":
    """Return the models of options that a picture has."""
    from resample.command.settings import PictureFormat, Resampling, chosen
    from resample_volume.command.choices import AppearanceChoices, PictureExtras, ReadOptions

    models: list[type[Choices]] = [AppearanceChoices, Resampling, PictureExtras, ReadOptions]
    models.append(PictureFormat)
    known = {field for model in models for field in model.model_fields} - {"bits", "deep"}
    return chosen(understood(call, spelled(options), sorted(known)), models)
