"""The one place with compiler flags and the kernels' cache on disk.

numba's cache looks only at the file of the function it stores: after an edit (or an upgrade) of a
kernel in another file, a caller would keep running the old machine code. Here the name of a cache
file also holds a digest of the core's kernels and of those in the same folder `kernels`, and
whether bounds are checked.
"""

import hashlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile

P = ParamSpec("P")
R = TypeVar("R")


def _digest(other: Path | None = None) -> str:
    """Fingerprint of the core's kernel sources and of those in another folder."""
    folder = Path(__file__).parent
    sources = [*sorted(folder.glob("*.py")), folder.parent / "types.py"]
    sources += sorted(other.glob("*.py")) if other else []
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


SOURCES = _digest()


@cache
def _version(folder: Path) -> str:
    """Fingerprint of all that a kernel of a folder may be compiled from."""
    here = Path(__file__).parent
    return _digest(folder) if folder != here and folder.name == here.name else SOURCES


class _SourceAwareCache(FunctionCache):  # type: ignore[misc]
    """A cache whose files are those of one version of all kernel sources.

    The version stands in the files' names, not only in the keys: an index that mentions a type
    which has since gone could not even be read.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        digest = _version(Path(inspect.getfile(function)).parent)
        version = f"{digest[:12]}{'-checked' if numba.config.BOUNDSCHECK else ''}"
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=f"{self._impl.filename_base}-{version}",
            source_stamp=self._impl.locator.get_source_stamp(),
        )


def _compile(
    function: Callable[P, R], *, parallel: bool = False, fastmath: bool | set[str] = False
) -> Callable[P, R]:
    # error_model="numpy": a division by zero is inf or nan, as in NumPy, and costs no branch.
    compiled = numba.njit(
        function, nogil=True, parallel=parallel, error_model="numpy", fastmath=fastmath
    )
    if hasattr(compiled, "enable_caching"):
        with suppress(RuntimeError):  # no folder can be written to: compile in every process
            compiled._cache = _SourceAwareCache(function)
    return compiled  # type: ignore[no-any-return]


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays and numbers; one thread runs it."""
    return _compile(function)


def lane_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function whose innermost loop works on several numbers at once.

    A product and a sum may be one operation, which rounds once, and zeros have no sign. Loops
    become lanes where what is written lies at fixed distances from all else in one array, and no
    index needs a look at its sign.
    """
    return _compile(function, fastmath={"contract", "nsz"})


def parallel_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile one `prange` around one kernel call (numba loses writes to bundles inside a body)."""
    return _compile(function, parallel=True)


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Run parallel kernels on at most `count` threads; None takes all. Pixels do not depend on it.

    Tasks are handed out one by one: tiles differ too much in cost for equal shares.
    """
    before = numba.get_num_threads()
    if count is not None:
        numba.set_num_threads(max(1, min(count, numba.config.NUMBA_NUM_THREADS)))
    try:
        with numba.parallel_chunksize(1):
            yield
    finally:
        numba.set_num_threads(before)


def is_stored(compiled: Callable[..., Any]) -> bool:
    """Whether machine code of this version of a kernel is on disk, so that it starts at once."""
    cache = getattr(compiled, "_cache", None)
    index = getattr(getattr(cache, "_cache_file", None), "_index_path", None)
    return not hasattr(compiled, "_cache") or (index is not None and Path(index).exists())
