"""Threads of libraries that have pools of their own, within what `--threads` allows."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

# What numba, BLAS and OpenMP, OpenCV and OpenImageIO read when they are loaded.
VARIABLES = (
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
    "OPENIMAGEIO_THREADS",
)
OPENEXR = "OPENIMAGEIO_OPTIONS"  # has OpenEXR's pool beside others


def leave_algebra_alone() -> None:
    """Let OpenBLAS, once it is loaded, work on one thread where the environment asks for no more.

    What commands ask of it is small. Threads of its own wait for work by turning round and round:
    they took a tenth of all time of a small picture.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextmanager
def at_most(count: int | None) -> Iterator[None]:
    """Let libraries that are loaded in a block run on at most `count` threads; None leaves them.

    What the environment allows already is never raised.
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
    """The smaller one of a count and what the environment gives."""
    allowed = int(given) if given and given.isdecimal() and int(given) > 0 else os.cpu_count() or 1
    return min(count, allowed)
