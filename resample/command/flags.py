"""Options that several commands have, as they are given; `settings` has those of models alone."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from resample.command.settings import CAMERA, HEADINGS, SIZE


def under(heading: str) -> Parameter:
    """Option that the help shows under one of `HEADINGS`."""
    return Parameter(group=Group(heading, sort_key=HEADINGS.index(heading)))


Flat = Parameter(name="*")  # a model's fields are flags of their own
Hyphen = Parameter(allow_leading_hyphen=True)  # -1,0,0 is a value, no flag
Switch = Parameter(negative="")  # there is no flag that says no

Output = Annotated[Path, Parameter(alias="-o")]
OptionalOutput = Annotated[Path | None, Parameter(alias="-o")]
FrameOutput = Annotated[
    Output, Parameter(help="Written to: .png, or .exr with linear RGBA, depth (Z) and coverage.")
]
FilmOutput = Annotated[
    Output,
    Parameter(help="Written to: .mp4, .webp, .gif, .apng, or a folder for numbered .png files."),
]
DemoOutput = Annotated[Output, Parameter(help="Written to: folder; created if missing.")]
Stats = Annotated[Path | None, Parameter(help="Also write sizes, counts and times (.json).")]
Json = Annotated[
    bool,
    Parameter(
        name="--json",
        negative="",
        help="Print JSON instead of a table; the PSNR of equal pictures is null.",
    ),
]

Size = Annotated[str, Parameter(help=SIZE)]
Bits = Annotated[Literal[8, 16], Parameter(help="Per channel: 8 or 16 of a PNG.")]
FilmBackground = Annotated[str, Parameter(help="Behind the picture: black, white or #rrggbb.")]
FramesPerSecond = Annotated[float, Parameter(help="Frames per second.")]
Resume = Annotated[
    bool, Switch, Parameter(help="Keep the frames that a run which ended early has made.")
]

Viewed = Annotated[
    str,
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
    under(CAMERA),
    Parameter(help="Degrees along the shorter side; 0 is parallel projection."),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"],
    Hyphen,
    under(CAMERA),
    Parameter(help="Axis that points upwards."),
]
