"""Options shared by several commands; `settings` has those that belong to models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

from cyclopts import Group, Parameter

from resample.command.about import CAMERA as ANGLES
from resample.command.about import OptionTopic
from resample.command.settings import CAMERA, HEADINGS, SIZE

if TYPE_CHECKING:
    from resample.cameras.viewpoints import Viewpoint


def under(heading: str) -> Parameter:
    """Parameter listed under one of `HEADINGS` in the help."""
    return Parameter(group=Group(heading, sort_key=HEADINGS.index(heading)))


def viewpoint(camera: str, fov: float, up: str) -> "Viewpoint":
    """Read a viewpoint; only one that is no angles loads the readers of camera files."""
    from resample.cameras.viewpoints import orbit_of

    orbit = orbit_of(camera, fov, up)
    if orbit is not None:
        return orbit
    from resample.cameras.files import viewpoint as viewpoint_in

    return viewpoint_in(camera, fov, up)


T = TypeVar("T")
AppearanceFlag = Annotated[
    T, OptionTopic.APPEARANCE
]  # options that belong to no model and affect the look
Flat = Parameter(name="*")  # the model's fields are flags themselves
Hyphen = Parameter(allow_leading_hyphen=True)  # values may begin with a hyphen, such as -1,0,0
Switch = Parameter(negative="")  # no --no-... flag

Output = Annotated[Path, OptionTopic.TARGET, Parameter(alias="-o")]
OptionalOutput = Annotated[Path | None, OptionTopic.TARGET, Parameter(alias="-o")]
FrameOutput = Annotated[
    Output, Parameter(help="Written to: .png, or .exr with linear RGBA, depth (Z) and coverage.")
]
FilmOutput = Annotated[
    Output,
    Parameter(help="Written to: .mp4, .webp, .gif, .apng, or a folder for numbered .png files."),
]
DemoOutput = Annotated[Output, Parameter(help="Written to: folder; created if missing.")]
Stats = Annotated[
    Path | None, OptionTopic.TARGET, Parameter(help="Also write sizes, counts and times (.json).")
]
Source = Annotated[Path | None, OptionTopic.SOURCE]
Target = Annotated[Path | None, OptionTopic.TARGET]
Json = Annotated[
    bool,
    OptionTopic.APPEARANCE,
    Parameter(
        name="--json",
        negative="",
        help="Print JSON instead of a table; the PSNR of equal pictures is null.",
    ),
]

Size = Annotated[str, OptionTopic.APPEARANCE, Parameter(help=SIZE)]
FilmBackground = Annotated[
    str, OptionTopic.APPEARANCE, Parameter(help="Background: black, white or #rrggbb.")
]
FramesPerSecond = Annotated[float, OptionTopic.APPEARANCE, Parameter(help="Frames per second.")]
Resume = Annotated[
    bool,
    OptionTopic.TARGET,
    Switch,
    Parameter(help="Keep the frames that an interrupted run has written."),
]

Viewed = Annotated[
    str,
    ANGLES,
    Hyphen,
    under(CAMERA),
    Parameter(
        help="Viewpoint: azimuth/elevation/zoom, such as 30/20/1.5; append /right/up to shift the "
        "center by fractions of the picture. Or front, back, left, right, top, bottom or "
        "corner, or a file of cameras."
    ),
]
FieldOfView = Annotated[
    float,
    OptionTopic.APPEARANCE,
    under(CAMERA),
    Parameter(help="Field of view along the shorter side in degrees; 0: parallel projection."),
]
Up = Annotated[
    Literal["x", "y", "z", "-x", "-y", "-z"],
    OptionTopic.APPEARANCE,
    Hyphen,
    under(CAMERA),
    Parameter(help="Axis that points up."),
]
Steady = Annotated[
    bool,
    OptionTopic.APPEARANCE,
    Switch,
    under(CAMERA),
    Parameter(
        help="Keep the same distance to the cloud's center at all angles, instead of fitting the "
        "cloud to the picture."
    ),
]
