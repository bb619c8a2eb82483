"""Files that killed processes left beside their targets."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from resample.files import writing
from resample.files.writing import beside, inheriting, replacing

KILLED = """
import os, signal, sys
from pathlib import Path

from resample.files.writing import replacing

with replacing(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(autouse=True)
def untidied(monkeypatch, tmp_path):
    """A process that has written nothing yet, in an empty folder."""
    monkeypatch.setattr(writing, "_tidied", set())
    monkeypatch.chdir(tmp_path)


def kill_while_writing(target: str) -> None:
    """Leave a part of a target."""
    subprocess.run([sys.executable, "-c", KILLED, target], check=False)


def names() -> list[str]:
    """Of all files here."""
    return sorted(path.name for path in Path().iterdir())


@pytest.mark.sweep
@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell whether a process lives")
def test_what_a_killed_process_was_writing_is_removed_by_the_next_one():
    for target in ("a.png", "b[1].nii.gz", "c"):
        kill_while_writing(target)
        (left,) = names()
        assert left.startswith(f".{target[0]}")
    with replacing("a.png") as temporary:
        temporary.write_text("whole")
    assert names() == ["a.png"]


def test_what_living_processes_and_other_machines_write_stays(monkeypatch):
    others = [
        f".a.tmp-{writing._machine()}-{os.getppid()}-01234567.png",
        ".a.tmp-ffffff-99999999-01234567.png",
        ".a.tmp-mine.png",
        f"a.tmp-{writing._machine()}-99999999-01234567.png",
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


def test_a_dead_process_of_the_same_number_is_not_taken_for_this_one():
    left = Path(f".a.tmp-{writing._machine()}-{os.getpid()}-01234567.png")
    left.write_text("half")
    with replacing("a.png"):
        assert not left.exists()


def test_what_a_dead_process_made_of_a_part_is_removed():
    left = Path(f".a.tmp-{writing._machine()}-99999999-01234567.png.exif")
    left.write_text("half")
    with replacing("b.png"):
        assert not left.exists()


def test_a_half_written_folder_is_removed():
    left = Path(f".a.tmp-{writing._machine()}-99999999-01234567.zarr")
    (left / "chunk").mkdir(parents=True)
    with beside(Path("a.zarr").resolve()) as temporary:
        (temporary / "chunk").mkdir(parents=True)
        assert names() == [temporary.name]
    assert names() == []


def test_names_as_long_as_file_systems_take_can_be_written():
    name = 251 * "a" + ".png"
    with replacing(name) as temporary:
        temporary.write_text("whole")
    assert names() == [name]


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell whether a process lives")
def test_folders_of_dead_processes_are_inherited_by_who_writes_the_same():
    own = f".tmp-{writing._machine()}"
    dead = [f".a{own}-99999999-01234567.png", f".a{own}-99999998-89abcdef.png"]
    others = [
        f".a{own}-99999999-01234567.exr",
        f".b{own}-99999999-01234567.png",
        f".a{own}-{os.getppid()}-01234567.png",
        ".a.tmp-ffffff-99999999-01234567.png",
    ]
    for name in (*dead, *others):
        Path(name).mkdir()
        Path(name, "part").write_text(name)
    Path(f".a{own}-99999997-01234567.png").write_text("a file")
    target = Path("a.png").resolve()
    with inheriting(target) as found:
        assert sorted(Path(path, "part").read_text() for path in found) == sorted(dead)
        with inheriting(target) as none:
            assert none == []
        with beside(target) as new:
            assert all(path.is_dir() for path in found)
            found[0].rename(new)
            assert Path(new, "part").read_text() in dead
    assert names() == sorted(others[2:])
