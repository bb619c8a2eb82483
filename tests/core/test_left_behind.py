"""Files that killed processes left beside their targets."""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from resample.files import writing
from resample.files.writing import beside, replacing
from tests.processes import PATIENCE

KILLED = """
import os, signal, sys
from pathlib import Path

from resample.files.writing import replacing

with replacing(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


WAITING = """
import sys

from resample.files.writing import replacing

with replacing(sys.argv[1]) as temporary:
    print("writing", flush=True)
    sys.stdin.readline()
    temporary.write_text("whole")
"""
OWNER = f"{writing._machine()}-01234567"


@pytest.fixture(autouse=True)
def untidied(monkeypatch, tmp_path):
    """A process that has written nothing yet, in an empty folder."""
    monkeypatch.setattr(writing, "_tidied", set())
    monkeypatch.chdir(tmp_path)


def names() -> list[str]:
    """Of all files here."""
    return sorted(path.name for path in Path().iterdir())


@pytest.mark.sweep
@pytest.mark.skipif(os.name == "nt", reason="there are no locks on Windows")
def test_what_a_killed_process_was_writing_is_removed_by_the_next_one():
    for target in ("a.png", "b[1].nii.gz", "c", "d\n.lock-1.png"):
        subprocess.run([sys.executable, "-c", KILLED, target], check=False)
        assert [name.startswith(f".{target[0]}") for name in names()] == [True, True]
    with replacing("a.png") as temporary:
        temporary.write_text("whole")
    assert names() == ["a.png"]


def leave(target: str, owner: str | None = None, *, more: str = "", folder: bool = False) -> Path:
    """Leave what a dead process would, beside its lock: the name of the temporary file."""
    home, stem = Path(target), f"{owner or OWNER}"
    Path(f".{home.stem}.lock-{stem}").touch()
    left = Path(f".{home.stem}.tmp-{stem}{home.suffix}{more}")
    if folder:
        (left / "chunk").mkdir(parents=True)
    else:
        left.write_text("half")
    return left


@contextmanager
def in_another_process(*words: str) -> Iterator[None]:
    """Another process that is writing `a.png`, perhaps started by another program."""
    command = [*words, sys.executable, "-c", WAITING, "a.png"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        if process.stdout.readline() != b"writing\n":
            pytest.skip(f"{words[0]} is not permitted here")
        yield
        process.communicate(b"go on\n", timeout=PATIENCE)
        assert process.returncode == 0


@pytest.mark.skipif(os.name == "nt", reason="there are no locks on Windows, and nothing is removed")
@pytest.mark.parametrize("way", ["plainly", "in another container"])
def test_what_living_processes_write_stays(way):
    """Also those of a container, whose numbers of processes are others."""
    later = 'for n in $(seq 300); do /bin/true; done; "$@"; :'  # a number that is free out here
    container = ["unshare", "--pid", "--fork", "--mount-proc", "sh", "-c", later, "sh"]
    if way != "plainly" and shutil.which("unshare") is None:
        pytest.skip("there is no unshare")
    with in_another_process(*(container if way != "plainly" else [])):
        before = names()
        assert len(before) == 2
        with replacing("b.png"):
            pass
        assert names() == sorted([*before, "b.png"])
    assert names() == ["a.png", "b.png"]
    assert Path("a.png").read_text() == "whole"


def test_what_this_process_and_other_machines_write_stays(monkeypatch):
    others = [
        str(leave("a.png", "ffffff-01234567")),
        ".a.lock-ffffff-01234567",
        ".a.tmp-mine.png",
        f".b.tmp-{OWNER}.png",  # nobody tells that its process has ended
        f"a.lock-{OWNER}",
    ]
    for name in others:
        Path(name).write_text("another's")
    with replacing("a.png") as first:
        first.write_text("first")
        monkeypatch.setattr(writing, "_tidied", set())
        with replacing("b.png") as second:
            assert first.exists()
            second.write_text("second")
    assert names() == sorted([*others, "a.png", "b.png"])


@pytest.mark.skipif(os.name == "nt", reason="there are no locks on Windows, and nothing is removed")
def test_what_dead_processes_made_of_parts_and_folders_is_removed():
    left = [leave("a.png"), leave("a.png", more=".exif"), leave("b.ome.zarr", folder=True)]
    with beside(Path("c.zarr").resolve()) as temporary:
        assert not any(path.exists() for path in left)
        (temporary / "chunk").mkdir(parents=True)
    assert names() == []


@pytest.mark.skipif(os.name == "nt", reason="there are no locks on Windows, and nothing is removed")
def test_a_file_that_is_replaced_while_it_is_written_stays(monkeypatch):
    with replacing("a.png") as temporary:
        other = temporary.with_name(f"{temporary.name}.exif")
        other.write_text("whole")
        other.replace(temporary)
        monkeypatch.setattr(writing, "_tidied", set())
        with replacing("b.png"):
            pass
    assert Path("a.png").read_text() == "whole"


@pytest.mark.skipif(os.name == "nt", reason="there are no locks on Windows")
def test_nothing_is_removed_where_there_are_no_locks(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "no locks available")

    left = leave("a.png")
    monkeypatch.setattr(writing.fcntl, "flock", refuse)
    with replacing("a.png") as temporary:
        temporary.write_text("whole")
    assert left.exists()
    assert Path("a.png").read_text() == "whole"


def test_names_as_long_as_file_systems_take_can_be_written():
    name = 251 * "a" + ".png"
    with replacing(name) as temporary:
        temporary.write_text("whole")
    assert names() == [name]
