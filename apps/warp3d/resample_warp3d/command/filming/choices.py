"""Options of films of depth images."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from resample.command.flags import OptionTopic
from resample.command.settings import Choices


class FilmInput(Choices):
    """How films of depth images are read."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    temporal: Annotated[
        Literal["auto", "none"],
        Field(
            description="Relative depth of films: auto aligns the scale and shift of each map "
            "with those before it, from cut to cut, unless they agree already; none takes one "
            "range for all."
        ),
    ] = "auto"
    fps: Annotated[
        float | None,
        Field(description="Frames per second. [default: those of the film, or 24]"),
    ] = None
