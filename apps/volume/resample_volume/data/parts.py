"""Process volumes in parts, so that mapped files are never in memory as a whole."""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.passes import in_order, threads_at_work

AS_THEY_ARE = (np.dtype(np.float32), np.dtype(np.float64))
SHORT = tuple(np.dtype(name) for name in ("uint8", "int8", "uint16", "int16"))  # exact in float32
CHUNK = 1 << 22  # voxels processed together
SHARE = 1 << 18  # voxels per task of a thread: temporaries stay in the CPU's cache


def slabs(values: NDArray[Any], voxels: int = CHUNK) -> Iterator[NDArray[Any]]:
    """Yield slices (z, Y, X) in order, about so many voxels at a time; views, not copies."""
    step = max(1, voxels // max(1, values[0].size))
    for z in range(0, len(values), step):
        yield values[z : z + step]


class PlaneRange(NamedTuple):
    """Planes of a volume that contain given voxels, with adjacent planes."""

    voxels: slice  # the voxels in them
    values: NDArray[Any]  # (z, Y, X) float32 or float64, read only
    first: int  # flat index of their first value into the volume


def kernel_layers(values: NDArray[Any], index: NDArray[np.int64]) -> Iterator[PlaneRange]:
    """Yield the parts of a volume (Z, Y, X) that contain voxels, in the types of kernels.

    Indices (N,) into the flat volume come in the order of an array or of the painter's bricks. The
    two types hold all others exactly. A contiguous volume of these types is passed as it is; others
    are converted some planes at a time, where there are voxels.
    """
    from resample_volume.data.kernels.gradients import BRICK

    if values.dtype in AS_THEY_ARE and values.flags.c_contiguous:
        yield PlaneRange(slice(0, index.size), _read_only(values), 0)
        return
    kind = np.float32 if values.dtype.newbyteorder("=") in (*SHORT, AS_THEY_ARE[0]) else np.float64
    plane, begin = values[0].size, 0
    thick = BRICK * max(1, CHUNK // max(1, BRICK * plane))
    many = thick * plane
    while begin < index.size:
        # Within this many planes voxels come in any order, but before those of the next planes.
        number = int(index[begin]) // many
        end = bisect_left(index, number + 1, begin, key=lambda n: n // many)
        above = max(0, number * thick - 1)
        near = values[above : (number + 1) * thick + 1].astype(kind, order="C")
        yield PlaneRange(slice(begin, end), _read_only(near), above * plane)
        begin = end


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view, so that arrays and mapped files share one compiled kernel."""
    given = values.view()
    given.setflags(write=False)
    return given


def side_by_side(job: Callable[[slice], None], count: int) -> None:
    """Run a job on ranges of `count` voxels, on several threads if they are many.

    NumPy and kernels release the GIL. The job's result for a voxel must not depend on others.
    """
    shares = [slice(n, min(n + SHARE, count)) for n in range(0, count, SHARE)]
    threads = min(threads_at_work(), len(shares))
    if threads < 2:
        for share in shares:
            job(share)
        return
    for _ in in_order(job, shares):
        pass
