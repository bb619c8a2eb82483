"""An animation is killed again and again, and resumed each time."""

import os
import subprocess
import sys

import pytest

from tests.processes import PATIENCE

# A run is killed after so many calls of a function, wherever that is: in a system call, between two
# pieces of a file. The parent has loaded the kernels, and has no threads (NUMBA_NUM_THREADS is 1).
KILLED_AND_RESUMED = """
import os, shutil, signal, sys
from pathlib import Path

import numpy as np

from resample.files.animations import write_film
from resample_volume.command.animation import Flight, FrameOptions, cameras_of, shots
from resample_volume.files.generated import vessel_tree
from resample_volume.appearance import Appearance
from resample_volume.rendering import Subject

TIMES = 20
subject = Subject.of(vessel_tree(24), Appearance())
cameras = cameras_of(subject, Flight(frames=12), (32, 32))
frames = shots(subject, cameras, FrameOptions(size=(32, 32)))
frames.frame(0)


def run(folder, last=None, report=None):
    # Whether a process that makes the films ends well, or is killed after its last call.
    folder.mkdir(exist_ok=True)
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    os.chdir(folder)
    calls = 0

    def count(*_):
        nonlocal calls
        calls += 1
        if calls == last:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(count)
    for name in ("frames", "film.webp"):
        write_film(Path(name), frames, 24, resume=True)
    sys.setprofile(None)
    if report:
        os.write(report, str(calls).encode())
    os._exit(0)


def content(folder):
    # Bytes of all files, also hidden ones, and names of folders.
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
            for path in folder.rglob("*")}


def shown(folder):
    return {name: data for name, data in content(folder).items()
            if not any(part.startswith(".") for part in Path(name).parts)}


reading, writing = os.pipe()
assert run(Path("whole"), report=writing)
whole, folder, calls = content(Path("whole")), Path("killed"), int(os.read(reading, 20))
rng = np.random.default_rng(7)
deaths = films = 0
while deaths < TIMES:
    if run(folder, last=rng.integers(1, calls)):
        assert content(folder) == whole
        shutil.rmtree(folder)
        films += 1
    else:
        deaths += 1
        assert shown(folder).items() <= whole.items(), (deaths, shown(folder).keys())
assert run(folder)
assert content(folder) == whole
print(deaths, films, calls)
"""


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that can be forked")
def test_films_killed_at_random_moments_are_resumed_to_the_same_bits(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-c", KILLED_AND_RESUMED],
        check=False,
        cwd=tmp_path,
        env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 0, ended.stderr
    deaths, _, calls = map(int, ended.stdout.split())
    assert deaths == 20
    assert calls > 1000
