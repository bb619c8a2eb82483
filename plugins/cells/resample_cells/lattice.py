"""Choose a lattice for an unstructured grid, and interpolate the grid at its voxels."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory import available_memory
from resample.reading.native import suppressed_output
from resample.types import Doubles
from resample_volume.files.vtk import points_along

MOST = 1 << 28  # voxels that are made unless steps are given
MOST_ALONG = 1 << 20  # voxels along a side, if steps are given
MOST_PER_PLACE = 512  # the same, for each point or cell: 8 along each axis
FEW = 1 << 12  # points or cells; smaller grids count as this size
LEAST = 1e-6  # of the longest side: a grid that is thinner has no volume
SLACK = 1e-6  # of a step: rounding of the bounds
JUDGED = 1 << 20  # points or cells sampled to estimate the error
NAME = "values"  # of the array in a leaf
MASK = "vtkValidPointMask"


class Leaf(NamedTuple):
    """A single piece with the chosen array."""

    data: Any  # a data set of VTK's with that array alone
    values: NDArray[Any]  # (N,) or (N, C), the same
    is_of_cells: bool


class Raster(NamedTuple):
    """Voxels in rows along x, y and z."""

    shape: tuple[int, ...]  # x, y, z
    spacing: Doubles  # (3,)
    origin: Doubles  # (3,) of the first voxel
    is_coarser: bool = False  # whether coarser than the mean cell, to save memory

    @property
    def size(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)


@np.errstate(all="ignore")  # absurd sizes are rejected, without warnings
def lattice_of(leaves: list[Leaf], spacing: tuple[float, ...], room: int, name: str) -> Raster:
    """Choose the lattice that covers all leaves.

    For point values the lattice ends at the bounds, for cell values voxels are centered in cells.

    `room`: bytes per voxel.
    """
    bounds = np.array([leaf.data.GetBounds() for leaf in leaves]).reshape(-1, 3, 2)
    low, high = bounds[..., 0].min(axis=0), bounds[..., 1].max(axis=0)
    extent = high - low
    if not (np.isfinite(extent).all() and (extent > LEAST * extent.max()).all()):
        sides = " x ".join(f"{side:.4g}" for side in extent)
        raise ValueError(f"{name} fills {sides}, no volume: give a grid with cells in space")
    ends = 0 if leaves[0].is_of_cells else 1
    if spacing:
        step = np.array(spacing)
        if (extent / step > MOST_ALONG).any():
            raise ValueError(
                f"{name}: steps of {min(spacing):g} make over {MOST_ALONG} voxels along a side of "
                f"{extent.max():.4g}; take larger ones"
            )
        between = [math.floor(each) for each in extent / step + (0.5 if not ends else SLACK)]
        shape = tuple(max(2, each + ends) for each in between)
        start = low + (extent - step * (np.array(shape) - 1.0)) / 2
        return Raster(shape, step, start)
    wanted = np.min([mean_cell(leaf.data, name) for leaf in leaves], axis=0)
    step, is_coarser = _bounded(wanted, extent, leaves, room)
    between = [max(1, round(each)) for each in extent / step]
    shape = tuple(max(2, each + ends) for each in between)
    step = extent / (np.array(shape) - ends)
    return Raster(shape, step, low + step * (0 if ends else 0.5), is_coarser)


def _bounded(step: Doubles, extent: Doubles, leaves: list[Leaf], room: int) -> tuple[Doubles, bool]:
    """Limit steps by memory and by the number of points."""
    places = sum(len(leaf.values) for leaf in leaves)
    most = float(min(MOST, MOST_PER_PLACE * max(places, FEW)))
    free = available_memory()
    if free is not None:
        most = min(most, free / 2 / room)
    step = np.minimum(step, extent)
    count = float(np.prod(extent / step))
    if count <= most:
        return step, False
    return np.minimum(step * (count / max(most, 8.0)) ** (1 / 3), extent), True


def mean_cell(data: Any, name: str) -> Doubles:
    """Return the sides (3,) of a box with the volume and proportions of the mean cell."""
    count = data.GetNumberOfCells()
    if data.IsA("vtkImageData"):
        turn = np.reshape(data.GetDirectionMatrix().GetData(), (3, 3))
        return np.asarray(np.abs(turn) @ np.array(data.GetSpacing()))
    if data.IsA("vtkRectilinearGrid"):
        sides = np.ptp(np.reshape(data.GetBounds(), (3, 2)), axis=1)
        return np.asarray(sides / np.maximum(1, np.array(data.GetDimensions()) - 1))
    side = _sides(data)
    volume = _volume(data) / max(1, count)
    if not (volume > 0 and np.isfinite(side).all() and (side > 0).all()):
        raise ValueError(f"{name}: its cells have no volume: give a grid with cells in space")
    return np.asarray(side * (volume / np.prod(side)) ** (1 / 3))


def _sides(data: Any) -> Doubles:
    """Return the mean sides of the cells' bounding boxes."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    place = np.asarray(vtk_to_numpy(data.GetPoints().GetData()), np.float64)
    if data.IsA("vtkStructuredGrid"):
        x, y, z = points_along(data)
        grid = place.reshape(z, y, x, 3)
        along = [np.abs(np.diff(grid, axis=axis)).mean(axis=(0, 1, 2)) for axis in range(3)]
        return np.asarray(np.sum(along, axis=0))
    cells = data.GetCells()
    first = vtk_to_numpy(cells.GetOffsetsArray())
    corner = place[vtk_to_numpy(cells.GetConnectivityArray())]
    first = first[:-1][np.diff(first) > 0]
    box = np.maximum.reduceat(corner, first) - np.minimum.reduceat(corner, first)
    return np.asarray(box.mean(axis=0))


