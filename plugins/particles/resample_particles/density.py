"""Maps of particles: column densities, means of a quantity along columns, and slices.

snapshot = read_particles("snapshot.hdf5", "gas")
column_density(snapshot, "z", size=(800, 800)).value
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from resample.cameras.models import Camera, Orthographic
from resample.messages import number, shape_of, warn
from resample.showable import array_of
from resample.types import Doubles
from resample_particles.particles import Particles
from resample_particles.placing import (
    PlacedParticles,
    along_axis,
    before_camera,
    on_screen,
    records_of,
)
from resample_particles.smoothing import (
    ColumnTables,
    KernelName,
    column_tables,
    kernel_of,
    slice_tables,
)

LISTED = 1 << 22  # most members of tiles at a time
FINE, FINE_SLICE = 8.0, 48.0  # samples along the reach of a kernel, with its Laplacian or without


@dataclass(frozen=True, eq=False)
class DensityMap:
    """A map of particles: numbers of pixels, and their meaning.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_particles import Particles, column_density
    >>> two = Particles(np.eye(3)[:2], 1.0, 0.3, units={"mass": "Msun", "length": "pc"})
    >>> found = column_density(two, "z", size=(16, 16))
    >>> found.name, found.units, found.value.shape
    ('column density', 'Msun/pc²', (16, 16))
    """

    value: Doubles  # (H, W); of a mean of a quantity NaN where no particle reaches
    name: str  # column density, density, or the quantity
    units: str

    def __array__(
        self, dtype: DTypeLike | None = None, *, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return `value`."""
        return array_of(self.value, dtype, copy)

    def save(self, path: str | Path) -> None:
        """Write the numbers: `.npy` in float64, `.exr` in float32; rows go from top to bottom."""
        from resample.files.formats import WriteOptions
        from resample.files.metadata.fields import FileMetadata
        from resample.files.pictures import Kind, Picture
        from resample.files.saving import write_picture
        from resample.files.writing import replacing, save_array

        target = Path(path)
        if target.suffix.lower() == ".npy":
            with replacing(target) as file:
                save_array(file, self.value)
        elif target.suffix.lower() == ".exr":
            said = (("quantity", "string", self.name), ("units", "string", self.units))
            kind = Kind(("Y",), 32, is_encoded=False)
            values = self.value[..., None].astype(np.float32)
            write_picture(target, Picture(values, kind, FileMetadata(spoken=said)), WriteOptions())
        else:
            raise ValueError(f"{path}: numbers are written as .npy or .exr")


def column_density(
    particles: Particles,
    view: Literal["x", "y", "z"] | Camera | Orthographic,
    *,
    size: tuple[int, int],
    kernel: KernelName = "cubic",
    quantity: str | None = None,
    slice_at: float | None = None,
    region: ArrayLike | None = None,
) -> DensityMap:
    """Return a map of the mass along columns, of a quantity's mean, or of a slice.

    Pixels hold means over their area. Mass is conserved at any zoom.

    Parameters
    ----------
    particles
        With smoothing lengths, or without: they are then found.
    view
        `x`, `y` or `z`, along which is projected: y and z, x and z, or x and y then point to the
        right and up, and a periodic box is continued as far as the picture goes. Or a camera.
        In perspective, each pixel gets the column along its rays; particles are left out if the
        kernel reaches the plane of the eye.
    size
        Width and height, px.
    kernel
        `cubic` (spline), `wendland` (C2) or `gaussian`.
    quantity
        Name; its mean by mass is shown, ∑ m q W / ∑ m W. None: the density.
    slice_at
        Where a plane cuts, along the axis, or as depth before the camera; scene units. None: all.
    region
        (2, 3) lowest and highest corner of the region along an axis; particles beyond in depth
        are left out. Default: the box, or all particles.

    Raises
    ------
    ValueError, LookupError
        An argument is invalid, or nothing is in the region.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_particles import Particles, column_density
    >>> one = Particles(np.zeros((1, 3)), 4.0, 0.5)
    >>> column = column_density(one, "z", size=(20, 20), region=[[-1, -1, -1], [1, 1, 1]])
    >>> round(float(column.value.sum()) * 0.1**2, 4)
    4.0
    """
    if not isinstance(particles, Particles):
        raise TypeError(
            f"particles of {type(particles).__name__}; give Particles, such as read_particles(path)"
        )
    shape, chosen = shape_of(size), kernel_of(kernel)
    name, value = ("", None) if quantity is None else particles.quantity(quantity)
    if slice_at is not None and not np.isfinite(number("slice_at", slice_at)):
        raise ValueError(f"a slice at {slice_at}; give a finite number in scene units")
    placed = _placed(particles, view, shape, region)
    if value is not None:
        placed.value[:] = value[placed.which]
    records = on_screen(records_of(placed, chosen, slice_at), placed.period_px, shape)
    is_slice = slice_at is not None
    if is_slice and not len(records):
        warn(f"no particle reaches the slice at {slice_at:g}")
    tables = (slice_tables if is_slice else column_tables)(kernel)
    sums = np.zeros((*shape, 1 if value is None else 2))
    _add(records, tables, FINE_SLICE if is_slice else FINE, sums)
    if value is None:
        units = _per_length(particles.units, 3 if is_slice else 2)
        return DensityMap(sums[..., 0], "density" if is_slice else "column density", units)
    mean = np.full(shape, np.nan)
    np.divide(sums[..., 1], sums[..., 0], out=mean, where=sums[..., 0] > 0)
    return DensityMap(mean, name, particles.units.get(name, ""))


