"""The one place with compiler flags and the kernels' cache on disk.

numba's cache looks only at the file of the function it stores: after an edit (or an upgrade) of a
kernel in another file, a caller would keep running the old machine code. The keys used here also
hold a digest of all kernel sources and whether bounds are checked.
"""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache

P = ParamSpec("P")
R = TypeVar("R")


def _digest() -> str:
    """Fingerprint of the sources that any kernel may be compiled from."""
    folder = Path(__file__).parent
    sources = [*sorted(folder.glob("*.py")), folder.parent / "types.py"]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


SOURCES = _digest()


class _SourceAwareCache(FunctionCache):  # type: ignore[misc]
    """A cache that forgets a kernel when any kernel's source changes."""

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        checked = bool(numba.config.BOUNDSCHECK)
        return (*super()._index_key(sig, codegen), SOURCES, checked)


def _compile(function: Callable[P, R], *, parallel: bool) -> Callable[P, R]:
    # error_model="numpy": a division by zero is inf or nan, as in NumPy, and costs no branch.
    compiled = numba.njit(function, nogil=True, parallel=parallel, error_model="numpy")
    if hasattr(compiled, "enable_caching"):
        try:
            compiled._cache = _SourceAwareCache(function)
        except RuntimeError:  # no folder can be written to: compile in every process
            pass
    return compiled  # type: ignore[no-any-return]


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays and numbers; one thread runs it."""
    return _compile(function, parallel=False)


def parallel_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile one `prange` around one kernel call (numba loses writes to bundles inside a body)."""
    return _compile(function, parallel=True)


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Run parallel kernels on at most `count` threads; None takes all. Pixels do not depend on it."""
    if count is None:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(count, numba.config.NUMBA_NUM_THREADS, os.cpu_count() or 1)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
