"""Limit the thread pools of libraries to what `--threads` allows."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

# Variables that numba, BLAS and OpenMP, OpenCV and OpenImageIO read when they are loaded.
VARIABLES = (
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
    "OPENIMAGEIO_THREADS",
)
OPENEXR = "OPENIMAGEIO_OPTIONS"  # sets the size of OpenEXR's pool, among others


def leave_algebra_alone() -> None:
    """Limit OpenBLAS to one thread when it is loaded, unless the environment asks for more.

    Commands give it little work, and its idle threads spin: they took a tenth of the total time of
    a small picture.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextmanager
def at_most(count: int | None) -> Iterator[None]:
    """Limit libraries loaded in a block to `count` threads; None sets no limit.

    A lower limit set in the environment is kept.
    """
    before = {name: os.environ.get(name) for name in (*VARIABLES, OPENEXR)}
    if count is not None:
        os.environ |= {name: str(_less(count, before[name])) for name in VARIABLES}
        if before[OPENEXR] is None:
            os.environ[OPENEXR] = f"exr_threads={count if count > 1 else -1}"  # -1: no pool
    try:
        yield
    finally:
        for name, given in before.items():
            os.environ.pop(name, None)
            if given is not None:
                os.environ[name] = given


def _less(count: int, given: str | None) -> int:
    """Minimum of a count and the limit in the environment."""
    allowed = int(given) if given and given.isdecimal() and int(given) > 0 else os.cpu_count() or 1
    return min(count, allowed)
