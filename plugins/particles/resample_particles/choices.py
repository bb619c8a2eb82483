"""Options of `resample-points density`, and how its maps are written."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from cyclopts import Parameter
from pydantic import Field

from resample.command.flags import Hyphen, OptionTopic, Switch
from resample.command.settings import Choices, FrameFormat, Threads
from resample.files.animations import FILMS
from resample_points.command.choices import CloudStart, Crop

if TYPE_CHECKING:
    from resample_particles.density import DensityMap

NUMBERS = (".npy", ".exr")
PICTURES = (".png",)


class DensityOptions(Choices):
    """What a map of particles shows."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    kind: Annotated[
        str,
        Parameter(name="--type"),
        Field(description="Type of the particles of a snapshot: gas, dark, stars, or 0 to 6."),
    ] = "gas"
    kernel: Annotated[
        Literal["cubic", "wendland", "gaussian"],
        Parameter(name="--smoothing-kernel"),
        Field(description="Smoothing kernel: cubic spline, wendland (C2) or gaussian."),
    ] = "cubic"
    quantity: Annotated[
        str | None,
        Field(
            description="Quantity to average by mass, such as temperature. [default: the "
            "column density]"
        ),
    ] = None
    log: Annotated[
        bool | None,
        Field(
            description="Logarithmic scale of colors. [default: on for densities, off for means]"
        ),
    ] = None
    axis: Annotated[
        Literal["x", "y", "z"] | None,
        Field(
            description="Axis along which is projected, in one map. [default: z, unless --camera "
            "is given]"
        ),
    ] = None
    crop: Crop = None
    slice: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Cut by a plane: where along the axis, in scene units or as a share of the "
            "range (50%); or its depth before the camera."
        ),
    ] = None
    span: Annotated[
        str | None,
        Parameter(name="--range", allow_leading_hyphen=True),
        Field(
            description="Values at the ends of the colormap: low,high, or quantiles such as "
            "2%,98%. [default: all; with --log at most 5 powers of ten]"
        ),
    ] = None
    colormap: Annotated[
        str, Field(description="Colormap, one of matplotlib's, such as turbo or tab10.")
    ] = "inferno"
    color_bar: Annotated[
        bool, Switch, Field(description="Add a bar to the right: the colors and their values.")
    ] = False
    threads: Threads = None

    def check(self, output: Path, height: int, start: CloudStart) -> None:
        """Refuse invalid options of a map before any work is done."""
        if output.suffix.lower() not in (*PICTURES, *NUMBERS):
            raise ValueError(
                f"{output}: maps are written as .png in colors, .exr or .npy in numbers; films as "
                f"{', '.join(FILMS)} or a folder"
            )
        self.check_appearance(output, height)
        start.start()
        if self.axis is not None and start.model_fields_set:
            raise ValueError("--axis and --camera are two views; give one of them")
        if start.model_fields_set and self.crop is not None and self.slice is not None:
            number_of(self.slice)
        if self.color_bar and output.suffix.lower() in NUMBERS:
            raise ValueError(f"{output}: numbers have no color bar; write a .png, or leave it out")

    def check_film(self, output: Path, height: int, form: FrameFormat) -> None:
        """Refuse invalid options of a film before any work is done."""
        self.check_appearance(output, height)
        if self.axis is not None:
            raise ValueError("--axis is for one map; films go around by --camera and --path")
        if self.slice is not None:
            number_of(self.slice)
        if form.bits != 8:
            raise ValueError(f"{output}: films have 8 bits per channel; leave --bits out")

    def check_appearance(self, output: Path, height: int) -> None:
        """Refuse invalid options of pictures and films."""
        from resample.colors import check_colormap
        from resample.measuring.color_bars import check_bar
        from resample_particles.files import type_of
        from resample_points.data.columns import box_of

        type_of(self.kind)
        box_of(self.crop)
        check_colormap(self.colormap)
        if self.color_bar:
            check_bar(output, height)


def number_of(text: str) -> float:
    """Return where a slice is, from text."""
    from resample.messages import numbers_in

    return numbers_in("a slice at", text, 1)[0]


def write_map(path: Path, found: "DensityMap", options: DensityOptions, form: FrameFormat) -> None:
    """Write a map: its numbers, or a picture in colors; say its range and units."""
    from resample.console import say
    from resample.files.saving import write_png
    from resample.measuring.color_bars import with_color_bar
    from resample_particles.mapping import map_picture
    from resample_points.data.parts import span_in

    span = span_in(found.value)
    if span is None:
        raise ValueError("no particle is in the picture")
    if path.suffix.lower() in NUMBERS:
        found.save(path)
    else:
        picture = map_picture(found, colormap=options.colormap, span=options.span, log=options.log)
        rgba, behind = picture.rgba, form.behind()
        if options.color_bar:
            rgba = with_color_bar(rgba, picture.bar(behind), behind)
        write_png(path, rgba, bits=form.bits, background=behind)
    say(f"{found.name}: {span[0]:.4g} to {span[1]:.4g} {found.units or 'in units of the file'}")
