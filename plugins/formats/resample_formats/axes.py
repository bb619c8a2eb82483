"""Axes with names and units, as FITS and NetCDF have them, and the lattices that they span."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.lengths import unit_of_length
from resample_volume.files.headers import VolumeHeader, check_shape, header, recording
from resample_volume.types import UNKNOWN, VOXEL, Recording

SPACE = 3
CHANNELS = ("band", "channel", "component", "member", "species", "stokes")  # beginnings of names


class LabelledAxis(NamedTuple):
    """An axis of an array; steps are in its unit, negative where coordinates fall."""

    name: str
    size: int
    step: float | None = None  # None: not told
    unit: str = ""
    first: float = 0.0

    def __str__(self) -> str:
        step = "" if self.step is None else f" by {abs(self.step):.4g} {self.unit}".rstrip()
        return f"{self.name}{step}"


def lattice_of(axes: Sequence[LabelledAxis], dtype: Any, name: str) -> VolumeHeader:
    """Return the header of axes x, y, z, and further ones: times, or channels by their names.

    Steps of one unit are spacings. Otherwise a voxel is a cube, but for x and y of one unit, which
    keep their proportion; the header's note says so.
    """
    space, more = axes[:SPACE], axes[SPACE:]
    shape = tuple(axis.size for axis in space)
    check_shape(shape, name)
    steps = np.array([abs(axis.step or 0.0) for axis in space])
    units = [axis.unit for axis in space]
    first, length, note = np.zeros(SPACE), VOXEL, ""
    direction = np.diag([-1.0 if (axis.step or 0.0) < 0 else 1.0 for axis in space])
    if (steps > 0).all() and len(set(units)) == 1:
        length, by = unit_of_length(units[0])
        length, first = length or UNKNOWN, by * np.array([axis.first for axis in space])
        steps = by * steps
    else:
        if (steps > 0).any():
            told = ", ".join(map(str, space))
            note = f"axes are {told}: voxels count as cubes (--spacing sets them)"
        is_alike = (steps[:2] > 0).all() and units[0] == units[1]
        steps = np.array([1.0, steps[1] / steps[0] if is_alike else 1.0, 1.0])
    known = header(shape, dtype, name, spacing=steps, origin=first, direction=direction)
    parts = [axis.size for axis in more if axis.name.lower().startswith(CHANNELS)]
    times = [axis.size for axis in more if not axis.name.lower().startswith(CHANNELS)]
    if len(parts) > 1 or len(times) > 1:
        check_shape(tuple(axis.size for axis in axes), name)
    return known._replace(times=sum(times) or 1, parts=sum(parts) or 1, length=length, note=note)


def recording_along(
    values: NDArray[Any], axes: Sequence[LabelledAxis], known: VolumeHeader
) -> Recording:
    """Make a recording of values (..., Z, Y, X) along axes that begin with x."""
    is_last_channels = len(axes) > SPACE and axes[SPACE].name.lower().startswith(CHANNELS)
    if len(axes) == SPACE + 2 and not is_last_channels:
        values = values.swapaxes(0, 1)
    return recording(values, known._replace(dtype=values.dtype), channels_first=True)
