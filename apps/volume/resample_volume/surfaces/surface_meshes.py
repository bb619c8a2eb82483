"""Isosurfaces as meshes: extracted by VTK, then moved onto the interpolated field."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_volume.classification.scales import scale_named
from resample_volume.data.memory import require_memory
from resample_volume.surfaces.meshes import IsoSurface, SceneMesh
from resample_volume.surfaces.plane_meshes import values_at
from resample_volume.types import Volume
from resample_volume.voxels.fields import check_iso
from resample_volume.voxels.gathered import Gathered
from resample_volume.voxels.visible import finite_range, lattice_of

BYTES_PER_VOXEL = 12  # bytes of VTK's input and of a surface of typical size
STEP = 1 / 16  # voxels, step of the differences for slopes
FARTHEST = 0.5  # voxels that a vertex moves per step, at most
TURNS = 3  # Newton steps, with the initial slopes


def surface_mesh(surface: IsoSurface, volume: Volume, field: Gathered) -> SceneMesh:
    """Extract an isosurface as a mesh with the field's gradients as normals.

    Vertices lie on the field's isosurface; triangles are about as large as voxels.
    """
    by = scale_named(volume.scale)
    value = surface.value if by is None else by.place(surface.value, "surface")
    check_iso(value, volume, finite_range(volume.values))
    require_memory(BYTES_PER_VOXEL * volume.values.size, f"a surface of {volume.name}")
    place, face = _corners(volume.values, value)
    place, slope = _onto(place, field, value)
    lattice = lattice_of(volume)
    corner = np.asarray(volume.origin, np.float64) + place @ lattice.T
    normal = slope @ np.linalg.inv(lattice)
    color = np.broadcast_to(np.asarray(surface.color, np.float64), corner.shape)
    return SceneMesh(corner, normal, color, face, surface.opacity)


def _corners(values: NDArray[Any], value: float) -> tuple[Doubles, NDArray[np.int64]]:
    """Return vertices (V, 3), voxels along x, y, z, and triangles (T, 3) of Flying Edges.

    Schroeder, Maynard and Geveci, Flying Edges: A High-Performance Scalable Isocontouring
    Algorithm, 2015. The outermost voxels extend by half a voxel, as in a field.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    padded = np.pad(values.astype(np.float32), 1, mode="edge")
    image = vtkImageData()
    image.SetDimensions(*padded.shape[::-1])
    image.SetOrigin(-1.0, -1.0, -1.0)
    image.GetPointData().SetScalars(numpy_to_vtk(padded.reshape(-1)))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, value)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    found = edges.GetOutput()
    if not found.GetNumberOfPolys():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    place = vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
    face = vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    if values.dtype.kind == "f":
        face = face[_beside_known(padded, place[face].mean(axis=1))]
    last = np.array(values.shape[::-1]) - 0.5
    return np.clip(place, -0.5, last), face


def _beside_known(padded: NDArray[np.float32], place: Doubles) -> NDArray[np.bool_]:
    """Return whether all eight voxels around points (N, 3) have values."""
    x, y, z = np.floor(np.nan_to_num(place) + 1).astype(np.int64).T
    known = np.asarray(np.isfinite(place).all(axis=1))
    for down, along, right in np.ndindex(2, 2, 2):
        known &= np.isfinite(padded[z + down, y + along, x + right])
    return known


def _onto(place: Doubles, field: Gathered, value: float) -> tuple[Doubles, Doubles]:
    """Move points onto the field's isosurface; also return slopes (V, 3), per voxel."""
    place = np.where(np.isfinite(place), place, 0.0)
    last = np.array(field.spline.shape[::-1]) - 0.5
    slope = _slope(place, field, last)
    steep = np.maximum((slope**2).sum(axis=1, keepdims=True), 1e-30)
    for _ in range(TURNS):
        move = (value - values_at(field, place))[:, np.newaxis] * slope / steep
        length = np.linalg.norm(move, axis=1, keepdims=True)
        move *= np.minimum(1.0, FARTHEST / np.maximum(length, 1e-30))
        place = np.clip(place + move, -0.5, last)
    return place, _slope(place, field, last)


def _slope(place: Doubles, field: Gathered, last: Doubles) -> Doubles:
    """Return the slopes (V, 3) of a field, per voxel."""
    found = np.empty_like(place)
    for axis in range(3):
        step = STEP * np.eye(3)[axis]
        before, after = np.maximum(place - step, -0.5), np.minimum(place + step, last)
        apart = after[:, axis] - before[:, axis]
        found[:, axis] = (values_at(field, after) - values_at(field, before)) / apart
    return found
