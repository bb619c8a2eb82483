"""Options of commands for point clouds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from cyclopts import Parameter
from pydantic import Field

from resample.command.flags import (
    CAMERA,
    LENS,
    FieldOfView,
    Hyphen,
    OptionTopic,
    Several,
    Steady,
    Switch,
    Up,
    Viewed,
    viewpoint,
)
from resample.command.settings import Choices, Threads

if TYPE_CHECKING:
    from resample.cameras.calibrations import Calibration
    from resample.cameras.viewpoints import Viewpoint
    from resample_points.data.cloud import Cloud
    from resample_points.data.columns import Wanted
    from resample_points.geometry.spacing import Surfels
    from resample_points.scenes import Shape


Crop = Annotated[
    str | None,
    Hyphen,
    Field(description="Crop to ranges along x, y, z: 0:10,:,-2:3 in scene units."),
]
Only = Annotated[
    tuple[str, ...],
    Several,
    Field(
        description="Show only points with these values of a column, or of x, y or z: "
        "classification=2, classification=2,5:6 or intensity=100:."
    ),
]


class CloudOptions(Choices):
    """Look of a point cloud."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    also: Annotated[
        tuple[str, ...],
        OptionTopic.SOURCE,
        Several,
        Field(
            description="Another file in the scene, placed by its coordinates: b.laz or another."
        ),
    ] = ()
    only: Only = ()
    crop: Crop = None
    color_by: Annotated[
        str | None,
        Field(
            description="Source of colors: a column of the file, such as intensity, or x, y or z. "
            "[default: the file's colors, or white]"
        ),
    ] = None
    colormap: Annotated[
        str, Field(description="Colormap, one of matplotlib's, such as turbo or tab10.")
    ] = "viridis"
    span: Annotated[
        str | None,
        Parameter(name="--range", allow_leading_hyphen=True),
        Field(
            description="Values at the ends of the colormap: low,high, or quantiles such as "
            "2%,98%. [default: the column's least and greatest value]"
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
            "[default: 1.75; 1 for stray points]"
        ),
    ] = None
    filter: Annotated[
        str | None, Field(description="Pixel filter, such as gaussian:sigma=0.6. [default: box]")
    ] = None
    light: Annotated[
        Literal["none", "eye"] | None,
        Field(
            description="Where light comes from: eye, the camera, or none. [default: eye for "
            "clouds without colors, otherwise none]"
        ),
    ] = None
    edl: Annotated[
        float,
        Field(
            description="Strength of eye-dome lighting, which darkens what lies behind edges, "
            "such as 1."
        ),
    ] = 0.0
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
        """Reject invalid options before any work is done."""
        from resample import registry
        from resample.colors import check_colormap
        from resample_points.data.columns import box_of

        self.style()
        self.conditions()
        box_of(self.crop)
        if "colormap" in self.model_fields_set:  # matplotlib takes a while to import
            check_colormap(self.colormap)
        if self.filter is not None:
            registry.build("filters", self.filter)
        if self.color_by is None and (self.color_bar or self.span is not None):
            raise ValueError("--color-bar and --range belong to --color-by; give it a column")
        if self.color_bar:
            from resample.measuring.color_bars import check_bar

            check_bar(output, height)

    def conditions(self) -> "list[Wanted]":
        """Return the conditions of --only."""
        from resample_points.data.columns import wanted_of

        return [wanted_of(text) for text in self.only]

    def style(self) -> Any:
        """Return the style for `render_cloud`."""
        from resample_points.painting.rendering import CloudStyle, Shading

        lights = {None: None, "none": Shading.NONE, "eye": Shading.HEADLIGHT}
        light, size = lights[self.light], self.point_size
        return CloudStyle(point_size=size, light=light, cull=self.one_sided, edl=self.edl)


class CloudStart(Choices):
    """Camera around a point cloud."""

    heading: ClassVar[str] = CAMERA
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    camera: Viewed = "30,20,1"
    fov: FieldOfView = 40.0
    up: Up = "z"
    steady: Steady = False

    def start(self) -> "Viewpoint":
        """Return the viewpoint; raises if it is invalid."""
        return viewpoint(self.camera, self.fov, self.up)


Aimed = TypeVar("Aimed", bound=CloudStart)


class CloudAim(CloudStart):
    """Camera of a point cloud."""

    pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(description="File or file:frame of a pose; instead of --camera, needs --intrinsics."),
    ] = None
    intrinsics: Annotated[
        str | None, LENS, Hyphen, Field(description="fx,fy,cx,cy[,skew] in px; for --pose.")
    ] = None
    panorama: Annotated[
        str | None,
        Field(
            description="Projection of a picture all around the camera: equirectangular, "
            "fisheye:fov=200, stereographic or cylindrical; with --pose, which needs no intrinsics."
        ),
    ] = None

    def check(self) -> None:
        """Reject invalid cameras before any work is done."""
        self.start()
        panorama_of(self.panorama)
        if self.panorama is None:
            calibrated_of(self.pose, self.intrinsics)
        elif self.intrinsics is not None:
            raise ValueError("--intrinsics are for a pinhole or lens; leave them out of --panorama")

    def camera_for(self, surfels: "Surfels | Cloud", shape: "Shape") -> Any:
        """Return the camera for a picture (height, width) of a cloud; raises as `check` does."""
        from resample.cameras.viewpoints import Orbit
        from resample_points.geometry.framing import ball_around
        from resample_points.scenes import camera_of, sized

        if self.panorama is not None:  # at a pose, or where --camera is
            if self.pose is not None:
                from resample.cameras.files import read_pose

                pose = read_pose(self.pose)
            else:
                pose = camera_of(surfels, shape, self.start()).world_to_camera
            return panorama_of(self.panorama).moved(pose)
        calibrated = calibrated_of(self.pose, self.intrinsics)
        if calibrated is not None:
            return sized(calibrated, shape)
        start = self.start()
        if self.steady and isinstance(start, Orbit):
            return start.around(ball_around(surfels), *shape)
        return camera_of(surfels, shape, start)


def panorama_of(name: str | None) -> Any:
    """Return the camera of a projection, at 0; None without one."""
    if name is None:
        return None
    from resample.cameras.pixels import Equirectangular
    from resample_points.painting.bending import ProjectedCamera

    if name == "equirectangular":
        return Equirectangular()
    return ProjectedCamera(name)


def calibrated_of(pose: str | None, intrinsics: str | None) -> "Calibration | None":
    """Read the camera of --pose and --intrinsics, if given."""
    if pose is None and intrinsics is None:
        return None
    if pose is None or intrinsics is None:
        raise ValueError("--pose and --intrinsics belong together; give both, or --camera")
    from resample.cameras.files import read_pose
    from resample.command.flags import with_intrinsics

    calibration = with_intrinsics("intrinsics", intrinsics, "corner")
    return calibration._replace(camera=calibration.camera.moved(read_pose(pose)))
