"""The command that shows pictures of one projection in another."""

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from cyclopts import Parameter
from pydantic import Field

from resample.command import flags
from resample.command.flags import SIZE, Hyphen, OptionTopic
from resample.command.settings import Choices, Written, height_and_width
from resample.words import parts_of
from resample_texture.command.choices import Besides, PictureFiltering, PictureWarping, Reports
from resample_texture.command.everyday import Files, Output

if TYPE_CHECKING:
    from resample_texture.command.inputs import PictureTarget


class BetweenProjections(Choices):
    """The projections of a picture and of its target."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    before: Annotated[
        str | None,
        Parameter(name="--from"),
        Field(
            description="What is given: the picture's projection, equirectangular, "
            "cubemap:layout=row, fisheye:fov=180,model=equidistant, stereographic, cylindrical, "
            "perspective:fov=90. [default: none; must be given]"
        ),
    ] = None
    after: Annotated[
        str | None,
        Parameter(name="--to"),
        Field(
            description="Projection of the target, as for --from. [default: none; must be given]"
        ),
    ] = None
    size: Annotated[str | None, Field(description=f"{SIZE} [default: none; must be given]")] = None
    turn: Annotated[
        str,
        Hyphen,
        Field(description="Turn the view right, up and clockwise by degrees: 30,10 or 30,10,5."),
    ] = "0,0,0"

    def check(self) -> None:
        """Refuse unknown projections, and a size or angles that are none."""
        from resample import registry

        before, after, shape = self.given()
        registry.check("projections", (before,))
        registry.build("projections", after).check(shape)
        self.angles()

    def given(self) -> tuple[str, str, tuple[int, int]]:
        """Return both projections, and height and width of the target, px.

        Raises ValueError: one is missing, or the size is none.
        """
        if self.before is None or self.after is None or self.size is None:
            options = {"--from": self.before, "--to": self.after, "--size": self.size}
            missing = " and ".join(name for name, value in options.items() if value is None)
            raise ValueError(f"give {missing}, too, such as --to perspective:fov=70 --size 640x480")
        return self.before, self.after, height_and_width(self.size)

    def angles(self) -> tuple[float, float, float]:
        """Return the angles in degrees.

        Raises ValueError: these are not two or three finite numbers.
        """
        from resample_texture.geometry.projections import rotation

        try:
            right, up, clockwise = (*map(float, parts_of(self.turn)), 0.0)[:3]
            rotation((right, up, clockwise))
        except ValueError:
            complaint = f"turn {self.turn!r}; give degrees right,up or right,up,clockwise, 30,10,0"
            raise ValueError(complaint) from None
        return right, up, clockwise

    def target(self, source_shape: tuple[int, int]) -> "PictureTarget":
        """Return the target of a picture (height, width)."""
        from resample import registry
        from resample_texture.command.inputs import PictureTarget
        from resample_texture.everyday import project
        from resample_texture.geometry.matrices import resizing

        before, after, shape = self.given()
        registry.build("projections", before).check(source_shape)
        angles: dict[str, Any] = {"turn": self.angles()}
        draws = partial(project, source=before, target=after, shape=shape, **angles)
        return PictureTarget(resizing(source_shape, shape), shape, draws)


PROJECTING = BetweenProjections.usual()
FILTERING, WRITTEN, REPORTS = PictureFiltering.usual(), Written.usual(), Reports.usual()


def project(
    files: Files,
    /,
    *,
    output: Output = None,
    projecting: Annotated[BetweenProjections, flags.Flat] = PROJECTING,
    filtering: Annotated[PictureFiltering, flags.Flat] = FILTERING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    reports: Annotated[Reports, flags.Flat] = REPORTS,
) -> None:
    r"""Show pictures of one projection in another, without seams: panoramas, cube maps, fisheyes.

    For example:

        resample-texture project sample:bricks a.png --size 400 \
            --from perspective:fov=90 --to fisheye:fov=90
        resample-texture project sample:bricks b.png --size 640x480 --turn 30,10 \
            --from fisheye:fov=180 --to perspective:fov=70
        resample-texture project sample:bricks c.png --size 400x200 \
            --from stereographic --to equirectangular
    """
    from resample_texture.command.jobs import warp_all

    projecting.check()
    warping = PictureWarping(**dict(filtering))
    besides = Besides(**dict(reports))
    warp_all(files, output, projecting.target, warping=warping, written=written, besides=besides)
