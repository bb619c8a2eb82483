"""Options that several commands have, as they are given; `settings` has those of models alone."""

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from cyclopts import Group, Parameter

from resample.command.about import CAMERA as ANGLES
from resample.command.about import About
from resample.command.settings import CAMERA, HEADINGS, SIZE


def under(heading: str) -> Parameter:
    """Option that the help shows under one of `HEADINGS`."""
    return Parameter(group=Group(heading, sort_key=HEADINGS.index(heading)))


T = TypeVar("T")
Look = Annotated[T, About.LOOK]  # of options that no model has: they say how results look
Flat = Parameter(name="*")  # a model's fields are flags of their own
Hyphen = Parameter(allow_leading_hyphen=True)  # -1,0,0 is a value, no flag
Switch = Parameter(negative="")  # there is no flag that says no

Output = Annotated[Path, About.TARGET, Parameter(alias="-o")]
OptionalOutput = Annotated[Path | None, About.TARGET, Parameter(alias="-o")]
FrameOutput = Annotated[
    Output, Parameter(help="Written to: .png, or .exr with linear RGBA, depth (Z) and coverage.")
]
FilmOutput = Annotated[
    Output,
    Parameter(help="Written to: .mp4, .webp, .gif, .apng, or a folder for numbered .png files."),
]
DemoOutput = Annotated[Output, Parameter(help="Written to: folder; created if missing.")]
Stats = Annotated[
    Path | None, About.TARGET, Parameter(help="Also write sizes, counts and times (.json).")
]
Source = Annotated[Path | None, About.SOURCE]
Target = Annotated[Path | None, About.TARGET]
Json = Annotated[
    bool,
    About.LOOK,
    Parameter(
        name="--json",
        negative="",
        help="Print JSON instead of a table; the PSNR of equal pictures is null.",
    ),
]

Size = Annotated[str, About.LOOK, Parameter(help=SIZE)]
FilmBackground = Annotated[
    str, About.LOOK, Parameter(help="Behind the picture: black, white or #rrggbb.")
]
FramesPerSecond = Annotated[float, About.LOOK, Parameter(help="Frames per second.")]
Resume = Annotated[
    bool,
    About.TARGET,
    Switch,
    Parameter(help="Keep the frames that a run which ended early has made."),
]

Viewed = Annotated[
    str,
    ANGLES,
    Hyphen,
    under(CAMERA),
    Parameter(
        help="Where from: azimuth/elevation/zoom, such as 30/20/1.5, also with /right/up, by which "
        "the middle is moved in shares of the picture; front, back, left, right, top, bottom or "
        "corner; or a file of cameras."
    ),
]
FieldOfView = Annotated[
    float,
    About.LOOK,
    under(CAMERA),
    Parameter(help="Degrees along the shorter side; 0 is parallel projection."),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"],
    About.LOOK,
    Hyphen,
    under(CAMERA),
    Parameter(help="Axis that points upwards."),
]
