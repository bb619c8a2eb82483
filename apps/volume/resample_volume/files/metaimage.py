"""MetaImage, by its definition (itk.org/Wiki/MetaIO/Documentation), as ITK understands it."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.lengths import times, unit_of_length
from resample_volume.data.recordings import in_unit, is_color, unit_of_space
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VoxelData,
    check_shape,
    header,
    recording,
    voxels,
)
from resample_volume.files.texts import (
    Fields,
    check_meta_numbers,
    files_named,
    is_hounsfield,
    text_fields,
    whole,
)
from resample_volume.types import UNKNOWN, VOXEL, Recording, Volume

TYPES = {
    "met_char": "int8",
    "met_uchar": "uint8",
    "met_short": "int16",
    "met_ushort": "uint16",
    "met_int": "int32",
    "met_uint": "uint32",
    "met_long": "int32",  # 4 bytes in all files, whatever the machine
    "met_ulong": "uint32",
    "met_long_long": "int64",
    "met_ulong_long": "uint64",
    "met_float": "float32",
    "met_double": "float64",
}
NAMES = {TYPES[name]: name.upper() for name in reversed(TYPES)}
SPACINGS = ("elementspacing", "elementsize")
ORIGINS = ("offset", "origin", "position")
MATRICES = ("transformmatrix", "rotation", "orientation")
SCALE = "ElementToIntensityFunctionSlope"


@dataclass(frozen=True)
class MetaImage(OneOfAll):
    """MetaImage, with the data in the same file or beside it; raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (".mha", ".mhd")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        told = text_fields(path, "=", "elementdatafile")
        if not told.value.get("elementdatafile"):
            raise ValueError(f"{path.name} is not a MetaImage: its header names no ElementDataFile")
        check_meta_numbers(path, told.value)
        axes = whole(path, told.value["ndims"])
        sizes = tuple(whole(path, word) for word in told.value["dimsize"].split())
        word = told.value.get("elementtype", "")
        kind = TYPES.get(word.lower().removesuffix("_array"))
        if kind is None:
            raise ValueError(
                f"{path.name} has voxels of type {word!r}; known are {', '.join(TYPES)}"
            )
        if len(sizes) != 4:
            check_shape(sizes, name)
        spacing, origin = _first(told.value, SPACINGS, 3), _first(told.value, ORIGINS, 3)
        unit, by = unit_of_length(told.value.get("distanceunits", ""))
        matrix = _first(told.value, MATRICES, axes * axes)
        steps = matrix.reshape(axes, axes)[:3, :3].T if matrix.size else np.eye(3)
        is_big = any(
            _is_true(told.value, f"{word}byteordermsb") for word in ("binarydata", "element")
        )
        known = header(
            sizes[:3],
            np.dtype(kind).newbyteorder(">" if is_big else "<"),
            name,
            spacing=times(spacing, by) if spacing.size else (1, 1, 1),
            origin=times(origin, by) if origin.size else (0, 0, 0),
            direction=steps,
        )
        parts = whole(path, told.value.get("elementnumberofchannels", "1"))
        if parts < 1:
            raise ValueError(f"{path.name}: its voxels have {parts} numbers; correct its header")
        known = known._replace(
            times=sizes[3] if len(sizes) == 4 else 1,
            parts=parts,
            is_color=is_color((parts,), known.dtype),
            pixel=f"vector of {kind}",
            units="hu" if is_hounsfield(told.value.get("units", "")) else "",
            length=unit or (UNKNOWN if spacing.size else VOXEL),
            note=f"{SCALE} is not applied, as in ITK" if SCALE.lower() in told.value else "",
        )
        stored = _stored(path, told)
        check(known)
        return recording(voxels(stored, known), known)


def write_metaimage(path: Path, volume: Volume) -> None:
    """Write a volume with its geometry to one compressed file."""
    volume, kind = in_unit(volume, "mm"), volume.values.dtype
    packer, packed = zlib.compressobj(6), []
    for plane in volume.values:
        packed.append(packer.compress(np.ascontiguousarray(plane, kind.newbyteorder("<")).data))
    packed.append(packer.flush())
    lines = (
        "ObjectType = Image",
        "NDims = 3",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CompressedData = True",
        f"CompressedDataSize = {sum(map(len, packed))}",
        f"TransformMatrix = {_listed(volume.direction.T.ravel())}",
        f"Offset = {_listed(volume.origin)}",
        "CenterOfRotation = 0 0 0",
        f"ElementSpacing = {_listed(volume.spacing)}",
        *([f"DistanceUnits = {unit_of_space(volume)}"] if unit_of_space(volume) else []),
        f"DimSize = {' '.join(map(str, volume.values.shape[::-1]))}",
        f"ElementType = {NAMES[kind.name]}",
        "ElementDataFile = LOCAL",
    )
    with path.open("wb") as file:
        file.write("\n".join(lines).encode() + b"\n")
        file.writelines(packed)


def _listed(numbers: Any) -> str:
    return " ".join(f"{number:.17g}" for number in numbers)


def _first(value: Mapping[str, str], keys: tuple[str, ...], count: int) -> Any:
    """Return the numbers of the first key present, or none."""
    found = next((value[key] for key in keys if key in value), "")
    return np.array([float(word) for word in found.split()][:count])


def _is_true(value: Mapping[str, str], key: str) -> bool:
    return value.get(key, "").lower()[:1] in ("t", "y", "1")


def _stored(path: Path, told: Fields) -> VoxelData:
    """Return the location of the data."""
    value = told.value
    data = value["elementdatafile"]
    is_local = data.upper() == "LOCAL"
    paths = [path] if is_local else files_named(path, data)
    skipped = whole(path, value.get("headersize", "0"))
    start = (told.end if is_local else 0) + max(0, skipped)
    is_exact = not (is_local or skipped)
    if value.get("binarydata", "true").lower()[:1] == "f":
        return VoxelData(paths, start, "text", is_exact=is_exact)
    if _is_true(value, "compresseddata"):
        return VoxelData(paths, start, "gzip", is_exact=is_exact)
    return VoxelData(paths, -1 if skipped < 0 else start, is_exact=is_exact)
