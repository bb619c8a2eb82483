"""Decorators of kernels and their roles, and the threads that run them.

A kernel is a function of arrays and numbers that runs as machine code. Who writes one writes plain
numba code. Where the machine code comes from is settled at the first call with arguments of new
types: from the library that was built ahead (`compiled.library`), else from numba, which is
imported only then (`compiled.compiling`) and keeps what it compiles on disk.
"""

import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, wraps
from threading import RLock
from types import ModuleType
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.engine.compiled import library
from resample.progress import OFTEN, is_watched, report

LOG = logging.getLogger("resample")
P = ParamSpec("P")
R = TypeVar("R")

Counter = NDArray[np.int64]  # (2,) how many tasks threads have taken, and how many there are
NONE_LEFT = 1 << 60  # tasks, more than there are
SHORT = 0.005  # seconds; a call that takes less is not watched unless that is asked for
PATIENCE = 1.0  # seconds that threads have for their last task; who compiles may take longer
LANES = {"contract", "nsz"}  # a product and a sum may be one operation; zeros have no sign

# numba's own variables, under their own names: numba may not be there to be asked.
IS_PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
if IS_PLAIN:
    np.seterr(all="ignore")  # as machine code does: 1 / 0 is inf, and hashes overflow
_allowed = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))
CORES = int(os.environ.get("NUMBA_NUM_THREADS") or len(_allowed(0)))

_registering = RLock()
_registrations: list[Callable[[], None]] = []  # that wait for numba to be imported
_compiler: list[ModuleType] = []


def compiler() -> ModuleType:
    """The module `compiling`, with all kernels and roles declared to numba."""
    with _registering:
        if not _compiler:
            from resample.engine.compiled import compiling

            _compiler.append(compiling)
        while _registrations:
            _registrations.pop(0)()
    return _compiler[0]


def when_compiling(register: Callable[[], None]) -> Callable[[], None]:
    """Call a function once numba is imported; at once if it is."""
    with _registering:
        _registrations.append(register)
        if _compiler:
            compiler()
    return register


def _compile(
    function: Callable[P, R], *, is_packed: bool = False, **options: Any
) -> Callable[P, R]:
    """Make a function that runs as machine code from Python, and that kernels can call."""
    if IS_PLAIN:
        return function
    ready = library.kernel(function)
    dispatchers: list[Any] = []

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if ready is not None:
            result = ready(args, kwargs)
            if result is not NotImplemented:
                return result  # type: ignore[no-any-return]
        return (dispatchers or made())[0](*args, **kwargs)  # type: ignore[no-any-return]

    def made() -> list[Any]:
        with _registering:
            if not dispatchers:
                dispatchers.append(compiler().define(call, function, is_packed, options))
        return dispatchers

    call.made = made  # type: ignore[attr-defined]
    call.options = {**options, "is_packed": is_packed}  # type: ignore[attr-defined]
    when_compiling(lambda: _compiler[0].define_part(call, function, options))
    return call


def dispatcher(called: Callable[..., Any]) -> Any:
    """A kernel's `Dispatcher` of numba, with signatures and statistics."""
    return called.made()[0]  # type: ignore[attr-defined]


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of arrays and numbers; one thread runs it."""
    return _compile(function)


def making_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that allocates arrays, and may be called by kernels that allocate none."""
    return _compile(function, _nrt=True)


def lane_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function with an innermost loop that is vectorized.

    A product and a sum may be one operation, which rounds once, and zeros have no sign. Loops
    become lanes where results lie at fixed distances from all else in one array, and no
    index needs a look at its sign.
    """
    return _compile(function, fastmath=LANES)


def inner_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that neither allocates nor returns arrays, called by other kernels.

    It counts no references, as its caller holds all arrays: bundles of many are then handed over
    for nothing. A kernel that allocates memory cannot be compiled so.
    """
    return _compile(function, _nrt=False)


