"""Render and film files for the command line: clouds, 3D Gaussians, and others."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from resample.command.settings import FrameFormat
from resample.console import note, say
from resample_points.command import gaussians as of_gaussians
from resample_points.command.choices import Aimed, CloudOptions, CloudStart
from resample_points.command.gaussians import GaussianOptions

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample.cameras.viewpoints import Viewpoint
    from resample.command.session import Session
    from resample.command.settings import Sharing
    from resample.files.animations import Frames, Shots
    from resample.types import Floats
    from resample_points.data.cloud import Cloud
    from resample_points.data.columns import Scale
    from resample_points.geometry.spacing import Surfels
    from resample_points.scenes import CloudScene, Shape

CHANNELS = 4  # of a picture, with its opacity
PATHS = ("orbit", "sway", "still")
FRAMES = 96
SWAY = 20.0  # degrees to each side
FAR = 100.0  # times its extent from which a cloud's distance to the origin is reported


class ColoredScene(NamedTuple):
    """A cloud, ready to be rendered with the options of a command."""

    scene: "CloudScene"
    options: CloudOptions
    scale: "Scale | None"  # scale of its colors

    def picture(self, camera: "Camera", shape: "Shape") -> Any:
        """Render a frame."""
        return self.scene.render(camera, size=shape[::-1], **self.choices())

    def choices(self) -> dict[str, Any]:
        """Return the choices of a picture."""
        look = self.options
        return {"style": look.style(), "filter": look.filter, "threads": look.threads}

    def bar(self, height: int, background: Any) -> "Floats | None":
        """Return the color bar, if requested."""
        if self.scale is None or not self.options.color_bar:
            return None
        from resample.measuring.color_bars import class_bar, plain_bar

        scale, behind = self.scale, background or (0.0, 0.0, 0.0)
        if scale.classes:
            colors, names = scale.class_colors(), scale.class_names()
            return class_bar(colors, names, height, title=scale.name, background=behind)
        colors = scale.colors()
        return plain_bar(colors, scale.span, height, title=scale.name, background=behind)

    def shown(self, frame: Any, form: FrameFormat) -> Any:
        """Return a frame, with the color bar if requested."""
        behind = form.behind()
        bar = self.bar(frame.rgba.shape[0], behind)
        if bar is None:
            return frame
        from resample.measuring.color_bars import with_color_bar

        return frame._replace(rgba=with_color_bar(frame.rgba, bar, behind))

    def write(self, path: Path, frame: Any, form: FrameFormat) -> None:
        """Write a frame with its color bar."""
        from resample.files.saving import tell_empty, write_frame

        behind = form.behind(path.suffix)
        write_frame(path, self.shown(frame, form), bits=form.bits, background=behind)
        tell_empty(path, not frame.coverage.any())

    @property
    def framing(self) -> "Surfels":
        """Points that cameras frame."""
        return self.scene.surfels

    def upright(self, aim: Aimed) -> Aimed:
        """Return the cameras unchanged: files of clouds name no axis up."""
        return aim

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""
        from resample.files.animations import Shots, fingerprint
        from resample.files.saving import screen_levels
        from resample.measuring.color_bars import with_color_bar
        from resample_points.scenes import film_job

        bar = self.bar(shape[0], background)

        def frame(n: int) -> Any:
            rgba = self.picture(cameras[n], shape).rgba
            if bar is not None:
                rgba = with_color_bar(rgba, bar, background)
            return screen_levels(rgba, background=background)

        surfels = self.framing
        job = {
            "cloud": fingerprint(surfels.origin, surfels.position, surfels.axes, surfels.color),
            **film_job(cameras, shape, background),
            "look": self.options.model_dump(exclude={"threads", "no_cache"}),
        }
        return Shots(len(cameras), frame, job)

    def write_index(self, path: Path, camera: "Camera", shape: "Shape") -> None:
        """Write the index of the point that each pixel shows."""
        from resample.files.writing import replacing, save_array

        look = self.options
        found = self.scene.indices(
            camera, size=shape[::-1], style=look.style(), threads=look.threads
        )
        with replacing(path) as file:
            save_array(file, found)


def scene_of(session: "Session", file: Path, look: CloudOptions) -> ColoredScene:
    """Read, color and prepare the cloud of a file."""
    import numpy as np

    from resample.messages import naming
    from resample.progress import told
    from resample_points.data.columns import colored, join_clouds, select_points
    from resample_points.files.readers import read_cloud
    from resample_points.geometry.spacing import LARGEST, prepare_cloud
    from resample_points.scenes import CloudScene

    with session.stage("read", bar="reading") as progress, told(progress):
        columns = [wanted.column for wanted in look.conditions()]
        columns += [] if look.color_by is None else [look.color_by]
        files, scale = (file, *map(Path, look.also)), None
        cloud = join_clouds([read_cloud(each, level=look.level, columns=columns) for each in files])
        with naming(file.name if len(files) == 1 else f"{len(files)} clouds"):
            cloud = select_points(cloud, look.only, look.crop)
        if look.color_by is not None:
            cloud, scale = colored(cloud, look.color_by, colormap=look.colormap, span=look.span)
        elif "colormap" in look.model_fields_set:
            note("--colormap applies to numbers; choose one by --color-by")
    with session.stage("prepare", bar="measuring") as progress, told(progress):
        surfels = prepare_cloud(
            cloud,
            largest=LARGEST if look.disc_limit is None else look.disc_limit,
            threads=look.threads,
            cache=not look.no_cache,
        )
    if not session.is_quiet:
        mention_origin(file.name, surfels, is_single=cloud.position.dtype == np.float32)
    return ColoredScene(CloudScene(surfels), look, scale)


def mention_origin(name: str, surfels: "Surfels", *, is_single: bool = False) -> None:
    """Report the origin of a cloud that lies far from 0, such as a georeferenced one.

    `is_single`: the file's positions are float32, which far from 0 has coarse steps.
    """
    import numpy as np

    from resample_points.data.parts import rows_of

    extent = max(
        (float(abs(surfels.position[rows]).max()) for rows in rows_of(surfels.position)),
        default=0.0,
    )
    farthest = abs(surfels.origin).max()
    if farthest <= FAR * extent:
        return
    place = ", ".join(f"{part:.10g}" for part in surfels.origin)
    exact = "positions are exact"
    if is_single:
        step = np.spacing(np.float32(farthest))
        exact = f"its float32 positions are rounded to {step:g} there (float64 keeps them)"
    say(f"{name} is centered near {place}; {exact}, poses in the file's coordinates")


def check_memory(shape: "Shape", output: Path, workers: int = 0) -> None:
    """Reject a picture (height, width) that does not fit into memory, here and in workers."""
    from resample.command.session import bytes_per_value, require_picture

    require_picture(shape, CHANNELS * bytes_per_value(output), workers=workers)


def path_of(path: str, frames: int | None, fps: float, start: "Viewpoint") -> "list[Viewpoint]":
    """Return the viewpoints of all frames of a film.

    `frames`: their number; None: `FRAMES`, or as many as the keyframes' times (s) need.
    """
    from resample.cameras.viewpoints import Orbit
    from resample.command.films import is_file_of_path, tour_of
    from resample.files.animations import check_count
    from resample_points.geometry.framing import FIELD

    if is_file_of_path(path, PATHS):
        return tour_of(Path(path), frames, fps, FIELD).viewpoints()
    if not isinstance(start, Orbit):
        raise ValueError(
            f"the path {path} goes around the cloud; give --camera as azimuth,elevation,zoom, or a "
            "file of keyframes or poses as --path"
        )
    count = FRAMES if frames is None else frames
    check_count(count)
    turns = [n / count for n in range(count)]
    if path == "still":
        angles = [start.azimuth] * count
    elif path == "sway":
        angles = [start.azimuth + SWAY * math.sin(2.0 * math.pi * turn) for turn in turns]
    else:
        angles = [start.azimuth + 360.0 * turn for turn in turns]
    return [replace(start, azimuth=angle) for angle in angles]


class Filmed(Protocol):
    """A scene that films go around."""

    @property
    def framing(self) -> "Surfels | Cloud":
        """Points that cameras frame."""

    def upright(self, aim: Aimed, /) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""


def holds_gaussians(file: Path, look: CloudOptions, gaussians: GaussianOptions) -> bool:
    """Whether a file holds 3D Gaussians, not points; refuse options of the other."""
    from resample_points.files.ply import ply_header

    is_of_gaussians = True
    with suppress(OSError, ValueError):  # most PLY files tell by their columns that they are not
        is_of_gaussians = not ply_header(file).names().isdisjoint(("opacity", "packed_position"))
    if is_of_gaussians:
        from resample_points.files.gaussians.formats import is_gaussians

        is_of_gaussians = is_gaussians(file)
    others, owner, held = gaussians.model_fields_set, "3D Gaussians", "none"
    if is_of_gaussians:
        others = look.model_fields_set - set(of_gaussians.SHARED)
        owner, held = "clouds of points", "3D Gaussians"
    if others:
        name = "look" if min(others) == "appearance" else min(others).replace("_", "-")
        raise ValueError(
            f"--{name} is an option of {owner}, and {file.name} holds {held}; leave it out"
        )
    return is_of_gaussians


def scene_in(
    files: Sequence[Path],
    look: CloudOptions,
    gaussians: GaussianOptions,
    session: "Session",
    threads: int | None = None,
) -> Filmed:
    """Read a file, or the first of several with a frame each."""
    if threads is not None:
        look = look.model_copy(update={"threads": threads})
    if len(files) > 1:
        first = scene_in(files[:1], look, gaussians, session)
        if isinstance(first, ColoredScene) and first.scale is not None:
            look = look.model_copy(update={"span": "{!r},{!r}".format(*first.scale.span)})
        return Sweep(first, files, partial(scene_in, look=look, gaussians=gaussians))
    if holds_gaussians(files[0], look, gaussians):
        return of_gaussians.gaussians_of(session, files[0], look, gaussians)
    return scene_of(session, files[0], look)


@dataclass(frozen=True)
class Sweep:
    """Files with a frame each, framed as the first."""

    first: Filmed
    files: Sequence[Path]
    read: Callable[..., Filmed]  # of a list with one file, and a session

    @property
    def framing(self) -> "Surfels | Cloud":
        """Points that cameras frame."""
        return self.first.framing

    def upright(self, aim: Aimed) -> Aimed:
        """Return cameras with the scene's own axis up, unless another is given."""
        return self.first.upright(aim)

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film; a frame's file is read when it is made."""
        from resample.command.session import Session
        from resample.files.animations import Shots

        def frame(n: int) -> Any:
            scene = self.read(self.files[n : n + 1], session=Session(is_quiet=True))
            return scene.film(cameras[n : n + 1], shape, background).frame(0)

        job = dict(self.first.film(cameras, shape, background).job)
        known = [(file.resolve(), file.stat()) for file in self.files]
        job["files"] = [[str(file), stat.st_size, stat.st_mtime_ns] for file, stat in known]
        return Shots(len(cameras), frame, job)


