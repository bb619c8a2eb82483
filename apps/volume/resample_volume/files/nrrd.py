"""NRRD, by its definition (teem.sourceforge.net/nrrd/format.html), with positions as in ITK.

Positions are converted to LPS if the file's space is one of right/left, anterior/posterior and
superior/inferior; other spaces are kept.
"""

import gzip
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from resample.lengths import times, unit_of_length
from resample.types import Doubles
from resample_volume.data.recordings import is_color, unit_of_space
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    VoxelData,
    check_shape,
    header,
    recording,
    voxels,
)
from resample_volume.files.texts import (
    NOTHING,
    Fields,
    check_nrrd_numbers,
    files_named,
    is_hounsfield,
    text_fields,
    whole,
)
from resample_volume.types import UNKNOWN, VOXEL, Recording, Volume

TYPES = {
    "int8": ("signed char", "int8", "int8_t"),
    "uint8": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "int16": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "uint16": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "int32": ("int", "signed int", "int32", "int32_t"),
    "uint32": ("uint", "unsigned int", "uint32", "uint32_t"),
    "int64": ("longlong", "long long", "long long int", "signed long long", "int64", "int64_t"),
    "uint64": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "float32": ("float",),
    "float64": ("double",),
}
NAMES = {name: kind for kind, names in TYPES.items() for name in names}
PACKINGS = {"raw": "raw", "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
PACKINGS |= {"text": "text", "txt": "text", "ascii": "text", "hex": "hex"}
WRITTEN = {"uint8": "uint8", "int8": "int8", "uint16": "uint16", "int16": "int16"}
WRITTEN |= {"int32": "int32", "float32": "float", "float64": "double"}

OF_SPACE = ("domain", "space", "time", "none", "???")  # kinds of axes along which voxels lie
LISTED = {"list", "time", "none", "???"}  # kinds of axes that list numbers other than colors
SIGNS = {
    **dict.fromkeys(("right-anterior-superior", "ras"), (-1.0, -1.0, 1.0)),
    **dict.fromkeys(("left-anterior-superior", "las"), (1.0, -1.0, 1.0)),
}
NUMBER = r"[^\s,()]+"
VECTOR = re.compile(rf"none|\(\s*{NUMBER}(?:\s*,\s*{NUMBER})*\s*\)", re.IGNORECASE)
IDENTITY = np.eye(3)
WORD = re.compile(r'"([^"]*)"')


class _Axes(NamedTuple):
    """Roles of a file's axes, the fastest first."""

    space: list[int]  # along which voxels lie: x, y, z and perhaps time
    part: int | None  # along which the numbers of a voxel lie
    size: list[int]


@dataclass(frozen=True)
class Nrrd(OneOfAll):
    """NRRD, with the data in the same file or beside it; raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (".nrrd", ".nhdr")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        told = text_fields(path, ":")
        with path.open("rb") as file:
            if file.read(4) != b"NRRD":
                raise ValueError(f"{path.name} is not a NRRD file: it does not begin with NRRD000")
        data = told.value.get("data file", told.value.get("datafile", ""))
        paths = files_named(path, data) if data else []
        for key in ("dimension", "type", "sizes", "encoding"):
            if key not in told.value:
                raise ValueError(f"{path.name} is not a NRRD file: its header has no {key}")
        check_nrrd_numbers(path, told.value)
        size = [whole(path, word) for word in told.value["sizes"].split()]
        kinds = told.value.get("kinds", "").lower().split() or ["???"] * len(size)
        if len(kinds) != len(size):
            raise ValueError(f"{path.name}: its kinds are {len(kinds)}, its axes {len(size)}")
        if "complex" in kinds:
            raise ValueError(
                f"{path.name} has voxels of complex numbers; a volume has one real number per "
                "voxel: extract a component"
            )
        apart = [axis for axis, kind in enumerate(kinds) if kind not in OF_SPACE]
        vectors = _vectors(told.value, path)
        if not apart and len(size) == 4 and vectors and vectors[0] is None:
            apart = [0]  # unlike the last one, which is time
        if len(apart) > 1:
            raise ValueError(f"{path.name} has {len(apart)} axes other than space; it may have 1")
        space = [axis for axis in range(len(size)) if axis not in apart]
        axes = _Axes(space, apart[0] if apart else None, size)
        known = _header(told.value, axes, path, name)
        stored = _stored(path, told, paths)
        check(known)
        values = voxels(stored, known).reshape(axes.size[::-1])
        parts = [] if axes.part is None else [axes.part]
        values = values.transpose([values.ndim - 1 - axis for axis in (*parts, *axes.space[::-1])])
        if len(axes.space) == 4 and parts:
            values = values.swapaxes(0, 1)
        shape = (known.times, known.parts, *known.shape[::-1])
        return recording(values.reshape(shape), known, channels_first=True)


def write_nrrd(path: Path, volume: Volume) -> None:
    """Write a volume with its geometry, compressed."""
    kind = volume.values.dtype
    steps = (volume.spacing * volume.direction).T
    unit = unit_of_space(volume).replace("µ", "u").replace("Å", "angstrom")
    lines = (
        "NRRD0004",
        f"type: {WRITTEN[kind.name]}",
        "dimension: 3",
        "space: left-posterior-superior",
        f"sizes: {' '.join(map(str, volume.values.shape[::-1]))}",
        f"space directions: {' '.join(map(_vector, steps))}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: gzip",
        f"space origin: {_vector(volume.origin)}",
        *([f'space units: "{unit}" "{unit}" "{unit}"'] if unit else []),
    )
    with path.open("wb") as file:
        file.write("\n".join(lines).encode() + b"\n\n")
        with gzip.GzipFile("", "wb", 6, file, mtime=0) as packed:
            for plane in volume.values:
                packed.write(np.ascontiguousarray(plane, kind.newbyteorder("<")).data)


def _vector(numbers: Doubles) -> str:
    return f"({','.join(f'{number:.17g}' for number in numbers)})"


def _header(value: Mapping[str, str], axes: _Axes, path: Path, name: str) -> VolumeHeader:
    stored = NAMES.get(value["type"].lower())
    if stored is None:
        raise ValueError(f"{path.name} has voxels of type {value['type']!r}; known are numbers")
    kind, endian = np.dtype(stored), value.get("endian", "").lower()
    if kind.itemsize > 1 and PACKINGS.get(value["encoding"].lower()) != "text":
        if endian not in ("little", "big"):
            raise ValueError(f"{path.name}: its endian is {endian!r}; it must be little or big")
        kind = kind.newbyteorder("<" if endian == "little" else ">")
    sizes = tuple(axes.size[axis] for axis in axes.space)
    if len(sizes) != 4:
        check_shape(sizes, name)
    spacing, origin, direction = _place(value, axes, path)
    # The unit of lengths, and the factor to it.
    length, by = VOXEL, 1.0
    if value.keys() & {"space directions", "spacings"}:
        words = WORD.findall(value.get("space units", ""))
        if not words:
            words = WORD.findall(value.get("units", ""))[: len(axes.size)]
            words = [words[axis] for axis in axes.space[:3] if axis < len(words)]
        known_units = {unit_of_length(word) for word in words} - {("", 1.0)}
        if len(known_units) > 1:
            raise ValueError(f"{path.name}: its lengths are in {', '.join(words)}; give one unit")
        length, by = next(iter(known_units), (UNKNOWN, 1.0))
    spacing, origin = times(spacing, by), times(origin, by)
    known = header(sizes[:3], kind, name, spacing=spacing, origin=origin, direction=direction)
    parts = 1 if axes.part is None else axes.size[axes.part]
    listed = LISTED & set(value.get("kinds", "").lower().split())
    units = [value.get(key, "") for key in ("sample units", "units")]
    return known._replace(
        times=math.prod(sizes[3:]),
        parts=parts,
        is_color=is_color((parts,), known.dtype) and not listed,
        pixel=f"vector of {kind.name}",
        units="hu" if any(map(is_hounsfield, units)) else "",
        length=length,
        note=_assumed(value, axes),
    )


def _assumed(value: Mapping[str, str], axes: _Axes) -> str:
    """Tell along which axes no distance of voxels is stated, and that values were quantized."""
    quantized = {"old min", "oldmin", "old max", "oldmax"} & value.keys()
    lines = ["values are as quantized: old min and old max are not applied"] * bool(quantized)
    if "space directions" in value:
        return "".join(lines)
    words = value.get("spacings", "").lower().split()
    missing = [n for n, axis in enumerate(axes.space[:3]) if words and words[axis] in NOTHING]
    listed = " and ".join("xyz"[n] for n in missing)
    lines += [f"no spacing along {listed} is stated; 1 is assumed"] * bool(missing)
    if "axis maxs" in value and (missing or not words):
        lines.append("axis maxs do not give it, as in ITK")
    return "; ".join(lines)


def _vectors(value: Mapping[str, str], path: Path) -> list[Doubles | None]:
    """Return the step along each axis, None for other than spatial ones; or no list."""
    text = value.get("space directions", "")
    words = VECTOR.findall(text)
    found = [None if word.lower() == "none" else _triple(word) for word in words]
    if text and len(found) != len(value["sizes"].split()):
        raise ValueError(f"{path.name}: its space directions are {len(found)}, not one per axis")
    return found


def _triple(text: str) -> Doubles:
    numbers = np.array([float(word) for word in text.strip("() ").split(",")])
    return np.resize(np.append(numbers, np.zeros(3)), 3)  # a fourth one is of time


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _place(value: Mapping[str, str], axes: _Axes, path: Path) -> tuple[Doubles, Doubles, Doubles]:
    """Return spacing, origin and direction."""
    vectors = _vectors(value, path)
    steps = [vectors[axis] for axis in axes.space[:3]] if vectors else []
    if not steps:
        return _along_axes(value, axes, path)
    if any(step is None for step in steps):
        raise ValueError(f"{path.name}: its space directions lack x, y or z")
    name = value.get("space", "").lower()
    sign = np.array(next((SIGNS[key] for key in SIGNS if name.startswith(key)), (1.0, 1.0, 1.0)))
    every = np.array(steps) * sign
    text = value.get("space origin", "")
    origin = _triple(text) * sign if text else np.zeros(3)
    length = np.linalg.norm(every, axis=1)
    unit = every / np.where(length > 0, length, 1)[:, np.newaxis]
    return length, origin, unit.T


def _along_axes(
    value: Mapping[str, str], axes: _Axes, path: Path
) -> tuple[Doubles, Doubles, Doubles]:
    """Do the same for a file without a space, from spacings and starts of axes."""

    def numbers(key: str) -> Doubles:
        words = value.get(key, "").split() or ["nan"] * len(axes.size)
        known = [math.nan if word in ("none", "???", "?") else float(word) for word in words]
        return np.array(known)[axes.space[:3]]

    spacing, low, high = numbers("spacings"), numbers("axis mins"), numbers("axis maxs")
    count = np.array(axes.size, np.float64)[axes.space[:3]]
    words = value.get("centers", value.get("centerings", "")).lower().split()
    if len(words) not in (0, len(axes.size)):
        raise ValueError(f"{path.name}: its centers are {len(words)}, not one per axis")
    nodes = np.array([words[axis] == "node" if words else False for axis in axes.space[:3]])
    told = np.where(np.isfinite(spacing), spacing, (high - low) / np.maximum(count - nodes, 1))
    origin = low + np.where(nodes, 0, told / 2)
    origin = np.where(np.isfinite(origin), origin, 0)
    return np.where(np.isnan(spacing), 1, spacing), origin, IDENTITY


def _stored(path: Path, told: Fields, apart: list[Path]) -> VoxelData:
    """Return the location of the data; `apart` are separate files, if any."""
    value = told.value
    packing = PACKINGS.get(value["encoding"].lower())
    if packing is None:
        known = ", ".join(PACKINGS)
        raise ValueError(f"{path.name}: its encoding is {value['encoding']!r}; known are {known}")
    paths, start = apart or [path], 0 if apart else told.end
    lines = whole(path, value.get("line skip", value.get("lineskip", "0")))
    skip = whole(path, value.get("byte skip", value.get("byteskip", "0")))
    if lines > 0:
        with paths[0].open("rb") as file:
            file.seek(start)
            for _ in range(min(lines, 100_000)):
                file.readline(1 << 20)
            start = file.tell()
    is_exact = bool(apart) and not (lines or skip)
    if packing in ("gzip", "bzip2"):
        return VoxelData(paths, start, packing, max(0, skip), is_exact)
    return VoxelData(paths, start + skip if skip >= 0 else -1, packing, is_exact=is_exact)
