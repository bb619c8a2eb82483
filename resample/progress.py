"""Progress, cancellation and distribution of long work.

Kernels take tasks from a counter that all their threads share. Python reads the counter at times
while it waits, and cancels by setting it past the last task: a picture, warp or cloud stops after
the tasks in progress, whatever paints it.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Event
from typing import Any, NamedTuple, Protocol, TypeVar

from resample.types import Doubles

OFTEN = 0.02  # seconds between two reads of the counter

Progress = Callable[[float], None]
P = TypeVar("P")
R = TypeVar("R")


class CancelledError(RuntimeError):
    """Work was stopped by a `Cancel`.

    Examples
    --------
    >>> from resample import Camera, Cancel, CancelledError, Resampler, cancellable, particles
    >>> balls = particles([[0, 0, 5]], (1, 1, 1), 0.5, 1)
    >>> camera = Camera.from_fov(60, 24, 32)
    >>> cancel = Cancel()
    >>> cancel.cancel()  # usually from another thread
    >>> try:
    ...     with cancellable(cancel):
    ...         Resampler()(balls, camera, height=24, width=32)
    ... except CancelledError as error:
    ...     print(error)
    the work was cancelled
    """


class Cancel:
    """A signal that stops work in another thread permanently.

    Parameters
    ----------
    other
        One that stops the same work, if it is given.

    Examples
    --------
    >>> stop = Cancel()
    >>> stop.cancel()  # from any thread, any number of times
    >>> stop.is_cancelled
    True
    """

    def __init__(self, other: "Cancel | None" = None) -> None:
        self._event, self._other = Event(), other

    @property
    def is_cancelled(self) -> bool:
        """Whether work should stop, or has stopped."""
        return self._event.is_set() or (self._other is not None and self._other.is_cancelled)

    def cancel(self) -> None:
        """Stop the work soon: it raises `CancelledError` in its caller."""
        self._event.set()


@dataclass(frozen=True)
class _Watch:
    cancel: Cancel | None = None
    progress: Progress | None = None
    shares: Doubles | None = None  # (N,) fraction done after each task; None: equal steps


_watch: ContextVar[_Watch] = ContextVar("watch", default=_Watch())  # noqa: B039  frozen


@contextmanager
def cancellable(cancel: Cancel | None) -> Iterator[None]:
    """Let a `Cancel` stop all work in this block; None changes nothing.

    Applies to the current thread or async task.

    Raises
    ------
    CancelledError
        The work was cancelled.

    Examples
    --------
    >>> from resample import Cancel, cancellable
    >>> cancel = Cancel()
    >>> with cancellable(cancel):  # `cancel.cancel()` in another thread stops the block
    ...     pass  # any picture, warp or cloud
    >>> cancel.is_cancelled
    False
    """
    before = _watch.get()
    token = _watch.set(before if cancel is None else _Watch(cancel, before.progress, before.shares))
    try:
        yield
    finally:
        _watch.reset(token)


def watched_cancel() -> Cancel | None:
    """Signal that may stop the current work, or None."""
    return _watch.get().cancel


@contextmanager
def told(progress: Progress | None, shares: Doubles | None = None) -> Iterator[None]:
    """Report the progress of the one kernel called in this block.

    `progress`: called with the fraction of the work that is done, 0 to 1; may raise to stop.
    `shares`: (N,) fraction of the work done after each task, ascending to 1; None: equal steps.
    """
    token = _watch.set(_Watch(_watch.get().cancel, progress, shares))
    try:
        yield
    finally:
        _watch.reset(token)
    if progress is not None:
        progress(1.0)


@contextmanager
def portion(first: float, last: float) -> Iterator[None]:
    """Report progress in this block as a part of the whole, from `first` to `last`.

    Examples
    --------
    >>> from resample.progress import report, portion, told
    >>> with told(print), portion(0.5, 0.75):
    ...     report(1, 2)
    0.625
    1.0
    """
    progress = progress_here()
    if progress is None:
        yield
        return
    token = _watch.set(
        _Watch(_watch.get().cancel, lambda share: progress(first + share * (last - first)))
    )
    try:
        yield
    finally:
        _watch.reset(token)


def progress_here() -> Progress | None:
    """State of progress of the current work."""
    return _watch.get().progress


def is_watched() -> bool:
    """Whether progress or cancellation of the current work is observed."""
    watch = _watch.get()
    return watch.cancel is not None or watch.progress is not None


def report(taken: int, count: int) -> None:
    """Report the number of a kernel's tasks that were taken.

    Raises CancelledError: the work was cancelled.
    """
    watch = _watch.get()
    if watch.cancel is not None and watch.cancel.is_cancelled:
        raise CancelledError("the work was cancelled")
    if watch.progress is None or not count:
        return
    done = min(taken, count)
    if watch.shares is None:
        watch.progress(done / count)
    elif 0 < done <= watch.shares.size:
        watch.progress(float(watch.shares[done - 1]))


class Executor(Protocol):
    """Executor of tasks, as in `concurrent.futures` or a dask client.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from resample.progress import shared_out
    >>> with ThreadPoolExecutor(2) as executor:
    ...     list(shared_out(executor, abs, [-1, 2, -3]))
    [1, 2, 3]
    """

    def map(self, job: Callable[..., Any], /, *parts: Iterable[Any]) -> Iterable[Any]:
        """Results of a job for each part, in order."""


class WorkerPool(NamedTuple):
    """Workers of a command."""

    executor: Executor
    tasks: int  # number of concurrent tasks
    threads: int  # of each task
    memory: int | None  # bytes for the data of a task on its machine; None: unknown
    is_local: bool  # whether all are on this machine and share its memory


def shared_out(executor: Executor | None, job: Callable[[P], R], parts: Iterable[P]) -> Iterator[R]:
    """Results of a job for parts, in order; without an executor they are computed here in turn.

    `executor`: of threads, processes or machines. For the latter two the job and parts must pickle.
    `job`: may be repeated for a part if its worker ended. `parts`: arguments of the job.
    """
    yield from map(job, parts) if executor is None else executor.map(job, list(parts))
