"""Interpolate unstructured grids at voxels, and estimate the error."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.native import suppressed_output
from resample.types import Doubles
from resample_volume.files.cells.lattice import SLACK, Leaf, Raster

JUDGED = 1 << 20  # points or cells sampled to estimate the error
NAME = "values"  # of the array in a leaf
MASK = "vtkValidPointMask"


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

    Parameters
    ----------
    into
        (Z, Y, X, C) of the whole lattice; unchanged outside the leaf.
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
