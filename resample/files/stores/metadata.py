"""Parse OME-Zarr 0.4 and 0.5 metadata: axes and resolution levels."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.types import Doubles
from resample.words import one_line

if TYPE_CHECKING:
    from resample.files.stores.models import Axis, Dataset, Transformation

VERSIONS = ("0.4", "0.5")
KINDS = {"time": "t", "channel": "c"}  # non-spatial axes
SPACE = "zyx"
METERS = {
    "angstrom": 1e-10,
    "nanometer": 1e-9,
    "micrometer": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "meter": 1.0,
}
OWN = "hybrid-resample"  # key of volume properties that the format lacks, in stores that we write


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
    unit: str = ""  # of length; empty: unknown
    direction: Doubles | None = None  # (3, 3) as in `Volume`
    units: str = ""  # of values, as in `Volume`
    space: str = ""  # as in `Volume`
    is_color: bool = False  # whether channels are red, green, blue and optional opacity


def layout_of(attributes: Mapping[str, Any], name: str, space: str = SPACE) -> Layout | None:
    """Parse a group's attributes; None if they describe no image."""
    from pydantic import ValidationError

    from resample.files.stores.models import Multiscale, Own

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
    try:
        image = Multiscale.model_validate(first)
        own = Own.model_validate(attributes.get(OWN, {}))
    except ValidationError as error:
        raise ValueError(f"{name}, multiscales: {one_line(error)}") from None
    axes, factor, unit = _axes(image.axes, name, space)
    levels = tuple(_level(level, image.transformations, factor, name) for level in image.datasets)
    turned = None if own.direction is None else np.array(own.direction, np.float64)
    return Layout(axes, levels, unit, turned, own.units, own.space, own.color)


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
    unit, factor = units["x"], np.ones(len(given))
    for axis, letter in enumerate(letters):
        own = units[letter]
        if letter in SPACE and own != unit:
            if own not in METERS or unit not in METERS:
                raise ValueError(
                    f"{name}: lengths along {letter} are in {own or 'no unit'}, along x in "
                    f"{unit or 'no unit'}; give both the same unit, of {', '.join(METERS)}"
                )
            factor[axis] = METERS[own] / METERS[unit]
    return "".join(letters), factor, unit


def _letter(axis: "Axis", name: str) -> str:
    """Letter of an axis, by its type, else by its name."""
    letter = KINDS.get(axis.type or "", axis.name.lower())
    if letter not in (*SPACE, *KINDS.values()):
        raise ValueError(
            f"{name} has an axis {axis.name!r} of type {axis.type!r}; known are time, channel and "
            "the axes of space z, y and x"
        )
    return letter


def _level(given: "Dataset", after: "list[Transformation]", factor: Doubles, name: str) -> Level:
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
    return Level(given.path, factor * scale, factor * start, is_placed)


def _numbers(given: list[float] | None, count: int, where: str) -> Doubles:
    if given is None or len(given) != count:
        raise ValueError(f"{where}: {given} are not {count} numbers, one for each axis")
    return np.array(given, np.float64)
