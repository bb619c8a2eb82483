"""Render clouds for the command line."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from resample.command.settings import FrameFormat
from resample.console import say
from resample_points.command.cameras import Shape, sized
from resample_points.command.choices import CloudOptions, beside

if TYPE_CHECKING:
    from resample.cameras.calibrations.lens_files import Calibration
    from resample.cameras.models import Camera
    from resample.command.session import Session
    from resample.types import Floats
    from resample_points.data.coloring import Scale
    from resample_points.geometry.spacing import Surfels

CHANNELS = 4  # of a picture, with its opacity
FAR = 100.0  # times its extent from which a cloud's distance to the origin is reported


class CloudScene(NamedTuple):
    """A cloud, ready to be rendered."""

    surfels: "Surfels"
    options: CloudOptions
    scale: "Scale | None"  # scale of its colors

    def picture(self, camera: "Camera | Calibration", shape: Shape) -> Any:
        """Render a frame."""
        from resample_points.painting.rendering import render_cloud

        look = self.options
        return render_cloud(
            self.surfels,
            sized(camera, shape),
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

    def shown(self, frame: Any, form: FrameFormat) -> Any:
        """Return a frame, with the color bar if requested."""
        behind = form.behind()
        bar = self.bar(frame.rgba.shape[0], behind)
        return frame._replace(rgba=beside(frame.rgba, bar, behind))

    def write(self, path: Path, frame: Any, form: FrameFormat) -> None:
        """Write a frame with its color bar."""
        from resample.files.saving import write_frame

        write_frame(path, self.shown(frame, form), bits=form.bits, background=form.behind())


def scene_of(session: "Session", file: Path, look: CloudOptions) -> CloudScene:
    """Read, color and prepare the cloud of a file."""
    from resample.watching import told
    from resample_points.data.coloring import colored
    from resample_points.files.readers import read_cloud
    from resample_points.geometry.spacing import LARGEST, prepare_cloud

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
    from resample_points.data.parts import rows_of

    extent = max(
        (float(abs(surfels.position[rows]).max()) for rows in rows_of(surfels.position)),
        default=0.0,
    )
    if abs(surfels.origin).max() > FAR * extent:
        place = ", ".join(f"{part:.10g}" for part in surfels.origin)
        say(
            f"{name} is centered near {place}; positions are exact, poses in the file's coordinates"
        )


def check_memory(shape: Shape, output: Path, workers: int = 0) -> None:
    """Refuse a picture (height, width) that does not fit into memory, here and in workers."""
    from resample.command.session import bytes_per_value, require_picture

    require_picture(shape, CHANNELS * bytes_per_value(output), workers=workers)
