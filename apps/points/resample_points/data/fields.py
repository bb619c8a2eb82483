"""Make clouds from the named columns of files."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.types import Floats
from resample_points.data.cloud import Cloud

Fields = Mapping[str, NDArray[Any]]  # columns of a file by name, (N,) each

PLACES = (("x", "y", "z"),)
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
COLORS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
PACKED = ("rgb", "rgba")  # a color packed into the bits of one number


def cloud_of(fields: Fields) -> Cloud:
    """Make a cloud from a file's columns."""
    position = _stacked(fields, PLACES)
    if position is None:
        raise ValueError(f"has no x, y and z; it has {', '.join(fields) or 'nothing'}")
    single = position.dtype.kind == "f" and position.dtype.itemsize <= 4
    normal = _stacked(fields, NORMALS)
    radius = fields.get("radius", np.zeros(0))
    known = {name for names in (*PLACES, *NORMALS, *COLORS) for name in names}
    known |= {*PACKED, "radius"}
    return Cloud(
        position.astype(np.float32 if single else np.float64),
        np.zeros((0, 3), np.float32) if normal is None else normal.astype(np.float32),
        _colors(fields),
        radius.astype(np.float32),
        {
            name: column
            for name, column in fields.items()
            if name not in known and not name.startswith("_")  # PCD's padding
        },
    )


def _stacked(fields: Fields, names: Sequence[tuple[str, ...]]) -> Any:
    """Stack the columns (N, 3) of the first complete group of names, or return None."""
    for group in names:
        if all(name in fields for name in group):
            return np.stack([fields[name] for name in group], axis=1)
    return None


def _colors(fields: Fields) -> Floats:
    """Return a file's colors in linear light (N, 3), or (0, 3)."""
    levels = _stacked(fields, COLORS)
    for name in PACKED:
        if levels is None and name in fields:
            levels = _unpacked(fields[name])
    if levels is None:
        return np.zeros((0, 3), np.float32)
    most = np.iinfo(levels.dtype).max if levels.dtype.kind in "iu" else 1
    return from_srgb(levels.astype(np.float32) / np.float32(most))


def _unpacked(packed: NDArray[Any]) -> NDArray[np.uint8]:
    """Unpack red, green and blue (N, 3) from the bits of numbers."""
    if packed.dtype.itemsize != 4:
        raise ValueError(f"packs colors into {packed.dtype.itemsize} bytes; 4 can be read")
    bits = np.ascontiguousarray(packed).view(np.uint32 if packed.dtype.isnative else ">u4")
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)
