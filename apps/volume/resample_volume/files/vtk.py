"""VTK's files: legacy ones as text or binary, and XML (.vti, .vtr), with checks that VTK needs."""

import base64
import math
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from math import prod
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from resample.reading.limits import check_ratio, check_size, check_unpacked
from resample.reading.native import plain, suppressed_output
from resample.reading.texts import check_xml_file
from resample.registry import load, missing
from resample.types import Doubles
from resample_volume.data.recordings import alone
from resample_volume.data.rectilinear import rectilinear
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
    VolumeHeader,
    VoxelData,
    accept_any,
    check_shape,
    existing_file,
    header,
    recording,
    stem,
    voxels,
)
from resample_volume.files.sections import (
    ArrayQuery,
    Named,
    Sections,
    cells_between,
    check_part,
    check_single,
    choose,
    middles,
    of_parts,
    part_of,
)
from resample_volume.files.texts import Numbers, numbers, steps_of
from resample_volume.types import Recording, Volume

BLOCK = 1 << 16  # bytes parsed at a time
APPENDED = "AppendedData"  # data after its start are not XML
WHOLE = ("ImageData", "RectilinearGrid", "StructuredGrid")  # elements that pieces fill
ARRAYS = ("DataArray", "Array")
NUMBER = re.compile(r"-?\d{1,12}", re.ASCII)
LARGEST = 1 << 40  # largest plausible count
WIDEST = 32  # bytes of an empty text
WIDTHS = {"8": 1, "6": 2, "2": 4, "4": 8}  # bytes of a number, by the last digit of its type
LETTERS = 32  # of base64 for three numbers of 64 bits
LETTER = re.compile(rb"[A-Za-z0-9+/]*")


@dataclass
class Element:
    """An element and its location."""

    name: str
    attributes: dict[str, str]
    start: int  # byte of its tag
    data: int = -1  # byte of its first non-blank character; -1: none
    end: int = -1  # byte of its end; -1: it has none


def elements_of(content: mmap) -> list[Element]:
    """Return all elements in order, as far as a file is XML; appended data is the last."""
    from xml.parsers import expat

    parser, every, around = expat.ParserCreate(), list[Element](), list[Element]()

    def begin(name: str, attributes: dict[str, str]) -> None:
        every.append(Element(name, attributes, parser.CurrentByteIndex))
        if name == APPENDED:
            raise StopIteration  # the rest is not XML
        around.append(every[-1])
        parser.CharacterDataHandler = place

    def end(_: str) -> None:
        around.pop().end = parser.CurrentByteIndex
        parser.CharacterDataHandler = place if around and around[-1].data < 0 else None

    def place(text: str) -> None:
        """Record where an element's data begin."""
        if around and text.strip():
            before = len(text) - len(text.lstrip())
            around[-1].data = parser.CurrentByteIndex + before
            parser.CharacterDataHandler = None

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        for start in range(0, len(content), BLOCK):
            parser.Parse(content[start : start + BLOCK], False)
    except (expat.ExpatError, LookupError, StopIteration):  # look-ups are of encodings
        pass
    return every


def data_start(content: mmap, appended: Element) -> int:
    """Return the byte after the underscore of appended data; -1: there is none."""
    place = content.find(b">", appended.start) + 1
    while place and content[place : place + 1].isspace():
        place += 1
    return place + 1 if place and content[place : place + 1] == b"_" else -1


