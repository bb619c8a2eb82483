"""Point clouds on the command line: look, camera, pictures and films."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from cyclopts import Parameter
from pydantic import BeforeValidator, Field

from resample.command.about import NUMBERS, OptionTopic
from resample.command.flags import Hyphen, Switch, Up, Viewed
from resample.command.settings import (
    CAMERA,
    SIZE,
    Choices,
    Threads,
    height_and_width,
    number,
)
from resample.console.backgrounds import linear_color
from resample.console.messages import say
from resample.lazy import installed_version

if TYPE_CHECKING:
    from resample.cameras.calibrations.lens_files import Calibration
    from resample.cameras.models import Camera
    from resample.cameras.viewpoints import Viewpoint
    from resample.command.session import Session
    from resample.console.backgrounds import Color
    from resample.files.animations import Frames, Shots
    from resample.types import Floats
    from resample_warp3d.clouds.coloring import Scale
    from resample_warp3d.clouds.spacing import Surfels

Shape = tuple[int, int]  # height and width, px

PATHS = ("orbit", "sway")
FRAMES = 96
SWAY = 20.0  # degrees to each side
FAR = 100.0  # times its extent from which a cloud's distance to the origin is reported


class CloudOptions(Choices):
    """Look of a point cloud."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    color_by: Annotated[
        str | None,
        Field(
            description="Source of colors: a column of the file, such as intensity, or x, y or z."
        ),
    ] = None
    colormap: Annotated[
        str,
        Field(description="Colormap for --color-by, one of matplotlib's, such as turbo or tab10."),
    ] = "viridis"
    span: Annotated[
        str | None,
        Parameter(name="--range", allow_leading_hyphen=True),
        Field(
            description="Values at the ends of the colormap: low,high, or quantiles such as "
            "2%,98%. Default: least and greatest value."
        ),
    ] = None
    color_bar: Annotated[
        bool, Switch, Field(description="Add a bar to the right: the colors and their values.")
    ] = False
    point_size: Annotated[
        float, Field(description="Scale of the points, relative to their spacing.")
    ] = 1.0
    disc_limit: Annotated[
        float | None,
        Field(
            description="Largest size of a point relative to its neighbours; inf for no limit. "
            "Default: 1.75, and 1 for stray points."
        ),
    ] = None
    filter: Annotated[
        str | None,
        Field(
            description="Pixel filter, such as gaussian:sigma=0.6. Default: the mean over a pixel."
        ),
    ] = None
    light: Annotated[
        Literal["none", "eye"] | None,
        Field(
            description="Where light comes from: eye, the camera (default for clouds without "
            "colors), or none."
        ),
    ] = None
    one_sided: Annotated[bool, Switch, Field(description="Cull points that face away.")] = False
    level: Annotated[
        int,
        Field(
            ge=0,
            description="Level of detail; 0 is the finest. Skip this many of the finest levels of "
            "a COPC file.",
        ),
    ] = 0
    no_cache: Annotated[
        bool,
        OptionTopic.RESOURCE,
        Switch,
        Field(description="Do not use the disk cache of the points' neighbours."),
    ] = False
    threads: Threads = None

    def check(self, output: Path, height: int) -> None:
        """Refuse invalid options before any work is done.

        Raises
        ------
        ValueError, LookupError
            An option is unknown, out of range, or does not go with another.
        """
        from resample import registry
        from resample.colors import check_colormap
        from resample.measuring.color_bars import check_bar

        self.style()
        check_colormap(self.colormap)
        if self.filter is not None:
            registry.build("filters", self.filter)
        if self.color_by is None and (self.color_bar or self.span is not None):
            raise ValueError("--color-bar and --range belong to --color-by; give it a column")
        if self.color_bar:
            check_bar(output, height)

    def style(self) -> Any:
        """Return the style that `render_cloud` takes."""
        from resample_warp3d.clouds.rendering import CloudStyle, Shading

        lights = {None: None, "none": Shading.NONE, "eye": Shading.HEADLIGHT}
        return CloudStyle(point_size=self.point_size, light=lights[self.light], cull=self.one_sided)


class CloudStart(Choices):
    """Camera around a point cloud."""

    heading: ClassVar[str] = CAMERA
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    camera: Viewed = "30/20/1"
    up: Up = "z"
    steady: Annotated[
        bool,
        Switch,
        Field(
            description="Keep the same distance to the cloud's center at all angles, instead of "
            "fitting the cloud to the picture."
        ),
    ] = False


