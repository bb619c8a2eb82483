"""A command that paints windows is killed: the same one goes on, any other removes what is left."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample.command import workers
from resample.command.workers import WorkerPool
from resample.files import writing
from resample.files.images import read_image
from resample.outofcore import windows
from resample_volume.cli import app
from tests import commands
from tests.processes import PATIENCE

ended = partial(commands.ended, app)
RENDER = [
    *("render", "a.zarr", "--size", "96", "--transfer", "150..190", "--camera", "30/10/1.3"),
    *("--fit", "volume", "--memory", "12MB", "--workers", "1", "-o", "a.exr"),
]
WRITTEN = 2  # windows, before the command is killed

# As a user's command, whose only worker is a thread of its own.
KILLED = """
import os, signal, sys
from contextlib import contextmanager
from pathlib import Path

from resample.command.workers import WorkerPool
from resample.command import workers
from resample_volume.cli import app


class Ending:
    def map(self, job, parts):
        for part in parts:
            if len(list(Path().glob(".a.tmp-*/window-*.npz"))) == int(sys.argv[1]):
                os.kill(os.getpid(), signal.SIGKILL)
            yield job(part)


@contextmanager
def worker_pools(sharing, threads=None):
    yield lambda: WorkerPool(Ending(), 1, 1, None, True)


workers.worker_pools = worker_pools
app(sys.argv[2:])
"""


@pytest.fixture(autouse=True)
def store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(writing, "_tidied", set())
    smoke = np.random.default_rng(5).integers(0, 200, (320, 60, 64)).astype(np.uint8)
    np.save("a.npy", smoke)
    assert ended("convert", "a.npy", "a.zarr", "--chunk", "16") == 0
    for file in Path("a.zarr").rglob("*"):
        known = file.stat()
        os.utime(file, (known.st_atime, known.st_mtime - 60))
    monkeypatch.setattr(writing, "_tidied", set())


@pytest.fixture
def painted(monkeypatch):
    """Windows that are painted by this process."""
    made, keep_tile = [], windows.keep_tile

    def noted(folder, window, *rest):
        made.append(window)
        keep_tile(folder, window, *rest)

    @contextmanager
    def hiring(sharing, threads=None):
        with ThreadPoolExecutor(1) as executor:
            crew = WorkerPool(executor, 1, threads or 1, None, is_local=True)
            yield lambda: crew if sharing.has_workers else None

    monkeypatch.setattr(windows, "keep_tile", noted)
    monkeypatch.setattr(workers, "worker_pools", hiring)
    return made


def kill(*words):
    words = [sys.executable, "-c", KILLED, str(WRITTEN), *words]
    killed = subprocess.run(words, check=False, capture_output=True, timeout=PATIENCE)
    assert killed.returncode == -9, killed.stderr.decode()
    (left,) = Path().glob(".a.tmp-*.exr")
    assert len(list(left.glob("window-*.npz"))) == WRITTEN
    return left


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell whether a process lives")
def test_the_same_command_goes_on_where_a_killed_one_was(painted, capsys):
    assert ended(*RENDER[:-1], "whole.exr") == 0
    every = sorted(painted)
    left = kill(*RENDER)
    painted.clear()
    capsys.readouterr()
    assert ended(*RENDER) == 0
    assert "2 windows are reused from a command that was killed" in capsys.readouterr().err
    assert len(painted) == len(every) - WRITTEN > 0
    assert not left.exists()
    assert not list(Path().glob(".a.tmp-*"))
    assert np.array_equal(read_image("a.exr"), read_image("whole.exr"))


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell whether a process lives")
@pytest.mark.parametrize("change", ["look", "store", "alone"])
def test_what_another_command_has_left_is_removed(change, painted):
    words = list(RENDER)
    if change == "look":
        words[5] = "150..180"
    elif change == "alone":
        words[-4:-2] = []
    left = kill(*RENDER)
    if change == "store":
        os.utime(next(file for file in Path("a.zarr/0/c").rglob("0") if file.is_file()), (9, 9))
    assert ended(*words) == 0
    made = len(painted)
    assert not left.exists()
    assert not list(Path().glob(".a.tmp-*"))
    assert ended(*words[:-1], "b.exr") == 0
    assert len(painted) == 2 * made
    assert np.array_equal(read_image("a.exr"), read_image("b.exr"))
