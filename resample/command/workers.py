"""Distribute a command's work to local processes or other machines by dask (an extra)."""

import logging
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING

from resample.command.settings import Sharing
from resample.memory import ALLOWED, GIVEN_BACK, allow
from resample.messages import one_line
from resample.progress import WorkerPool
from resample.reading.limits import restored

if TYPE_CHECKING:
    from distributed import Client

PACKAGE = "hybrid-resample"
PATIENCE = 60  # seconds to wait for workers that are restarted
ANSWER = 10  # seconds to wait for an answer of a scheduler
SHARE = 0.5  # fraction of a worker's memory for the data of its tasks


StartWorkers = Callable[[], WorkerPool | None]


@contextmanager
def at_work(sharing: Sharing, threads: int | None = None) -> Iterator[WorkerPool | None]:
    """The requested workers, until the end of the block; None if none were requested.

    Parameters and errors as in `worker_pools`.
    """
    with worker_pools(sharing, threads) as start:
        yield start()


@contextmanager
def worker_pools(sharing: Sharing, threads: int | None = None) -> Iterator[StartWorkers]:
    """Function that starts the user's workers when it is first called.

    It returns the same workers each time; they end with the block. None: none were asked for.

    `threads`: threads of each task; None: the local cores are divided, and remote tasks take one
    each.
    """
    check_sharing(sharing)
    if not sharing.has_workers:
        yield lambda: None
        return
    # Exceptions of tasks that no worker takes; older versions of dask have only one.
    from distributed import KilledWorker, scheduler

    names = ("NoWorkerError", "NoValidWorkerError")
    no_worker_errors = tuple(getattr(scheduler, name) for name in names if hasattr(scheduler, name))
    with ExitStack() as held:
        client = cache(lambda: held.enter_context(_client(sharing, held)))
        try:
            yield cache(lambda: _pool_of(client(), sharing, threads))
        except KilledWorker as error:
            with suppress(OSError, TimeoutError):  # workers may still be starting
                client().wait_for_workers(sharing.workers or 1, timeout=5)
            raise ChildProcessError(
                f"a task failed because {error.allowed_failures + 1} workers ended while running "
                "it, most likely because memory ran out; allow less --memory, or use fewer workers"
            ) from None
        except no_worker_errors:
            raise ChildProcessError(
                f"all workers have ended and none restarted within {PATIENCE} seconds; allow "
                "less --memory, or use fewer workers, or none"
            ) from None


def check_sharing(sharing: Sharing) -> None:
    """Reject workers that cannot exist, before any work is done."""
    if sharing.workers is not None and sharing.scheduler is not None:
        raise ValueError("--workers starts processes, --scheduler has its own; give only one")
    if sharing.has_workers:
        try:
            import distributed  # noqa: F401
        except ImportError as error:
            raise ValueError(
                f"workers need dask, and {error.name} is not installed: "
                f"pip install '{PACKAGE}[dist]'"
            ) from None


def share_memory(sharing: Sharing) -> None:
    """Reserve local workers' shares of `--memory`, from now on."""
    allowed = ALLOWED.get()
    if allowed is not None and sharing.workers:
        allow(allowed // (1 + sharing.workers))


def _client(sharing: Sharing, held: ExitStack) -> "Client":
    """Client of the given scheduler, or of a local one."""
    import asyncio

    import dask.config
    from distributed import Client, LocalCluster

    if sharing.scheduler is not None:
        try:
            asyncio.run(asyncio.wait_for(_meet(sharing.scheduler), ANSWER))
            return Client(sharing.scheduler, set_as_default=False, timeout=ANSWER)
        except Exception as error:  # an answer that makes no sense raises anything
            raise OSError(
                f"no scheduler of dask answers at {sharing.scheduler}: {one_line(error):.200}"
            ) from None
    own = {
        "distributed.nanny.pre-spawn-environ": _environment(),
        "distributed.scheduler.no-workers-timeout": f"{PATIENCE}s",
    }
    held.enter_context(dask.config.set(own))
    held.enter_context(restored())  # dask sets variables for its workers there
    folder = held.enter_context(tempfile.TemporaryDirectory(prefix="resample-workers-"))
    try:
        cluster = LocalCluster(
            n_workers=sharing.workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # any port, local access only
            memory_limit=0,  # memory limits are computed here
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        )
    except (RuntimeError, TimeoutError):  # dask's message is about its internals
        raise ChildProcessError(
            f"--workers {sharing.workers}: one ended before it was ready, most likely killed "
            "because memory ran out; use fewer workers, or none"
        ) from None
    return Client(held.enter_context(cluster), set_as_default=False)


async def _meet(address: str) -> None:
    """Ask what answers at an address who it is: clients of dask do not survive all answers."""
    from distributed import Security
    from distributed.core import connect

    comm = await connect(address, **Security().get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        kind = (await comm.read())["type"]
        if kind != "Scheduler":
            raise ValueError(f"it is a {kind}")
    finally:
        comm.abort()


def _environment() -> dict[str, object]:
    """Environment of workers: no logging, little memory kept."""
    import dask.config

    own: dict[str, object] = dask.config.get("distributed.nanny.pre-spawn-environ", {})
    held = {"MALLOC_MMAP_THRESHOLD_": str(GIVEN_BACK)}  # as in `return_freed_memory`
    return {**own, **held, "DASK_LOGGING__DISTRIBUTED": "critical"}


def _pool_of(client: "Client", sharing: Sharing, threads: int | None) -> WorkerPool:
    executor = client.get_executor(pure=False)
    if sharing.workers is not None:
        each = threads or max(1, (os.cpu_count() or 1) // sharing.workers)
        return WorkerPool(executor, sharing.workers, each, None, is_local=True)
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    if not workers:
        raise OSError(f"the scheduler at {sharing.scheduler} has no workers; start some")
    from importlib.metadata import PackageNotFoundError, version

    own = version(PACKAGE)
    try:
        others = set(client.run(version, PACKAGE).values()) - {own}
    except PackageNotFoundError:
        raise ValueError(f"workers do not have {PACKAGE}; install {own} there") from None
    if others:
        raise ValueError(f"workers have {PACKAGE} {', '.join(others)} and this is {own}")
    count = sum(worker["nthreads"] for worker in workers)
    limits = [worker["memory_limit"] / worker["nthreads"] for worker in workers]
    least = min((limit for limit in limits if limit), default=None)
    memory = None if least is None else int(SHARE * least)
    return WorkerPool(executor, count, threads or 1, memory, is_local=False)
