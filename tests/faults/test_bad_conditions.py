"""Commands with a full disk, without streams, and with little memory: whole, or one line."""

import contextlib
import os
import shutil
from functools import partial
from pathlib import Path

import pytest

from tests.faults.commands import COMMANDS, content, hidden, run, whole_of, write_inputs

resource = pytest.importorskip("resource", reason="limits of Unix")
pytestmark = [pytest.mark.sweep, pytest.mark.slow]
LITTLE = 2_000_000_000  # bytes of address space
UNLIMITED = resource.RLIM_INFINITY
CLOSED = [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)]  # descriptors


@pytest.fixture
def folder(tmp_path):
    write_inputs(tmp_path)
    return tmp_path


@pytest.fixture
def whole(tmp_path_factory, target):
    return whole_of(lambda: tmp_path_factory.mktemp("whole"), target)


def failed_well(folder: Path, target: str, ended, before=None) -> bool:
    """Whether a command failed, which it may do in one line, without a trace."""
    lines = ended.stderr.splitlines()
    assert ended.returncode in (0, 2), (ended.returncode, lines)
    assert "Traceback" not in ended.stderr
    if ended.returncode:
        assert content(folder / target) == (before or {})
        assert sum("error:" in line for line in lines) == 1, lines
    assert [name for name in hidden(folder) if not name.endswith(".frames")] == []
    return bool(ended.returncode)


@pytest.mark.parametrize("target", COMMANDS)
def test_a_full_disk_is_an_error_of_one_line(folder, target, whole):
    sizes = sorted(len(each) for each in whole.values() if each)
    for most in (0, sizes[-1] // 2, sizes[-1] - 1):
        ended = run(
            folder,
            target,
            preexec_fn=partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, UNLIMITED)),
        )
        assert failed_well(folder, target, ended)
        shutil.rmtree(folder / f".{target}.frames", ignore_errors=True)  # finished frames stay
    assert run(folder, target).returncode == 0
    assert content(folder / target) == whole


@pytest.mark.parametrize("closed", CLOSED, ids=str)
@pytest.mark.parametrize(
    "target", ["volume.png", "volume.gif", "turned.jpg", "eye.png", "cloud.png"]
)
def test_a_command_without_streams_writes_the_same(folder, target, whole, closed):
    def close() -> None:
        for descriptor in closed:
            with contextlib.suppress(OSError):
                os.close(descriptor)

    ended = run(folder, target, preexec_fn=close)
    assert ended.returncode == 0, ended.stderr
    assert content(folder / target) == whole


@pytest.mark.parametrize("target", COMMANDS)
def test_a_command_with_two_gigabytes_of_address_space_works_or_says_so(folder, target, whole):
    little = partial(resource.setrlimit, resource.RLIMIT_AS, (LITTLE, LITTLE))
    ended = run(folder, target, preexec_fn=little)
    if not failed_well(folder, target, ended):
        assert content(folder / target) == whole
