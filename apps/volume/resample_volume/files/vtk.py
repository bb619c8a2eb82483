"""Legacy files of VTK (`.vtk`), text or binary: image data, rectilinear grids, grids of cells.

The form is that of "VTK File Formats" (docs.vtk.org): numbers of binary files are big-endian.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from resample.reading.limits import check_size
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
    check_shape,
    header,
    recording,
    voxels,
)
from resample_volume.files.sections import (
    Array,
    ArrayQuery,
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
from resample_volume.types import Recording

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
        known = "nothing that is known; known are STRUCTURED_POINTS, RECTILINEAR_GRID and grids"
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


def _header(lattice: _Lattice, array: Array, name: str) -> VolumeHeader:
    dtype = np.dtype(np.uint8) if array.is_shade else array.dtype
    if not array.named.is_of_cells:
        return header(lattice.points, dtype, name, spacing=lattice.spacing, origin=lattice.origin)
    origin = lattice.origin + lattice.spacing / 2
    count = cells_between(lattice.points)
    return header(count, dtype, name, spacing=lattice.spacing, origin=origin)


def _evened(every: Recording, lattice: _Lattice, is_of_cells: bool) -> Recording:
    """Resample a recording to an even lattice."""
    volume = alone(every)
    x, y, z = (middles(each, of_cells=is_of_cells) for each in lattice.planes)
    even = rectilinear(volume.values, x, y, z, volume.name)
    values = even.values[np.newaxis, np.newaxis]
    return Recording(values, *even[1:5], note=even.note, length=every.length)


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
                    f"{found.name} is no grid of cells, which spacing of the reader "
                    f"{wanted.reader} is for: leave it out, or give --spacing, which takes the "
                    "place of the file's"
                )
            lattice = _lattice(found)
            points = lattice.points
            arrays = found.arrays(math.prod(points), math.prod(cells_between(points)))
            chosen = choose([each.named for each in arrays], wanted, path.name)
            array = next(each for each in arrays if each.named == chosen)
            bare = _header(lattice, array, name)
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
        return _evened(every, lattice, chosen.is_of_cells) if lattice.planes else every
