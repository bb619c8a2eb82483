"""Maps of densities: MRC and CCP4 of microscopes and crystals, and Gaussian's cubes."""

import math
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Literal

import numpy as np

from resample.reading.limits import check_items, check_size
from resample.types import Doubles
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    VoxelData,
    check_shape,
    first_bytes,
    header,
    recording,
    voxels,
)
from resample_volume.files.texts import check_length, numbers, whole
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
        # Type and shape of the voxels, and the axes of columns, rows and sections.
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


BOHR = 0.529177210903  # Å (CODATA 2018)
LONGEST = 4096  # bytes of a line


@dataclass(frozen=True)
class Cube(OneOfAll):
    """Gaussian's cubes, in Å; several orbitals are channels."""

    suffixes: ClassVar[tuple[str, ...]] = (".cube", ".cub")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        check_size(path.name, path.stat().st_size)
        with path.open("rb") as file:
            known = _header(file, path, name)
            check(known)
            count = known.size // known.dtype.itemsize
            check_length(file, count, path.name)
            require_memory(2 * known.size, name)
            values = numbers(file, count, known.dtype, path.name)
            if file.read(LONGEST).strip():
                raise ValueError(f"{path.name} is damaged: more than its {count} numbers follow")
        every = np.empty((known.parts, *known.shape[::-1]), known.dtype)
        every[...] = values.reshape(*known.shape, known.parts).transpose(3, 2, 1, 0)
        return recording(every, known, channels_first=True)


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _header(file: BinaryIO, path: Path, name: str) -> VolumeHeader:
    for _ in range(2):
        file.readline(LONGEST)  # titles
    words = _words(file)
    atoms, origin = _counted(words, path, "atoms and the origin")
    parts = whole(path, words[4].decode("latin-1")) if len(words) > 4 else 1
    axes = [_counted(_words(file), path, f"voxels along {axis}") for axis in "xyz"]
    sizes = [size for size, _ in axes]
    check_items(path.name, abs(atoms), "atoms")
    if len({size < 0 for size in sizes}) > 1:
        raise ValueError(
            f"{path.name}: numbers of voxels are {', '.join(map(str, sizes))}; "
            "give all the same sign: positive for Bohr, negative for Å"
        )
    for line in islice(iter(lambda: file.readline(LONGEST), b""), abs(atoms)):
        if len(line.split()) != 5:
            raise ValueError(f"{path.name}: an atom has five numbers, not {line[:60].split()}")
    if atoms < 0:
        # Read the number of orbitals, and skip their indices.
        words = _words(file)
        count = whole(path, words[0].decode("latin-1")) if words else 0
        check_items(path.name, count, "orbitals")
        left = count + 1 - len(words)
        while left > 0:
            words = _words(file)
            if not words:
                raise ValueError(f"{path.name} is cut off: {count} orbitals are not named")
            left -= len(words)
        if left < 0:
            raise ValueError(f"{path.name} is damaged: more than {count} orbitals are named")
        parts = count
    if parts < 1:
        raise ValueError(f"{path.name}: its voxels have {parts} numbers; correct its header")
    shape = tuple(map(abs, sizes))
    check_shape(shape, name)
    scale = 1.0 if sizes[0] < 0 else BOHR  # negative numbers: lengths are Å
    steps = scale * np.array([step for _, step in axes])
    length = np.linalg.norm(steps, axis=1)
    unit = steps / np.where(length > 0, length, 1)[:, np.newaxis]
    known = header(shape, np.float32, name, spacing=length, origin=scale * origin, direction=unit.T)
    pixel = f"{parts} orbitals" if atoms < 0 else ""
    return known._replace(parts=parts, pixel=pixel, length="Å")


def _words(file: BinaryIO) -> list[bytes]:
    return file.readline(LONGEST).split()


def _counted(words: list[bytes], path: Path, what: str) -> tuple[int, Doubles]:
    """Parse an integer, and three other numbers."""
    try:
        place = np.array([float(word) for word in words[1:4]])
        count = int(words[0][:20])
    except (ValueError, IndexError):
        place, count = np.zeros(0), 0
    if len(place) != 3:
        told = b" ".join(words)[:60]
        raise ValueError(
            f"{path.name} is not a Gaussian cube: {what} are a number and three more, not {told!r}"
        )
    return count, place
