"""Films whose frames several processes make."""

import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from resample.command import workers
from resample.command.workers import WorkerPool
from resample_warp3d.cli import app
from tests.commands import ended, refused
from tests.killing import Killing

ROOM = ["animate", "sample:room", "--frames", "3", "--size", "40x30"]


class Elsewhere:
    """Does as processes would: what it is given and gives is pickled."""

    def __init__(self, executor):
        self.executor = executor

    def map(self, job, *given):
        return self.executor.map(pickle.loads(pickle.dumps(job)), *given)


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def pickled(monkeypatch):
    """Workers that are threads of this process, but know nothing of what it holds."""

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


def cloud():
    rng = np.random.default_rng(3)
    normal = rng.normal(size=(800, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    np.savez("ball.npz", position=normal, normal=normal, color=np.abs(normal))
    return ["animate-cloud", "ball.npz", "--frames", "3", "--size", "40", "--up", "y"]


@pytest.mark.usefixtures("pickled")
def test_frames_of_depth_images_are_the_same_elsewhere():
    assert ended(app, *ROOM, "-o", "one") == 0
    assert ended(app, *ROOM, "-o", "two", "--workers", "2") == 0
    assert len(frames("one")) == 3
    assert frames("one") == frames("two")
    (Path("two") / "frame-0001.png").unlink()
    assert ended(app, *ROOM, "-o", "two", "--workers", "1", "--resume") == 0
    assert frames("one") == frames("two")


@pytest.mark.usefixtures("pickled")
def test_frames_of_clouds_are_the_same_elsewhere():
    words = cloud()
    assert ended(app, *words, "-o", "one") == 0
    assert ended(app, *words, "-o", "two", "--workers", "2") == 0
    assert len(frames("one")) == 3
    assert frames("one") == frames("two")


def test_what_workers_cannot_do_is_refused_in_a_line(capsys):
    error = refused(app, capsys, *ROOM, "-o", "a", "--workers", "2", "--depth-output", "depth")
    assert "depth of frames can only be written by one process; leave workers out" in error
    error = refused(app, capsys, *ROOM, "-o", "a", "--workers", "2", "--scheduler", "tcp://a:1")
    assert "give only one" in error


@pytest.mark.sweep(kept_by="test_frames_of_depth_images_are_the_same_elsewhere")
def test_processes_make_the_same_films():
    for name, words in (("room", ROOM), ("ball", cloud())):
        assert ended(app, *words, "-o", f"{name}1") == 0
        assert ended(app, *words, "-o", f"{name}2", "--workers", "2") == 0
        assert frames(f"{name}1") == frames(f"{name}2")
    assert sorted(os.listdir()) == ["ball.npz", "ball1", "ball2", "room1", "room2"]


@pytest.mark.sweep(
    kept_by="tests/core/test_workers.py::test_a_killed_worker_costs_a_film_its_own_frames_alone"
)
@pytest.mark.parametrize(("words", "is_late"), [(ROOM, True), (None, False)])
def test_a_killed_worker_costs_a_film_its_own_frames_alone(words, is_late, tmp_path, monkeypatch):
    words, asked, killers = words or cloud(), workers.at_work, []

    @contextmanager
    def at_work(sharing, threads=None):
        with asked(sharing, threads) as crew:
            killers.append(Killing(crew.executor, tmp_path / "marks", 1, is_late))
            yield crew._replace(executor=killers[0])

    assert ended(app, *words, "-o", "whole") == 0
    monkeypatch.setattr(workers, "at_work", at_work)
    (tmp_path / "marks").mkdir()
    assert ended(app, *words, "-o", "film", "--workers", "2") == 0
    killers[0].redone(0)
    assert frames("whole") == frames("film")
