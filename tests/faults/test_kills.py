"""Commands are killed 300 times: the target is as it was or whole, and the next run tidies up."""

import os
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.faults.commands import COMMANDS, Tree, began, content, hidden, run, write_inputs

pytestmark = [
    pytest.mark.sweep,
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="signals of Unix"),
]
KILLS = 25  # of each command
ENDED = {signal.SIGKILL: (-9,), signal.SIGTERM: (143, -15), signal.SIGINT: (130, -2)}


@pytest.fixture
def known(tmp_path, target):
    """A folder with what a command reads, what it writes, and how long it takes."""
    write_inputs(tmp_path)
    assert run(tmp_path, target).returncode == 0  # caches are warm from here on
    whole = content(tmp_path / target)
    clear(tmp_path / target)
    begin = time.perf_counter()
    assert run(tmp_path, target).returncode == 0
    assert content(tmp_path / target) == whole
    return whole, time.perf_counter() - begin


def clear(path: Path) -> None:
    """Remove a folder: stores are not overwritten, and frames of films appear one by one."""
    if path.is_dir():
        shutil.rmtree(path)


def signalled(
    folder: Path, target: str, seconds: float, number: int, is_late: bool, **how: Any
) -> int:
    """Send a signal to a command after so many seconds, or as soon as it writes; its status."""
    command, begin, before = began(folder, target, **how), time.perf_counter(), hidden(folder)
    while command.poll() is None:
        if time.perf_counter() - begin > seconds or (is_late and hidden(folder) != before):
            time.sleep(seconds % 0.005)
            command.send_signal(number)
            break
        time.sleep(0.0005)
    command.communicate()
    return command.returncode


def is_part(left: Tree, whole: Tree) -> bool:
    """Whether it is a folder of finished frames, which appear one by one; leftovers are hidden."""
    shown = {name: data for name, data in left.items() if not Path(name).name.startswith(".frame")}
    return "animation.json" in whole and shown.items() <= whole.items()


@pytest.mark.parametrize("target", COMMANDS)
def test_a_killed_command_leaves_its_target_as_it_was_or_whole(tmp_path, target, known):
    whole, seconds = known
    path, rng, killed = tmp_path / target, np.random.default_rng(7), 0
    while killed < KILLS:
        clear(path)
        if rng.random() < 0.5:
            path.unlink(missing_ok=True)
        before = content(path)
        at, is_late = rng.uniform(0.05, 1.0) * seconds, bool(killed % 2)
        killed += signalled(tmp_path, target, at, signal.SIGKILL, is_late) == -signal.SIGKILL
        left = content(path)
        assert left in (before, whole) or is_part(left, whole)
    clear(path)
    assert run(tmp_path, target).returncode == 0
    assert content(path) == whole
    assert hidden(tmp_path) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("target", COMMANDS)
def test_a_stopped_command_says_so_and_leaves_nothing_behind(tmp_path, target, known, number):
    whole, seconds = known
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        clear(tmp_path / target)
        before = content(tmp_path / target)
        status = signalled(tmp_path, target, share * seconds, number, is_late=share > 0.6)
        assert status in (0, *ENDED[number])
        left = content(tmp_path / target)
        assert left in (before, whole) or is_part(left, whole)
        assert [name for name in hidden(tmp_path) if not name.endswith(".frames")] == []


@pytest.mark.parametrize("number", ENDED)
def test_a_command_is_stopped_while_it_compiles(tmp_path, number):
    """What it has compiled until then is kept, and whole."""
    write_inputs(tmp_path)
    kernels = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "RESAMPLE_KERNELS": "off"}
    environment, statuses = {**os.environ, **kernels}, []
    for seconds in (2.0, 3.0, 5.0, 8.0):
        at = seconds, number
        statuses.append(signalled(tmp_path, "cloud.png", *at, is_late=False, env=environment))
        assert content(tmp_path / "cloud.png") == {} or statuses[-1] == 0
    assert set(statuses) <= {0, *ENDED[number]}
    assert run(tmp_path, "cloud.png", env=environment).returncode == 0
    whole = content(tmp_path / "cloud.png")
    assert run(tmp_path, "cloud.png").returncode == 0
    assert content(tmp_path / "cloud.png") == whole
