"""Resample data sets of VTK onto a lattice, after validating cells, which VTK does not."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.memory import require_memory
from resample_cells.lattice import (
    NAME,
    Error,
    Leaf,
    Raster,
    lattice_of,
    mean_cell,
    probed,
)
from resample_volume.files.headers import Check, check_shape, header, recording
from resample_volume.files.sections import ArrayQuery, Named, choose, of_parts, part_of
from resample_volume.files.vtk import arrays_of, points_along
from resample_volume.types import Recording

ANY = -1  # number of corners
CORNERS = {  # of a cell, by VTK's number of its kind
    **{0: 0, 1: 1, 2: ANY, 3: 2, 4: ANY, 5: 3, 6: ANY, 7: ANY, 8: 4, 9: 4},
    **{10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 15: 10, 16: 12},  # in space
    **{21: 3, 22: 6, 23: 8, 24: 10, 25: 20, 26: 15, 27: 13, 28: 9, 29: 27, 30: 6, 31: 12},
    **{32: 18, 33: 24, 34: 7, 37: 19},  # of quadratic shape
}
POLYHEDRON = 42
GHOSTS = "vtkGhostType"  # says which points and cells are hidden
SURFACES = "vtkPolyData"
OVERHEAD = 16  # bytes of temporaries per voxel


def check_cells(data: Any, name: str) -> None:
    """Reject grids with non-finite points, or cells with corners that do not exist."""
    if not data.IsA("vtkPointSet"):
        return
    from vtkmodules.util.numpy_support import vtk_to_numpy

    points = vtk_to_numpy(data.GetPoints().GetData()) if data.GetPoints() else np.empty((0, 3))
    if not np.isfinite(points).all():
        raise ValueError(f"{name} is damaged: some of its points are not numbers")
    if data.IsA("vtkStructuredGrid"):
        shape = points_along(data)
        check_shape(shape, name)
        if math.prod(shape) != len(points):
            raise ValueError(f"{name} is damaged: it has {len(points)} points, not as many as said")
    elif data.IsA("vtkUnstructuredGrid"):
        _check_unstructured(data, len(points), name)
    else:
        raise ValueError(f"{name} is {data.GetClassName()!r:.60}, which is not known")


def _check_unstructured(data: Any, points: int, name: str) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    kinds = vtk_to_numpy(_kinds(data))
    strange = sorted({int(kind) for kind in np.unique(kinds)} - {*CORNERS, POLYHEDRON})
    if strange:
        raise ValueError(
            f"{name} has cells of VTK's kind {strange[0]}, which is not known; make them "
            "linear or quadratic ones (ParaView's Tetrahedralize)"
        )
    count = _counts(data.GetCells(), points, name)
    wanted = np.array([CORNERS.get(kind, ANY) for kind in range(POLYHEDRON + 1)])[kinds]
    if len(count) != len(kinds) or ((wanted != ANY) & (wanted != count)).any():
        raise ValueError(f"{name} is damaged: cells have other numbers of corners than their kinds")
    if POLYHEDRON in kinds:
        _check_faces(data, points, len(kinds), name)


def _kinds(data: Any) -> Any:
    """Return the kinds of cells, by a method that VTK 9.6 renamed."""
    try:
        return data.GetCellTypes()
    except TypeError:
        return data.GetCellTypesArray()


def _check_faces(data: Any, points: int, cells: int, name: str) -> None:
    faces, places = data.GetPolyhedronFaces(), data.GetPolyhedronFaceLocations()
    if faces is None or places is None or places.GetNumberOfCells() != cells:
        raise ValueError(f"{name} is damaged: polyhedra have no faces")
    _counts(faces, points, name)
    _counts(places, faces.GetNumberOfCells(), name)


def _counts(held: Any, most: int, name: str) -> NDArray[Any]:
    """Return the number of corners of each cell, out of `most` in all."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    first = vtk_to_numpy(held.GetOffsetsArray())
    corner = vtk_to_numpy(held.GetConnectivityArray())
    count = np.diff(first)
    if first.size and (first[0] != 0 or (count < 0).any() or first[-1] != corner.size):
        raise ValueError(f"{name} is damaged: cells do not begin where those before them end")
    if corner.size and not (corner.min() >= 0 and corner.max() < most):
        raise ValueError(f"{name} is damaged: cells have corners that are not among its points")
    return np.asarray(count)


def resampled(
    pieces: Sequence[Any],
    wanted: ArrayQuery,
    spacing: tuple[float, ...],
    name: str,
    check: Check,
) -> Recording:
    """Resample one array of a grid, or of its pieces, onto a lattice.

    Values outside of cells are NaN. Where pieces overlap, those with smaller cells win.

    Result: components of vectors are channels. `note` tells the resampling and its error.
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
