"""Convert image planes to meshes with the field's colors at their vertices."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.messages import parts_of
from resample.types import Doubles
from resample_volume.classification.scales import scale_named
from resample_volume.data.memory import require_memory
from resample_volume.surfaces.image_planes import ImagePlane, outline
from resample_volume.surfaces.meshes import IsoSurface, SceneMesh
from resample_volume.types import Volume
from resample_volume.voxels.gathered import Gathered, check_iso
from resample_volume.voxels.shading import PAD
from resample_volume.voxels.visible import finite_range, lattice_of

FINEST = 8  # vertices per voxel along each axis of a plane, at most
MOST = 1 << 18  # quadrangles of a plane
CHUNK = 1 << 18  # points interpolated at a time
BYTES_PER_VOXEL = 12  # bytes of VTK's input and of a surface of typical size
STEP = 1 / 16  # voxels, step of the differences for slopes
FARTHEST = 0.5  # voxels that a vertex moves per step, at most
TURNS = 3  # Newton steps, with the initial slopes
FORM = (
    "give its center (0 is the volume's center) and thickness in scene units along the view, or "
    "along a scene direction: 20,10 or 20,10,0,0,1"
)


def plane_mesh(plane: ImagePlane, volume: Volume, field: Gathered) -> SceneMesh:
    """Make a mesh without normals, so that colors are not shaded."""
    place, face = _grid(outline(volume, plane.numbers))
    if field.known.size:  # triangles in voxels that have values
        known = field.known.reshape([count + 2 * PAD for count in field.spline.shape])
        x, y, z = np.floor(place[face].mean(axis=1) + 0.5).astype(np.int64).T + PAD
        face = face[known[z, y, x] > 0]
    color = plane.palette.colors(values_at(field, place), plane.window or (0.0, 1.0)).astype(
        np.float64
    )
    corner = np.asarray(volume.origin, np.float64) + place @ field.lattice.T
    return SceneMesh(corner, np.zeros_like(corner), color.astype(np.float64), face, plane.opacity)


def values_at(field: Gathered, place: Doubles) -> Doubles:
    """Interpolate a field at points (N, 3), voxels along x, y and z, at most 1/2 outside."""
    from scipy.ndimage import map_coordinates

    spline = field.spline
    padded = [count + 2 * PAD for count in spline.shape]
    coefficient = spline.coefficient.reshape(padded)
    found = np.empty(len(place))
    for start in range(0, len(place), CHUNK):
        part = slice(start, start + CHUNK)
        at = place[part, ::-1].T + PAD
        map_coordinates(coefficient, at, found[part], order=3, prefilter=False)
    return np.clip(spline.zero + spline.scale * found, spline.floor, spline.ceiling)


def _grid(corner: Doubles) -> tuple[Doubles, NDArray[np.int64]]:
    """Triangulate a convex polygon (N, 3), voxels, by vertices (V, 3) and triangles (T, 3)."""
    if len(corner) == 4 and np.allclose(corner[0] + corner[2], corner[1] + corner[3]):
        first, right, both, down = corner
        patches = [np.array([first, right, down, both])]
    else:
        middle = corner.mean(axis=0)
        after = np.roll(corner, -1, axis=0)
        patches = [np.array([middle, middle, *pair]) for pair in zip(corner, after, strict=True)]
    area = sum(math.prod(_lengths(patch)) for patch in patches)
    per = min(FINEST, math.sqrt(MOST / max(area, 1e-9)))  # vertices per voxel
    deepest = max(_steps(patch, per)[0] for patch in patches)
    places, faces, start = [], [], 0
    for patch in patches:
        place, face = _patch(patch, (deepest, _steps(patch, per)[1]))
        places.append(place)
        faces.append(face + start)
        start += len(place)
    return np.concatenate(places), np.concatenate(faces)


def _lengths(patch: Doubles) -> tuple[float, float]:
    """Return its greatest lengths down and right, voxels."""
    first, right, down, both = patch
    deep = max(np.linalg.norm(down - first), np.linalg.norm(both - right))
    wide = max(np.linalg.norm(right - first), np.linalg.norm(both - down))
    return float(deep), float(wide)


def _steps(patch: Doubles, per: float) -> tuple[int, int]:
    deep, wide = _lengths(patch)
    return max(1, math.ceil(per * deep - 1e-6)), max(1, math.ceil(per * wide - 1e-6))


def _patch(patch: Doubles, steps: tuple[int, int]) -> tuple[Doubles, NDArray[np.int64]]:
    """Return vertices and triangles between four corners: first, right, down and both."""
    down, right = (np.linspace(0, 1, count + 1) for count in steps)
    v, u = (part[..., np.newaxis] for part in np.meshgrid(down, right, indexing="ij"))
    place = (1 - v) * ((1 - u) * patch[0] + u * patch[1]) + v * ((1 - u) * patch[2] + u * patch[3])
    number = np.arange(v.size).reshape(steps[0] + 1, steps[1] + 1)
    a, b, c, d = (
        part.ravel()
        for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    face = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return place.reshape(-1, 3), face


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


class Section(NamedTuple):
    """The slab between two parallel planes."""

    center: float  # scene units from the volume's center, along the normal
    thickness: float  # scene units, > 0
    normal: tuple[float, float, float] | None = None  # scene direction; None: away from the eye

    @classmethod
    def of(cls, text: str) -> "Section":
        """Parse `center,thickness` or `center,thickness,nx,ny,nz`."""
        try:
            numbers = [float(part) for part in parts_of(text)]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 5) or not np.isfinite(numbers).all():
            raise ValueError(f"slab {text!r}; {FORM}")
        center, thickness, *normal = numbers
        if not thickness > 0:
            raise ValueError(f"slab {text!r}: its thickness must be above 0; {FORM}")
        if not normal:
            return cls(center, thickness)
        if not any(normal):
            raise ValueError(f"slab {text!r}: the normal must not be 0,0,0; {FORM}")
        x, y, z = normal
        return cls(center, thickness, (x, y, z))

    @property
    def clips(self) -> tuple[str, ...]:
        """Both planes as `cropping.planes` takes them; none for a slab across the view."""
        if self.normal is None:
            return ()
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        toward = ",".join(map(repr, self.normal))
        back = ",".join(repr(-part) for part in self.normal)
        return f"{toward},{near!r}", f"{back},{-far!r}"

    def planes(self, forward: Doubles) -> Doubles:
        """Return both planes (2, 4) around the scene's origin, as `cropping.planes` does.

        `forward`: (3,) direction of the view, used if there is no normal.
        """
        normal = np.asarray(forward if self.normal is None else self.normal, np.float64)
        normal = normal / np.abs(normal).max()
        normal /= np.linalg.norm(normal)
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        return np.array([[*normal, -near], [*-normal, far]])
