"""Read PCD files of the Point Cloud Library."""

import math
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from resample.console import say_of
from resample.reading.limits import check_unpacked
from resample_points.data.cloud import Cloud, Fields, cloud_of
from resample_points.files.plain import NUMBER, binary_cloud, header_of, text_fields

UNMOVED = [0, 0, 0, 1, 0, 0, 0]  # x, y, z and a quaternion, w first
PCD_TYPES = {"I": "i", "U": "u", "F": "f"}


def read_pcd(path: Path) -> Cloud:
    """Read a PCD file: ASCII, binary, or binary and compressed."""
    with path.open("rb") as file:
        header = {words[0].upper(): words[1:] for words in header_of(file, "DATA") if words}
        count, kind = _pcd_points(header)
        place = " ".join(header.get("VIEWPOINT", []))
        if [float(word) for word in place.split() if NUMBER.fullmatch(word)] not in ([], UNMOVED):
            say_of(path, f"its VIEWPOINT ({place:.60}) is not applied, as in other programs")
        encoding = " ".join(header["DATA"]).lower()
        if encoding == "binary":
            return binary_cloud(path, file, count, kind)
        if encoding == "ascii":
            fields = text_fields(path, file, count, kind)
        elif encoding == "binary_compressed":
            fields = _compressed_fields(path, file, count, kind)
        else:
            raise ValueError(f"has DATA {encoding}; known: ascii, binary, binary_compressed")
    return cloud_of({name: column for name, column in fields.items() if column.ndim == 1})


def _pcd_points(header: dict[str, list[str]]) -> tuple[int, np.dtype[Any]]:
    """Return the number and the type of points."""
    try:
        names = header["FIELDS"] if "FIELDS" in header else header["COLUMNS"]
        counts = [int(word) for word in header.get("COUNT", ["1"] * len(names))]
        sizes = map(int, header["SIZE"])
        types = [PCD_TYPES[word.upper()] for word in header["TYPE"]]
        sides = ["POINTS"] if "POINTS" in header else ["WIDTH", "HEIGHT"]
        points = math.prod(int(header[side][0]) for side in sides)
        # Padding is often called _ several times.
        own = [f"{name} {n}" if name in names[:n] else name for n, name in enumerate(names)]
        described = zip(own, types, sizes, counts, strict=True)
        fields = [(n, f"<{t}{size}", (k,) if k > 1 else ()) for n, t, size, k in described]
        return points, np.dtype(fields)
    except (KeyError, IndexError, ValueError, TypeError):
        raise ValueError("has no PCD header with FIELDS, SIZE, TYPE and POINTS that fit") from None


def _compressed_fields(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Fields:
    """Read columns stored one after the other, compressed by LZF."""
    from resample_points.kernels.lzf import unpack

    sizes = file.read(8)
    packed, size = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
    data = np.frombuffer(file.read(packed), np.uint8)
    if len(data) < packed or size != count * kind.itemsize:
        raise OSError(f"{path} is cut off or damaged: its packed points do not fit its header")
    check_unpacked(str(path), packed, size)
    unpacked = np.zeros(size, np.uint8)
    if unpack(data, unpacked) != size:
        raise OSError(f"{path} is damaged: its packed points cannot be unpacked")
    fields, first = {}, 0
    for name in kind.names or ():
        part = kind[name]
        column = unpacked[first : first + count * part.itemsize]
        fields[name] = column.view(part.base).reshape(count, *part.shape)
        first += count * part.itemsize
    return fields
