"""MRC and CCP4 maps of microscopy and crystallography, as MRC2014 defines them (ccpem.ac.uk).

Positions are in Å. The first voxel lies at ORIGIN unless that is 0, otherwise at NXSTART, NYSTART
and NZSTART. Cells may be oblique; their first axis is x, their second lies in the plane of x and y.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from resample.types import Doubles
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VoxelData,
    check_shape,
    first_bytes,
    header,
    recording,
    voxels,
)
from resample_volume.types import VOXEL, Recording

LENGTH = 1024  # bytes of a header
FIELDS = {  # name: NumPy's type, and its place
    "count": ("3i4", 0),  # columns, rows, sections
    "mode": ("i4", 12),
    "start": ("3i4", 16),  # number of the first column, row, section
    "grid": ("3i4", 28),  # intervals of the cell along x, y, z
    "cell": ("3f4", 40),  # Å
    "angles": ("3f4", 52),  # degrees
    "order": ("3i4", 64),  # which axis, 1 to 3, columns, rows and sections are of
    "group": ("i4", 88),  # of symmetry
    "extended": ("i4", 92),  # bytes of a second header
    "imod": ("2i4", 152),  # IMOD's stamp and flags
    "origin": ("3f4", 196),
    "word": ("S4", 208),
    "stamp": ("2u1", 212),  # of the machine: order of bytes
}
FORM = np.dtype(
    {
        "names": list(FIELDS),
        "formats": [kind for kind, _ in FIELDS.values()],
        "offsets": [place for _, place in FIELDS.values()],
        "itemsize": LENGTH,
    }
)
TYPES = {0: "int8", 1: "int16", 2: "float32", 6: "uint16", 12: "float16"}
ORDERS: dict[int, Literal["<", ">"]] = {0x44: "<", 0x11: ">"}
REFUSED = {
    3: "complex numbers of 16 bits; write the map that they are the transform of, in mode 2",
    4: "complex numbers; write the map that they are the transform of, in mode 2",
    101: "numbers of 4 bits; convert it to mode 0, such as with IMOD's newstack -mode 0",
}
PICTURES, VOLUMES = 0, 401  # groups of stacks
STAMP, IS_SIGNED = 1146047817, 1  # IMOD's; without the flag its bytes have no sign
LARGEST = 1 << 30  # bytes of a second header


@dataclass(frozen=True)
class Mrc(OneOfAll):
    """MRC and CCP4 maps, in Å; volumes of a stack are times. Raw voxels are memory mapped."""

    suffixes: ClassVar[tuple[str, ...]] = (
        *(".mrc", ".map", ".ccp4", ".mrcs", ".mrc.gz", ".map.gz", ".ccp4.gz", ".mrcs.gz"),
    )

    def read(self, path: Path, name: str, check: Check) -> Recording:
        fields = _fields(first_bytes(path, LENGTH), path.name)
        # What is known of voxels, and which of x, y, z columns, rows and sections are of
        kind = _type(fields, path.name)
        order = tuple(map(int, fields["order"]))
        axes = tuple(axis - 1 for axis in order) if any(order) else (0, 1, 2)
        if sorted(axes) != [0, 1, 2]:
            raise ValueError(
                f"{path.name} is damaged: its axes are {order}, not 1, 2, 3 in some order"
            )
        extended = int(fields["extended"])
        if not 0 <= extended <= LARGEST:
            raise ValueError(f"{path.name} is damaged: its second header has {extended} bytes")
        count, times = [int(each) for each in fields["count"]], 1
        if int(fields["group"]) == VOLUMES:
            each = int(fields["grid"][2])
            if not 1 <= each <= count[2] or count[2] % each or axes[2] != 2:
                raise ValueError(
                    f"{path.name} is damaged: {count[2]} sections are no stack of volumes of {each}"
                )
            count[2], times = each, count[2] // each
        shape = tuple(count[axes.index(axis)] for axis in range(3))
        check_shape(shape, name)
        spacing, origin, direction = _place(fields, axes, path.name)
        known = header(shape, kind, name, spacing=spacing, origin=origin, direction=direction)
        missing = [axis for axis, side in zip("xyz", fields["cell"], strict=True) if not side]
        note = f"no size of the cell along {' and '.join(missing)}: voxels of 1 Å are assumed"
        if len(missing) in (0, 3):
            note = ""
        known = known._replace(times=times, length=VOXEL if len(missing) == 3 else "Å", note=note)
        check(known)
        start = LENGTH + int(fields["extended"])
        packing = "gzip" if path.name.lower().endswith(".gz") else "raw"
        if packing == "gzip":
            stored = VoxelData([path], 0, packing, start, is_exact=False)
        else:
            stored = VoxelData([path], start, is_exact=False)
        sizes = [known.shape[axis] for axis in axes[::-1]]
        values = voxels(stored, known).reshape(known.times, *sizes)
        turned = [1 + axes[::-1].index(axis) for axis in (2, 1, 0)]
        is_pictures = int(fields["group"]) == PICTURES and int(fields["grid"][2]) == 1
        if is_pictures:
            known = known._replace(note="a stack of pictures: its slices are those pictures")
        return recording(values.transpose(0, *turned), known)


def _fields(start: bytes, name: str) -> Any:
    """Parse the header in the byte order of its stamp; without one, in the plausible order."""
    if len(start) < LENGTH or start[208:211] != b"MAP":
        raise ValueError(f"{name} is not an MRC or CCP4 map, or its header is cut off")
    stamped = ORDERS.get(start[212])
    for order in (stamped,) if stamped else ORDERS.values():
        fields = np.frombuffer(start, FORM.newbyteorder(order), 1)[0]
        if stamped or int(fields["mode"]) in (*TYPES, *REFUSED):
            return fields
    raise ValueError(f"{name} is damaged: neither order of bytes gives its mode a meaning")


def _type(fields: Any, file: str) -> np.dtype[Any]:
    mode = int(fields["mode"])
    if mode in REFUSED:
        raise ValueError(f"{file} has mode {mode}, {REFUSED[mode]}")
    if mode not in TYPES:
        raise ValueError(
            f"{file} has the unknown mode {mode}; known are {', '.join(map(str, TYPES))}"
        )
    stamp, flags = (int(each) for each in fields["imod"])
    if mode == 0 and stamp == STAMP and not flags & IS_SIGNED:
        return np.dtype("uint8")
    order: Literal["<", ">"] = ">" if fields.dtype["mode"].byteorder == ">" else "<"
    return np.dtype(TYPES[mode]).newbyteorder(order)


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _place(fields: Any, axes: tuple[int, ...], file: str) -> tuple[Doubles, Doubles, Doubles]:
    """Return spacing, origin and direction; 1 Å if the file has no spacing."""
    cell, grid = np.array(fields["cell"], np.float64), np.array(fields["grid"], np.float64)
    if (grid < 0).any():
        raise ValueError(f"{file} is damaged: its cell has {grid.min():g} intervals")
    is_told = (cell != 0) & (grid > 0)
    spacing = np.where(is_told, cell / np.where(grid > 0, grid, 1), 1.0)
    direction = _cell_axes(np.array(fields["angles"], np.float64), file)
    origin = np.array(fields["origin"], np.float64)
    if not origin.any():
        first = [float(fields["start"][axes.index(axis)]) for axis in range(3)]
        origin = direction @ (spacing * first)
    return spacing, origin, direction


def _cell_axes(angles: Doubles, file: str) -> Doubles:
    """Return unit vectors along a cell's axes as columns, from their angles; 0 means 90."""
    if not angles.any() or (angles == 90).all():
        return np.eye(3)
    alpha, beta, gamma = np.radians(angles)
    if not ((angles > 0) & (angles < 180)).all():
        listed = ", ".join(f"{angle:g}" for angle in angles)
        raise ValueError(f"{file}: its cell has angles of {listed} degrees; correct its header")
    x = math.cos(beta)
    y = (math.cos(alpha) - x * math.cos(gamma)) / math.sin(gamma)
    rest = 1 - x * x - y * y
    if rest <= 0:
        raise ValueError(f"{file}: no cell has the angles of its header; correct it")
    return np.array([[1, math.cos(gamma), x], [0, math.sin(gamma), y], [0, 0, math.sqrt(rest)]])