def check_blocks(path: Path) -> None:
    """Reject sizes beyond what the file can hold: VTK would end the process."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        every = elements_of(content)
        if not every:
            raise ValueError(f"{path.name} is damaged: it is not XML")
        size, attributes = len(content), every[0].attributes
        number = "<Q" if attributes.get("header_type") == "UInt64" else "<I"
        if attributes.get("byte_order") == "BigEndian":
            number = number.replace("<", ">")
        is_packed = "compressor" in attributes
        if every[-1].name == APPENDED and data_start(content, every[-1]) < 0:
            raise ValueError(f"{path.name} is damaged: its data do not begin with an underscore")
        unpacked = 0
        for begin in _begins(content, every):
            width = struct.calcsize(number)
            whole_numbers = begin[: min(2, len(begin) // width) * width]
            numbers = [one for (one,) in struct.iter_unpack(number, whole_numbers)]
            if not numbers or (is_packed and numbers[0] and len(numbers) < 2):
                raise ValueError(f"{path.name} is damaged: data do not begin with their size")
            if numbers[0] > size:
                raise ValueError(
                    f"{path.name} is damaged: {numbers[0]} bytes or blocks are not there"
                )
            if is_packed and len(numbers) > 1:
                if numbers[0] and not numbers[1]:  # VTK divides by it
                    raise ValueError(f"{path.name} is damaged: blocks of data have no size")
                unpacked += numbers[0] * numbers[1]
                check_unpacked(path.name, size, unpacked)
        size = len(content)
        # Reject arrays far larger than the file: VTK would allocate them.
        needed = places = whole = filled = 0
        for element in every:
            attributes = element.attributes
            if element.name == "Piece":
                counts = [
                    count_of(attributes.get(key, "1"))
                    for key in ("NumberOfPoints", "NumberOfCells")
                ]
                places = max(1, _inside(attributes.get("Extent", "")), *counts)
                filled += places
                needed += places
            elif element.name in WHOLE:
                whole = _inside(attributes.get("WholeExtent", ""))
            elif element.name in ARRAYS:
                rows = max(places, count_of(attributes.get("NumberOfTuples", "0")))
                width = WIDTHS.get(attributes.get("type", "")[-1:], WIDEST)
                needed += rows * count_of(attributes.get("NumberOfComponents", "1")) * width
            check_ratio(path.name, size, needed)
        if whole > filled:
            raise ValueError(f"{path.name} is damaged: its pieces hold {filled} of {whole} points")
        require_memory(needed, path.name)


def count_of(text: str) -> int:
    """Parse a count; an invalid one counts as large."""
    number = _number(text)
    return LARGEST if number < 0 else number


def _inside(extent: str) -> int:
    """Return the points within an extent; 0 for an invalid one."""
    ends = [_number(end) for end in extent.split()]
    if len(ends) != 6:
        return 0
    return prod(max(0, b - a + 1) for a, b in zip(ends[::2], ends[1::2], strict=True))


def _number(text: str) -> int:
    """Parse an integer; an invalid one counts as large."""
    known = NUMBER.fullmatch(text.strip())
    return int(text) if known else LARGEST


def _begins(content: mmap, every: list[Element]) -> Iterator[bytes]:
    """Return the first bytes of each array's data."""
    appended = every[-1] if every[-1].name == APPENDED else None
    start = -1 if appended is None else data_start(content, appended)
    for element in every:
        attributes = element.attributes
        if attributes.get("format") == "binary" and element.data >= 0:
            yield _decoded(content[element.data : element.data + LETTERS])
        elif appended is not None and (attributes.get("offset") or "-").strip().isdecimal():
            place = start + count_of(attributes["offset"])
            begin = content[place : place + LETTERS]
            yield _decoded(begin) if appended.attributes.get("encoding") == "base64" else begin


def _decoded(letters: bytes) -> bytes:
    """Decode base64 up to the first invalid character or padding."""
    known = LETTER.match(letters)
    found = known[0] if known else b""
    found = found[: len(found) - (len(found) % 4 == 1)]
    return base64.b64decode(found + b"=" * (-len(found) % 4))


BASE64 = re.compile(rb"[A-Za-z0-9+/=\s]*")


def read_vti(path: Path, wanted: ArrayQuery, name: str, check: Check = accept_any) -> Recording:
    """Read one array at points or cells; components are channels, or a color."""
    image = grid_of(path, "vtkXMLImageDataReader")
    chosen, every, values = _values(image, wanted, path.name)
    with path.open("rb") as file:  # as written: VTK makes it (1, 1, 1) if it is not a number
        found = re.search(rb"<ImageData[^>]*\bSpacing=\"([^\"]*)\"", file.read(1 << 16))
    spacing = [float(text) for text in found[1].split()] if found else None
    known = image_header(image, values.dtype, spacing, name, is_of_cells=chosen.is_of_cells)
    known = of_parts(known, chosen, every, wanted)
    check(known)
    return recording(part_of(values, chosen, wanted, name), known)


