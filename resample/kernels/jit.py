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
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

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


@intrinsic  # type: ignore[untyped-decorator]
def _add_one(_: Any, counter: Any) -> Any:
    """Add 1 to the first number of an array (1,) of int64 at one go; gives what it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(numba.int64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return numba.int64(counter), generate


def next_task(counter: NDArray[np.int64]) -> int:
    """Number of the next task that no thread has taken yet; `counter` (1,) starts at 0."""
    counter[0] += 1
    return int(counter[0]) - 1


@overload(next_task)
def _next_task(counter):  # type: ignore[no-untyped-def]  # noqa: ARG001
    def compiled(counter):  # type: ignore[no-untyped-def]
        return _add_one(counter)

    return compiled


def workers() -> int:
    """How many threads a parallel kernel runs on now."""
    return int(numba.get_num_threads())


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Run parallel kernels on at most `count` threads; None takes all. Pixels do not depend on it.

    A `prange` gives threads equal parts of consecutive tasks. Who has tasks of uneven cost starts a
    worker for each thread, and lets it ask for the `next_task`.
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
