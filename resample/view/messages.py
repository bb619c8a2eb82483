"""Messages from a page to the viewer, validated."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

LARGEST = 2048  # px of a side
LONGEST = 65_536  # bytes of a message

Key = Annotated[str, Field(max_length=40)]
Camera = Annotated[str, Field(max_length=200)]
Text = Annotated[str, Field(max_length=1000)]
Value = bool | int | float | Text | Annotated[list[Text], Field(max_length=32)]
Settings = Annotated[dict[Key, Value], Field(max_length=100)]
Side = Annotated[int, Field(ge=8, le=LARGEST)]


class _Message(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    settings: Settings
    width: Side
    height: Side
    number: Annotated[int, Field(ge=0)]  # sequence number of the page's messages


class Draw(_Message):
    """Paint a picture; a newer request replaces pending ones."""

    kind: Literal["draw"]
    moving: bool  # a preview suffices
    other: Settings | None = None  # paint these as well, and measure the difference
    rival: Key | None = None  # let another renderer paint it, and measure the difference


class Pick(_Message):
    """Describe what is visible at a position."""

    kind: Literal["pick"]
    x: float  # px to the right; pixel centers are at halves
    y: float  # px down


class Slice(_Message):
    """Return an orthogonal slice of a volume through a voxel, in a picture of this size."""

    kind: Literal["slice"]
    plane: Key  # by its name, as the view lists it
    voxel: tuple[int, int, int]  # index along x, y and z
    window: tuple[float, float] | None = None  # values, as stored, that are black and white


class MeasureLine(_Message):
    """Return the length of a line, and the values along it."""

    kind: Literal["measure"]
    start: tuple[float, float, float]  # scene units
    end: tuple[float, float, float]


class Ask(_Message):
    """Return information on options, such as the points of a curve."""

    kind: Literal["ask"]
    what: Key


class Export(_Message):
    """Return commands and code that make the picture, and a film through keyframes."""

    kind: Literal["export"]
    keyframes: Annotated[list[Camera], Field(max_length=64)] = []


class MakeFilm(_Message):
    """Make a film through keyframes and report progress; a second message stops it."""

    kind: Literal["film"]
    keyframes: Annotated[list[Camera], Field(max_length=64)]  # empty: stop the film


class Save(_Message):
    """Return the picture as a file."""

    kind: Literal["save"]
    suffix: Literal[".png", ".exr"]


Message = Draw | Pick | Slice | MeasureLine | Ask | Export | MakeFilm | Save
_adapter: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def message_of(text: str) -> Message:
    """Parse a message of a page."""
    if len(text) > LONGEST:
        raise ValueError(f"a message of {len(text)} letters; at most {LONGEST} are allowed")
    return _adapter.validate_json(text)
