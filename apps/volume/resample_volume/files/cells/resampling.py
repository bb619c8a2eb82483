"""Resample data sets of VTK, of one piece or many, onto a lattice."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.memory import require_memory
from resample_volume.files.cells.lattice import Leaf, Raster, lattice_of, mean_cell
from resample_volume.files.cells.probing import NAME, Error, probed
from resample_volume.files.cells.validity import check_cells
from resample_volume.files.parsing.choosing import ArrayQuery, Named, choose, of_parts, part_of
from resample_volume.files.parsing.headers import Check, header, recording
from resample_volume.files.xml.vti import arrays_of
from resample_volume.types import Recording

GHOSTS = "vtkGhostType"  # says which points and cells are hidden
SURFACES = "vtkPolyData"
OVERHEAD = 16  # bytes of temporaries per voxel


def resampled(
    pieces: Sequence[Any],
    wanted: ArrayQuery,
    spacing: tuple[float, ...],
    name: str,
    check: Check,
) -> Recording:
    """Resample one array of a grid, or of its pieces, onto a lattice.

    Values outside of cells are NaN. Where pieces overlap, those with smaller cells win.

    Returns
    -------
    Components of vectors are channels. `note` tells the resampling and its error.
    """
    solid = [piece for piece in pieces if not piece.IsA(SURFACES) and piece.GetNumberOfCells()]
    if not solid:
        raise ValueError(f"{name} has no cells in space; surfaces are shown by --mesh")
    for piece in solid:
        check_cells(piece, name)
    chosen, every, leaves = _leaves(solid, wanted, name)
    kind, parts = leaves[0].values.dtype, 1 if wanted.part else chosen.parts
    room = 3 * parts * kind.itemsize + OVERHEAD
    lattice = lattice_of(leaves, spacing, room, name)
    sizes = " x ".join(map(str, lattice.shape))
    what = f"{name} on a lattice of {sizes} voxels"
    require_memory(room * lattice.size, what, "take larger steps, as the reader's spacing")
    bare = header(lattice.shape, kind, name, spacing=lattice.spacing, origin=lattice.origin)
    known = of_parts(bare, chosen, every, wanted)._replace(is_color=False)
    check(known)
    span = _span(leaves)
    values = np.full((*lattice.shape[::-1], parts), np.nan, kind)
    order = leaves
    if len(leaves) > 1:
        order = sorted(leaves, key=lambda leaf: -float(np.prod(mean_cell(leaf.data, name))))
    errors = [probed(leaf, lattice, values, span) for leaf in order]
    note = _note(lattice, leaves, errors, len(pieces) - len(leaves))
    return recording(values, known)._replace(note=note)


def pieces_of(data: Any) -> list[Any]:
    """Return the pieces of a composite data set; for others itself."""
    if not data.IsA("vtkCompositeDataSet"):
        return [data]
    found, at = [], data.NewIterator()
    at.InitTraversal()
    while not at.IsDoneWithTraversal():
        held = at.GetCurrentDataObject()
        found += [held] if held is not None and held.IsA("vtkDataSet") else []
        at.GoToNextItem()
    return found


def _leaves(
    pieces: Sequence[Any], wanted: ArrayQuery, name: str
) -> tuple[Named, list[Named], list[Leaf]]:
    """Return the chosen array, all arrays of its first piece, and the pieces with it alone."""
    held = [arrays_of(piece) for piece in pieces]
    names = [[named for named, _ in arrays] for arrays in held]
    having = [every for every in names if any(wanted.array in ("", one.name) for one in every)]
    every = having[0] if having else names[0]
    chosen = choose(every, wanted, name)
    alike = (chosen.name, chosen.parts, chosen.is_of_cells)
    leaves = [
        _leaf(piece, chosen, array, wanted)
        for piece, arrays in zip(pieces, held, strict=True)
        for named, array in arrays
        if (named.name, named.parts, named.is_of_cells) == alike
    ]
    kind = np.result_type(*(leaf.values.dtype for leaf in leaves))
    if any(leaf.values.dtype != kind for leaf in leaves):
        leaves = [_with(leaf.data, leaf.values.astype(kind), chosen) for leaf in leaves]
    return chosen, every, leaves


def _leaf(piece: Any, chosen: Named, array: Any, wanted: ArrayQuery) -> Leaf:
    """Reduce a piece to one array, of floats that hold its numbers."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    stored = vtk_to_numpy(array)
    values = stored
    if wanted.part and chosen.parts > 1:
        values = part_of(stored.reshape(-1), chosen, wanted, chosen.name)
    kind = np.result_type(values.dtype, np.float32)
    bare = piece.NewInstance()
    bare.CopyStructure(piece)
    for held, other in (
        (bare.GetPointData(), piece.GetPointData()),
        (bare.GetCellData(), piece.GetCellData()),
    ):
        if other.HasArray(GHOSTS):
            held.AddArray(other.GetArray(GHOSTS))
    return _with(bare, np.ascontiguousarray(values, kind), chosen)


def _with(bare: Any, values: NDArray[Any], chosen: Named) -> Leaf:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    array = numpy_to_vtk(values)  # holds a reference to NumPy's memory
    array.SetName(NAME)
    (bare.GetCellData() if chosen.is_of_cells else bare.GetPointData()).AddArray(array)
    return Leaf(bare, values, chosen.is_of_cells)


@np.errstate(over="ignore")
def _span(leaves: list[Leaf]) -> float:
    """Return the range (highest less lowest) of finite values."""
    known = [leaf.values[np.isfinite(leaf.values)] for leaf in leaves]
    low = min((float(some.min()) for some in known if some.size), default=0.0)
    high = max((float(some.max()) for some in known if some.size), default=0.0)
    return high - low


def _note(lattice: Raster, leaves: list[Leaf], errors: list[Error], without: int) -> str:
    """Return a line about the resampling."""
    whole = Error(
        sum(error.squares for error in errors),
        max(error.most for error in errors),
        sum(error.judged for error in errors),
        sum(error.left_out for error in errors),
    )
    things = "centers of cells" if leaves[0].is_of_cells else "points"
    sizes = " x ".join(map(str, lattice.shape))
    steps = " x ".join(f"{step:.4g}" for step in lattice.spacing)
    cells = sum(leaf.data.GetNumberOfCells() for leaf in leaves)
    told = f"{cells} cells" + (f" in {len(leaves)} pieces" if len(leaves) > 1 else "")
    coarser = ", coarser than its cells, to save memory" if lattice.is_coarser else ""
    every = len(leaves) + without
    left = f"; {without} of {every} pieces lack this array, or cells" if without else ""
    return (
        f"{told} were resampled onto a lattice of {sizes} voxels, {steps} apart{coarser}; "
        f"{whole.line(things)}{left}"
    )
