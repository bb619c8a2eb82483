"""Read point clouds: PLY, PCD, LAS, text columns, NumPy arrays."""

import errno
import struct
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import is_in_file
from resample.reading.arrays import npz_names, read_npz
from resample.reading.limits import check_size, check_unpacked
from resample.types import Doubles
from resample.watching import report
from resample_points.data.cloud import Cloud, kept_columns, some_of
from resample_points.data.fields import COLORS, NORMALS, PLACES, Fields, cloud_of
from resample_points.data.parts import STEP, CloudBuilder, storage_for
from resample_points.files.las import read_las

MOST_DIGITS = 30  # digits of a count
LONGEST_HEADER = 1000  # lines
COMMENTS = ("#", "//")  # beginnings of comment lines
PARTS = {"position": (3,), "normal": (3,), "color": (3,), "radius": ()}  # shapes per point
COLUMNS = {3: "x y z", 4: "x y z value", 6: "x y z r g b", 9: "x y z r g b nx ny nz"}

GAUSSIANS = (  # columns of 3D Gaussians; each set is sufficient
    {"f_dc_0", "opacity", "scale_0", "rot_0"},
    {"packed_position", "packed_rotation", "packed_scale"},
)

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
PCD_TYPES = {"I": "i", "U": "u", "F": "f"}


