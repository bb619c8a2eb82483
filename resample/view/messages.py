"""What a page may say to the viewer, checked: kinds, sizes, and options as in settings files."""

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
    number: Annotated[int, Field(ge=0)]  # which of the page's messages it is


class Draw(_Message):
    """Paint a picture; the latest is painted, those before it are forgotten."""

    kind: Literal["draw"]
    moving: bool  # a preview will do
    other: Settings | None = None  # paint these as well, and tell how far apart both are
    rival: Key | None = None  # have another renderer paint it, and tell how far apart both are


class Pick(_Message):
    """Tell what is seen at a place."""

    kind: Literal["pick"]
    x: float  # px to the right; centers are at halves
    y: float  # px down


class Ask(_Message):
    """Tell what a painter knows of the options, such as the points of a curve."""

    kind: Literal["ask"]
    what: Key


class Export(_Message):
    """Tell how the picture, and a film through keyframes, are made without the viewer."""

    kind: Literal["export"]
    keyframes: Annotated[list[Camera], Field(max_length=64)] = []


class MakeFilm(_Message):
    """Give the film through keyframes as a file, telling how far it is; a second one stops it."""

    kind: Literal["film"]
    keyframes: Annotated[list[Camera], Field(max_length=64)]  # none: stop the film


class Save(_Message):
    """Give the picture as a file."""

    kind: Literal["save"]
    suffix: Literal[".png", ".exr"]


Message = Draw | Pick | Ask | Export | MakeFilm | Save
_adapter: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def message_of(text: str) -> Message:
    """Message of a page.

    Raises
    ------
    ValueError
        It is none.
    """
    if len(text) > LONGEST:
        raise ValueError(f"a message of {len(text)} letters; {LONGEST} at most are read")
    return _adapter.validate_json(text)
