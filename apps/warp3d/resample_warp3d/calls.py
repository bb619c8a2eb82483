"""Views, stereo pictures and films in one call, with the options of the commands by their names."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import CommandOptions, FilmOptions, takes
from resample.messages import shortly, warn
from resample_warp3d import warping
from resample_warp3d.types import Source, Warped

Named = str | PathLike[str]
CAMERAS = ("intrinsics", "depth_intrinsics", "target_intrinsics")  # also as matrices (3, 3)
POSES = ("pose", "source_pose", "depth_pose")  # also as matrices (3, 4) or (4, 4)
DepthOptions = TypedDict("DepthOptions", {  # noqa: UP013 - as a class one line each
    "fov": float, "lens": str, "convention": str, "source_pose": ArrayLike,
    "source_projection": str, "pixel_size": float, "depth_kind": str, "depth_scale": float,
    "near": float, "far": float, "baseline": float, "focal": float, "doffs": float,
    "depth_intrinsics": ArrayLike, "depth_pose": ArrayLike, "confidence": Named,
    "least_confidence": float, "size": str | int | tuple[int, int], "method": str, "filter": str,
    "noise": float, "refine": str, "fill": bool, "fill_by": str, "unmixed": bool, "threads": int,
}, total=False)  # fmt: skip
TargetOptions = TypedDict("TargetOptions", {  # noqa: UP013
    "target_intrinsics": ArrayLike, "target_fov": float, "target_lens": str,
    "target_projection": str, "target_pixel_size": float,
}, total=False)  # fmt: skip
LayoutOptions = TypedDict("LayoutOptions", {  # noqa: UP013
    "disparity": Any, "temporal": str, "layout": str, "eyes": str, "divergence": float,
    "convergence": float, "eye_distance": float, "zero_plane": float, "fraction": float,
    "disparity_scale": float, "foreground_scale": float, "preserve_borders": bool,
    "crop_borders": bool, "quilt": str, "depth_model": Named, "model_size": int,
    "model_mean": str, "model_std": str, "model_batch": int, "background": str, "bits": int,
    "profile": str, "file_quality": str | int, "holes": Named, "coverage": Named, "start": str,
    "end": str, "codec": str, "crf": int, "bitrate": str, "pixel_format": str, "name_layout": bool,
}, total=False)  # fmt: skip


class RenderOptions(DepthOptions, TargetOptions, total=False):
    """Options of `render`, as in the command."""

    move: str | tuple[float, float, float]
    turn: str | tuple[float, ...]


class StereoOptions(DepthOptions, CommandOptions, LayoutOptions, total=False):
    """Options of `stereo`, as in the command, and `disparity` in place of a depth."""

    intrinsics: ArrayLike


class AnimateOptions(DepthOptions, TargetOptions, FilmOptions, total=False):
    """Options of `animate`, as in the command."""

    intrinsics: ArrayLike
    amount: float
    background: str
    temporal: str
    depth_output: Named


@takes(RenderOptions)
def render(
    color: Any,
    depth: Any,
    intrinsics: Any = None,
    pose: Any = None,
    *prepared: Any,
    **options: Unpack[RenderOptions],
) -> Warped:
    """Render a picture with depth from another viewpoint, as `resample-warp3d render` does.

    Parameters
    ----------
    color
        A picture by its path, or levels (H, W, 3 or 4) of 8 bits. Or a prepared `Source`, with an
        equation, a shape and a method, as `warping.render` takes them.
    depth
        A path, or numbers (H, W) of the kind that `depth_kind` says; otherwise z, scene units.
    intrinsics
        `(fx, fy, cx, cy)` or a matrix (3, 3), px; 0 is the first pixel's corner; or a
        file. `fov=` will do in its place; without either 60 degrees are assumed, with a warning.
    pose
        World to camera, (3, 4) or (4, 4), or a file. Or `move=(x, y, z)`, to the right, down and
        forward, and `turn=(yaw, pitch, roll)`.
    options
        Options of the command: `move`, `turn`, `fov`, `depth_scale`, `size`, `fill`, ...

    Returns
    -------
    As `warp`: picture (height, width, C) of linear light, coverage, depth and holes.

    Raises
    ------
    ValueError, TypeError, OSError
        As for the command.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import render
    >>> wall = np.full((24, 32), 4.0)
    >>> render(np.zeros((24, 32, 3), np.uint8), wall, fov=60, move=(0.5, 0, 0))
    Warped(24 × 32 × 3 float32, 91 % covered)
    """
    if isinstance(color, Source):
        choices: Any = options
        return warping.render(color, depth, intrinsics, pose, *prepared, **choices)
    if pose is None and np.shape(intrinsics) in ((3, 4), (4, 4)):
        intrinsics, pose = None, intrinsics
    from resample.command.session import Session
    from resample.command.settings import chosen
    from resample_warp3d.command.choices import Depth, DepthWarping, Joint
    from resample_warp3d.command.inputs import DepthReader, read_views
    from resample_warp3d.command.rendering import joined, joining_of
    from resample_warp3d.command.rendering import prepared as prepared_views
    from resample_warp3d.command.source import FOV, SourceCamera
    from resample_warp3d.command.target import Aim

    with _files(color, depth) as (names, folder):
        if len(names) < 2:
            raise TypeError("a view needs the picture's depth; give render(color, depth)")
        given = _spelled({"intrinsics": intrinsics, "pose": pose, **options}, folder)
        models = (SourceCamera, Depth, Aim, DepthWarping)
        eye, meaning, aim, choice = chosen(given, models)
        known = eye.of_recording(names[0]).guessed()
        if known.fov != eye.fov:
            warn(f"assumed a field of view of {FOV:g} degrees; fov= or intrinsics= states it")
        if not aim.model_fields_set:
            warn("the view is the picture's own; move=, turn= or pose= moves the camera")
        aim.step()
        aim.check_target()
        reader = DepthReader.checked(known, meaning, labels=choice.unmixed)
        taken = read_views(reader, names[0], names[1], [])
        target = aim.camera_model(taken.camera, taken.shape, eye.convention)
    session, joint = Session(), joining_of(taken, Joint.usual(), unmixed=choice.unmixed)
    sources = prepared_views(session, taken.views, choice)
    return joined(session, sources, target, aim.shape(taken.shape), choice, joint).warped


@takes(StereoOptions)
def stereo(
    picture: Any,
    depth: Any = None,
    output: Named | None = None,
    **options: Unpack[StereoOptions],
) -> NDArray[np.uint8] | None:
    """Make the other eye's picture, or both, as `resample-warp3d stereo` does.

    Parameters
    ----------
    picture
        A picture or film by its path, or levels (H, W, 3 or 4) of 8 bits.
    depth
        A path, or numbers (H, W): disparity, depth or relative depth, which is recognised and said;
        None with `depth_model`.
    output
        File to write; None: return the picture.
    options
        Options of the command: `layout`, `eyes`, `divergence`, `convergence`, `depth_kind`, `fill`,
        `fraction`, ...; or `disparity` (H, W), px, in place of a depth.

    Returns
    -------
    Levels (H, W, 3 or 4) if there is no output; with opacity, where there are holes.

    Raises
    ------
    ValueError, TypeError, OSError
        As for the command.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import stereo
    >>> left = np.zeros((24, 32, 3), np.uint8)
    >>> left[:, 20] = 255  # a line
    >>> both = stereo(left, np.full((24, 32), 6.0), layout="sbs", depth_kind="pair")
    >>> both.shape, np.flatnonzero(both[12, :, 0] > 128).tolist()
    ((24, 64, 3), [20, 46])
    """
    from PIL import Image

    from resample.command.applications import run

    given: dict[str, Any] = {**options}
    if "disparity" in given:
        depth, given["depth_kind"] = given.pop("disparity"), "pair"
    with _files(picture, depth) as (names, folder):
        made = folder / "stereo.png" if output is None else Path(output)
        run("warp3d", "stereo", *names, output=made, **_spelled(given, folder))
        return np.asarray(Image.open(made)) if output is None else None


@takes(AnimateOptions)
def animate(
    picture: Any, depth: Any, output: Named | None = None, **options: Unpack[AnimateOptions]
) -> NDArray[np.uint8] | None:
    """Film a picture with depth as `resample-warp3d animate` does: along a camera path.

    Parameters
    ----------
    picture, depth
        As for `stereo`; depth of the kind that `depth_kind` says.
    output
        Film to write: `.mp4`, `.webm`, `.gif`, `.webp`, `.apng`, or a folder of pictures; None:
        return the frames (N, H, W, 3).
    options
        Options of the command: `path`, `amount`, `frames`, `fov`, `fill`, ...

    Raises
    ------
    ValueError, TypeError, OSError
        As for the command.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> from resample_warp3d import animate
    >>> film = pathlib.Path(tempfile.mkdtemp()) / "sway.webp"
    >>> animate(np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 4.0), film, fov=60, frames=2)
    >>> film.stat().st_size > 0
    True
    """
    from resample.command.applications import film

    given: dict[str, Any] = {**options}
    is_known = given.keys() & {"fov", "intrinsics", "lens", "source_pose", "source_projection"}
    if not is_known and ".r3d" not in str(picture):
        given["fov"] = 60.0
        warn("assumed a field of view of 60 degrees; fov= or intrinsics= states it")
    with _files(picture, depth) as (names, folder):
        return film("warp3d", "animate", *names, output=output, **_spelled(given, folder))


@contextmanager
def _files(picture: Any, depth: Any) -> Iterator[tuple[list[str], Path]]:
    """Files of a picture and its depth; arrays are written to a folder."""
    from PIL import Image

    with TemporaryDirectory() as folder:
        names = []
        if isinstance(picture, str | PathLike):
            names.append(str(picture))
        elif np.ndim(picture) in (2, 3) and np.asarray(picture).dtype == np.uint8:
            names.append(str(Path(folder) / "picture.png"))
            Image.fromarray(np.asarray(picture)).save(names[0])
        else:
            raise TypeError(f"a picture {shortly(picture)}; give a path or levels of 8 bits")
        if isinstance(depth, str | PathLike):
            names.append(str(depth))
        elif depth is not None:
            names.append(str(Path(folder) / "depth.npy"))
            np.save(names[1], np.asarray(depth))
        yield names, Path(folder)


def _spelled(options: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return options in the command's form: cameras as numbers, poses as files."""
    given = {name: value for name, value in options.items() if value is not None}
    for name in {*POSES} & given.keys():
        if np.shape(given[name]) in ((3, 4), (4, 4)):
            file = folder / f"{name}.txt"
            np.savetxt(file, np.vstack([given[name], [0, 0, 0, 1]])[:4])
            given[name] = str(file)
    for name in {*CAMERAS} & given.keys():
        if np.shape(given[name]) == (3, 3):
            (fx, skew, cx), (_, fy, cy), _ = np.asarray(given[name], np.float64).tolist()
            given[name] = fx, fy, cx, cy, skew
    if isinstance(given.get("size"), list | tuple):
        given["size"] = "{}x{}".format(*given["size"])
    return given
