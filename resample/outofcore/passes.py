"""Passes over parts of a scene: on threads, or by an executor, with progress."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import cache, partial, wraps
from itertools import pairwise
from typing import Any, NamedTuple, ParamSpec, TypeVar
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from resample.progress import Executor, Progress, shared_out, told

P = TypeVar("P")
R = TypeVar("R")
Given = ParamSpec("Given")

Memo = dict[tuple[Any, ...], Any]  # by function, arguments and values

_kept: ContextVar[Memo | None] = ContextVar("kept", default=None)


@contextmanager
def memoizing(kept: Memo) -> Iterator[None]:
    """Enable memoization within a block.

    Values must not change while results about them are kept.
    """
    token = _kept.set(kept)
    try:
        yield
    finally:
        _kept.reset(token)


def memo_of(values: Any) -> Memo:
    """Return the cached facts about values; without a scene nothing is kept for long."""
    kept: Memo | None = getattr(values, "found", _kept.get())
    return {} if kept is None else kept


def memoized(of: Callable[[Any], Any]) -> Callable[[Callable[Given, R]], Callable[Given, R]]:
    """Memoize a function that only depends on values and numbers, in a scene or on the values."""

    def decorated(find: Callable[Given, R]) -> Callable[Given, R]:
        @wraps(find)
        def found(*args: Given.args, **kwargs: Given.kwargs) -> R:
            values, others = of(args[0]), args[1:]
            kept = memo_of(values)
            key = (find, id(values), *others, *sorted(kwargs.items()))
            if key in kept and kept[key][0]() is values:  # not others that had the same id
                return kept[key][1]  # type: ignore[no-any-return]
            result = find(*args, **kwargs)
            with suppress(TypeError):  # lists have no weak references
                kept[key] = ref(values), result
            return result

        return found

    return decorated


MOST_THREADS = 8
DIGIT = 16  # bits


class PassContext(NamedTuple):
    """Executor, threads and progress of a pass."""

    executor: Executor | None = None  # runs parts; None: all run in this process
    threads: int | None = None  # of each process; None: all
    tell: Progress | None = None  # called with the fraction done, 0 to 1; None: the caller's

    def portion(self, first: float, last: float) -> "PassContext":
        """Return the context of a part of the work, by fractions of the whole."""
        tell = self.tell
        if tell is None:
            return self
        return self._replace(tell=lambda share: tell(first + (last - first) * share))


def passed(
    job: Callable[[P], R],
    parts: Sequence[P],
    context: PassContext,
    sizes: Sequence[int] | None = None,
) -> Iterator[R]:
    """Run a job on parts, and yield its results in their order; `sizes` are their shares in it.

    Other processes get the job pickled, and may repeat it if one of them ended.
    """
    done = np.cumsum([0, *(sizes or [1] * len(parts))])
    results = shared_out(context.executor, partial(_on_threads, job, context.threads), parts)
    for first, last in pairwise(done):
        share = context.portion(first / max(1, done[-1]), last / max(1, done[-1]))
        with nullcontext() if share.tell is None else told(share.tell):
            result = next(results)
        yield result


def _on_threads(job: Callable[[P], R], count: int | None, part: P) -> R:
    """Run a job on at most so many threads."""
    from resample.engine.jit import threads

    with nullcontext() if count is None else threads(count):
        return job(part)


def ranked(
    ranks: Iterable[int], counted: Callable[[int, int], NDArray[np.int64]], digits: int
) -> list[int]:
    """Return the numbers of given ranks in ascending order, by passes of `counts_by_digit`."""
    count, found = cache(counted), []
    for rank in ranks:
        prefix, left = 0, rank
        for digit in reversed(range(digits)):
            last = np.cumsum(count(prefix, digit))
            own = int(np.searchsorted(last, left, side="right"))
            left -= int(last[own - 1]) if own else 0
            prefix = prefix << DIGIT | own
        found.append(prefix)
    return found


def counts_by_digit(
    number: NDArray[np.unsignedinteger[Any]], prefix: int, digit: int
) -> NDArray[np.int64]:
    """Count 16 bits, digit 0 the lowest, of the numbers (N,) with a prefix as higher bits."""
    high = number >> number.dtype.type(DIGIT * digit)
    own = high[high >> number.dtype.type(DIGIT) == prefix] & number.dtype.type((1 << DIGIT) - 1)
    return np.bincount(own.astype(np.int64), minlength=1 << DIGIT)


@contextmanager
def thread_pool(threads: int | None = None) -> Iterator[ThreadPoolExecutor]:
    """Threads, `threads_at_work` by default; none begins another task after the block."""
    pool = ThreadPoolExecutor(threads or threads_at_work())
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def in_order(
    job: Callable[[P], R], parts: Iterable[P], pool: ThreadPoolExecutor | None = None
) -> Iterator[R]:
    """Run a job on threads; yield its results in the order of the parts; few are queued."""
    waiting, most = deque[Future[R]](), threads_at_work()
    with thread_pool() if pool is None else nullcontext(pool) as own:
        for part in parts:
            waiting.append(own.submit(job, part))
            if len(waiting) > most:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def threads_at_work() -> int:
    """Return the number of concurrent parts, within `resample.engine.jit.threads`."""
    from resample.engine.jit import workers

    return min(MOST_THREADS, workers())


def spans_within(start: NDArray[np.int64], most: int) -> Iterator[tuple[int, int]]:
    """Yield spans of tiles that have at most so many members together, or single tiles.

    `start` (T + 1,) is the number of members of all tiles before each.
    """
    tile, count = 0, len(start) - 1
    while tile < count and start[tile] < start[-1]:
        last = int(np.searchsorted(start, start[tile] + most, side="right")) - 1
        last = min(max(last, tile + 1), count)
        if start[last] > start[tile]:
            yield tile, last
        tile = last