def read_vtr(path: Path, wanted: ArrayQuery, name: str) -> Volume:
    """Read one array of a rectilinear grid; parameters as in `read_vti`."""
    grid = grid_of(path, "vtkXMLRectilinearGridReader")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    chosen, every, values = _values(grid, wanted, path.name)
    points = grid.GetDimensions()
    shape = cells_between(points) if chosen.is_of_cells else points
    known = of_parts(header(shape, values.dtype, name), chosen, every, wanted)
    check_single(known, path.name)
    axes = (grid.GetXCoordinates(), grid.GetYCoordinates(), grid.GetZCoordinates())
    x, y, z = (middles(vtk_to_numpy(axis), of_cells=chosen.is_of_cells) for axis in axes)
    values = part_of(values, chosen, wanted, name)
    made = rectilinear(values.reshape(known.shape[::-1]), x, y, z, name)
    return made._replace(length=known.length)


def points_along(data: Any) -> tuple[int, ...]:
    """Return points along x, y, z of a structured grid, in a way that all VTK versions support."""
    first, last = np.reshape(data.GetExtent(), (3, 2)).T.tolist()
    return tuple(b - a + 1 for a, b in zip(first, last, strict=True))


def grid_of(path: Path, reader_name: str, check: Callable[[Path], None] | None = None) -> Any:
    """Read a file by a reader of VTK's, after checks of it; `check` is a further one."""
    try:
        forms = import_module("vtkmodules.vtkIOXML")
    except ImportError:
        raise ValueError(
            f"{path.name}: {path.suffix} is read by VTK; pip install 'hybrid-resample[vtk]'"
        ) from None
    _check_end(path)
    check_xml_file(path, "AppendedData")
    check_blocks(path)
    if check is not None:
        check(path)
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    failures: list[str] = []
    reader = getattr(forms, reader_name)()
    reader.AddObserver("ErrorEvent", lambda _, event: failures.append(event))
    reader.SetFileName(plain(path))
    with suppressed_output():
        reader.UpdateInformation()
        _refuse(failures, path.name)
        attributes = reader.GetOutputInformation(0)
        extents = vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT()
        if attributes.Has(extents):  # else it is not a grid; the caller rejects it
            first, last = np.reshape(attributes.Get(extents), (3, 2)).T.tolist()
            count = math.prod(b - a + 1 for a, b in zip(first, last, strict=True))
            require_memory(count, path.name)  # at least a byte per voxel
            check_unpacked(path.name, path.stat().st_size, count)
        reader.Update()
        _refuse(failures, path.name)
    return reader.GetOutput()


def _values(grid: Any, wanted: ArrayQuery, name: str) -> tuple[Named, list[Named], Any]:
    """Return the chosen array, all arrays, and the values (N,), or (N, C) with components."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    every = arrays_of(grid)
    names = [named for named, _ in every]
    chosen = choose(names, wanted, name)
    array = every[names.index(chosen)][1]
    return chosen, names, vtk_to_numpy(array)  # which holds a reference to VTK's memory


def arrays_of(grid: Any) -> list[tuple[Named, Any]]:
    """Return the numeric arrays at the points and cells of a data set of VTK's."""
    found = []
    for of_cells, held in ((False, grid.GetPointData()), (True, grid.GetCellData())):
        for n in range(held.GetNumberOfArrays()):
            if array := held.GetArray(n):  # None for texts
                told = str(held.GetArrayName(n)), array.GetNumberOfComponents()
                found.append((Named(*told, of_cells, array is held.GetScalars()), array))
    return found