def _placed(
    particles: Particles, view: str | Camera | Orthographic, shape: tuple[int, int], region: Any
) -> PlacedParticles:
    whole = particles.smoothed()
    if isinstance(view, str):
        return along_axis(whole, view, shape, region)
    if region is not None:
        raise ValueError("a region belongs to a view along an axis; leave it out of a camera's")
    return before_camera(whole, view)


def _per_length(units: Mapping[str, str], power: int) -> str:
    """Return the units of a density; empty where they are not known."""
    mass, length = units.get("mass", ""), units.get("length", "")
    exponent = {2: "\u00b2", 3: "\u00b3"}[power]
    if not mass and not length:
        return ""
    return f"{mass or 'mass'}/{length or 'length'}{exponent}"


def _add(records: Doubles, tables: ColumnTables, fineness: float, sums: Doubles) -> None:
    """Add masses, and masses times the quantity, to pixels (H, W, 1 or 2).

    Particles are added in the order of their places and masses, whatever their order in memory.
    """
    from resample_particles.kernels.columns import paint_columns

    shape = sums.shape[:2]
    ordered = np.ascontiguousarray(records[_order(records)])
    first, last = tiles_of(ordered, shape)
    count = np.prod(last - first, axis=1)
    ends = np.cumsum(count)
    begin = 0
    while begin < len(ordered):
        end = max(int(np.searchsorted(ends, ends[begin] - count[begin] + LISTED)), begin + 1)
        rows = slice(begin, end)
        start, member = _listed(first[rows], last[rows], count[rows], shape)
        paint_columns(ordered[rows], tables.profile, tables.quadrant, start, member, fineness, sums)
        begin = end


def _order(records: Doubles) -> NDArray[np.int64]:
    """Return an order of particles that depends on what they are alone."""
    order = np.argsort(records[:, 0], kind="stable")
    if (np.diff(records[order, 0]) == 0).any():
        order = np.lexsort(records.T[::-1])
    return order


def tiles_of(
    records: Doubles, shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first tile of each particle and the one after its last, (N, 2) down, across."""
    from resample_particles.kernels.columns import REACH_X, REACH_Y, TILE, X, Y

    place, reach = records[:, [Y, X]], records[:, [REACH_Y, REACH_X]]
    most = np.array(shape) - 1
    first = np.clip(np.floor(place - reach), 0, most).astype(np.int64) // TILE
    last = np.clip(np.floor(place + reach), 0, most).astype(np.int64) // TILE + 1
    return first, last


def _listed(
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    count: NDArray[np.int64],
    shape: tuple[int, int],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the members of each tile begin, and the members, in the particles' order."""
    from resample_particles.kernels.columns import TILE

    down, across = (-(-side // TILE) for side in shape)
    member = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(member)) - np.repeat(np.cumsum(count) - count, count)
    wide = (last - first)[member, 1]
    tile = (first[member, 0] + nth // wide) * across + first[member, 1] + nth % wide
    small = np.uint16 if down * across < 1 << 16 else np.int64  # sorted by digits
    member = member[np.argsort(tile.astype(small), kind="stable")]
    start = np.append(0, np.cumsum(np.bincount(tile, minlength=down * across)))
    return start, member
