"""Go through a volume in parts, so that one mapped from a file is never held as a whole."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numpy.typing import NDArray

CHUNK = 1 << 22  # voxels looked at together
SHARE = 1 << 18  # voxels that a thread takes at a time: what is made of them stays in the cache
MOST_THREADS = 8


def slabs(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Whole slices (z, Y, X) in their order, about `CHUNK` voxels at a time; views, not copies."""
    step = max(1, CHUNK // max(1, values[0].size))
    for z in range(0, len(values), step):
        yield values[z : z + step]


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
