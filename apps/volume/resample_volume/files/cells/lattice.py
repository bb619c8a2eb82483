"""Choose a lattice for an unstructured grid: its bounds, with steps of the mean cell size."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory import available_memory
from resample.types import Doubles
from resample_volume.files.cells.validity import points_along

MOST = 1 << 28  # voxels that are made unless steps are given
MOST_ALONG = 1 << 20  # voxels along a side, if steps are given
MOST_PER_PLACE = 512  # the same, for each point or cell: 8 along each axis
FEW = 1 << 12  # points or cells; smaller grids count as this size
LEAST = 1e-6  # of the longest side: a grid that is thinner has no volume
SLACK = 1e-6  # of a step: rounding of the bounds


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

    Parameters
    ----------
    room
        Bytes per voxel.
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
