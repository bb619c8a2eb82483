"""OME-Zarr metadata, axes and levels; and which chunks of an array exist, without asking for each.

A missing chunk has the fill value. A folder or zip file lists all names at once, so that millions
of missing chunks cost nothing.
"""

import logging
import re
from collections.abc import Mapping, Sequence
from functools import cache
from math import prod
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from resample.lengths import ratio, times, unit_of_length
from resample.memory import amount
from resample.messages import one_line
from resample.reading.limits import SIMILAR_FRAMES, limits, refused
from resample.types import Doubles

VERSIONS = ("0.4", "0.5")
KINDS = {"time": "t", "channel": "c"}  # non-spatial axes
SPACE = "zyx"
OWN = "hybrid-resample"  # key of volume properties that the format lacks, in stores that we write
MOST = 1 << 32  # chunks in the table; only used pages take memory
FEW = 4  # if at most one chunk in so many exists, they are read one by one
NUMBER = re.compile(r"\d{1,12}")

Selection = Sequence[slice | int]  # along each axis; slices have both ends


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


class Level(NamedTuple):
    """An array and its position; numbers are per axis, in its order."""

    path: str  # relative to the group
    scale: Doubles  # (D,) scene units between elements
    start: Doubles  # (D,) scene units, position of the first element
    is_placed: bool  # whether the file states the position, not only the voxel size


class Layout(NamedTuple):
    """Metadata of an image."""

    axes: str  # letters t, c, z, y and x in the order of the arrays
    levels: tuple[Level, ...]  # finest first
    unit: str = ""  # of length, see `resample.lengths`; empty: unknown
    direction: Doubles | None = None  # (3, 3) as in `Volume`
    units: str = ""  # of values, as in `Volume`
    space: str = ""  # as in `Volume`
    is_color: bool = False  # whether channels are red, green, blue and optional opacity
    looks: tuple[Channel, ...] = ()  # of channels


def layout_of(attributes: Mapping[str, Any], name: str, space: str = SPACE) -> Layout | None:
    """Parse a group's attributes; None if they describe no image."""
    told = attributes.get("ome", attributes)
    if not isinstance(told, Mapping) or "multiscales" not in told:
        return None
    images = told["multiscales"]
    first = images[0] if isinstance(images, list) and images else None
    if not isinstance(first, Mapping):
        raise ValueError(f"{name}: multiscales must be a list of images, not {images!r:.40}")
    version = str(told.get("version") or first.get("version") or VERSIONS[0])
    if version not in VERSIONS:
        raise ValueError(
            f"{name} is of OME-Zarr {version:.20}; {' and '.join(VERSIONS)} are supported: convert "
            "it, or name one of its arrays"
        )
    part = "multiscales"
    try:
        image = Multiscale.model_validate(first)
        own = Own.model_validate(attributes.get(OWN, {}))
        part = "omero"
        omero = told.get("omero", {}) if space == SPACE else {}  # pictures have no looks
        looks = tuple(Omero.model_validate(omero).channels)
    except ValidationError as error:
        raise ValueError(f"{name}, {part}: {one_line(error)}") from None
    axes, factor, unit = _axes(image.axes, name, space)
    levels = tuple(_level(level, image.transformations, factor, name) for level in image.datasets)
    turned = None if own.direction is None else np.array(own.direction, np.float64)
    return Layout(axes, levels, unit, turned, own.units, own.space, own.color, looks)


def moved(layout: Layout, number: int) -> Level:
    """Position a level, also if its file does not state it: as means of finer voxels.

    Where the translation is missing, coarser voxels are taken as means of the finest ones, with a
    common corner.
    """
    level, finest = layout.levels[number], layout.levels[0]
    if level.is_placed or number == 0:
        return level
    return level._replace(start=finest.start + (level.scale - finest.scale) / 2)


def _axes(given: "list[Axis]", name: str, space: str) -> tuple[str, Doubles, str]:
    """Letters of the axes, factors to a common length unit, and that unit."""
    letters = [_letter(axis, name) for axis in given]
    if len(set(letters)) < len(letters) or not set(letters) >= set(space):
        listed, wanted = ", ".join(axis.name for axis in given), ", ".join(space[:-1])
        raise ValueError(
            f"{name} has the axes {listed}; wanted are {wanted} and {space[-1]} once each, and "
            "beside them time and channel at most"
        )
    units = {letter: axis.unit or "" for letter, axis in zip(letters, given, strict=True)}
    unit, factor = unit_of_length(units["x"])[0], np.ones(len(given))
    for axis, letter in enumerate(letters):
        own, by = unit_of_length(units[letter])
        if letter in SPACE and own and unit:
            factor[axis] = by * ratio(own, unit)
        elif letter in SPACE and units[letter] != units["x"]:
            raise ValueError(
                f"{name}: lengths along {letter} are in {units[letter] or 'no unit'}, along x in "
                f"{units['x'] or 'no unit'}; give both the same unit, such as micrometer"
            )
    return "".join(letters), factor, unit


def _letter(axis: Axis, name: str) -> str:
    """Letter of an axis, by its type, else by its name."""
    letter = KINDS.get(axis.type or "", axis.name.lower())
    if letter not in (*SPACE, *KINDS.values()):
        raise ValueError(
            f"{name} has an axis {axis.name!r} of type {axis.type!r}; known are time, channel and "
            "the axes of space z, y and x"
        )
    return letter


