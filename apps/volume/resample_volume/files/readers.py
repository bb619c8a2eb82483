"""Readers of volume files, one class per format.

Positions are in the file's own physical space, which for medical formats is LPS, millimeters. The
direction matrix is preserved, rotated or mirrored; if a format lacks them, spacing is 1 and origin
is 0. Heavy libraries are imported by the reader that needs them, when it reads.
"""

import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from resample.reading.arrays import DamageError, read_npy, read_npz
from resample_volume.data.recordings import is_color
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    VoxelData,
    accept_any,
    check_type,
    header,
    recording,
    voxels,
    wrong_size,
)
from resample_volume.files.texts import Numbers, sizes_of, spacing_of
from resample_volume.types import UNKNOWN, Recording, Volume

AXES = ("x", "y", "z")
BYTE_ORDERS = {"<": "little", ">": "big", "=": sys.byteorder}  # by NumPy's sign


class Reader(Protocol):
    """Protocol of readers of volumes; installed ones are found by their suffixes.

    A folder is read by the reader for its files' suffix. Unreadable files raise a `ValueError` or
    `OSError` of one line.
    """

    suffixes: ClassVar[tuple[str, ...]]  # in lower case, with their dot; the longest match wins

    def __call__(self, path: Path) -> Volume:
        """Read one volume."""


@runtime_checkable
class Recorder(Protocol):
    """Protocol of readers of formats with several times or channels."""

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        """Read all times and channels; `check` may reject the header before values are read."""


@runtime_checkable
class Streamer(Protocol):
    """Protocol of readers that read brick by brick."""

    def streamed(self, path: Path, check: Check = accept_any) -> Recording:
        """Open all times and channels; a chosen one has `data.values.Bricks`."""

    def levels(self, path: Path) -> list[dict[str, Any]]:
        """Return the file's levels, the finest first: `path`, `shape` and `spacing` of each."""


@dataclass(frozen=True)
class Raw(OneOfAll):
    """Raw voxels, x fastest; uncompressed files are memory mapped.

    Without `shape` and `dtype`, these are taken from a name like `engine_256x256x128_uint8.raw`.
    """

    shape: Numbers = ""  # voxels along x, y, z, and times: (256, 256, 128) or "256x256x128x10"
    dtype: str = ""  # NumPy's name; > or < before it, as in >i2, is the order of its bytes
    spacing: Numbers = ""  # 0.2x0.2x1um, or without a unit
    endian: str = ""  # little or big; empty: as dtype says, else little
    offset: int = 0  # bytes before the first voxel

    suffixes: ClassVar[tuple[str, ...]] = (".raw", ".raw.gz")

    def __post_init__(self) -> None:
        spacing_of(self.spacing)
        if self.shape:
            sizes_of(self.shape)
        if self.endian not in ("", *BYTE_ORDERS.values()):
            raise ValueError(f"endian is little or big, not {self.endian!r}")
        if self.dtype:
            check_type(_type(self.dtype, self.endian), "raw")
        if self.offset < 0:
            raise ValueError(f"offset is a number of bytes from 0 on, not {self.offset}")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        found = re.fullmatch(r"(.+)_(\d+x\d+x\d+(?:x\d+)?)_(\w+)", name)
        if not (found or (self.shape and self.dtype)):
            raise ValueError(
                f"{path.name} does not tell its shape and type as engine_256x256x128_uint8.raw "
                "does; give shape and dtype"
            )
        sizes = self.shape or (found[2] if found else "")
        kind = self.dtype or (found[3] if found else "")
        every = sizes_of(sizes)
        spacing, length = spacing_of(self.spacing)
        dtype, name = _type(kind, self.endian), found[1] if found else name
        known = header(every[:3], dtype, name, spacing=spacing)
        known = known._replace(times=math.prod(every[3:]), length=length)
        check(known)
        if path.suffix.lower() == ".gz":
            return recording(voxels(VoxelData([path], 0, "gzip", self.offset), known), known)
        given = path.stat().st_size - self.offset
        if given != known.size:
            raise wrong_size(path.name, max(0, given), known.size)
        shape = (known.times, *known.shape[::-1])
        return recording(np.memmap(path, known.dtype, "r", self.offset, shape), known)


@dataclass(frozen=True)
class Npy(OneOfAll):
    """NumPy's own format; memory mapped.

    Values are (Z, Y, X), or (T, Z, Y, X) of several times or channels, or (T, C, Z, Y, X) of both;
    where the last of four axes has 3 or 4 numbers of a color's type, they are colors.
    """

    spacing: Numbers = ""  # 0.2x0.2x1um, or without a unit; the file has none

    suffixes: ClassVar[tuple[str, ...]] = (".npy",)

    def __post_init__(self) -> None:
        spacing_of(self.spacing)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            values = read_npy(path, mapped=True)
        except DamageError as error:
            raise ValueError(
                f"{path.name} is not an array of numbers, or cut off: {error.reason}"
            ) from None
        return recording_of(values, name, self.spacing, check)


@dataclass(frozen=True)
class Npz(OneOfAll):
    """NumPy arrays: one as in `.npy`, or coordinates of planes `x`, `y`, `z` and one of values."""

    array: str = ""  # name of the values; empty: the only one besides x, y, z

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            held = read_npz(path)
        except DamageError as error:
            raise ValueError(
                f"{path.name} holds no arrays, or is damaged: {error.reason}"
            ) from None
        others = [key for key in held if key not in AXES]
        chosen = self.array or (others[0] if len(others) == 1 else "")
        if chosen not in others:
            raise ValueError(
                f"{path.name} holds {', '.join(held) or 'nothing'}; a volume is one array "
                "of values (Z, Y, X), which is chosen by its name: --reader npz:array=density"
            )
        values = held[chosen]
        if not set(AXES) <= held.keys():
            return recording_of(values, name, check=check)
        check(header(values.shape[::-1], values.dtype, name))
        from resample_volume.data.rectilinear import rectilinear

        made = rectilinear(values, held["x"], held["y"], held["z"], name)
        found = Recording(made.values[None, None], *made[1:5], note=made.note)
        return found._replace(length=UNKNOWN)


def recording_of(
    values: NDArray[Any], name: str, spacing: Numbers = "", check: Check = accept_any
) -> Recording:
    """Make a recording of an array as `Npy` has them."""
    known = header_of_array(values.shape, values.dtype, name, *spacing_of(spacing))
    check(known)
    return recording(values, known, channels_first=not known.is_color)


def header_of_array(
    shape: tuple[int, ...], dtype: np.dtype[Any], name: str, spacing: Any, length: str
) -> VolumeHeader:
    """Make the header of an array as `Npy` has them."""
    colored = len(shape) == 4 and is_color(shape, dtype)
    space = shape[:3] if colored else shape[-3:] if len(shape) in (4, 5) else shape
    known = header(space[::-1], dtype, name, spacing=spacing)._replace(length=length)
    if colored:
        return known._replace(parts=shape[3], is_color=True)
    if len(shape) > 3:
        return known._replace(times=shape[0], parts=math.prod(shape[1:-3]))
    return known


def _type(name: str, endian: str) -> np.dtype[Any]:
    own = BYTE_ORDERS.get(name[:1], "")
    try:
        dtype = np.dtype(name)
    except TypeError:
        raise ValueError(f"dtype is a name like uint8, int16 or float32, not {name!r}") from None
    if own and endian and own != endian:
        raise ValueError(f"dtype {name!r} is {own}-endian, endian says {endian}; give one of them")
    return dtype.newbyteorder(">" if "big" in (own, endian) else "<")