def image_header(
    image: Any, dtype: Any, spacing: Any, name: str, *, is_of_cells: bool
) -> VolumeHeader:
    """Return the header of image data; its first voxel may have any index.

    `spacing`: replaces the image's; None: the image's. `is_of_cells`: whether voxels are its cells.
    """
    points = image.GetDimensions()
    known = header(
        cells_between(points) if is_of_cells else points,
        dtype,
        name,
        spacing=image.GetSpacing() if spacing is None else spacing,
        origin=image.GetOrigin(),
        direction=np.reshape(image.GetDirectionMatrix().GetData(), (3, 3)),
    )
    first = known.spacing * (np.array(image.GetExtent()[::2]) + is_of_cells / 2)
    return known._replace(origin=known.origin + known.direction @ first)


def _check_end(path: Path) -> None:
    """Reject truncated files and invalid base64: VTK would read forever."""
    with path.open("rb") as file:
        head = re.search(rb'<AppendedData\s+encoding="base64"\s*>\s*_', file.read(1 << 16))
        file.seek(max(0, path.stat().st_size - 1024))
        last = file.read()
        if b"</VTKFile" not in last:
            _refuse(["its end is missing"], path.name)
        if head is None:
            return
        file.seek(head.end())
        while block := file.read(1 << 20):
            content, end, _ = block.partition(b"<")
            if not BASE64.fullmatch(content):
                _refuse(["characters outside base64"], path.name)
            if end:
                return


def _refuse(failures: list[str], name: str) -> None:
    if failures:
        raise ValueError(f"{name} is damaged or not what its suffix says; get the file again")


@dataclass(frozen=True)
class Vti(OneOfAll):
    """VTK image data, at points or cells. Components are channels, or a color."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    suffixes: ClassVar[tuple[str, ...]] = (".vti",)

    def __post_init__(self) -> None:
        check_part(self.part)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        wanted = ArrayQuery(self.array, self.part, "vti")
        return read_vti(path, wanted, name, check)


@dataclass(frozen=True)
class Vtr:
    """VTK rectilinear grid; values at points, or at the cells between planes."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    suffixes: ClassVar[tuple[str, ...]] = (".vtr",)

    def __post_init__(self) -> None:
        check_part(self.part)

    def __call__(self, path: Path) -> Volume:
        wanted = ArrayQuery(self.array, self.part, "vtr")
        return read_vtr(existing_file(path), wanted, stem(path, self.suffixes))


OTHERS = {
    "polydata": "a surface; write it as PLY or STL and show it with --mesh beside a volume",
    "field": "arrays without a place; write them as image data",
}
GRIDS = ("structured_grid", "unstructured_grid")  # of cells
AXES = ("x_coordinates", "y_coordinates", "z_coordinates")


class _Lattice(NamedTuple):
    """The lattice of points."""

    points: tuple[int, ...]  # x, y, z
    spacing: Doubles
    origin: Doubles
    planes: list[Doubles]  # coordinates along x, y, z if uneven; otherwise none


@np.errstate(all="ignore")  # absurd numbers are rejected, without warnings
def _lattice(found: Sections) -> _Lattice:
    """Read the header of the lattice, up to the first array of points or cells."""
    if found.dataset not in ("structured_points", "rectilinear_grid"):
        known = "unknown; known are STRUCTURED_POINTS, RECTILINEAR_GRID and grids"
        why = OTHERS.get(found.dataset, known)
        raise ValueError(f"{found.name} holds {found.dataset.upper()[:40]!r}, {why}")
    # Read numbers by key, and coordinates of planes
    told: dict[str, list[float]] = {}
    planes: dict[str, Doubles] = {}
    while (words := found.line()) and words[0].lower() not in ("point_data", "cell_data"):
        word = words[0].lower()
        if word in AXES:
            planes[word] = found.coordinates(words)
        elif word == "field":
            found.skip_field(words)
        else:
            told[word] = found.floats(words[1:])
    found.back()
    first = np.zeros(3)
    if len(told.get("extent", ())) == 6:
        low, high = np.reshape(told["extent"], (3, 2)).T
        told["dimensions"], first = (high - low + 1).tolist(), low
    points = tuple(int(each) for each in told.get("dimensions", ()) if abs(each) < 1 << 40)
    check_shape(points, found.name)
    spacing = np.array(told.get("spacing", told.get("aspect_ratio", (1, 1, 1))))
    origin = np.array(told.get("origin", (0, 0, 0)))
    if spacing.shape != (3,) or origin.shape != (3,):
        raise ValueError(f"{found.name}: SPACING and ORIGIN are three numbers each; correct them")
    if found.dataset == "structured_points":
        return _Lattice(points, spacing, origin + first * spacing, [])
    missing = [key.upper() for key in AXES if key not in planes]
    if missing:
        raise ValueError(f"{found.name} is damaged: it has no {', '.join(missing)}")
    return _Lattice(points, np.ones(3), np.zeros(3), [planes[key] for key in AXES])


