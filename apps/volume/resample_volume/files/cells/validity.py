"""Validate the cells of a grid, which VTK itself does not check."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_volume.files.parsing.headers import check_shape

ANY = -1  # number of corners
CORNERS = {  # of a cell, by VTK's number of its kind
    **{0: 0, 1: 1, 2: ANY, 3: 2, 4: ANY, 5: 3, 6: ANY, 7: ANY, 8: 4, 9: 4},
    **{10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 15: 10, 16: 12},  # in space
    **{21: 3, 22: 6, 23: 8, 24: 10, 25: 20, 26: 15, 27: 13, 28: 9, 29: 27, 30: 6, 31: 12},
    **{32: 18, 33: 24, 34: 7, 37: 19},  # of quadratic shape
}
POLYHEDRON = 42


def check_cells(data: Any, name: str) -> None:
    """Reject grids with non-finite points, or cells with corners that do not exist."""
    if not data.IsA("vtkPointSet"):
        return
    from vtkmodules.util.numpy_support import vtk_to_numpy

    points = vtk_to_numpy(data.GetPoints().GetData()) if data.GetPoints() else np.empty((0, 3))
    if not np.isfinite(points).all():
        raise ValueError(f"{name} is damaged: some of its points are no numbers")
    if data.IsA("vtkStructuredGrid"):
        shape = points_along(data)
        check_shape(shape, name)
        if math.prod(shape) != len(points):
            raise ValueError(f"{name} is damaged: it has {len(points)} points, not as many as said")
    elif data.IsA("vtkUnstructuredGrid"):
        _check_unstructured(data, len(points), name)
    else:
        raise ValueError(f"{name} is {data.GetClassName()!r:.60}, which is not known")


def points_along(data: Any) -> tuple[int, ...]:
    """Return points along x, y, z of a structured grid, in a way that all VTK versions support."""
    first, last = np.reshape(data.GetExtent(), (3, 2)).T.tolist()
    return tuple(b - a + 1 for a, b in zip(first, last, strict=True))


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
    """Return the kinds of cells, whose method VTK 9.6 renamed."""
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
