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

from resample.reading.arrays import DamageError, read_npy
from resample_volume.data.recordings import is_color
from resample_volume.files.parsing.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    accept_any,
    check_type,
    existing_file,
    header,
    recording,
    stem,
)
from resample_volume.files.parsing.sections import ArrayQuery, check_part
from resample_volume.files.parsing.texts import Numbers, sizes_of, spacing_of, steps_of
from resample_volume.files.parsing.voxels import VoxelData, voxels, wrong_size
from resample_volume.types import Recording, Volume

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
    """Protocol of readers whose format may hold more than one volume."""

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        """Read all times and channels; `check` may reject the header before values are read."""


@runtime_checkable
class Streamer(Protocol):
    """Protocol of readers whose files can be read brick by brick."""

    def streamed(self, path: Path, check: Check = accept_any) -> Recording:
        """Open all times and channels; a chosen one has `data.bricks.Bricks`."""

    def levels(self, path: Path) -> list[dict[str, Any]]:
        """Return the file's levels, the finest first: `path`, `shape` and `spacing` of each."""


@dataclass(frozen=True)
class Nrrd(OneOfAll):
    """NRRD, with the data in the same file or beside it; raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (".nrrd", ".nhdr")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.nrrd import read_nrrd

        return read_nrrd(path, name, check)


@dataclass(frozen=True)
class MetaImage(OneOfAll):
    """MetaImage, with the data in the same file or beside it; raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (".mha", ".mhd")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.metaimage import read_metaimage

        return read_metaimage(path, name, check)


@dataclass(frozen=True)
class Nifti(OneOfAll):
    """NIfTI-1 or -2 in a single file; slope and intercept are applied, which gives floats.

    Its coordinates are RAS; they are converted to LPS, like those of other formats.
    """

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".nii", ".nii.gz")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.nifti import read_nifti

        return read_nifti(path, name, check)


@dataclass(frozen=True)
class Vti(OneOfAll):
    """VTK image data, at points or cells. Components are channels, or a color."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    suffixes: ClassVar[tuple[str, ...]] = (".vti",)

    def __post_init__(self) -> None:
        check_part(self.part)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.xml.vti import read_vti

        wanted = ArrayQuery(self.array, self.part, "vti")
        return read_vti(path, wanted, name, check)


@dataclass(frozen=True)
class Vtk(OneOfAll):
    """VTK's legacy files, as text or binary: image data, rectilinear grids, grids of cells.

    Values are at points or cells; components are channels, or a color. Unstructured grids are
    resampled onto a lattice, with the extra vtk.
    """

    array: str = ""  # name of the array; empty: the first of SCALARS, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    spacing: Numbers = ""  # of that lattice, as 0.5 or 1x1x2; empty: the mean size of cells

    suffixes: ClassVar[tuple[str, ...]] = (".vtk",)

    def __post_init__(self) -> None:
        check_part(self.part)
        steps_of(self.spacing)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.vtk import read_vtk

        wanted = ArrayQuery(self.array, self.part, "vtk")
        return read_vtk(path, wanted, steps_of(self.spacing), name, check)


@dataclass(frozen=True)
class Mrc(OneOfAll):
    """MRC and CCP4 maps, in Å; volumes of a stack are times. Raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (
        *(".mrc", ".map", ".ccp4", ".mrcs", ".mrc.gz", ".map.gz", ".ccp4.gz", ".mrcs.gz"),
    )

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.mrc import read_mrc

        return read_mrc(path, name, check)


@dataclass(frozen=True)
class Cube(OneOfAll):
    """Gaussian's cubes, in Å; several orbitals are channels."""

    suffixes: ClassVar[tuple[str, ...]] = (".cube", ".cub")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        from resample_volume.files.formats.cube import read_cube

        return read_cube(path, name, check)


@dataclass(frozen=True)
class TiffStack(OneOfAll):
    """A folder of gray pictures, sorted by number, or one multi-page file.

    Sizes, times and channels are those of OME-TIFF or ImageJ; other pictures have none.
    """

    spacing: Numbers = ""  # instead of the file's

    suffixes: ClassVar[tuple[str, ...]] = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp")

    def __post_init__(self) -> None:
        spacing_of(self.spacing)

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        from resample_volume.files.stacks import slices
        from resample_volume.files.stacks.descriptions import stack_facts

        if path.is_dir():
            paths, name = slices.files_with(path, self.suffixes), path.resolve().name
        else:
            paths, name = [existing_file(path)], stem(path, self.suffixes)
        if not paths:
            raise ValueError(f"{path} holds no slices; known are {', '.join(self.suffixes)}")
        pages = slices.stack_pages(paths)
        first, count = pages[0], len(pages)
        facts = stack_facts(first.told, count, first.channels, name, is_alone=len(paths) == 1)
        own = (facts.spacing, facts.length)
        spacing, length = spacing_of(self.spacing) if self.spacing else own
        shape = (first.width, first.height, facts.slices or count)
        known = header(shape, first.dtype, name, spacing=spacing, origin=facts.origin)
        color, parts = is_color((first.channels,), known.dtype), first.channels * facts.channels
        known = known._replace(length=length, note=facts.note, is_color=color)
        known = known._replace(parts=parts, times=facts.times)
        check(known)
        every = facts.sorted(slices.stack_values(paths, known, pages))
        if facts.line != (0, 1):
            every = np.asarray(facts.line[0] + facts.line[1] * every, np.float32)
            known = known._replace(dtype=every.dtype, is_color=False)
        found = recording(every, known, channels_first=first.channels == 1)
        return found._replace(looks=facts.looks)


@dataclass(frozen=True)
class Dicom:
    """A folder with a DICOM series, sorted by position, or one multi-frame file."""

    series: str = ""  # instance UID; needed where the folder holds several

    space: ClassVar[str] = "lps"
    suffixes: ClassVar[tuple[str, ...]] = (".dcm",)

    def __call__(self, path: Path) -> Volume:
        from resample_volume.files.stacks import dicom

        if path.is_dir():
            files = dicom.dicom_slices(path, self.series)
            return dicom.dicom_volume(files, path.resolve().name)
        name = stem(existing_file(path), self.suffixes)
        return dicom.dicom_volume([path], name)


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
        known = self._header(path, name)
        check(known)
        if path.suffix.lower() == ".gz":
            return recording(voxels(VoxelData([path], 0, "gzip", self.offset), known), known)
        given = path.stat().st_size - self.offset
        if given != known.size:
            raise wrong_size(path.name, max(0, given), known.size)
        shape = (known.times, *known.shape[::-1])
        return recording(np.memmap(path, known.dtype, "r", self.offset, shape), known)

    def _header(self, path: Path, name: str) -> VolumeHeader:
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
        return known._replace(times=math.prod(every[3:]), length=length)


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
                f"{path.name} is no array of numbers, or cut off: {error.reason}"
            ) from None
        return recording_of(values, name, self.spacing, check)


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
