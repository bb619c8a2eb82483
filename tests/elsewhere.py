"""Films whose frames are made by other processes, or by threads that know nothing of this one."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from resample.command import workers
from resample.command.workers import WorkerPool
from tests.commands import ended
from tests.killing import Killing


class Elsewhere:
    """Does as processes would: what it is given and gives is pickled."""

    def __init__(self, executor):
        self.executor = executor

    def map(self, job, *given):
        return self.executor.map(pickle.loads(pickle.dumps(job)), *given)


def pickle_for_workers(monkeypatch):
    """Have workers be threads of this process, which know nothing of what it holds."""

    @contextmanager
    def at_work(sharing, threads=None):
        if not sharing.has_workers:
            yield None
            return
        with ThreadPoolExecutor(1) as executor:
            yield WorkerPool(
                Elsewhere(executor), sharing.workers, threads or 1, None, is_local=True
            )

    monkeypatch.setattr(workers, "at_work", at_work)


def frames(folder):
    return [path.read_bytes() for path in sorted(Path(folder).glob("*.png"))]


def assert_same_film(app, words):
    """Two workers make the frames that one process makes."""
    assert ended(app, *words, "-o", "one") == 0
    assert ended(app, *words, "-o", "two", "--workers", "2") == 0
    assert len(frames("one")) == 3
    assert frames("one") == frames("two")


def assert_killed_costs_own_frames(app, words, folder, monkeypatch, *, is_late):
    """A worker that is killed costs a film its own frames alone."""
    asked, killers = workers.at_work, []

    @contextmanager
    def at_work(sharing, threads=None):
        with asked(sharing, threads) as crew:
            killers.append(Killing(crew.executor, folder / "marks", 1, is_late))
            yield crew._replace(executor=killers[0])

    assert ended(app, *words, "-o", "whole") == 0
    monkeypatch.setattr(workers, "at_work", at_work)
    (folder / "marks").mkdir()
    assert ended(app, *words, "-o", "film", "--workers", "2") == 0
    killers[0].redone(0)
    assert frames("whole") == frames("film")
