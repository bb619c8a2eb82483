"""The one place with compiler flags, the kernels' cache on disk, and threads.

numba's cache looks only at the file of the function it stores: after an edit (or an upgrade) of a
kernel in another file, a caller would keep running the old machine code. Here the name of a cache
file also holds a digest of the engine and of the folders `kernels` of the caller's own package, a
digest of the compiler's settings that change machine code (`NUMBA_SLP_VECTORIZE` and others), and
whether bounds are checked. In a folder that is asked for (NUMBA_CACHE_DIR), files lie by the
names of modules: a checkout, a copy and an installed wheel of the same sources share them.

Of several processes that want one kernel, the first compiles it and the others wait for its file.
"""

import hashlib
import inspect
import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import cache, wraps
from pathlib import Path
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import ffi
from numba.core import cgutils
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

from resample.watching import OFTEN, is_watched, look

try:
    import fcntl
except ImportError:  # Windows: every process compiles for itself
    fcntl = None  # type: ignore[assignment]

LOG = logging.getLogger("resample")
P = ParamSpec("P")
R = TypeVar("R")

Counter = NDArray[np.int64]  # (2,) how many tasks threads have taken, and how many there are
NONE_LEFT = 1 << 60  # tasks, more than there are
SHORT = 0.005  # seconds; a call that takes less is not watched unless that is asked for
PATIENCE = 1.0  # seconds that threads have for their last task; who compiles may take longer


def _digest(*folders: Path) -> str:
    """Fingerprint of the engine's sources and of those in other folders, wherever they lie."""
    engine = Path(__file__).parent
    sources = [engine.parent / "types.py"]
    for folder in (engine, *folders):
        sources += sorted(folder.rglob("*.py"))
    read = b"".join(source.read_bytes() for source in sources)
    return hashlib.sha256(read).hexdigest()


SOURCES = _digest()


def _leave_locks_untimed() -> None:
    """Let numba not take the time at each call of LLVM.

    A first picture takes 70,000 of them, and each is told to the timers of all kernels that wait
    for the one that is compiled: a tenth of all, for a number that nobody asks for.
    """
    lock = getattr(ffi.lib, "_lock", None)
    for begin, end in list(getattr(lock, "_cblist", ())):
        if begin.__module__ == numba.core.base.__name__:
            ffi.unregister_lock_callback(begin, end)


_leave_locks_untimed()


# Settings of numba's that change machine code; a trial of one must not stay in the cache.
SETTINGS = (
    "OPT",
    "LOOP_VECTORIZE",
    "SLP_VECTORIZE",
    "CPU_NAME",
    "CPU_FEATURES",
    "ENABLE_AVX",
    "DISABLE_INTEL_SVML",
    "USING_SVML",
    "LLVM_REFPRUNE_PASS",
    "LLVM_REFPRUNE_FLAGS",
    "DEBUGINFO_DEFAULT",
    "EXTEND_VARIABLE_LIFETIMES",
    "DEBUG_NRT",
    "NRT_STATS",
    "ENABLE_PROFILING",
)
_asked: list[int] = []  # what SLP_VECTORIZE was before a packed kernel set it for itself


def _settings() -> str:
    """Fingerprint of the compiler's settings, as they are now."""
    values = {name: getattr(numba.config, name, None) for name in SETTINGS}
    if _asked:
        values["SLP_VECTORIZE"] = _asked[0]
    return hashlib.sha256(repr(values).encode()).hexdigest()


@cache
def _version(package: Path) -> str:
    """Fingerprint of all that a package's kernels may be compiled from.

    That is the engine and, outside it, all folders `kernels` of the package.
    """
    own = sorted(package.rglob("kernels"))
    return _digest(*own) if own else SOURCES


def _package_of(source: Path) -> Path:
    """Topmost package that a file lies in, or its folder."""
    above = [folder for folder in source.parents if (folder / "__init__.py").exists()]
    return above[-1] if above else source.parent