class CloudAim(CloudStart):
    """Camera of a point cloud."""

    pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(description="File or file:frame of a pose; instead of --camera, needs --intrinsics."),
    ] = None
    intrinsics: Annotated[
        str | None, NUMBERS, Hyphen, Field(description="fx,fy,cx,cy[,skew] in px; for --pose.")
    ] = None

    def check(self) -> None:
        """Refuse invalid cameras before any work is done.

        Raises
        ------
        ValueError, LookupError, OSError
            As `start_of` and `calibrated_of` do.
        """
        start_of(self.camera, self.up)
        calibrated_of(self.pose, self.intrinsics)

    def camera_for(self, surfels: "Surfels", shape: Shape) -> Any:
        """Return the camera for a picture (height, width) of a cloud; raises as `check` does."""
        from resample.cameras.viewpoints import Orbit
        from resample_warp3d.clouds.framing import ball_around

        calibrated = calibrated_of(self.pose, self.intrinsics)
        if calibrated is not None:
            return _sized(calibrated, shape)
        start = start_of(self.camera, self.up)
        if self.steady and isinstance(start, Orbit):
            return start.around(ball_around(surfels), *shape)
        return camera_of(surfels, shape, start)


class CloudFormat(Choices):
    """Size, background and bits of a cloud's picture."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    size: Annotated[str, Field(description=SIZE)] = "640x480"
    background: Annotated[
        str | None,
        Field(
            description="Background: black, white, #rrggbb or none for transparent. Default: none."
        ),
    ] = None
    bits: Annotated[
        Literal[8, 16],
        BeforeValidator(number),
        Field(description="Bits per channel: 8 or 16 (PNG)."),
    ] = 8

    def height_and_width(self) -> Shape:
        """Return the size, px.

        Raises
        ------
        ValueError
            The size or the background's color is invalid.
        """
        self.behind()
        return height_and_width(self.size)

    def behind(self) -> "Color | None":
        """Linear color behind the picture; None leaves it transparent."""
        return None if self.background is None else linear_color(self.background)

    def shown(self, frame: Any, scene: "CloudScene") -> Any:
        """Return a frame, with the color bar if requested."""
        behind = self.behind()
        bar = scene.bar(frame.rgba.shape[0], behind)
        return frame._replace(rgba=beside(frame.rgba, bar, behind))

    def write(self, path: Path, frame: Any, scene: "CloudScene") -> None:
        """Write a frame with its color bar.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        from resample.files.saving import write_frame

        write_frame(path, self.shown(frame, scene), bits=self.bits, background=self.behind())


class CloudScene(NamedTuple):
    """A cloud, ready to be rendered."""

    surfels: "Surfels"
    options: CloudOptions
    scale: "Scale | None"  # scale of its colors

    def picture(self, camera: "Camera | Calibration", shape: Shape) -> Any:
        """Render a frame."""
        from resample_warp3d.clouds.rendering import render_cloud

        look = self.options
        return render_cloud(
            self.surfels,
            _sized(camera, shape),
            size=shape[::-1],
            style=look.style(),
            filter=look.filter,
            threads=look.threads,
        )

    def bar(self, height: int, background: Any) -> "Floats | None":
        """Return the color bar, if requested."""
        from resample.measuring.color_bars import plain_bar

        if self.scale is None or not self.options.color_bar:
            return None
        colors, span, name = self.scale.colors(), self.scale.span, self.scale.name
        behind = background or (0.0, 0.0, 0.0)
        return plain_bar(colors, span, height, title=name, background=behind)


def beside(rgba: "Floats", bar: "Floats | None", background: Any) -> "Floats":
    """Put a color bar beside a picture, if there is one."""
    from resample.measuring.color_bars import with_color_bar

    return rgba if bar is None else with_color_bar(rgba, bar, background)


def scene_of(session: "Session", file: Path, look: CloudOptions) -> CloudScene:
    """Read, color and prepare the cloud of a file.

    Raises
    ------
    ValueError, OSError
        The file is not a cloud, lacks a column, or cannot be read.
    """
    from resample.watching import told
    from resample_warp3d.clouds.coloring import colored
    from resample_warp3d.clouds.files import read_cloud
    from resample_warp3d.clouds.spacing import LARGEST, prepare_cloud

    columns = () if look.color_by is None else (look.color_by,)
    with session.stage("read", bar="reading") as progress, told(progress):
        cloud, scale = read_cloud(file, level=look.level, columns=columns), None
        if look.color_by is not None:
            cloud, scale = colored(cloud, look.color_by, colormap=look.colormap, span=look.span)
    with session.stage("prepare", bar="measuring") as progress, told(progress):
        surfels = prepare_cloud(
            cloud,
            largest=LARGEST if look.disc_limit is None else look.disc_limit,
            threads=look.threads,
            cache=not look.no_cache,
        )
    mention_origin(file.name, surfels)
    return CloudScene(surfels, look, scale)


