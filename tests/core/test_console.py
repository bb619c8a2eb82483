import io
import json
import logging
import math

import cyclopts
import pytest

from resample.command.session import Session, libraries, require_picture, run
from resample.console import listening, progress_bar, say
from resample.files.writing import check_targets
from resample.memory import require_memory
from resample_comparisons.options import rows_as_json


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
    monkeypatch.setattr("resample.memory.physical_memory", lambda: libraries() + (100 << 20))
    require_picture((1000, 1000), 100)
    needed = f"{(libraries() + 300_000_000) / (1 << 30):.2f}"
    with pytest.raises(
        ValueError, match=rf"picture of 3000 x 1000 pixels needs about {needed} GiB"
    ):
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


def logged(capsys, monkeypatch, loudness):
    """What a command says of two things that the library logs."""
    monkeypatch.setenv("RESAMPLE_LOG", loudness)
    log = logging.getLogger("resample")
    with listening():
        log.info("much is done")
        log.debug("this is %s", "how")
    log.warning("nobody listens any more")
    said = capsys.readouterr()
    assert said.out == ""
    return said.err


def test_commands_say_what_the_library_logs(capsys, monkeypatch):
    much, how = "resample: much is done\n", "resample: this is how\n"
    assert logged(capsys, monkeypatch, "info") == much
    assert logged(capsys, monkeypatch, "debug") == much + how
    assert logged(capsys, monkeypatch, "warning") == ""


def test_an_unknown_loudness_is_an_error_of_one_line(capsys, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LOG", "all")
    with pytest.raises(SystemExit) as end:
        run(cyclopts.App(), [])
    assert end.value.code == 2
    line = "resample: error: RESAMPLE_LOG is 'all'; it can be debug, info, warning\n"
    assert capsys.readouterr().err == line


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


def test_a_bar_counts_parts_where_they_are_known(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stderr", terminal)
    with progress_bar("scanning bricks", 64) as progress:
        progress(0.25)
    assert "16/64" in terminal.getvalue()


def test_a_file_gets_no_bar(monkeypatch):
    monkeypatch.setattr("sys.stderr", io.StringIO())
    with progress_bar("working") as progress:
        assert progress is None


def test_what_memory_is_needed_is_logged(caplog):
    with caplog.at_level("DEBUG", logger="resample"):
        require_memory(1 << 30, "all", "do less")
    assert caplog.messages == ["all: 1 GiB of memory"]