class _ByModule(UserProvidedCacheLocator):  # type: ignore[misc]
    """A folder that is asked for, in which files lie by modules instead of by paths."""

    def __init__(self, function: Callable[..., Any], source: str) -> None:
        super().__init__(function, source)
        self._cache_path = os.path.join(numba.config.CACHE_DIR, function.__module__)


class _Stored(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_ByModule, *CompileResultCacheImpl._locator_classes)


class _SourceAwareCache(FunctionCache):  # type: ignore[misc]
    """A cache whose files are those of one version of all kernel sources.

    The version stands in the files' names, not only in the keys: an index that mentions a type
    which has since gone could not even be read. Settings of the compiler that were changed after a
    kernel was named are a trial: nothing is taken from the disk then, and nothing stored.
    """

    _impl_class = _Stored

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._name = f"{function.__module__}.{function.__qualname__}"
        digest = _version(_package_of(Path(inspect.getfile(function))))
        self._named_for = _settings()
        version = f"{digest[:12]}-{self._named_for[:6]}"
        if numba.config.BOUNDSCHECK:
            version += "-checked"
        self._cache_file = IndexDataCacheFile(
            cache_path=self._cache_path,
            filename_base=f"{self._impl.filename_base}-{version}",
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        stored = super().load_overload(sig, target_context) if self._is_apt() else None
        if stored is None:
            _say_that_it_compiles(self._name)
        else:
            LOG.debug("%s: taken from %s", self._name, self._cache_path)
        return stored

    def save_overload(self, sig: Any, data: Any) -> None:
        if self._is_apt():
            super().save_overload(sig, data)

    def _is_apt(self) -> bool:
        return _settings() == self._named_for


@contextmanager
def _in_turn(index: str) -> Iterator[None]:
    """Wait until no other process or thread loads or compiles the kernel of an index file.

    Besides the time, two at once might give one file's name to machine code for different types.
    """
    with ExitStack() as held:
        with suppress(OSError):  # a folder that has gone, a file system without locks: do not wait
            if fcntl is not None:
                lock = held.enter_context(Path(f"{index}.lock").open("ab"))
                fcntl.flock(lock, fcntl.LOCK_EX)
                # To close the file is not enough: a forked process may hold it, too.
                held.callback(fcntl.flock, lock, fcntl.LOCK_UN)
        yield


@cache
def _say_that_it_takes_long() -> None:
    LOG.info("compiling kernels, once per installation: about 20 seconds")


def _say_that_it_compiles(name: str) -> None:
    _say_that_it_takes_long()
    LOG.debug("compiling %s", name)


def _store(compiled: Any, function: Callable[..., Any]) -> None:
    """Keep a kernel's machine code on disk, compiled by one process at a time."""
    compiled._cache = _SourceAwareCache(function)
    compile_now, index = compiled.compile, compiled._cache._cache_file._index_path

    def compile_in_turn(signature: Any) -> Any:
        with _in_turn(index):
            return compile_now(signature)

    compiled.compile = compile_in_turn


_packs = Lock()  # numba has one setting for all threads


def _pack(compiled: Any) -> None:
    """Let the compiler make equal operations on neighbouring numbers one operation."""
    compile_now = compiled.compile

    def compile_packed(signature: Any) -> Any:
        with _packs:
            before = numba.config.SLP_VECTORIZE
            _asked.append(before)
            numba.config.SLP_VECTORIZE = 1
            try:
                return compile_now(signature)
            finally:
                numba.config.SLP_VECTORIZE = before
                _asked.pop()

    compiled.compile = compile_packed


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel that becomes a part of those that call it, and is never run by itself.

    numba would make machine code of it and of all that it calls, which nothing would use.
    """

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        return 0

    @property
    def codegen(self) -> "type[_Unheard]":
        return _Unheard


class _Unheard:
    """Takes the place of the engine, which parts are not given to."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Parts raise nothing that would need an environment of theirs."""


class PartCompiler(Compiler):  # type: ignore[misc]
    """numba's compiler for kernels that others call."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


# error_model="numpy": a division by zero is inf or nan, as in NumPy, and costs no branch.
OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def _compile(
    function: Callable[P, R], *, is_packed: bool = False, **options: Any
) -> Callable[P, R]:
    """Make a function that Python calls by machine code, which is kept on disk, and kernels inline.

    What kernels call is compiled with them, without the code that unpacks Python's arguments and
    without machine code of its own: both would take a fifth of the time.
    """
    if numba.config.DISABLE_JIT:
        return function
    compiled = numba.njit(function, **OPTIONS, **options)
    try:
        _store(compiled, function)
    except RuntimeError:
        LOG.info("kernels cannot be kept on disk: every process compiles them; set NUMBA_CACHE_DIR")
    if is_packed:
        _pack(compiled)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        return compiled(*args, **kwargs)  # type: ignore[no-any-return]

    call.compiled = compiled  # type: ignore[attr-defined]
    inner = {**OPTIONS, **options, "no_cpython_wrapper": True, "pipeline_class": PartCompiler}
    overload(call, jit_options=inner, strict=False)(lambda *_: function)
    return call


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays and numbers; one thread runs it."""
    return _compile(function)


def making_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that makes arrays for itself, and may be called by those that make none."""
    return _compile(function, _nrt=True)


def lane_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function whose innermost loop works on several numbers at once.

    A product and a sum may be one operation, which rounds once, and zeros have no sign. Loops
    become lanes where what is written lies at fixed distances from all else in one array, and no
    index needs a look at its sign.
    """
    return _compile(function, fastmath={"contract", "nsz"})


def inner_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays that makes none and gives none, to be called by other kernels.

    It counts no references, as its caller holds all arrays: bundles of many are then handed over
    for nothing. A kernel that needs memory of its own cannot be compiled so.
    """
    return _compile(function, _nrt=False)


def lane_step(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a loop of lanes that a lane kernel runs time and again, as a part of that kernel."""
    return _compile(function, fastmath={"contract", "nsz"}, forceinline=True)


def inner_step(function: Callable[P, R]) -> Callable[P, R]:
    """An inner kernel that becomes a part of what calls it: no bundles are handed over.

    For what packed kernels do time and again.
    """
    return _compile(function, fastmath={"contract", "nsz"}, forceinline=True, _nrt=False)


def parallel_kernel(function: Callable[Concatenate[Counter, P], None]) -> Callable[P, None]:
    """Compile a function that all threads run at once, each with other `tasks`.

    Its first argument counts the tasks that are taken; callers leave it out.
    """
    return _on_all_threads(function, _compile(function))


def packed_kernel(function: Callable[Concatenate[Counter, P], None]) -> Callable[P, None]:
    """A parallel kernel in which equal operations on neighbouring numbers become one.

    For code that does the same to a few numbers that lie side by side, too few for loops of lanes.
    """
    compiled = _compile(function, is_packed=True, fastmath={"contract", "nsz"})
    return _on_all_threads(function, compiled)


def _on_all_threads(
    function: Callable[Concatenate[Counter, P], None],
    compiled: Callable[Concatenate[Counter, P], None],
) -> Callable[P, None]:
    """Call of a kernel on as many threads as `workers` allows."""
    seconds = [math.inf]  # that the last call took

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        look(0, 0)
        counter, begin = np.zeros(2, np.int64), time.perf_counter()
        # To wait for others takes a tenth of a millisecond, which small pictures have not got.
        takes_part = seconds[0] < SHORT and not is_watched()
        count = workers() - takes_part
        started = [_pool().submit(compiled, counter, *args, **kwargs) for _ in range(count)]
        if takes_part:
            with _stopping(started, counter):
                compiled(counter, *args, **kwargs)
        _await(started, counter)
        seconds[0] = time.perf_counter() - begin

    if hasattr(compiled, "compiled"):
        call.compiled = compiled.compiled  # type: ignore[attr-defined]
    return call


@contextmanager
def _stopping(started: list[Future[None]], counter: Counter) -> Iterator[None]:
    """Leave threads no tasks if something is raised."""
    try:
        yield
    except BaseException:
        counter[0] = NONE_LEFT
        for thread in started:
            thread.cancel()
        wait(started, PATIENCE)
        raise


def _await(started: list[Future[None]], counter: Counter) -> None:
    """Wait for threads, and look at what they do."""
    with _stopping(started, counter):
        while wait(started, OFTEN).not_done:
            look(int(counter[0]), int(counter[1]))
    for thread in started:
        thread.result()


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads that wait for tasks; a forked process, which has none of them, gets its own."""
    return ThreadPoolExecutor(numba.config.NUMBA_NUM_THREADS, "resample")


def _compile_nothing() -> None:
    """Wait until no thread compiles: a process that is forked the while could never compile."""
    _packs.acquire()
    global_compiler_lock.acquire()


def _compile_again() -> None:
    global_compiler_lock.release()
    _packs.release()


def _begin_anew() -> None:
    _compile_again()
    _pool.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_compile_nothing, after_in_parent=_compile_again, after_in_child=_begin_anew
    )


@kernel
def tasks(counter: Counter, count: int) -> Iterator[int]:
    """Numbers below `count`, each for the first thread to ask for one."""
    counter[1] = count
    task = _next_of(counter)
    while task < count:
        yield task
        task = _next_of(counter)


@intrinsic  # type: ignore[untyped-decorator]
def _add_one(_: Any, counter: Any) -> Any:
    """Add 1 to the first number of an array of int64 at one go; gives what it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        one = context.get_constant(numba.int64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return numba.int64(counter), generate


def _next_of(counter: Counter) -> int:
    """How many tasks had been taken, of which this is one more."""
    counter[0] += 1
    return int(counter[0]) - 1


@overload(_next_of)
def _compiled_next_of(counter):  # type: ignore[no-untyped-def]  # noqa: ARG001
    def compiled(counter):  # type: ignore[no-untyped-def]
        return _add_one(counter)

    return compiled


@intrinsic  # type: ignore[untyped-decorator]
def _load_soon(_: Any, array: Any, index: Any) -> Any:
    """Ask for the cache line of a number of a flat array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        place = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        of_types = ir.FunctionType(ir.VoidType(), [place.type, number, number, number])
        prefetch = cgutils.get_or_insert_function(builder.module, of_types, "llvm.prefetch.p0")
        builder.call(prefetch, [place, number(0), number(3), number(1)])  # to read, keep, data
        return context.get_dummy_value()

    return numba.void(array, index), generate


def load_soon(array: NDArray[Any], index: int) -> None:
    """Begin to load what is around a number of a flat array; changes nothing but time."""


@overload(load_soon)
def _load_soon_compiled(array, index):  # type: ignore[no-untyped-def]  # noqa: ARG001
    def compiled(array, index):  # type: ignore[no-untyped-def]
        _load_soon(array, index)

    return compiled


_limit: ContextVar[int | None] = ContextVar("limit", default=None)


def workers() -> int:
    """How many threads a parallel kernel runs on now; plain Python has no atomic counter."""
    most = 1 if numba.config.DISABLE_JIT else numba.config.NUMBA_NUM_THREADS
    limit = _limit.get()
    return int(most if limit is None else max(1, min(limit, most)))


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Run parallel kernels on at most `count` threads; None takes all. Pixels do not depend on it.

    Holds for the thread, or task, that asks for it.
    """
    token = _limit.set(count)
    try:
        yield
    finally:
        _limit.reset(token)


def index_of(called: Callable[..., Any]) -> Path | None:
    """File that says which machine code of a kernel is on disk; None if none can be kept."""
    cache_file = getattr(called.compiled._cache, "_cache_file", None)  # type: ignore[attr-defined]
    return None if cache_file is None else Path(cache_file._index_path)
