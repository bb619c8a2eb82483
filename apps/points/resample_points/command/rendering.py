"""Render clouds and films of clouds for the command line."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from resample.command.settings import FrameFormat
from resample.console import note, say
from resample.lazy import installed_version
from resample_points.command.choices import Aimed, CloudOptions

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample.cameras.viewpoints import Viewpoint
    from resample.command.session import Session
    from resample.files.animations import Shots
    from resample.types import Floats
    from resample_points.data.cloud import Cloud
    from resample_points.data.coloring import Scale
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
        from resample.measuring.color_bars import class_bar, plain_bar

        if self.scale is None or not self.options.color_bar:
            return None
        scale, behind = self.scale, background or (0.0, 0.0, 0.0)
        if scale.classes:
            colors, names = scale.class_colors(), scale.class_names()
            return class_bar(colors, names, height, title=scale.name, background=behind)
        colors = scale.colors()
        return plain_bar(colors, scale.span, height, title=scale.name, background=behind)

    def shown(self, frame: Any, form: FrameFormat) -> Any:
        """Return a frame, with the color bar if requested."""
        from resample.measuring.color_bars import with_color_bar

        behind = form.behind()
        bar = self.bar(frame.rgba.shape[0], behind)
        if bar is None:
            return frame
        return frame._replace(rgba=with_color_bar(frame.rgba, bar, behind))

    def write(self, path: Path, frame: Any, form: FrameFormat) -> None:
        """Write a frame with its color bar."""
        from resample.files.saving import tell_empty, write_frame

        behind = form.behind(path.suffix)
        write_frame(path, self.shown(frame, form), bits=form.bits, background=behind)
        tell_empty(path, not frame.coverage.any())

    @property
    def framing(self) -> "Surfels":
        """What cameras are framed around."""
        return self.scene.surfels

    def upright(self, aim: Aimed) -> Aimed:
        """Return the cameras as they are: files of clouds name no axis up."""
        return aim

    def film(self, cameras: Sequence[Any], shape: "Shape", background: Any) -> "Shots":
        """Return the frames of a film."""
        from resample.files.animations import Shots, fingerprint
        from resample.files.saving import screen_levels
        from resample.measuring.color_bars import with_color_bar

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
        """Write which point each pixel shows."""
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

    from resample.progress import told
    from resample_points.data.coloring import colored
    from resample_points.geometry.spacing import LARGEST, prepare_cloud
    from resample_points.scenes import CloudScene

    with session.stage("read", bar="reading") as progress, told(progress):
        cloud, scale = _chosen(file, look), None
        if look.color_by is not None:
            cloud, scale = colored(cloud, look.color_by, colormap=look.colormap, span=look.span)
        elif "colormap" in look.model_fields_set:
            note("--colormap colors numbers, of which --color-by names one")
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


def _chosen(file: Path, look: CloudOptions) -> "Cloud":
    """Read the clouds of a command, and select their points."""
    from resample.messages import naming
    from resample_points.data.selecting import join_clouds, select_points
    from resample_points.files.readers import read_cloud

    named = {wanted.column: None for wanted in look.conditions()}
    columns = tuple(dict.fromkeys((*named, *([] if look.color_by is None else [look.color_by]))))
    files = (file, *map(Path, look.also))
    cloud = join_clouds([read_cloud(each, level=look.level, columns=columns) for each in files])
    with naming(file.name if len(files) == 1 else f"{len(files)} clouds"):
        return select_points(cloud, look.only, look.crop)


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
    """Refuse a picture (height, width) that does not fit into memory, here and in workers."""
    from resample.command.session import bytes_per_value, require_picture

    require_picture(shape, CHANNELS * bytes_per_value(output), workers=workers)


def paths_over(
    files: Sequence[Path], path: str | None, frames: int | None
) -> tuple[str, int | None]:
    """Return the path and the number of frames of a film of files, one frame each if several."""
    if len(files) == 1:
        return path or "orbit", frames
    if frames not in (None, len(files)):
        raise ValueError(f"--frames {frames} of {len(files)} files, which are a frame each")
    return path or "still", len(files)


def path_of(path: str, frames: int | None, fps: float, start: "Viewpoint") -> "list[Viewpoint]":
    """Return the viewpoints of all frames of a film.

    Parameters
    ----------
    frames
        Number of frames; None: `FRAMES`, or as many as the keyframes' times (s) need.
    fps
        Frames per second.
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


def film_job(cameras: Sequence[Any], shape: "Shape", background: Any) -> dict[str, Any]:
    """Return what the frames of every film depend on."""
    import numpy as np

    from resample.files.animations import fingerprint

    numbers = [  # intrinsics, in perspective or parallel
        each.matrix if hasattr(each, "matrix") else (each.sx, each.sy, each.cx, each.cy)
        for each in cameras
    ]
    poses = np.stack([camera.world_to_camera for camera in cameras])
    return {
        "cameras": fingerprint(np.array(numbers, np.float64), poses),
        "size": list(shape),
        "background": list(background),
        "version": installed_version(),
    }