def lane_step(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a loop of lanes that a lane kernel repeats, inlined into the kernel."""
    return _compile(function, fastmath=LANES, forceinline=True)


def inner_step(function: Callable[P, R]) -> Callable[P, R]:
    """An inner kernel that is inlined into its callers: no bundles are handed over.

    For steps that packed kernels repeat.
    """
    return _compile(function, fastmath=LANES, forceinline=True, _nrt=False)


def parallel_kernel(function: Callable[Concatenate[Counter, P], None]) -> Callable[P, None]:
    """Compile a function that all threads run at once, each with its own `tasks`.

    Its first argument counts the tasks that are taken; callers leave it out.
    """
    return _on_all_threads(function, _compile(function))


def packed_kernel(function: Callable[Concatenate[Counter, P], None]) -> Callable[P, None]:
    """A parallel kernel with vectorized operations on neighbouring numbers.

    For code that does the same to a few numbers that lie side by side, too few for loops of lanes.
    """
    compiled = _compile(function, is_packed=True, fastmath=LANES)
    return _on_all_threads(function, compiled)


def _on_all_threads(
    function: Callable[Concatenate[Counter, P], None],
    compiled: Callable[Concatenate[Counter, P], None],
) -> Callable[P, None]:
    """Call of a kernel on as many threads as `workers` allows."""
    seconds = [math.inf]  # that the last call took

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        report(0, 0)
        counter, begin = np.zeros(2, np.int64), time.perf_counter()
        # To wait for others takes a tenth of a millisecond: too costly for small pictures.
        # Plain Python stays on this thread, where a debugger is.
        takes_part = IS_PLAIN or (seconds[0] < SHORT and not is_watched())
        count = workers() - takes_part
        started = [_pool().submit(compiled, counter, *args, **kwargs) for _ in range(count)]
        if takes_part:
            with _stopping(started, counter):
                compiled(counter, *args, **kwargs)
        if started:
            # Wait for threads, and look at what they do.
            with _stopping(started, counter):
                while wait(started, OFTEN).not_done:
                    report(int(counter[0]), int(counter[1]))
            for thread in started:
                thread.result()
        seconds[0] = time.perf_counter() - begin

    if hasattr(compiled, "made"):
        call.made = compiled.made  # type: ignore[attr-defined]
    return call


@contextmanager
def _stopping(started: list[Future[None]], counter: Counter) -> Iterator[None]:
    """Take all tasks from threads on an exception."""
    try:
        yield
    except BaseException:
        counter[0] = NONE_LEFT
        for thread in started:
            thread.cancel()
        wait(started, PATIENCE)
        raise


@cache
def _pool() -> ThreadPoolExecutor:
    """Threads that wait for tasks; a forked process gets its own."""
    return ThreadPoolExecutor(CORES, "resample")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)


@inner_kernel  # a generator never gives back references
def tasks(counter: Counter, count: int) -> Iterator[int]:
    """Numbers below `count`, each for the first thread to ask for one."""
    counter[1] = count
    task = next_task(counter)
    while task < count:
        yield task
        task = next_task(counter)


def next_task(counter: Counter) -> int:
    """Take a task; how many had been taken before. Atomic where it is compiled."""
    counter[0] += 1
    return int(counter[0]) - 1


def load_soon(array: NDArray[Any], index: int) -> None:
    """Prefetch the surroundings of a number of a flat array; changes only the time."""


when_compiling(lambda: _compiler[0].define_instructions(next_task, load_soon))


_limit: ContextVar[int | None] = ContextVar("limit", default=None)


def workers() -> int:
    """Current number of threads of parallel kernels; plain Python has no atomic counter."""
    most = 1 if IS_PLAIN else CORES
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


Body = Callable[..., Any]


def role(function: Callable[P, R]) -> Callable[P, R]:
    """A function that does what is played (`plays`) by the class of its first argument.

    It becomes a part of the `inner_kernel` that calls it, and likewise makes and gives no arrays.
    """
    return _cast(function, inline="always")


def called_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that is called, as it is too long to become a part of a loop that plays it twice."""
    return _cast(function, inline="never", _nrt=False)


def making_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that may make arrays."""
    return _cast(function, inline="never")


def lane_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that is a part of loops of lanes, as a `lane_step` is."""
    return _cast(function, inline="never", fastmath=LANES, forceinline=True)


def _cast(function: Callable[P, R], inline: str, **own: Any) -> Callable[P, R]:
    bodies: dict[type, Body] = {}

    @wraps(function)
    def play(*given: P.args, **named: P.kwargs) -> R:
        body = bodies.get(type(given[0])) or bodies[object]
        return body(*given, **named)  # type: ignore[no-any-return]

    when_compiling(lambda: compiler().define_role(play, bodies, inline, own))
    play.bodies = bodies  # type: ignore[attr-defined]
    play.options = {**own, "inline": inline}  # type: ignore[attr-defined]
    return play


def plays(what: Callable[..., R], of: type) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of what a role does for bundles of the class `of`; `object` is all others."""

    def register(body: Callable[P, R]) -> Callable[P, R]:
        what.bodies[of] = body  # type: ignore[attr-defined]
        return body

    return register
