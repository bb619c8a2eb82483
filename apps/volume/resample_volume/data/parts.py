"""Go through a volume in parts, so that one mapped from a file is never held as a whole."""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AS_THEY_ARE = (np.dtype(np.float32), np.dtype(np.float64))
SHORT = tuple(np.dtype(name) for name in ("uint8", "int8", "uint16", "int16"))  # exact in float32
CHUNK = 1 << 22  # voxels looked at together
SHARE = 1 << 18  # voxels that a thread takes at a time: what is made of them stays in the cache
MOST_THREADS = 8


def slabs(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Whole slices (z, Y, X) in their order, about `CHUNK` voxels at a time; views, not copies."""
    step = max(1, CHUNK // max(1, values[0].size))
    for z in range(0, len(values), step):
        yield values[z : z + step]


class Layers(NamedTuple):
    """Planes of a volume that some of its voxels lie in, and those around them."""

    voxels: slice  # that lie in them
    values: NDArray[Any]  # (z, Y, X) float32 or float64, read only
    first: int  # flat index of their first value into the volume


def layers_alike(values: NDArray[Any], index: NDArray[np.int64]) -> Iterator[Layers]:
    """Parts of a volume (Z, Y, X) in which voxels lie, as kernels take them, whatever its type.

    Indices (N,) into the flat volume come in the order of an array or of the painter's bricks. Both
    types hold what others do exactly; a volume that is of them in rows is given as it is, all of
    others some planes at a time, if there are voxels in them.
    """
    from resample_volume.data.kernels.gradients import BRICK

    if values.dtype in AS_THEY_ARE and values.flags.c_contiguous:
        yield Layers(slice(0, index.size), _read_only(values), 0)
        return
    kind = np.float32 if values.dtype.newbyteorder("=") in (*SHORT, AS_THEY_ARE[0]) else np.float64
    plane, begin = values[0].size, 0
    thick = BRICK * max(1, CHUNK // max(1, BRICK * plane))
    many = thick * plane
    while begin < index.size:
        # Within as many planes voxels come in any order, but all before those of the next ones.
        number = int(index[begin]) // many
        end = bisect_left(index, number + 1, begin, key=lambda n: n // many)
        above = max(0, number * thick - 1)
        near = values[above : (number + 1) * thick + 1].astype(kind, order="C")
        yield Layers(slice(begin, end), _read_only(near), above * plane)
        begin = end


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    """View that nothing is written to: arrays and files mapped for reading share one kernel."""
    given = values.view()
    given.setflags(write=False)
    return given


def side_by_side(job: Callable[[slice], None], count: int) -> None:
    """Do a job for all of so many voxels, some at a time, on several threads if they are many.

    Where it is about arrays, NumPy and kernels let other threads go on. What the job does for a
    voxel must not depend on the others.
    """
    shares = [slice(n, min(n + SHARE, count)) for n in range(0, count, SHARE)]
    threads = min(threads_at_work(), len(shares))
    if threads < 2:
        for share in shares:
            job(share)
        return
    pool = ThreadPoolExecutor(threads)
    try:
        for _ in pool.map(job, shares):
            pass
    finally:
        pool.shutdown(cancel_futures=True)


def threads_at_work() -> int:
    """How many parts are worked on at a time, within the limit of `resample.engine.jit.threads`."""
    from resample.engine.jit import workers

    return min(MOST_THREADS, workers())