def write_animation(
    output: Path,
    files: Sequence[Path],
    read: Callable[..., Filmed],
    *,
    path: str | None,
    frames: int | None,
    fps: float,
    start: CloudStart,
    shape: "Shape",
    background: Any,
    threads: int | None,
    resume: bool,
    sharing: "Sharing",
) -> None:
    """Write a film around the content of files.

    `read`: function of a session, and of a number of threads or none, that reads the files; workers
    get it pickled. `shape`: height and width, px. `background`: linear light. All others are those
    of `resample-points animate`.
    """
    from resample.command.films import write_shared
    from resample.command.session import Session
    from resample.command.workers import at_work, share_memory
    from resample_points.scenes import cameras_of

    if len(files) > 1:
        if frames not in (None, len(files)):
            raise ValueError(f"--frames {frames} of {len(files)} files, which are a frame each")
        path, frames = path or "still", len(files)
    path = path or "orbit"
    viewpoints = path_of(path, frames, fps, start.start())
    share_memory(sharing)
    scene = read(session=Session())
    if path in PATHS:
        viewpoints = path_of(path, frames, fps, scene.upright(start).start())
    cameras = cameras_of(scene.framing, viewpoints, shape, steady=start.steady)
    film = scene.film(cameras, shape, background)
    again = partial(frames_of, read, cameras, shape, background)
    with at_work(sharing, threads) as crew:
        write_shared(output, film, again, crew, fps=fps, resume=resume)


def frames_of(
    read: Callable[..., Filmed],
    cameras: Sequence[Any],
    shape: "Shape",
    background: Any,
    threads: int,
) -> "Frames":
    """Return the function that makes frames, in a worker."""
    from resample.command.session import Session

    return read(session=Session(), threads=threads).film(cameras, shape, background).frame