def read_cloud(path: str | Path, *, level: int = 0, columns: Sequence[str] | None = None) -> Cloud:
    """Read a point cloud.

    A cloud that does not fit into memory, or into what `resample.memory.allowing` permits, is read
    part by part into memory-mapped arrays: LAS, LAZ, COPC, and binary PLY and PCD. They are used
    like any other arrays.

    Parameters
    ----------
    path
        The suffix decides. `.ply` and `.pcd`: ASCII and all binary kinds. `.xyz`, `.txt`, `.asc` or
        `.csv`: text of numbers in columns (x y z, then r g b, then a normal; or x y z and a value;
        or as named by the first line). `.xyzn`: x y z and a normal. `.npz`: the arrays position
        and, if known, normal, color (linear light) and radius. Colors of all other formats are
        taken for sRGB: integers of their type's range, floats from 0 to 1; in text 0 to 255 if any
        is above 1. Further values per point are kept as columns. `.las` and `.laz`, including
        COPC, need the extra `las`; if they have no colors, points are colored by intensity, or
        else by class.
    level
        Number of the finest levels of a COPC file to skip.
    columns
        Names of columns to keep. Default: all.

    Returns
    -------
    The points whose positions are finite. A mesh's triangles are ignored: its vertices are points.

    Raises
    ------
    ValueError
        The format is unknown, the file does not have it, it has no points or lacks a column, or
        neither memory nor disk has room for it.
    OSError
        The file is missing, cut off or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from resample_points import read_cloud
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "scan.xyz"
    ...     np.savetxt(path, [[0, 0, 1, 255, 0, 0], [0, 1, 1, 0, 255, 0]])
    ...     cloud = read_cloud(path)
    >>> cloud.position.shape, cloud.color[0].tolist()
    ((2, 3), [1.0, 0.0, 0.0])
    """
    source = Path(path)
    reader = READERS.get(source.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: clouds are read from {', '.join(READERS)}")
    if not source.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    if level and source.suffix.lower() not in LASER:
        raise ValueError(f"{source.name} has no levels, which COPC files have")
    try:
        if source.suffix.lower() in LASER:
            return read_las(source, level, columns)
        cloud = kept_columns(reader(source), columns)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None
    if is_in_file(cloud.position):
        return cloud
    known = np.asarray(np.isfinite(cloud.position).all(axis=1))
    if not known.any():
        raise ValueError(f"{source.name}: has no points")
    return cloud if known.all() else some_of(cloud, known)


def is_cloud(path: Path) -> bool:
    """Whether a file is a cloud by its suffix, or for `.npz` by the names of its arrays."""
    if path.suffix.lower() != ".npz":
        return path.suffix.lower() in READERS
    try:
        return "position" in npz_names(path)
    except OSError:
        return False


def _read_arrays(path: Path) -> Cloud:
    known: dict[str, Any] = read_npz(path)
    if "position" not in known:
        raise ValueError(f"has no array position; a cloud has {', '.join(PARTS)}")
    count = len(known["position"]) if known["position"].ndim else 0
    parts = {name: known.pop(name, np.zeros((0, *rest))) for name, rest in PARTS.items()}
    for name, part in parts.items():
        if part.shape[1:] != PARTS[name] or len(part) not in {count, 0}:
            raise ValueError(f"{name} has the shape {part.shape}; give {(count, *PARTS[name])}")
    position = parts.pop("position")
    kind = np.float32 if position.dtype == np.float32 else np.float64
    single = {name: part.astype(np.float32) for name, part in parts.items()}
    columns = {name: part for name, part in known.items() if _is_column(part, count)}
    return Cloud(position.astype(kind), **single, columns=columns)


def _is_column(part: NDArray[Any], count: int) -> bool:
    """Whether an array holds a number for each point."""
    return part.shape == (count,) and part.dtype.kind in "iufb"


def _read_columns(path: Path) -> Cloud:
    """Read a cloud from columns of numbers separated by commas, semicolons or blanks."""
    try:
        check_size(str(path), path.stat().st_size)
        lines = path.read_text("utf-8").translate(str.maketrans(",;", "  ")).splitlines()
    except UnicodeDecodeError:
        raise ValueError("is not a text file") from None
    first = next((n for n, line in enumerate(lines) if line.strip()), 0)
    names = _names(lines[first]) if lines else []
    is_comment = bool(lines) and lines[first].lstrip().startswith(COMMENTS)
    table = _table(lines[first + 1 :] if names and not is_comment else lines)
    if names and not is_comment and len(names) != table.shape[1]:
        raise ValueError(f"names {len(names)} columns and has {table.shape[1]}")
    if len(names) != table.shape[1] or not set(names).issuperset("xyz"):
        names = _usual_names(table.shape[1], path.suffix.lower() == ".xyzn")
    fields = dict(zip(names, table.T, strict=True))
    for group in COLORS:
        levels = [fields[name] for name in group if name in fields]
        if len(levels) == 3 and np.max(levels, initial=0.0) > 1:
            fields.update({name: fields[name] / 255 for name in group})
    return cloud_of(fields)


def _names(line: str) -> list[str]:
    """Return the column names of a line; empty if it holds a number."""
    words = line.strip().lstrip("#/").split()
    if any(_is_number(word) for word in words):
        return []
    known = {name for names in (*PLACES, *NORMALS, *COLORS) for name in names}
    return [word.lower() if word.lower() in known else word for word in words]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _usual_names(width: int, with_normals: bool) -> list[str]:
    """Return the usual names of columns for a table without names."""
    usual = {6: "x y z nx ny nz"} if with_normals else COLUMNS
    if width not in usual:
        raise ValueError(
            f"has {width} columns; known are {', '.join(usual.values())}, or columns named by the "
            "first line"
        )
    return usual[width].split()


def _header(file: BinaryIO, last: str) -> list[list[str]]:
    """Read the words of a header's lines up to the one that begins with `last`."""
    lines = []
    for line in islice(file, LONGEST_HEADER):
        words = line.decode("latin-1").split()
        lines.append(words)
        if words and words[0] == last:
            return lines
    raise ValueError(f"is not of this format: it has no line {last}")


def _read_ply(path: Path) -> Cloud:
    with path.open("rb") as file:
        header = _header(file, "end_header")
        if header[0] != ["ply"]:
            raise ValueError("is not a PLY file: it does not begin with ply")
        encoding, lines, count, kind = _ply_vertices(header)
        if encoding == "ascii":
            for _ in islice(file, min(lines, path.stat().st_size)):
                pass
            return cloud_of(_text_fields(path, file, count, kind))
        return _binary_cloud(path, file, count, kind)


def _ply_vertices(header: list[list[str]]) -> tuple[str, int, int, np.dtype[Any]]:
    """Return encoding, elements before the vertices, number and type of vertices."""
    encoding, element, before, count = "", "", 0, -1
    fields = []
    for words in header:
        if words[:1] == ["format"]:
            encoding = " ".join(words[1:2])
        elif words[:1] == ["element"]:
            element = " ".join(words[1:2])
            count = _length(words) if element == "vertex" else count
            before += _length(words) if count < 0 else 0
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in PLY_TYPES:
                raise ValueError(f"has vertices with '{' '.join(words)}', which is no number")
            fields.append((words[2], PLY_FORMATS.get(encoding, "") + PLY_TYPES[words[1]]))
    _refuse_gaussians({name for name, _ in fields})
    if encoding not in PLY_FORMATS or count < 0:
        raise ValueError(f"has no element vertex, or is none of {', '.join(PLY_FORMATS)}")
    if before and encoding != "ascii":
        raise ValueError("has something before its vertices; write the vertices first")
    return encoding, before, count, np.dtype(fields)


def _refuse_gaussians(names: set[str]) -> None:
    if any(own <= names for own in GAUSSIANS):
        raise ValueError(
            "holds 3D Gaussians (f_dc_*, opacity, scale_*, rot_*), which `read_gaussians` reads "
            "and `resample-points render` paints; a cloud of points has x y z red green blue"
        )


def _within(column: NDArray[Any], kind: np.dtype[Any], name: str) -> NDArray[Any]:
    """Convert numbers to a type that must hold all of them."""
    if kind.kind in "iu" and column.size:
        ends = np.iinfo(kind)
        if not (ends.min <= column.min() and column.max() <= ends.max):  # nor NaN
            raise ValueError(f"holds numbers of {name} that do not fit into {kind}")
    return column.astype(kind)


def _length(words: list[str]) -> int:
    """Return the number of elements from a header line."""
    if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > MOST_DIGITS:
        raise ValueError(f"has a PLY header with {' '.join(words)!r:.60}; it needs a whole number")
    return int(words[2])


def _binary_cloud(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Cloud:
    """Read a cloud of `count` consecutive binary points."""
    wanted, given = count * kind.itemsize, path.stat().st_size - file.tell()
    if not 0 <= wanted <= given or count > given:  # points without fields have no bytes
        raise OSError(f"{path} is cut off: {given} of {wanted} bytes are there")
    gathering = CloudBuilder(storage_for(count, path.name))
    for first in range(0, max(count, 1), STEP):
        some = min(STEP, count - first)
        points = np.frombuffer(file.read(some * kind.itemsize), kind, some)
        fields = {name: points[name] for name in kind.names or () if points[name].ndim == 1}
        gathering.add(cloud_of(fields))
        report(first + some, count)
    return gathering.cloud()


def _text_fields(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Fields:
    """Read columns from lines of numbers, in their types."""
    check_size(str(path), path.stat().st_size)
    most = min(max(count, 0), path.stat().st_size)  # a point has a byte or more
    table = _table([line.decode("latin-1") for line in islice(file, most)])
    if count < 0 or len(table) < count:
        raise OSError(f"{path} is cut off: {len(table)} of {count} points are there")
    fields, first = {}, 0
    for name in kind.names or ():
        if first >= table.shape[1]:
            raise ValueError(f"has {table.shape[1]} numbers in a line and no {name}")
        fields[name] = _within(table[:, first], kind[name].base, name)
        first += int(np.prod(kind[name].shape))
    return fields


def _table(lines: list[str]) -> Doubles:
    """Parse lines of numbers separated by blanks, (N, columns)."""
    if not any(line.strip() for line in lines):
        return np.zeros((0, 3))
    try:
        table: Doubles = np.loadtxt(lines, np.float64, comments=COMMENTS, ndmin=2)
        return table
    except ValueError as error:
        raise ValueError(f"is not a table of numbers: {str(error).partition(';')[0]}") from None


def _read_pcd(path: Path) -> Cloud:
    with path.open("rb") as file:
        header = {words[0].upper(): words[1:] for words in _header(file, "DATA") if words}
        count, kind = _pcd_points(header)
        encoding = " ".join(header["DATA"]).lower()
        if encoding == "binary":
            return _binary_cloud(path, file, count, kind)
        if encoding == "ascii":
            fields = _text_fields(path, file, count, kind)
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
        sizes, types = (
            map(int, header["SIZE"]),
            [PCD_TYPES[word.upper()] for word in header["TYPE"]],
        )
        points = int(header["POINTS"][0]) if "POINTS" in header else _area(header)
        described = zip(_unique_names(names), types, sizes, counts, strict=True)
        return points, np.dtype(
            [
                (name, f"<{letter}{size}", (count,) if count > 1 else ())
                for name, letter, size, count in described
            ]
        )
    except (KeyError, IndexError, ValueError, TypeError):
        raise ValueError("has no PCD header with FIELDS, SIZE, TYPE and POINTS that fit") from None


def _unique_names(names: list[str]) -> list[str]:
    """Make field names unique; padding is often called _ several times."""
    return [f"{name} {n}" if name in names[:n] else name for n, name in enumerate(names)]


def _area(header: dict[str, list[str]]) -> int:
    return int(header["WIDTH"][0]) * int(header["HEIGHT"][0])


def _compressed_fields(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Fields:
    """Read columns stored one after the other, compressed by LZF."""
    from resample_points.files.kernels.lzf import unpack

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


READERS: dict[str, Callable[[Path], Cloud]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    ".xyz": _read_columns,
    ".xyzn": _read_columns,
    ".txt": _read_columns,
    ".asc": _read_columns,
    ".csv": _read_columns,
    ".npz": _read_arrays,
    ".las": read_las,
    ".laz": read_las,
}
LASER = (".las", ".laz")
