"""Work of a command shared out among processes of this machine or of others, by dask: an extra."""

import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING

from resample.command.settings import Sharing
from resample.memory import GIVEN_BACK
from resample.watching import Crew
from resample.words import one_line

if TYPE_CHECKING:
    from distributed import Client

PACKAGE = "hybrid-resample"
PATIENCE = 60  # seconds that work waits for workers that are started again
SHARE = 0.5  # of a worker's memory that the data of its tasks may take


Hire = Callable[[], Crew | None]


@contextmanager
def at_work(sharing: Sharing, threads: int | None = None) -> Iterator[Crew | None]:
    """Workers that a user asks for, until the end of the block; None if he asks for none.

    Parameters and errors as of `hiring`.
    """
    with hiring(sharing, threads) as hire:
        yield hire()


@contextmanager
def hiring(sharing: Sharing, threads: int | None = None) -> Iterator[Hire]:
    """Who starts the workers that a user asks for: when he is asked for them first.

    They are the same ones each time, and end with the block; None if the user asks for none.

    Parameters
    ----------
    sharing
        How many processes, or where a scheduler listens.
    threads
        Of each task; None shares out the cores of this machine, and takes one on others.

    Raises
    ------
    ValueError
        The extra is not installed, both are asked for, or workers have another version of ours.
    OSError
        The scheduler does not answer, it has no workers, or workers ended again and again, or as
        they began.
    """
    check_sharing(sharing)
    if not sharing.is_asked:
        yield _nobody
        return
    from distributed import KilledWorker

    nobody_left = _nobody_left()
    with ExitStack() as held:
        client = cache(lambda: held.enter_context(_client(sharing, held)))
        try:
            yield cache(lambda: _crew(client(), sharing, threads))
        except KilledWorker as error:
            with suppress(OSError, TimeoutError):  # those that begin cannot be ended well
                client().wait_for_workers(sharing.workers or 1, timeout=5)
            raise ChildProcessError(
                f"a task was given up after {_attempts(error)} workers had ended over it, most "
                "likely for want of memory; allow less --memory, or take fewer workers"
            ) from None
        except nobody_left:
            raise ChildProcessError(
                f"all workers have ended, and for {PATIENCE} seconds none was ready again; allow "
                "less --memory, or take fewer workers, or none"
            ) from None


def _nobody_left() -> tuple[type[Exception], ...]:
    """What tasks fail with that no worker takes; older versions of dask have one word for it."""
    from distributed import scheduler

    names = ("NoWorkerError", "NoValidWorkerError")
    return tuple(getattr(scheduler, name) for name in names if hasattr(scheduler, name))


def _nobody() -> None:
    """Nobody is asked for."""


def check_sharing(sharing: Sharing) -> None:
    """Refuse workers that there cannot be, before any work is done.

    Raises
    ------
    ValueError
        As of `at_work`.
    """
    if sharing.workers is not None and sharing.scheduler is not None:
        raise ValueError("workers are started here and a scheduler has its own; give one of both")
    if sharing.is_asked:
        try:
            import distributed  # noqa: F401
        except ImportError as error:
            raise ValueError(
                f"workers are dask's, and {error.name} is not installed: "
                f"pip install '{PACKAGE}[dist]'"
            ) from None


def _client(sharing: Sharing, held: ExitStack) -> "Client":
    """Client of the scheduler that is asked for, or of one of our own."""
    import dask.config
    from distributed import Client, LocalCluster

    if sharing.scheduler is not None:
        try:
            return Client(sharing.scheduler, set_as_default=False, timeout="10s")
        except (OSError, ValueError) as error:
            raise OSError(
                f"no scheduler of dask answers at {sharing.scheduler}: {one_line(error):.200}"
            ) from None
    own = {
        "distributed.nanny.pre-spawn-environ": _environment(),
        "distributed.scheduler.no-workers-timeout": f"{PATIENCE}s",
    }
    held.enter_context(dask.config.set(own))
    held.enter_context(_kept_environment())
    folder = held.enter_context(tempfile.TemporaryDirectory(prefix="resample-workers-"))
    with _starting(sharing.workers):
        cluster = LocalCluster(
            n_workers=sharing.workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # any port, for nobody else
            memory_limit=0,  # what tasks may take is reckoned by us
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        )
    return Client(held.enter_context(cluster), set_as_default=False)


@contextmanager
def _kept_environment() -> Iterator[None]:
    """Leave this process's environment as it was: dask puts there what workers are to find."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _starting(count: int | None) -> Iterator[None]:
    """Say in one line that workers could not be started."""
    try:
        yield
    except (RuntimeError, TimeoutError):  # dask's words are of its own parts
        raise ChildProcessError(
            f"--workers {count}: one ended before it was ready, most likely killed for want of "
            "memory; take fewer workers, or none"
        ) from None


def _environment() -> dict[str, object]:
    """What workers find in their environment: they say nothing of themselves, and hold little."""
    import dask.config

    own: dict[str, object] = dask.config.get("distributed.nanny.pre-spawn-environ", {})
    held = {"MALLOC_MMAP_THRESHOLD_": str(GIVEN_BACK)}  # as of `give_back`
    return {**own, **held, "DASK_LOGGING__DISTRIBUTED": "critical"}


def _crew(client: "Client", sharing: Sharing, threads: int | None) -> Crew:
    executor = client.get_executor(pure=False)
    if sharing.workers is not None:
        own = threads or max(1, (os.cpu_count() or 1) // sharing.workers)
        return Crew(executor, sharing.workers, own, None, is_local=True)
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    if not workers:
        raise OSError(f"the scheduler at {sharing.scheduler} has no workers; start some")
    _check_versions(client)
    count = sum(worker["nthreads"] for worker in workers)
    limits = [worker["memory_limit"] / worker["nthreads"] for worker in workers]
    least = min((limit for limit in limits if limit), default=None)
    memory = None if least is None else int(SHARE * least)
    return Crew(executor, count, threads or 1, memory, is_local=False)


def _check_versions(client: "Client") -> None:
    """Refuse workers whose pictures may have other bits."""
    from importlib.metadata import PackageNotFoundError, version

    own = version(PACKAGE)
    try:
        others = set(client.run(version, PACKAGE).values()) - {own}
    except PackageNotFoundError:
        raise ValueError(f"workers do not have {PACKAGE}; install {own} there") from None
    if others:
        raise ValueError(f"workers have {PACKAGE} {', '.join(others)} and this is {own}")


def _attempts(error: Exception) -> int:
    """How many workers ended over a task."""
    return int(getattr(error, "allowed_failures", 3)) + 1
