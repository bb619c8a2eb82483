"""Work that is watched while it goes on, how far it is and whether it is to stop, or shared out.

Kernels take tasks from a counter that all their threads share. Python waits for them beside, looks
at the counter now and then, and writes a number into it that leaves no tasks if they are to stop:
so a picture, a warp or a cloud stops after the tasks in hand, whatever paints it.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Event
from typing import Any, NamedTuple, Protocol, TypeVar

from resample.types import Doubles

OFTEN = 0.02  # seconds between two looks

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
    >>> cancel.cancel()  # mostly from another thread, while the work goes on
    >>> try:
    ...     with cancellable(cancel):
    ...         Resampler()(balls, camera, height=24, width=32)
    ... except CancelledError as error:
    ...     print(error)
    the work was cancelled
    """


class Cancel:
    """What stops work that goes on in another thread, for good.

    Examples
    --------
    >>> stop = Cancel()
    >>> stop.cancel()  # from any thread, any number of times
    >>> stop.is_cancelled
    True
    """

    def __init__(self) -> None:
        self._event = Event()

    @property
    def is_cancelled(self) -> bool:
        """Whether work is to stop, or has."""
        return self._event.is_set()

    def cancel(self) -> None:
        """Let work stop soon: it raises `CancelledError` where it was called."""
        self._event.set()


@dataclass(frozen=True)
class _Watch:
    cancel: Cancel | None = None
    progress: Progress | None = None
    shares: Doubles | None = None  # (N,) of the work that is done after so many tasks; None: evenly


_watch: ContextVar[_Watch] = ContextVar("watch", default=_Watch())  # noqa: B039  frozen


@contextmanager
def cancellable(cancel: Cancel | None) -> Iterator[None]:
    """Let a `Cancel` stop everything that is done here; None changes nothing.

    Holds for the thread, or task, that asks for it.

    Raises
    ------
    CancelledError
        It was cancelled.

    Examples
    --------
    >>> from resample import Cancel, cancellable
    >>> cancel = Cancel()
    >>> with cancellable(cancel):  # `cancel.cancel()` in another thread stops what goes on here
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


@contextmanager
def told(progress: Progress | None, shares: Doubles | None = None) -> Iterator[None]:
    """Tell how far the one kernel is that is called here.

    Parameters
    ----------
    progress
        Called with the share of the work that is done, 0 to 1, and may raise to stop.
    shares
        (N,) of the work that is done after so many tasks, ascending to 1; None: as much for each.
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
    """Let what is done here be that part of the work, from one share of all to another.

    Examples
    --------
    >>> from resample.watching import look, portion, told
    >>> with told(print), portion(0.5, 0.75):
    ...     look(1, 2)
    0.625
    1.0
    """
    progress = _watch.get().progress
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


def is_watched() -> bool:
    """Whether someone wants to stop what is done here, or to know how far it is."""
    watch = _watch.get()
    return watch.cancel is not None or watch.progress is not None


def look(taken: int, count: int) -> None:
    """Tell how many of a kernel's tasks were taken.

    Raises
    ------
    CancelledError
        The work is to stop.
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
    """Who does parts of some work: `concurrent.futures` has several, and dask's clients one.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from resample.watching import shared_out
    >>> with ThreadPoolExecutor(2) as executor:
    ...     list(shared_out(executor, abs, [-1, 2, -3]))
    [1, 2, 3]
    """

    def map(self, job: Callable[..., Any], /, *parts: Iterable[Any]) -> Iterable[Any]:
        """What a job gives for parts, in their order."""
        ...


class Crew(NamedTuple):
    """Who does parts of a command's work."""

    executor: Executor
    tasks: int  # that are done at a time
    threads: int  # of each task
    memory: int | None  # bytes that the data of a task may take on its machine; None: not known
    is_local: bool  # whether all are on this machine, and share its memory


def shared_out(executor: Executor | None, job: Callable[[P], R], parts: Iterable[P]) -> Iterator[R]:
    """What a job gives for parts, in their order; without an executor one after the other, here.

    Parameters
    ----------
    executor
        Of threads, processes or machines. The latter two take a job and parts that pickle.
    job
        May be done again for a part, if who did it ended.
    parts
        Of the work.
    """
    yield from map(job, parts) if executor is None else executor.map(job, list(parts))
