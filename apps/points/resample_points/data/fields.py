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
    ("rf", "gf", "bf"),  # CloudCompare's, from 0 to 1
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
PACKED = ("rgb", "rgba")  # a color packed into the bits of one number
BITS_8, BITS_16 = 255, 65535  # greatest levels
FLOATING = 2.0  # greatest float of colors that go from 0 to 1, some of them brighter than white


def cloud_of(fields: Fields, white: float | None = None) -> Cloud:
    """Make a cloud from a file's columns.

    `white`: level of colors that is white. Default: found by `white_of`.
    """
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
        _colors(fields, white),
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


def white_of(kind: np.dtype[Any], most: float) -> float:
    """Return the level of white, from the type of levels and the greatest of them.

    Whole numbers have 8 bits, or 16 where one is above 255; wider types that exceed 16 bits have
    their range. Floats go from 0 to 1, or as whole numbers do where one is above 2.

    Examples
    --------
    >>> import numpy as np
    >>> white_of(np.dtype(np.uint16), 200), white_of(np.dtype(np.float32), 254.5)
    (255.0, 255.0)
    """
    if kind.kind == "f":
        return 1.0 if most <= FLOATING else float(BITS_8 if most <= BITS_8 else BITS_16)
    greatest = int(np.iinfo(kind).max)
    bits = BITS_8 if most <= BITS_8 else BITS_16 if most <= BITS_16 else greatest
    return float(min(bits, greatest))


def _colors(fields: Fields, white: float | None) -> Floats:
    """Return a file's colors in linear light (N, 3), or (0, 3)."""
    levels = _stacked(fields, COLORS)
    for name in PACKED:
        if levels is None and name in fields:
            levels, white = _unpacked(fields[name]), BITS_8
    if levels is None:
        return np.zeros((0, 3), np.float32)
    return linear(levels, white)


def linear(levels: NDArray[Any], white: float | None = None) -> Floats:
    """Return linear light of sRGB levels; `white` as of `cloud_of`."""
    if white is None:
        white = white_of(levels.dtype, most_of(levels))
    with np.errstate(over="ignore"):  # infinite: such points are dropped
        return from_srgb(levels.astype(np.float32) / np.float32(white))


def most_of(levels: NDArray[Any]) -> float:
    """Return the greatest finite level, at least 0."""
    return float(np.nan_to_num(levels, nan=0.0, posinf=0.0).max(initial=0))


def _unpacked(packed: NDArray[Any]) -> NDArray[np.uint8]:
    """Unpack red, green and blue (N, 3) from the bits of numbers."""
    if packed.dtype.itemsize != 4:
        raise ValueError(f"packs colors into {packed.dtype.itemsize} bytes; 4 can be read")
    bits = np.ascontiguousarray(packed).view(np.uint32 if packed.dtype.isnative else ">u4")
    return np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], axis=1).astype(np.uint8)
