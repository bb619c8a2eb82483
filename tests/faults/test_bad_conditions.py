"""Commands without disk, memory, rights or streams: the target is whole, or one line says why."""

import contextlib
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.faults.commands import COMMANDS, content, hidden, run, whole_of, write_inputs

resource = pytest.importorskip("resource", reason="limits of Unix")
pytestmark = [pytest.mark.sweep, pytest.mark.slow]
RIGHTS = "-dac_override,-dac_read_search"  # by which root may write everywhere
IS_ROOT = os.getuid() == 0
CLOSED = [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)]  # descriptors


class Condition(NamedTuple):
    """What a command meets."""

    begins: Callable[[], object] | None = None  # called in its process before it
    folder: str = ""  # of the target
    variables: Mapping[str, str] = {}
    within: tuple[str, ...] = ()  # program that runs it
    fails: bool | None = None  # None: as it may


def limited(kind: int, count: int) -> Callable[[], object]:
    return partial(resource.setrlimit, kind, (count, count))


CONDITIONS = {
    "2 GB of addresses": Condition(limited(resource.RLIMIT_AS, 2_000_000_000)),
    "700 MB of addresses": Condition(limited(resource.RLIMIT_AS, 700_000_000)),
    "400 MB of addresses": Condition(limited(resource.RLIMIT_AS, 400_000_000)),
    "300 MB of data": Condition(limited(resource.RLIMIT_DATA, 300_000_000)),
    "24 open files": Condition(limited(resource.RLIMIT_NOFILE, 24)),
    "no folder": Condition(folder="gone/", fails=True),
    "a folder without rights": Condition(
        folder="locked/", within=("setpriv", "--bounding-set", RIGHTS) * IS_ROOT, fails=True
    ),
    "no folder for kernels": Condition(variables={"NUMBA_CACHE_DIR": "/proc/none"}, fails=False),
    "no cache": Condition(variables={"HYBRID_RESAMPLE_CACHE": "/proc/none"}, fails=False),
    "no home": Condition(variables={"HOME": "/proc/none"}, fails=False),
}
WITHOUT_KERNELS = ("volume.png",)  # the one that compiles them anew in reasonable time


@pytest.fixture
def folder(tmp_path):
    write_inputs(tmp_path)
    (tmp_path / "locked").mkdir(mode=0o555)
    return tmp_path


@pytest.fixture
def whole(tmp_path_factory, target):
    return whole_of(lambda: tmp_path_factory.mktemp("whole"), target)


def fails_well(ended: "subprocess.CompletedProcess[str]", path: Path) -> bool:
    """Whether a command has failed, which it may in one line and without a trace."""
    assert ended.returncode in (0, 2), (ended.returncode, ended.stderr)
    assert "Traceback" not in ended.stderr
    if ended.returncode:
        assert content(path) == {}
        assert ended.stderr.count("error: ") == 1, ended.stderr
    if path.parent.is_dir():
        assert [name for name in hidden(path.parent) if not name.endswith(".frames")] == []
    return bool(ended.returncode)


@pytest.mark.parametrize("name", CONDITIONS)
@pytest.mark.parametrize("target", COMMANDS)
def test_a_command_works_or_says_what_is_wrong(folder, target, whole, name):
    condition = CONDITIONS[name]
    if condition.within and shutil.which(condition.within[0]) is None:
        pytest.skip("the superuser may write everywhere")
    if name == "no folder for kernels" and target not in WITHOUT_KERNELS:
        pytest.skip("all kernels would be compiled")
    ended = run(
        folder,
        condition.folder + target,
        command=target,
        within=condition.within,
        preexec_fn=condition.begins,
        env={**os.environ, **condition.variables},
    )
    fails = fails_well(ended, folder / condition.folder / target)
    assert condition.fails in (None, fails), ended.stderr
    assert fails or content(folder / condition.folder / target) == whole


@pytest.mark.parametrize("target", COMMANDS)
def test_a_full_disk_is_an_error_of_one_line(folder, target, whole):
    sizes = sorted(len(each) for each in whole.values() if each)
    for most in (0, sizes[-1] // 2, sizes[-1] - 1):
        full = limited(resource.RLIMIT_FSIZE, most)
        assert fails_well(run(folder, target, preexec_fn=full), folder / target)
        shutil.rmtree(folder / f".{target}.frames", ignore_errors=True)  # finished frames stay
    assert run(folder, target).returncode == 0
    assert content(folder / target) == whole


@pytest.mark.parametrize("closed", CLOSED, ids=str)
@pytest.mark.parametrize("target", ["volume.png", "volume.gif", "turned.jpg", "cloud.png"])
def test_a_command_without_streams_writes_the_same(folder, target, whole, closed):
    def close() -> None:
        for descriptor in closed:
            with contextlib.suppress(OSError):
                os.close(descriptor)

    ended = run(folder, target, preexec_fn=close)
    assert ended.returncode == 0, ended.stderr
    assert content(folder / target) == whole


@pytest.mark.parametrize("target", COMMANDS)
def test_a_clock_that_went_back_changes_nothing(folder, target, whole):
    for file in (each for each in folder.rglob("*") if each.is_file()):
        os.utime(file, (time.time() + 3e7,) * 2)
    assert run(folder, target).returncode == 0
    assert content(folder / target) == whole