def mention_origin(name: str, surfels: "Surfels") -> None:
    """Report the origin of a cloud that lies far from 0, such as a georeferenced one."""
    from resample_warp3d.clouds.parts import rows_of

    extent = max(
        (float(abs(surfels.position[rows]).max()) for rows in rows_of(surfels.position)),
        default=0.0,
    )
    if abs(surfels.origin).max() > FAR * extent:
        place = ", ".join(f"{part:.10g}" for part in surfels.origin)
        say(
            f"{name} is centered near {place}; positions are exact, poses in the file's coordinates"
        )


def start_of(camera: str, up: str) -> "Viewpoint":
    """Read a cloud's viewpoint; angles get the default field of view of clouds.

    Raises
    ------
    ValueError, LookupError, OSError
        It is not a perspective camera, or its file cannot be read.
    """
    from resample.cameras.files import viewpoint
    from resample_warp3d.clouds.framing import FIELD

    start = viewpoint(camera, FIELD, up)
    if getattr(start, "fov", FIELD) == 0:
        raise ValueError("a field of view of 0 degrees; clouds are seen in perspective")
    return start


def calibrated_of(pose: str | None, intrinsics: str | None) -> "Calibration | None":
    """Read the camera of --pose and --intrinsics, if given.

    Raises
    ------
    ValueError, LookupError, OSError
        Only one is given, the numbers do not make a camera, or a file cannot be read.
    """
    from resample.cameras.files import read_pose
    from resample_warp3d.command.cameras.intrinsics import with_intrinsics

    if pose is None and intrinsics is None:
        return None
    if pose is None or intrinsics is None:
        raise ValueError("--pose and --intrinsics belong together; give both, or --camera")
    calibration = with_intrinsics("intrinsics", intrinsics, "corner")
    return calibration._replace(camera=calibration.camera.moved(read_pose(pose)))


def camera_of(surfels: "Surfels", shape: Shape, viewpoint: "Viewpoint") -> Any:
    """Return the camera of a viewpoint; angles alone fit the cloud to the frame."""
    from resample.cameras.viewpoints import Orbit
    from resample_warp3d.clouds.framing import framed

    if not isinstance(viewpoint, Orbit):
        return _sized(viewpoint, shape)
    camera = framed(
        surfels,
        size=shape[::-1],
        azimuth=viewpoint.azimuth,
        elevation=viewpoint.elevation,
        up=viewpoint.up,
        fov=viewpoint.fov,
    )
    return _panned(_zoomed(camera, viewpoint.zoom), viewpoint.pan, surfels, shape)


def path_of(path: str, frames: int | None, fps: float, start: "Viewpoint") -> "list[Viewpoint]":
    """Return the viewpoints of all frames of a film.

    Parameters
    ----------
    path
        One of `PATHS`, or a file as `resample.cameras.keyframes.keyframes_of` takes it.
    frames
        Number of frames; None: `FRAMES`, or as many as the keyframes' times (s) need.
    fps
        Frames per second.
    start
        Start of the path, unless it has keyframes.

    Raises
    ------
    ValueError, OSError
        The path is unknown, the file is invalid, there are too few or too many frames, or the start
        is not a camera around the cloud.
    """
    from resample.cameras.keyframes import keyframes_of, left_out_of
    from resample.cameras.viewpoints import Orbit
    from resample.files.animations import MOST_FRAMES, check_count
    from resample_warp3d.clouds.framing import FIELD

    if path not in PATHS:
        if not Path(path).exists() and not Path(path).suffix:
            raise ValueError(
                f"unknown path {path!r}; known: {', '.join(PATHS)}, or a file of keyframes or poses"
            )
        keyframes = keyframes_of(Path(path), FIELD)
        complaint = left_out_of(Path(path))
        if complaint is not None:
            say(complaint)
        if frames is None:
            frames = 1 + round(min(keyframes.duration * fps, MOST_FRAMES))
        check_count(frames)
        return keyframes.between(frames)
    if not isinstance(start, Orbit):
        raise ValueError(
            f"the path {path} goes around the cloud; give --camera as azimuth/elevation/zoom, or a "
            "file of keyframes or poses as --path"
        )
    count = FRAMES if frames is None else frames
    check_count(count)
    turns = [n / count for n in range(count)]
    if path == "sway":
        angles = [start.azimuth + SWAY * math.sin(2.0 * math.pi * turn) for turn in turns]
    else:
        angles = [start.azimuth + 360.0 * turn for turn in turns]
    return [replace(start, azimuth=angle) for angle in angles]


