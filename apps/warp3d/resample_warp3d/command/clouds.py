"""Point clouds on the command line: how they look, where from, and films of them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from cyclopts import Parameter
from pydantic import BeforeValidator, Field

from resample.command.about import NUMBERS, About
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
SWAY = 20.0  # degrees to either side
FAR = 100.0  # times its extent a cloud is from the origin when that is said


class CloudLook(Choices):
    """How a cloud is drawn."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[About] = About.LOOK

    color_by: Annotated[
        str | None,
        Field(
            description="Source of colors: a column of the file, such as intensity, or x, y or z."
        ),
    ] = None
    colormap: Annotated[
        str, Field(description="Of --color-by: one of matplotlib's, such as turbo or tab10.")
    ] = "viridis"
    span: Annotated[
        str | None,
        Parameter(name="--range", allow_leading_hyphen=True),
        Field(
            description="Values of the colormap's ends: low,high, or shares of the points, such as "
            "2%,98%. The least and the greatest."
        ),
    ] = None
    color_bar: Annotated[
        bool, Switch, Field(description="Add a bar to the right: of colors and values.")
    ] = False
    point_size: Annotated[
        float, Field(description="Factor of what the points' spacing suggests.")
    ] = 1.0
    disc_limit: Annotated[
        float | None,
        Field(
            description="How many times as large as those around it a point may be; inf for no "
            "limit. 1.75, and 1 for stray points."
        ),
    ] = None
    filter: Annotated[
        str | None,
        Field(description="Pixel filter, such as gaussian:sigma=0.6. The mean over a pixel."),
    ] = None
    light: Annotated[
        Literal["none", "eye"] | None,
        Field(
            description="Where light comes from: eye, for clouds without colors, or none, for "
            "others."
        ),
    ] = None
    one_sided: Annotated[bool, Switch, Field(description="Leave out what is seen from behind.")] = (
        False
    )
    level: Annotated[
        int,
        Field(
            ge=0,
            description="Level of detail; 0 is the finest. So many of the finest levels of a COPC "
            "file are left out.",
        ),
    ] = 0
    no_cache: Annotated[
        bool,
        About.RESOURCE,
        Switch,
        Field(description="Keep nothing of the cloud's neighbours on disk, and take nothing."),
    ] = False
    threads: Threads = None

    def check(self, output: Path, height: int) -> None:
        """Refuse what would be refused later, before any work is done.

        Raises
        ------
        ValueError, LookupError
            Something is unknown, out of range, or does not go together.
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
        """The style that `render_cloud` takes."""
        from resample_warp3d.clouds.rendering import CloudStyle, Light

        lights = {None: None, "none": Light.NONE, "eye": Light.HEADLIGHT}
        return CloudStyle(point_size=self.point_size, light=lights[self.light], cull=self.one_sided)


class CloudStart(Choices):
    """From where a cloud is seen, around it."""

    heading: ClassVar[str] = CAMERA
    about: ClassVar[About] = About.LOOK

    camera: Viewed = "30/20/1"
    up: Up = "z"
    steady: Annotated[
        bool,
        Switch,
        Field(
            description="Stand equally far from the cloud's middle at all angles, not where it "
            "fills the picture."
        ),
    ] = False


class CloudAim(CloudStart):
    """From where a cloud is seen."""

    pose: Annotated[
        str | None,
        About.SOURCE,
        Field(description="File or file:frame of a pose: in place of the camera, with intrinsics."),
    ] = None
    intrinsics: Annotated[
        str | None, NUMBERS, Hyphen, Field(description="fx,fy,cx,cy[,skew] in px; for a pose.")
    ] = None

    def check(self) -> None:
        """Refuse what is no camera, before any work is done.

        Raises
        ------
        ValueError, LookupError, OSError
            As of `start_of` and `calibrated_of`.
        """
        start_of(self.camera, self.up)
        calibrated_of(self.pose, self.intrinsics)

    def camera_for(self, surfels: "Surfels", shape: Shape) -> Any:
        """Camera for a picture (height, width) of a cloud; errors as of `check`."""
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
    """What kind of picture of a cloud is written."""

    heading: ClassVar[str] = "Picture"
    about: ClassVar[About] = About.LOOK

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
        """Size, px.

        Raises
        ------
        ValueError
            It is none, or the background is no color.
        """
        self.behind()
        return height_and_width(self.size)

    def behind(self) -> "Color | None":
        """Linear color behind the picture; None leaves it transparent."""
        return None if self.background is None else linear_color(self.background)

    def shown(self, frame: Any, scene: "CloudScene") -> Any:
        """Frame with the bar of its colors, if that is asked for."""
        behind = self.behind()
        bar = scene.bar(frame.rgba.shape[0], behind)
        return frame._replace(rgba=beside(frame.rgba, bar, behind))

    def write(self, path: Path, frame: Any, scene: "CloudScene") -> None:
        """Write a frame with its bar.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        from resample.files.images import write_frame

        write_frame(path, self.shown(frame, scene), bits=self.bits, background=self.behind())


