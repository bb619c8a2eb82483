import io
import json
import math

import pytest

from resample.command.console import progress_bar, say
from resample.command.session import Session, announce_compilation, require_picture
from resample.files.writing import check_targets, rows_as_json
from resample.memory import require_memory


def test_targets_are_tried_and_left_alone(tmp_path):
    (tmp_path / "there").write_text("keep me")
    check_targets(tmp_path / "there", None, tmp_path / "new")
    assert (tmp_path / "there").read_text() == "keep me"
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_targets_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(OSError, match="cannot be written"):
        check_targets(tmp_path / "a", tmp_path / "none/b")
    with pytest.raises(OSError, match="not a regular file"):
        check_targets(tmp_path)
    with pytest.raises(ValueError, match="cannot be written twice"):
        check_targets(tmp_path / "a", tmp_path / "b/../a")


def test_what_cannot_fit_is_refused_with_a_remedy(monkeypatch):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 1 << 30)
    require_memory(1 << 30, "all", "do less")
    with pytest.raises(ValueError, match=r"all needs 2\.0 GiB, .* has 1\.0 GiB of memory; do less"):
        require_memory(1 << 31, "all", "do less")


def test_a_picture_larger_than_the_memory_is_refused(monkeypatch):
    monkeypatch.setattr("resample.memory.physical_memory", lambda: 100 << 20)
    require_picture((1000, 1000), 100)
    with pytest.raises(ValueError, match=r"a picture of 3000 x 1000 pixels needs 0.3 GiB"):
        require_picture((1000, 3000), 100)
    monkeypatch.setattr("resample.memory.physical_memory", lambda: None)
    require_picture((10**6, 10**6), 100)


def test_times_of_stages_of_one_name_add_up(monkeypatch):
    clock = iter([1.0, 3.0, 10.0, 10.5])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    session = Session()
    for _ in range(2):
        with session.stage("paint"):
            pass
    assert session.times() == {"paint": 2.5}


@pytest.mark.parametrize("stored", [True, False])
def test_compilation_is_announced_where_the_kernel_is_not_on_disk(capsys, monkeypatch, stored):
    asked = []
    monkeypatch.setattr(
        "resample.engine.jit.is_stored", lambda given: asked.append(given) or stored
    )
    announce_compilation(print)
    assert asked == [print]
    said = capsys.readouterr()
    assert said.out == ""
    assert ("compiling kernels, once per installation" in said.err) != stored


def test_rows_without_bound_are_valid_json():
    assert json.loads(rows_as_json([{"psnr": math.inf}])) == [{"psnr": None}]


def test_what_is_said_goes_to_stderr(capsys):
    say("hello")
    assert capsys.readouterr() == ("", "resample: hello\n")


def test_a_terminal_gets_a_bar(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    with progress_bar("working") as progress:
        progress(0.5)
    assert "working" in terminal.getvalue()


def test_a_file_gets_no_bar(monkeypatch):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with progress_bar("working") as progress:
        assert progress is None