def cameras_of(
    surfels: "Surfels", viewpoints: "Sequence[Viewpoint]", shape: Shape, *, steady: bool = False
) -> list[Any]:
    """Return the cameras of all frames; orbits keep one distance to the cloud's center.

    With `steady` it is the distance of steady pictures, which does not depend on the angles.
    """
    from resample.cameras.viewpoints import Orbit
    from resample_warp3d.clouds.framing import ball_around, framed_together

    around = [viewpoint for viewpoint in viewpoints if isinstance(viewpoint, Orbit)]
    if len(around) < len(viewpoints):
        return [_sized(viewpoint, shape) for viewpoint in viewpoints]
    if steady:
        ball = ball_around(surfels)
        return [each.around(ball, *shape) for each in around]
    first = around[0]
    cameras = framed_together(
        surfels,
        size=shape[::-1],
        angles=[(each.azimuth, each.elevation) for each in around],
        up=first.up,
        fov=first.fov,
    )
    wide = math.tan(math.radians(first.fov) / 2.0)
    return [
        _zoomed(camera, each.zoom * wide / math.tan(math.radians(each.fov) / 2.0))
        for camera, each in zip(cameras, around, strict=True)
    ]


def film_of(scene: CloudScene, cameras: Sequence[Any], shape: Shape, background: Any) -> "Shots":
    """Return the frames of a film of a cloud."""
    import numpy as np

    from resample.files.animations import Shots, fingerprint
    from resample.measuring.compare import shown

    bar = scene.bar(shape[0], background)

    def frame(n: int) -> Any:
        rgba = beside(scene.picture(cameras[n], shape).rgba, bar, background)
        return np.floor(np.clip(shown(rgba, background), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)

    surfels = scene.surfels
    job = {
        "cloud": fingerprint(surfels.origin, surfels.position, surfels.axes, surfels.color),
        "cameras": fingerprint(
            np.stack([camera.matrix for camera in cameras]),
            np.stack([camera.world_to_camera for camera in cameras]),
        ),
        "size": list(shape),
        "look": scene.options.model_dump(exclude={"threads", "no_cache"}),
        "background": list(background),
        "version": installed_version(),
    }
    return Shots(len(cameras), frame, job)


def frames_of(
    file: Path,
    look: CloudOptions,
    cameras: Sequence[Any],
    shape: Shape,
    background: Any,
    memory: int | None,
    threads: int,
) -> "Frames":
    """Return the function that makes frames of a file's cloud, within `memory` bytes."""
    from resample.command.session import Session
    from resample.memory import allow, allowing

    with allowing(None):
        if memory is not None:
            allow(memory)
        scene = scene_of(Session(), file, look.model_copy(update={"threads": threads}))
    return film_of(scene, cameras, shape, background).frame


def memory_of_each(workers: int) -> int | None:
    """Share `--memory` between this process and workers, in bytes; None: all free memory."""
    from resample.memory import ALLOWED, allow

    allowed = ALLOWED.get()
    if allowed is None or not workers:
        return allowed
    allow(allowed // (1 + workers))
    return ALLOWED.get()


def _sized(viewpoint: Any, shape: Shape) -> Any:
    """Return the camera of a viewpoint without angles."""
    return viewpoint.sized(*shape) if hasattr(viewpoint, "sized") else viewpoint


def _panned(
    camera: "Camera", pan: tuple[float, float], surfels: "Surfels", shape: Shape
) -> "Camera":
    """Shift the cloud's center right and up, in shares of the picture's shorter side."""
    from resample_warp3d.clouds.framing import ball_around

    if pan == (0.0, 0.0):
        return camera
    pose = camera.world_to_camera.copy()
    depth = float(pose[2, :3] @ ball_around(surfels)[0] + pose[2, 3])
    side = depth * min(shape) / camera.fx
    pose[:2, 3] += side * pan[0], -side * pan[1]
    return camera.moved(pose)


def _zoomed(camera: "Camera", zoom: float) -> "Camera":
    matrix = camera.matrix.copy()
    matrix[:2, :2] *= zoom
    return replace(camera, matrix=matrix)