def _volume(data: Any) -> float:
    """Return the volume of all cells."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

    bare = data.NewInstance()
    bare.CopyStructure(data)
    sizes = vtkCellSizeFilter()
    sizes.SetInputData(bare)
    for other in ("VertexCount", "Length", "Area"):
        getattr(sizes, f"Compute{other}Off")()
    sizes.Update()
    found = vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume"))
    return float(np.abs(found).sum())


class Error(NamedTuple):
    """Error of interpolated values."""

    squares: float = 0.0  # sum, in parts of the values' range
    most: float = 0.0  # in parts of it
    judged: int = 0  # values
    left_out: int = 0  # points at the border without known voxels on all sides

    def line(self, things: str) -> str:
        """Format the error, of points or cells."""
        if not self.judged:
            return f"none of its {things} has known voxels on all sides, so the error is not known"
        mean = 100 * (self.squares / self.judged) ** 0.5
        share = 100 * self.judged / (self.judged + self.left_out)
        told = f"differ by {mean:.2g} % of the range (rms), {100 * self.most:.2g} % at most"
        which = f"the grid's own {things}" if share == 100 else f"{share:.0f} % of its {things}"
        return f"interpolated back at {which} they {told}"


def probed(leaf: Leaf, lattice: Raster, into: NDArray[Any], span: float) -> Error:
    """Write a leaf's values to its voxels; return the error against its own values.

    `into`: (Z, Y, X, C) of the whole lattice; unchanged outside the leaf.
    """
    ends = np.reshape(leaf.data.GetBounds(), (3, 2))
    place = (ends - lattice.origin[:, np.newaxis]) / lattice.spacing[:, np.newaxis]
    most = np.array(lattice.shape) - 1
    low = np.clip(np.ceil(place[:, 0] - SLACK), 0, most + 1).astype(int)
    high = np.clip(np.floor(place[:, 1] + SLACK), -1, most).astype(int)
    if (high < low).any():
        return Error(left_out=len(leaf.values))
    x, y, z = (slice(a, b + 1) for a, b in zip(low, high, strict=True))
    found, is_known = _probe(leaf.data, lattice, low, high)
    part = into[z, y, x]
    found, is_known = found.reshape(part.shape), is_known.reshape(part.shape[:3])
    part[is_known] = found[is_known]
    found[~is_known] = np.nan
    return _error(leaf, found, lattice.origin + low * lattice.spacing, lattice.spacing, span)


def _probe(
    data: Any, lattice: Raster, low: NDArray[np.int_], high: NDArray[np.int_]
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return values (N, ...) of a part of the lattice, and a mask of known ones."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkProbeFilter

    image = vtkImageData()
    image.SetDimensions((high - low + 1).tolist())
    image.SetSpacing(lattice.spacing.tolist())
    image.SetOrigin((lattice.origin + low * lattice.spacing).tolist())
    probe = vtkProbeFilter()
    probe.SetInputData(image)
    probe.SetSourceData(data)
    probe.SetValidPointMaskArrayName(MASK)
    with suppressed_output():
        probe.Update()
    held = probe.GetOutput().GetPointData()
    return vtk_to_numpy(held.GetArray(NAME)), vtk_to_numpy(held.GetArray(MASK)) != 0


@np.errstate(all="ignore")  # numbers near the largest float
def _error(leaf: Leaf, found: NDArray[Any], start: Doubles, step: Doubles, span: float) -> Error:
    """Estimate the error of voxels (Z, Y, X, C) at a leaf's points or cell centers."""
    from scipy.ndimage import map_coordinates

    some = slice(None, None, max(1, -(-len(leaf.values) // JUDGED)))
    given = leaf.values[some].reshape(-1, found.shape[-1])
    at = ((_places(leaf)[some] - start) / step).T[::-1]
    error = Error()
    for part, wanted in zip(_parts(found), given.T, strict=True):
        there = map_coordinates(part, at, order=1, mode="nearest", output=np.float64)
        known = np.isfinite(there) & np.isfinite(wanted)
        apart = np.abs(there[known] - wanted[known]) / (span or 1.0)
        error = Error(
            error.squares + float(np.square(apart).sum()),
            max(error.most, float(apart.max(initial=0))),
            error.judged + apart.size,
            error.left_out + int(np.isfinite(wanted).sum()) - apart.size,
        )
    return error


def _parts(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (values[..., part] for part in range(values.shape[-1]))


def _places(leaf: Leaf) -> Doubles:
    """Return the points (N, 3) of a leaf's values."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkCellCenters

    data = leaf.data
    if leaf.is_of_cells:
        centers = vtkCellCenters()
        centers.VertexCellsOff()
        centers.CopyArraysOff()
        centers.SetInputData(data)
        centers.Update()
        return np.asarray(vtk_to_numpy(centers.GetOutput().GetPoints().GetData()), np.float64)
    if data.IsA("vtkRectilinearGrid"):
        planes = (data.GetZCoordinates(), data.GetYCoordinates(), data.GetXCoordinates())
        return _grid([np.asarray(vtk_to_numpy(each), np.float64) for each in planes])
    if data.IsA("vtkImageData"):
        first = data.GetExtent()[::2]
        counts = zip(first, data.GetDimensions(), data.GetSpacing(), strict=True)
        axes = [step * (start + np.arange(count)) for start, count, step in counts]
        turn = np.reshape(data.GetDirectionMatrix().GetData(), (3, 3))
        return np.asarray(_grid(axes[::-1]) @ turn.T + data.GetOrigin())
    return np.asarray(vtk_to_numpy(data.GetPoints().GetData()), np.float64)


def _grid(axes: list[Doubles]) -> Doubles:
    """Return points (N, 3) x, y, z of planes z, y, x; x is fastest."""
    z, y, x = np.meshgrid(*axes, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=-1)
