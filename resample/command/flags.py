"""Options of commands: topics, headings, help texts, and shared flags.

Settings from untrusted files may only change the look of a picture. So an option states its
category by a mark in its annotation or by its model; one without is not taken from a file.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from cyclopts import Group, Parameter

from resample.console import note
from resample.messages import numbers_in

if TYPE_CHECKING:
    from cyclopts.argument import Argument
    from pydantic import BaseModel

    from resample.cameras.calibrations import Calibration
    from resample.cameras.models import AnyConvention
    from resample.cameras.poses import UpAxis
    from resample.cameras.viewpoints import Viewpoint

Shape = tuple[int, int]  # height and width, px
FILES = "a file of Open3D (.json), ROS (.yaml) or OpenCV (.yml, .xml)"


class OptionTopic(Enum):
    """Category of an option. All but `APPEARANCE` must be set by the user."""

    APPEARANCE = "look"  # appearance of the picture
    SOURCE = "source"  # other files that are read
    TARGET = "target"  # files that are written, addresses that are served or called
    RESOURCE = "resource"  # memory, threads and processes
    TRUST = "trust"  # what files are allowed to do


class Inline(NamedTuple):
    """`APPEARANCE`, unless the option's reader would treat the value as a file name."""

    known: tuple[str, ...] = ()  # words that do not name files
    rule: str = ""  # module and function that tells whether another text is a file; none: all are

    def names_file(self, text: str) -> bool:
        """Whether a text names a file."""
        if text in self.known:
            return False
        module, _, function = self.rule.partition(":")
        return not module or bool(getattr(import_module(module), function)(text))


Mark = OptionTopic | Inline
Marks = Mapping[str, Mark | None]  # marks of options, by name

ANGLES = Inline(rule="resample.cameras.viewpoints:is_file")
LENS = Inline(rule="resample.cameras.calibrations:is_file")

FULL = "--help"
DEFAULT = re.compile(r"\s*\[default: (.*)\]\s*$", re.DOTALL)  # at the end of a help text
NOTHING = (None, (), "", inspect.Parameter.empty)

# Beginnings of help texts.
SIZE = "Size in px: 400 for a square, 640x480 for width and height."
USUAL_SIZE = "640x480"  # of pictures and films without a given size
SQUARE = f"{SIZE} A volume fits a square from all sides; published times are for 400."
CALIBRATED = (
    "Lens: fx,fy,cx,cy,k1,k2,p1,p2[,k3...], or a .yml, .xml, .json or .toml file of OpenCV's "
    "calibration"
)
MEMORY = "Memory limit, such as 2GiB"
COUNTED = "Pixel coordinates are 0 at the first pixel's corner, or at its center (opencv): in"

CAMERA, LIGHT, SETTINGS, LIMITS = "Camera", "Light", "Settings", "Limits"
HEADINGS = (  # in the order of the help
    *("Input", "Source camera", "Several sources", "Further volumes", "Target", "Look"),
    *("3D Gaussians", LIGHT),
    *(CAMERA, "Stereo", "Projection", "Method", "Picture", "Films", "Annotations and objects"),
    *("Further outputs", "Page", "Workers", SETTINGS, LIMITS),
)


def described(argument: "Argument") -> tuple[str, str]:
    """Help text and default of an argument; no default if required or off."""
    text = " ".join((argument.parameter.help or "").split())
    stated = DEFAULT.search(text)
    if stated:
        return text[: stated.start()], stated[1]
    default = argument.field_info.default
    if argument.parameter.required or (argument.required and default in NOTHING):
        return text, ""
    if isinstance(default, bool):
        return text, "" if argument.parameter.negative == () else ("on" if default else "off")
    if any(default is empty or default == empty for empty in NOTHING):
        return text, "none"
    return text, f"{default:g}" if isinstance(default, float) else str(default)


def about(mark: Mark | None, value: object) -> OptionTopic | None:
    """Category of an option's value; None if the option states none."""
    if not isinstance(mark, Inline):
        return mark
    names_file = isinstance(value, str) and mark.names_file(value)
    return OptionTopic.SOURCE if names_file else OptionTopic.APPEARANCE


def marks_of(command: Callable[..., Any]) -> Marks:
    """Marks of all options of a command, by name without leading hyphens."""
    hints = get_type_hints(command, include_extras=True)
    found: dict[str, Mark | None] = {}
    for part in inspect.signature(command).parameters.values():
        if part.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        kind = hints[part.name]
        model = model_in(kind)
        if model is None:
            metadata = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
            found[name_of(part.name, metadata)] = _mark_in(metadata)
        else:
            usual = getattr(model, "about", None)
            for field, info in model.model_fields.items():
                own = _mark_in(info.metadata)
                found[name_of(field, info.metadata)] = usual if own is None else own
    return found


