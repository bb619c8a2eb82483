"""Pydantic models of OME-Zarr attributes; imported when a store is read."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

Number = Annotated[float, Field(allow_inf_nan=False)]


class Axis(BaseModel):
    """One axis of all arrays."""

    name: str
    type: str | None = None
    unit: str | None = None


class Transformation(BaseModel):
    """Scale or translation; numbers in separate files belong to older versions."""

    type: Literal["identity", "scale", "translation"]
    scale: list[Number] | None = None
    translation: list[Number] | None = None


class Dataset(BaseModel):
    """One resolution level."""

    path: str
    transformations: Annotated[
        list[Transformation], Field(alias="coordinateTransformations", min_length=1)
    ]


class Multiscale(BaseModel):
    """One image at several resolutions."""

    axes: Annotated[list[Axis], Field(min_length=2, max_length=5)]
    datasets: Annotated[list[Dataset], Field(min_length=1, max_length=64)]  # each half the last
    transformations: Annotated[list[Transformation], Field(alias="coordinateTransformations")] = []


class Window(BaseModel):
    """Values that are dark and bright."""

    start: Number
    end: Number


class Channel(BaseModel):
    """Look of a channel, as OMERO has it."""

    label: str = ""
    color: Annotated[str, Field(pattern="^#?[0-9A-Fa-f]{6}([0-9A-Fa-f]{2})?$")] | None = None
    window: Window | None = None
    active: bool = True


class Omero(BaseModel):
    """Looks of all channels."""

    channels: Annotated[list[Channel], Field(max_length=4096)] = []


class Own(BaseModel):
    """Properties that the format lacks; see `writing`."""

    direction: Annotated[list[list[Number]], Field(min_length=3, max_length=3)] | None = None
    units: str = ""
    space: str = ""
    color: bool = False