def _level(given: Dataset, after: list[Transformation], factor: Doubles, name: str) -> Level:
    """Level with its own transformations and those of the image."""
    scale, start, is_placed = np.ones(factor.size), np.zeros(factor.size), False
    for step in [*given.transformations, *after]:
        if step.type == "scale":
            along = _numbers(step.scale, factor.size, f"{name}/{given.path}, scale")
            scale, start = along * scale, along * start
        elif step.type == "translation":
            is_placed = True
            start = start + _numbers(
                step.translation, factor.size, f"{name}/{given.path}, translation"
            )
    lengths = [
        np.array([times(length, by) for length, by in zip(each, factor, strict=True)])
        for each in (scale, start)
    ]
    return Level(given.path, lengths[0], lengths[1], is_placed)


def _numbers(given: list[float] | None, count: int, where: str) -> Doubles:
    if given is None or len(given) != count:
        raise ValueError(f"{where}: {given} are not {count} numbers, one for each axis")
    return np.array(given, np.float64)


class Holes(NamedTuple):
    """Missing chunks of an array."""

    missing: int  # chunks, or shards
    total: int  # number of all
    is_there: NDArray[np.bool_] | None  # by chunk index; None: all exist, or it is unknown

    def message(self, fill: Any) -> str:
        """Message about missing chunks; empty if none are missing."""
        if not self.missing:
            return ""
        return (
            f"{self.missing} of {self.total} chunks are missing and are drawn as the fill value "
            f"{fill}"
        )


@cache
def warned(line: str) -> None:
    """Show a warning once, however often a picture is opened."""
    logging.getLogger("resample").warning("%s", line)


def holes_of(array: Any, name: str) -> Holes:
    """Find missing chunks of a zarr array in a folder or zip file.

    Other stores cannot list them.
    """
    sides = _sides(array)
    grid = tuple(-(-size // side) for size, side in zip(array.shape, sides, strict=True))
    count = prod(grid)
    names = array.store.names(array.path, len(grid) + 1)  # of a `GuardedStore`
    if names is None:
        return Holes(0, count, None)
    there = [index for index in (_index(array, name, grid) for name in names) if index is not None]
    missing = count - len(there)
    if not missing:
        return Holes(0, count, None)
    _check_claims(array, name, Holes(missing, count, None), there)
    if count > MOST:
        return Holes(missing, count, None)
    is_there = np.zeros(grid, np.bool_)
    if there:
        is_there[tuple(np.array(there).T)] = True
    return Holes(missing, count, is_there)


def values_of(array: Any, holes: Holes | None, chosen: Selection) -> NDArray[Any]:
    """Read a part of an array without looking up missing chunks."""
    if holes is None or holes.is_there is None:
        return np.asarray(array[tuple(chosen)])
    sides = _sides(array)
    ends = [(at.start, at.stop) if isinstance(at, slice) else (at, at + 1) for at in chosen]
    touched = tuple(
        slice(first // side, -(-last // side))
        for (first, last), side in zip(ends, sides, strict=True)
    )
    part = holes.is_there[touched]
    if part.size == 0 or part.sum() * FEW > part.size:
        return np.asarray(array[tuple(chosen)])
    fill = 0 if array.fill_value is None else array.fill_value
    found = np.full([last - first for first, last in ends], fill, array.dtype)
    for index in np.argwhere(part):
        own = [
            (max(first, (n + at.start) * side), min(last, (n + at.start + 1) * side))
            for n, at, side, (first, last) in zip(index.tolist(), touched, sides, ends, strict=True)
        ]
        target = tuple(
            slice(a - first, b - first) for (a, b), (first, _) in zip(own, ends, strict=True)
        )
        found[target] = array[tuple(slice(*pair) for pair in own)]
    alone = tuple(n for n, at in enumerate(chosen) if not isinstance(at, slice))
    return found.squeeze(alone)


def _sides(array: Any) -> tuple[int, ...]:
    """Elements of a chunk, or shard, along each axis."""
    sides: tuple[int, ...] = getattr(array, "shards", None) or array.chunks
    return sides


def _index(array: Any, name: str, grid: tuple[int, ...]) -> tuple[int, ...] | None:
    """Index of the chunk in a file of this name; None for other files."""
    index = tuple(int(word) for word in NUMBER.findall(name))[-len(grid) :]
    is_within = len(index) == len(grid) and all(
        n < size for n, size in zip(index, grid, strict=True)
    )
    return index if is_within and array.metadata.encode_chunk_key(index) == name else None


def _check_claims(array: Any, name: str, holes: Holes, there: list[tuple[int, ...]]) -> None:
    """Reject an array of gigabytes by its metadata if most of its chunks are missing."""
    known = limits()
    claimed = holes.missing * prod(_sides(array)) * array.dtype.itemsize
    if claimed <= known.unpacked:
        return
    keys = (f"{array.path}/{array.metadata.encode_chunk_key(index)}" for index in there)
    stored = sum(array.store.size(key.lstrip("/")) or 0 for key in keys)
    if claimed > SIMILAR_FRAMES * known.ratio * max(1, stored):
        found = (
            f"{amount(stored)} exist of {holes.total} chunks; {holes.missing} "
            f"({amount(claimed)}) are missing"
        )
        raise refused(name, found, "ratio")