@dataclass(frozen=True)
class Vtk(OneOfAll):
    """VTK's legacy files, as text or binary: image data, rectilinear grids, grids of cells.

    Values are at points or cells; components are channels, or a color. Unstructured grids are
    resampled onto a lattice, with the extra vtk.
    """

    array: str = ""  # name of the array; empty: the first of SCALARS, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors

    spacing: Numbers = ""  # of the lattice, as 0.5 or 1x1x2; empty: the mean size of cells

    suffixes: ClassVar[tuple[str, ...]] = (".vtk",)

    def __post_init__(self) -> None:
        check_part(self.part)
        steps_of(self.spacing)

    def read(self, path: Path, name: str, check: Check) -> Recording:
        wanted = ArrayQuery(self.array, self.part, "vtk")
        spacing = steps_of(self.spacing)
        # Read one array, at points or cells; components are channels, or a color
        with path.open("rb") as file:
            found = Sections(file, path.name)
            if found.is_text:
                check_size(path.name, path.stat().st_size)
            if found.dataset in GRIDS:
                if absent := missing("readers", "vtu"):
                    raise ValueError(f"{found.name} holds a grid of cells; {absent}")
                grids: Any = load("readers", "vtu")
                read: Recording = grids.of_sections(found, wanted, spacing, name, check)
                return read
            if spacing:
                raise ValueError(
                    f"{found.name} is not a grid of cells, and spacing of the reader "
                    f"{wanted.reader} is for those: leave it out, or give --spacing instead of the "
                    "file's"
                )
            lattice = _lattice(found)
            points = lattice.points
            arrays = found.arrays(math.prod(points), math.prod(cells_between(points)))
            chosen = choose([each.named for each in arrays], wanted, path.name)
            array = next(each for each in arrays if each.named == chosen)
            dtype = np.dtype(np.uint8) if array.is_shade else array.dtype
            count, origin = points, lattice.origin
            if chosen.is_of_cells:
                count, origin = cells_between(points), origin + lattice.spacing / 2
            bare = header(count, dtype, name, spacing=lattice.spacing, origin=origin)
            known = of_parts(bare, chosen, [each.named for each in arrays], wanted)
            if lattice.planes:
                check_single(known, path.name)
            check(known)
            stored = bare._replace(parts=chosen.parts)
            if found.is_text:
                require_memory(stored.size, name)
                file.seek(array.start)
                values = numbers(file, array.size, array.dtype, path.name)
                if array.is_shade:
                    values = np.rint(255 * np.clip(np.nan_to_num(values), 0, 1)).astype(np.uint8)
            else:
                values = voxels(VoxelData([path], array.start, is_exact=False), stored)
        every = recording(part_of(values, chosen, wanted, name), known)
        if not lattice.planes:
            return every
        x, y, z = (middles(each, of_cells=chosen.is_of_cells) for each in lattice.planes)
        volume = alone(every)
        even = rectilinear(volume.values, x, y, z, volume.name)
        values = even.values[np.newaxis, np.newaxis]
        return Recording(values, *even[1:5], note=even.note, length=every.length)
