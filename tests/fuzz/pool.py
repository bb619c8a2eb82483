"""Cases tried in processes of their own, whose time and memory are limited."""

import faulthandler
import multiprocessing
import os
import resource
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

READ, REFUSED = "read", "refused"
DOCUMENTED = (ValueError, OSError, LookupError, MemoryError)
BUGS = (KeyError, IndexError)  # which the command lines pass on with their traceback, too

Try = Callable[[int, Path], object]  # what a seed means, in a folder that is empty


class Found(NamedTuple):
    """What became of a case."""

    seed: int
    result: str  # READ, REFUSED, or what is wrong

    @property
    def is_fault(self) -> bool:
        return self.result not in (READ, REFUSED)


class Setup(NamedTuple):
    """Processes, and what each may take."""

    make: Callable[[], Try]  # called once in each process
    seconds: float = 20.0  # of a case
    memory: int = 6 << 30  # bytes of a process, addresses that are not used included
    allowed: tuple[type[BaseException], ...] = ()  # besides the documented ones


def attempted(
    attempt: Try, seed: int, folder: Path, allowed: tuple[type[BaseException], ...]
) -> str:
    """Result of one case in this process."""
    from resample.messages import one_line

    try:
        attempt(seed, folder)
    except BUGS as error:
        return _fault(error)
    except (*DOCUMENTED, *allowed) as error:
        line = one_line(error)
        if not line.isprintable():
            return f"control characters in {line!r:.300}"
        return REFUSED if line else _fault(error)
    except BaseException as error:  # a fault is what this looks for
        return _fault(error)
    return READ


def _fault(error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)[-4:]
    way = " < ".join(f"{Path(one.filename).name}:{one.lineno}" for one in reversed(last))
    return f"{type(error).__name__}: {str(error)!r:.160} at {way}"


def _work(setup: Setup, pipe: Connection) -> None:
    """Try seeds until there are no more."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):  # libraries print
        os.dup2(nowhere, descriptor)
    faulthandler.disable()
    warnings.simplefilter("ignore")
    attempt = setup.make()
    resource.setrlimit(resource.RLIMIT_AS, (setup.memory, setup.memory))
    pipe.send("ready")  # imports are not counted as time of a case
    while (seed := pipe.recv()) is not None:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            result = attempted(attempt, seed, Path(folder), setup.allowed)
        pipe.send(result)


class Worker:
    """A process that is replaced where it ends or hangs."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.start()

    def start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(self.setup, other), daemon=True)
        self.process.start()
        other.close()
        self.pipe.recv()

    def tried(self, seed: int) -> Found:
        """Result of a case; one that ends the process, or does not end, is a fault."""
        self.pipe.send(seed)
        if not self.pipe.poll(self.setup.seconds):
            self.replace()
            return Found(seed, f"hang: no end after {self.setup.seconds:g} s")
        try:
            return Found(seed, self.pipe.recv())
        except EOFError:
            self.process.join(10)
            code = self.process.exitcode
            self.replace()
            return Found(seed, f"crash: the process ended with {code}")

    def replace(self) -> None:
        self.close()
        self.start()

    def close(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def tried_all(setup: Setup, seeds: range, seconds: float) -> list[Found]:
    """Results of seeds, one after the other, as many as there is time for."""
    worker, found, start = Worker(setup), [], time.monotonic()
    try:
        for seed in seeds:
            found.append(worker.tried(seed))
            if time.monotonic() - start > seconds:
                break
    finally:
        worker.close()
    return found
