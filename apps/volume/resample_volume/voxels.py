"""Which voxels are seen: the transfer function applied, the transparent ones left out."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles, Floats
from resample_volume.memory import require_memory
from resample_volume.slabs import slabs
from resample_volume.transfer import DataRange, TransferFunction, extinction
from resample_volume.types import Volume

GRADIENTS = {"central": 0, "sobel": 1}  # voxels to either side over which slopes are smoothed
STEEP = 99  # percentile of the gradients' lengths that counts as a full surface

BYTES_PER_VOXEL = 200  # of a kept voxel, from here to the picture

Evaluate = Callable[[NDArray[Any], DataRange], Floats]


class Voxels(NamedTuple):
    """The N voxels of a volume that are not transparent, in the order z, y, x."""

    position: Floats  # (N, 3) scene units
    color: Floats  # (N, 3) linear light, unlit
    extinction: Floats  # (N,) optical depth per scene unit, > 0
    gradient: Floats  # (N, 3) data units per scene unit, along the scene's axes; or (0, 3)
    lattice: Doubles  # (3, 3) columns are the steps from a voxel to its neighbours, scene units


class _Seen(NamedTuple):
    """Voxels picked by their opacity."""

    place: NDArray[np.int64]  # (N,) index into the flat volume, z slowest
    value: NDArray[Any]  # (N,) data units
    opacity: Floats  # (N,) > 0


def classify(
    volume: Volume,
    transfer: TransferFunction,
    *,
    gradient: str | None = "central",
    gradient_opacity: tuple[float, float] | None = None,
) -> Voxels:
    """Voxels that the transfer function lets be seen.

    Parameters
    ----------
    volume
        Any of its types, also mapped from a file: it is read in chunks and not copied.
    transfer
        Gives colors and opacities. Where it makes all transparent, no voxel is returned.
    gradient
        One of `GRADIENTS`: differences of neighbours, or the same smoothed across (1-2-1) for
        noisy data; None for none, when voxels will not be lit. Values that are missing or infinite
        take no part.
    gradient_opacity
        Opacity is multiplied by a ramp that rises from 0 to 1 between these two lengths of the
        gradient, as fractions of their 99th percentile; so surfaces stay and even regions vanish.

    Raises
    ------
    ValueError
        The gradient is unknown or missing, the ramp descends, or the voxels do not fit in memory.
    """
    _check(gradient, gradient_opacity)
    data_range = finite_range(volume.values) if transfer.normalized else (0.0, 1.0)
    seen = _seen(volume, transfer, data_range)
    slope = np.empty((0, 3), np.float32)
    if gradient is not None:
        slope = _gradients(volume, seen.place, GRADIENTS[gradient])
    if gradient_opacity is not None:
        seen, slope = _modulated(seen, slope, gradient_opacity)
    lattice = lattice_of(volume)
    unit = transfer.opacity_unit or float(np.cbrt(abs(np.linalg.det(lattice))))
    color = _evaluated(transfer.colors, seen.value, data_range)
    thickness = extinction(seen.opacity, unit)
    return Voxels(_positions(volume, seen.place), color, thickness, slope, lattice)


def finite_range(values: NDArray[Any]) -> DataRange:
    """Least and greatest value that is neither NaN nor infinite; (0, 1) where there is none."""
    low, high = np.inf, -np.inf
    for chunk in slabs(values):
        known = chunk if values.dtype.kind in "iu" else chunk[np.isfinite(chunk)]
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    return (low, high) if low <= high else (0.0, 1.0)


def lattice_of(volume: Volume) -> Doubles:
    """Matrix whose columns are the steps to the next voxel along x, y and z, scene units."""
    return np.asarray(volume.direction * volume.spacing, np.float64)


def _check(gradient: str | None, ramp: tuple[float, float] | None) -> None:
    if gradient is not None and gradient not in GRADIENTS:
        raise ValueError(f"unknown gradient {gradient!r}; known: {', '.join(GRADIENTS)}, None")
    if ramp is None:
        return
    if gradient is None:
        raise ValueError("gradient_opacity needs a gradient; choose " + " or ".join(GRADIENTS))
    if not 0 <= ramp[0] <= ramp[1] < np.inf:
        raise ValueError(f"gradient_opacity must be two fractions that ascend from 0 (got {ramp})")


def _seen(volume: Volume, transfer: TransferFunction, data_range: DataRange) -> _Seen:
    parts = []
    start = count = 0
    for chunk in slabs(volume.values):
        value = chunk.reshape(-1)
        opacity = _evaluated(transfer.opacities, value, data_range)
        index = np.flatnonzero(opacity > 0)
        parts.append(_Seen(index + start, value[index], opacity[index]))
        start, count = start + value.size, count + index.size
        require_memory(BYTES_PER_VOXEL * count, f"{volume.name} with {count} visible voxels")
    return _Seen(*map(np.concatenate, zip(*parts, strict=True)))


def _evaluated(function: Evaluate, value: NDArray[Any], data_range: DataRange) -> Floats:
    """Evaluate a function of values (N,), by a table of all values where these are few."""
    dtype = value.dtype
    if dtype.kind not in "iu" or dtype.itemsize > 2:
        return function(value, data_range)
    bits = np.dtype(f"u{dtype.itemsize}")
    every = np.arange(1 << (8 * dtype.itemsize)).astype(bits)
    table = function(every.view(dtype), data_range)
    return np.asarray(table[value.view(bits)])


def _gradients(volume: Volume, voxel: NDArray[np.int64], reach: int) -> Floats:
    from resample_volume.kernels.voxels import gradients

    values = np.asarray(volume.values).view()
    values.setflags(write=False)  # arrays and files mapped for reading share one compiled kernel
    to_scene = np.ascontiguousarray(np.linalg.inv(lattice_of(volume)).T)
    gradient = np.empty((voxel.size, 3), np.float32)
    gradients(values, voxel, reach, to_scene, gradient)
    return gradient


def _modulated(seen: _Seen, slope: Floats, ramp: tuple[float, float]) -> tuple[_Seen, Floats]:
    """Less opacity where values hardly change; a volume of even values stays as it is."""
    if not seen.place.size:
        return seen, slope
    length = np.linalg.norm(slope, axis=1)
    share = np.interp(length, np.percentile(length, STEEP) * np.array(ramp), [0, 1])
    opacity = (seen.opacity * share).astype(np.float32)
    kept = np.flatnonzero(opacity > 0)
    return _Seen(seen.place[kept], seen.value[kept], opacity[kept]), slope[kept]


def _positions(volume: Volume, voxel: NDArray[np.int64]) -> Floats:
    from resample_volume.kernels.voxels import place

    position = np.empty((voxel.size, 3), np.float32)
    origin = np.asarray(volume.origin, np.float64)
    place(voxel, volume.values.shape, lattice_of(volume), origin, position)
    return position
