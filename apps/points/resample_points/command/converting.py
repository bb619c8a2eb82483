"""Convert files of 3D Gaussians for the command line."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from resample.command.flags import OptionTopic, Several
from resample.command.settings import Choices
from resample_points.command.choices import CloudOptions, Crop
from resample_points.command.gaussians import GaussianOptions, Largest, LeastOpacity

if TYPE_CHECKING:
    from resample.command.session import Session


class ConvertOptions(Choices):
    """What is written of 3D Gaussians."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    also: Annotated[
        tuple[str, ...],
        OptionTopic.SOURCE,
        Several,
        Field(
            description="Another scene to join, and a file of its pose: b.ply or b.ply,pose.txt."
        ),
    ] = ()
    pose: Annotated[
        str | None,
        OptionTopic.SOURCE,
        Field(description="File of a pose: the scene is moved and turned by it."),
    ] = None
    crop: Crop = None
    degree: Annotated[
        int | None, Field(ge=0, le=3, description="Highest degree of harmonics to keep.")
    ] = None
    least_opacity: LeastOpacity = 0.0
    largest: Largest = None

    def check(self) -> None:
        """Refuse invalid options before any work is done."""
        from resample_points.data.selecting import box_of

        box_of(self.crop)


def converted(session: "Session", file: Path, output: Path, options: ConvertOptions) -> None:
    """Read Gaussians, and write what the options keep of them."""
    from resample.cameras.files import read_pose
    from resample.console import say
    from resample.memory import amount
    from resample_points.command.gaussians import gaussians_read
    from resample_points.data.gaussians import Gaussians
    from resample_points.data.harmonics import COUNTS
    from resample_points.data.joining import DOWN, placed_gaussians, with_up
    from resample_points.files.gaussians.writing import suffix_of, write_gaussians

    clouds = CloudOptions(also=options.also, crop=options.crop)
    kept = GaussianOptions(least_opacity=options.least_opacity, largest=options.largest)
    scene = gaussians_read(session, file, clouds, kept)
    if not isinstance(scene, Gaussians):
        raise ValueError(f"{file.name} has {scene.file.count:,} Gaussians, too many for the memory")
    if options.pose is not None:
        scene = placed_gaussians(scene, read_pose(options.pose))
    width = scene.harmonics.shape[1]
    if options.degree is not None:
        width = min(width, COUNTS[options.degree])
        scene = scene._replace(harmonics=scene.harmonics[:, :width])
    is_ply = [name.suffix.lower() == ".ply" for name in (file, output)]
    if is_ply == [False, True]:  # most programs that read PLY do not read its axis
        scene = with_up(scene, DOWN)._replace(up=None)
    with session.stage("write", bar="writing"):
        write_gaussians(output, scene)
    lost = "" if suffix_of(output) != ".splat" or not width else "; .splat has no harmonics"
    say(
        f"{output.name}: {len(scene.opacity):,} Gaussians with harmonics of degree "
        f"{COUNTS.index(width)}, {amount(output.stat().st_size)}{lost}"
    )
