"""Options of the command line for warps."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from cyclopts import Parameter, Token
from pydantic import Field

from resample.command.flags import (
    CALIBRATED,
    COUNTED,
    LENS,
    SIZE,
    Coverage,
    Hyphen,
    Inline,
    OptionTopic,
    Stats,
    Switch,
)
from resample.command.settings import (
    Choices,
    Convention,
    MethodsFilter,
    Threads,
    height_and_width,
)
from resample.files.stores import opening

INTERPOLATIONS = (
    "Interpolation between texels: area-spline, lanczos, spline, catmull-rom, "
    "bilinear, nearest, gaussian."
)
MATRIX = Inline(rule="resample_texture.geometry.matrices:is_file")
Edges = Literal["transparent", "clamp", "wrap", "mirror"]


def _picture(_kind: Any, words: Sequence[Token]) -> opening.Place:
    """Return the path or address that was given."""
    return opening.place_of(words[-1].value)


Picture = Annotated[
    Path | opening.Address, Parameter(converter=_picture, n_tokens=1, accepts_keys=False)
]


class WarpGeometry(Choices):
    """The target of a warp, given by one of matrix, corners, map, flow and lens."""

    heading: ClassVar[str] = "Target"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    matrix: Annotated[
        str | None,
        MATRIX,
        Hyphen,
        Field(
            description="3 x 3 homography or 2 x 3 affine map from source to target: 9 or 6 "
            "numbers, or a text or .npy file; pixel centers at + 0.5."
        ),
    ] = None
    corners: Annotated[
        str | None,
        Hyphen,
        Field(
            description="x,y of four corners: where the picture's top left, top right, bottom "
            "right and bottom left go; or four points of the source -> four of the target."
        ),
    ] = None
    map: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="File of the source coordinates of every target pixel: .npy (H, W, 2), "
            ".npz with x and y, or a picture of two channels; pixel centers at + 0.5."
        ),
    ] = None
    flow: Annotated[
        Path | None,
        OptionTopic.SOURCE,
        Field(
            description="Displacement of every source pixel: a .flo file, or a file as for --map."
        ),
    ] = None
    lens: Annotated[
        str | None,
        LENS,
        Hyphen,
        Field(description=f"{CALIBRATED}. Its distortion is removed."),
    ] = None
    convention: Annotated[Convention, Field(description=f"{COUNTED} matrix, corners and map.")] = (
        "corner"
    )
    inverse: Annotated[
        bool,
        Switch,
        Field(
            description="Invert the mapping: the matrix maps target to source; a lens's distortion "
            "is added."
        ),
    ] = False
    size: Annotated[
        str | None,
        Field(description=f"{SIZE} [default: the source's; the map's; or what holds the corners]"),
    ] = None

    def check(self) -> None:
        """Refuse a wrong target before any picture is read."""
        self.given()
        self.shape()

    def given(self) -> tuple[str, Any]:
        """Return name and value of the option that was given."""
        names = ("matrix", "corners", "map", "flow", "lens")
        given = [(name, getattr(self, name)) for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            flags = ", ".join(f"--{name}" for name in names)
            found = " and ".join(f"--{name}" for name, _ in given) or "none"
            raise ValueError(f"give one of {flags}, not {found}")
        return given[0]

    def shape(self) -> tuple[int, int] | None:
        """Return height and width of the target, px, if given."""
        return None if self.size is None else height_and_width(self.size)


class PictureFiltering(Choices):
    """How texels become pixels."""

    heading: ClassVar[str] = "Method"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    method: Annotated[
        str,
        Field(
            description="Method: hybrid, paper, bilinear, opencv-supersample:n=8 ...; "
            "see resample plugins."
        ),
    ] = "hybrid"
    filter: MethodsFilter = None
    interpolation: Annotated[
        str | None,
        Field(description=f"{INTERPOLATIONS} [default: the method's own; area-spline for hybrid]"),
    ] = None
    quality: Annotated[
        float | None,
        Field(
            description="Parts per target px that texels are split into, 1 to 16. [default: 1.5 "
            "for hybrid]"
        ),
    ] = None
    linear: Annotated[bool, Field(description="Average linear light, or encoded values.")] = True
    encoding: Annotated[
        Literal["auto", "srgb", "linear"],
        Field(
            description="How the file encodes light in integers. Auto: as it says by a profile or "
            "mark; else 8 bits are sRGB and 16 bits linear."
        ),
    ] = "auto"
    threads: Threads = None

    @property
    def sampling(self) -> dict[str, Any]:
        """Options of the method, by the names that it has for them."""
        return self.model_dump(include={"filter", "interpolation", "quality"})

    def check(self) -> None:
        """Refuse unknown names before any work is done.

        Raises ValueError, LookupError: a plugin is unknown or refuses its parameters.
        """
        from resample import registry

        registry.build("methods", self.method)
        if self.filter is not None:
            registry.build("filters", self.filter)
        if self.interpolation is not None:
            registry.build("interpolations", self.interpolation)


class PictureWarping(PictureFiltering):
    """How a picture is warped."""

    edge: Annotated[Edges, Field(description="What lies beyond the picture's edges.")] = (
        "transparent"
    )
    total: Annotated[
        bool,
        Switch,
        Field(description="Values are totals, such as flux: preserve their sum, not their mean."),
    ] = False


class Filling(PictureWarping):
    """Options of a warp that fills its target, so that its edges must not fade."""

    edge: Annotated[Edges, Field(description="What lies beyond the picture's edges.")] = "clamp"


class Reports(Choices):
    """Which files are written besides a picture."""

    heading: ClassVar[str] = "Further outputs"
    about: ClassVar[OptionTopic] = OptionTopic.TARGET

    coverage: Coverage = None
    stats: Stats = None


class Besides(Reports):
    """Which part of a warp is written, and which files besides it."""

    roi: Annotated[
        str | None,
        OptionTopic.APPEARANCE,
        Field(
            description="Write only this part of the target: left,top,width,height in px. "
            "[default: all of it]"
        ),
    ] = None


def region(text: str | None) -> tuple[int, int, int, int] | None:
    """Read left, top, width and height from a text such as 10,20,300,200."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d+)[,\s]+(\d+)[,\s]+(\d+)[,\s]+(\d+)\s*", text, re.ASCII)
    if match is None:
        raise ValueError(f"roi {text!r}; give left,top,width,height in whole px, such as 0,0,64,64")
    left, top, width, height = (int(number) for number in match.groups())
    return left, top, width, height