def model_in(kind: Any) -> "type[BaseModel] | None":
    """Model with options as fields; None if the argument is not such a model."""
    from pydantic import BaseModel

    inner = get_origin(kind) is Annotated and get_args(kind)[0]
    return inner if isinstance(inner, type) and issubclass(inner, BaseModel) else None


def name_of(field: str, metadata: Any) -> str:
    """Name of an option without leading hyphens."""
    for part in metadata:
        if isinstance(part, Parameter) and part.name:
            return str(next(iter(part.name))).removeprefix("--")
    return field.replace("_", "-")


def _mark_in(metadata: Any) -> Mark | None:
    return next((part for part in metadata if isinstance(part, OptionTopic | Inline)), None)


def under(heading: str) -> Parameter:
    """Parameter listed under one of `HEADINGS` in the help."""
    return Parameter(group=Group(heading, sort_key=HEADINGS.index(heading)))


def viewpoint(camera: str, fov: float, up: "UpAxis") -> "Viewpoint":
    """Read a viewpoint; loads the readers of camera files unless it is angles."""
    tell_radians(fov)
    from resample.cameras.viewpoints import orbit_of

    orbit = orbit_of(camera, fov, up)
    if orbit is not None:
        return orbit
    from resample.cameras.files import viewpoint as viewpoint_in

    return viewpoint_in(camera, fov, up)


def tell_radians(fov: float | None) -> None:
    """Warn that a field of view may be in radians."""
    if fov is not None and 0.3 < fov < 3.15:
        note(f"the field of view is {fov:g} degrees; if radians are meant, give {fov * 57.296:.4g}")


T = TypeVar("T")
AppearanceFlag = Annotated[
    T, OptionTopic.APPEARANCE
]  # options that belong to no model and affect the look
Flat = Parameter(name="*")  # the model's fields are flags themselves
Hyphen = Parameter(allow_leading_hyphen=True)  # values may begin with a hyphen, such as -1,0,0
Switch = Parameter(negative="")  # no --no-... flag
Several = Parameter(allow_leading_hyphen=True, negative="", show_default=False)  # given repeatedly

Output = Annotated[Path, OptionTopic.TARGET, Parameter(alias="-o")]
OptionalOutput = Annotated[Path | None, OptionTopic.TARGET, Parameter(alias="-o")]
FrameOutput = Annotated[
    Output,
    Parameter(
        help="Written to: .png, .jpg, .tif, .webp, or .exr with linear RGBA, depth (Z), coverage."
    ),
]
FilmOutput = Annotated[
    Output,
    Parameter(help="Written to: .mp4, .webp, .gif, .apng, or a folder for numbered .png files."),
]
DemoOutput = Annotated[Output, Parameter(help="Written to: folder; created if missing.")]
Stats = Annotated[
    Path | None, OptionTopic.TARGET, Parameter(help="Also write sizes, counts and times (.json).")
]
Coverage = Annotated[
    Path | None,
    OptionTopic.TARGET,
    Parameter(help="Also write the share of each pixel that is covered (.png, .tif, .exr)."),
]
Source = Annotated[Path | None, OptionTopic.SOURCE]
Target = Annotated[Path | None, OptionTopic.TARGET]

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
        help="Viewpoint: azimuth,elevation,zoom, such as 30,20,1.5; append ,right,up to shift the "
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
    Parameter(
        help="Axis that points up; z, but y for meshes (as in glTF and OBJ), and the file's "
        "for 3D Gaussians."
    ),
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


def check_intrinsics(name: str, text: str) -> None:
    """Reject anything but numbers for `with_intrinsics` or a camera file."""
    with_intrinsics(name, text, "corner")


def with_intrinsics(name: str, text: str, convention: "AnyConvention") -> "Calibration":
    """Read intrinsics from numbers, or from a file in its own program's convention."""
    from resample.cameras.calibrations import Calibration, is_file, read_intrinsics
    from resample.cameras.models import Camera

    if is_file(text):
        return read_intrinsics(text)
    numbers = numbers_in(name, text)
    if len(numbers) not in (4, 5):
        raise ValueError(f"{name} {text!r}; give fx,fy,cx,cy or fx,fy,cx,cy,skew")
    fx, fy, cx, cy, skew = [*numbers, 0.0][:5]
    return Calibration(Camera.from_intrinsics(fx, fy, cx, cy, skew=skew, convention=convention))