class CloudScene(NamedTuple):
    """A cloud that is ready to be drawn."""

    surfels: "Surfels"
    look: CloudLook
    scale: "Scale | None"  # what its colors mean

    def picture(self, camera: "Camera | Calibration", shape: Shape) -> Any:
        """Frame that a camera sees."""
        from resample_warp3d.clouds.rendering import render_cloud

        look = self.look
        return render_cloud(
            self.surfels,
            _sized(camera, shape),
            size=shape[::-1],
            style=look.style(),
            filter=look.filter,
            threads=look.threads,
        )

    def bar(self, height: int, background: Any) -> "Floats | None":
        """Bar of the cloud's colors, if it is asked for."""
        from resample.measuring.color_bars import plain_bar

        if self.scale is None or not self.look.color_bar:
            return None
        colors, span, name = self.scale.colors(), self.scale.span, self.scale.name
        behind = background or (0.0, 0.0, 0.0)
        return plain_bar(colors, span, height, title=name, background=behind)


def beside(rgba: "Floats", bar: "Floats | None", background: Any) -> "Floats":
    """Picture with its bar, if it has one."""
    from resample.measuring.color_bars import with_color_bar

    return rgba if bar is None else with_color_bar(rgba, bar, background)


def scene_of(session: "Session", file: Path, look: CloudLook) -> CloudScene:
    """Cloud of a file, colored and measured.

    Raises
    ------
    ValueError, OSError
        It is no cloud, has not what is asked for, or cannot be read.
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
    """Say where a cloud is that lies far from the origin, as those of maps do."""
    from resample_warp3d.clouds.parts import rows_of

    extent = max(
        (float(abs(surfels.position[rows]).max()) for rows in rows_of(surfels.position)),
        default=0.0,
    )
    if abs(surfels.origin).max() > FAR * extent:
        place = ", ".join(f"{part:.10g}" for part in surfels.origin)
        say(f"{name} lies about {place}; places are exact, and poses are in its coordinates")


def start_of(camera: str, up: str) -> "Viewpoint":
    """Where a cloud is seen from; angles come with the field of view of clouds.

    Raises
    ------
    ValueError, LookupError, OSError
        It is no camera in perspective, or its file cannot be read.
    """
    from resample.cameras.files import viewpoint
    from resample_warp3d.clouds.framing import FIELD

    start = viewpoint(camera, FIELD, up)
    if getattr(start, "fov", FIELD) == 0:
        raise ValueError("a field of view of 0 degrees; clouds are seen in perspective")
    return start


def calibrated_of(pose: str | None, intrinsics: str | None) -> "Calibration | None":
    """Camera of the words of a pose and of intrinsics, if they are given.

    Raises
    ------
    ValueError, LookupError, OSError
        Only one is, the numbers are no camera's, or a file cannot be read.
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
    """Camera that looks at a cloud from where it fills the frame, if only angles are given."""
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
    """Viewpoints of all frames of a film.

    Parameters
    ----------
    path
        One of `PATHS`, or a file as `resample.cameras.keyframes.keyframes_of` takes it.
    frames
        How many; None are `FRAMES`, or as many as the keyframes' times ask for, in seconds.
    fps
        Frames per second.
    start
        Where the path starts, unless it has keyframes.

    Raises
    ------
    ValueError, OSError
        The path is unknown, the file's content is none, there are too few or too many frames, or
        the start is no camera around the cloud.
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
            f"the path {path} goes around the cloud; give its camera as azimuth/elevation/zoom, or "
            "a file of keyframes or poses as the path"
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
    """Cameras of all frames; those around the cloud stay at one distance from its middle.

    That of `steady` is the distance of pictures that are, whatever the angles.
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
    """Frames of a cloud."""
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
        "look": scene.look.model_dump(exclude={"threads", "no_cache"}),
        "background": list(background),
        "version": installed_version(),
    }
    return Shots(len(cameras), frame, job)


def frames_of(
    file: Path,
    look: CloudLook,
    cameras: Sequence[Any],
    shape: Shape,
    background: Any,
    memory: int | None,
    threads: int,
) -> "Frames":
    """Frames of the cloud of a file, within so many bytes; errors as of `scene_of`."""
    from resample.command.session import Session
    from resample.memory import allow, allowing

    with allowing(None):
        if memory is not None:
            allow(memory)
        scene = scene_of(Session(), file, look.model_copy(update={"threads": threads}))
    return film_of(scene, cameras, shape, background).frame


def memory_of_each(workers: int) -> int | None:
    """Bytes of `--memory` for this process and each of so many others; None: what is free."""
    from resample.memory import ALLOWED, allow

    allowed = ALLOWED.get()
    if allowed is None or not workers:
        return allowed
    allow(allowed // (1 + workers))
    return ALLOWED.get()


def _sized(viewpoint: Any, shape: Shape) -> Any:
    """Camera that a viewpoint without angles stands for."""
    return viewpoint.sized(*shape) if hasattr(viewpoint, "sized") else viewpoint


def _panned(
    camera: "Camera", pan: tuple[float, float], surfels: "Surfels", shape: Shape
) -> "Camera":
    """Camera by which the cloud's middle is moved to the right and up, in shares of the picture."""
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
