"""Compiled kernels in the user's cache: kept, checked, and removed when they are old."""

import os
import time
from pathlib import Path

import pytest

from resample.engine import jit
from resample.engine.compiled import compiling, entries
from resample.engine.compiled.entries import Entry
from tests.processes import python
from tests.small_kernels import nothing

ENTRY = Entry("a.kernel", "qd", ["a.kernel", "b.STEP"], 1.5, b"machine code\n" * 100)


def test_an_entry_is_read_as_it_was_written(tmp_path):
    entries.write(tmp_path / "of.kernel", ENTRY)
    assert entries.read(tmp_path / "of.kernel") == ENTRY
    assert [path.name for path in tmp_path.iterdir()] == ["of.kernel"]


def test_there_is_no_entry_without_a_file(tmp_path):
    assert entries.read(tmp_path / "of.kernel") is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda _: b"",
        lambda data: data[:10],
        lambda data: data[:-1],
        lambda data: data[: len(data) // 2] + b"\0" + data[len(data) // 2 + 1 :],
        *(lambda data, at=at: _flipped(data, at) for at in (0, 20, 85, 95, 200, 700)),
    ],
)
def test_a_damaged_entry_is_thrown_away(tmp_path, damage, caplog):
    path = tmp_path / "of.kernel"
    entries.write(path, ENTRY)
    path.write_bytes(damage(path.read_bytes()))
    assert entries.read(path) is None
    assert not path.exists()
    assert "is damaged and compiled anew" in caplog.text


def _flipped(data, at):
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :]


@pytest.mark.skipif(jit.IS_PLAIN, reason="plain Python has no machine code")
def test_a_kernel_whose_file_is_damaged_is_compiled_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(compiling, "folder", lambda: tmp_path)
    called = jit.kernel(nothing.__wrapped__)
    called(1)
    (file,) = tmp_path.glob("*.kernel")
    file.write_bytes(_flipped(file.read_bytes(), 5000))
    again = jit.kernel(nothing.__wrapped__)
    again(1)
    assert sum(jit.dispatcher(again).stats.cache_misses.values()) == 1
    third = jit.kernel(nothing.__wrapped__)
    third(1)
    assert sum(jit.dispatcher(third).stats.cache_hits.values()) == 1


HASHES = """
from resample.engine.jit import dispatcher, making_kernel

@making_kernel
def looked_up(number):
    known = {}
    known["a"], known["abc"] = number, 2.0
    return known["a"] + hash("abc" if number > 1.0 else "d" * int(number))

looked_up(1.5)
print(sum(dispatcher(looked_up).stats.cache_hits.values()), looked_up(1.5) == 1.5 + hash("abc"))
"""


@pytest.mark.skipif(jit.IS_PLAIN, reason="plain Python has no machine code")
def test_machine_code_that_needs_a_secret_of_python_runs_in_a_new_process(tmp_path, monkeypatch):
    # Modules of numba's tell LLVM of the secret, which kept code would be killed without.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    program = tmp_path / "hashes.py"
    program.write_text(HASHES)
    run = f"import runpy; runpy.run_path({str(program)!r})"
    assert [python(run), python(run)] == ["0 True\n", "1 True\n"]


def test_files_that_nobody_used_for_long_are_removed(tmp_path):
    for name, days in (("new.kernel", 1), ("old.kernel", 61), ("left.new", 2), ("now.new", 0)):
        (tmp_path / name).write_bytes(b"x")
        at = time.time() - days * entries.DAY
        os.utime(tmp_path / name, (at, at))
    entries.prune(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.kernel", "now.new"]


def test_beyond_a_size_those_go_that_were_not_used_for_longest(tmp_path):
    for n in range(5):
        (tmp_path / f"{n}.kernel").write_bytes(b"x" * 100)
        at = time.time() - n * 3600
        os.utime(tmp_path / f"{n}.kernel", (at, at))
    entries.prune(tmp_path, most=300)
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{n}.kernel" for n in range(3)]


def test_to_read_an_entry_is_to_use_it(tmp_path):
    path = tmp_path / "of.kernel"
    entries.write(path, ENTRY)
    os.utime(path, (1, 1))
    entries.read(path)
    assert time.time() - path.stat().st_mtime < entries.DAY


def test_a_disk_that_is_full_leaves_no_file_and_is_told_of(tmp_path, monkeypatch, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    entries.say_that_nothing_is_kept.cache_clear()
    monkeypatch.setattr(os, "replace", full)
    with caplog.at_level("INFO", "resample"):
        entries.write(tmp_path / "of.kernel", ENTRY)
        entries.write(tmp_path / "of.kernel", ENTRY)
    assert list(tmp_path.iterdir()) == []
    assert caplog.text.count("No space left on device") == 1


def test_kernels_are_in_the_users_cache_unless_numba_is_told_a_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path))
    assert compiling.folder() == tmp_path / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", "elsewhere")
    assert compiling.folder() == Path("elsewhere")
