"""What is printed and said where nobody takes it: closed streams, full disks, readers that left."""

import io
import os
import subprocess
import sys

import cyclopts
import pytest

from resample import console
from resample.console import progress_bar, say
from tests.commands import ended
from tests.processes import PATIENCE

COMMAND = """
import os, sys
from pathlib import Path
from resample.command.stopping import start

status = 0
for words in (["plugins", "filters"], ["nonsense"]):
    sys.argv = ["resample", *words]
    try:
        start("resample.cli")
    except SystemExit as end:
        status = 10 * status + end.code
with open(sys.orig_argv[-1], "w") as file:
    sys.stdout.write("printed")
    sys.stderr.write("said")
    sys.stdout.flush()
    file.write(f"status {status} free {file.fileno() > 2} read {sys.stdin.read()!r} ")
    file.flush()
    os.system("echo of a child; echo of a child >&2")
"""


class Full(io.StringIO):
    """A stream on a full disk."""

    def write(self, _):
        raise OSError(28, "No space left on device")


@pytest.mark.skipif(os.name == "nt", reason="a shell of Unix")
def test_a_command_whose_streams_are_closed_works_and_prints_into_no_file(tmp_path):
    target = tmp_path / "file"
    shell = 'exec "$0" -c "$1" "$2" <&- >&- 2>&-'
    words = ["sh", "-c", shell, sys.executable, COMMAND, target]
    assert subprocess.run(words, check=False, timeout=PATIENCE).returncode == 0
    assert target.read_text() == "status 2 free True read '' "


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
def test_what_is_said_to_a_full_disk_is_lost_and_the_command_goes_on(monkeypatch):
    app = cyclopts.App()

    @app.command
    def work() -> int:
        say("half is done")
        return 0

    with open("/dev/full", "w", buffering=1) as full:
        monkeypatch.setattr(sys, "stderr", full)
        assert ended(app, "work") == 0
        say("nobody minds any more")
    with open("/dev/full", "w", buffering=1) as full:
        monkeypatch.setattr(sys, "stderr", full)
        assert ended(app, "nonsense") == 2


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
def test_what_a_full_disk_does_not_print_is_an_error_of_one_line(monkeypatch, capsys):
    app = cyclopts.App()
    app.command(lambda: sys.stdout.write("result") and None, name="work")
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert ended(app, "work") == 2
    line = "resample: error: standard output: cannot be written: No space left on device\n"
    assert capsys.readouterr().err == line


@pytest.mark.parametrize("stream", [None, Full()])
def test_without_a_stream_nothing_is_said_and_no_bar_is_shown(stream, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream)
    say("hello")
    with progress_bar("working") as progress:
        assert progress is None


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_a_program_without_streams_may_run_a_command(name, monkeypatch):
    app = cyclopts.App()
    app.command(lambda: sys.stdout.write("result") and None, name="work")
    monkeypatch.setattr(sys, name, None)
    assert ended(app, "work") == 0
    getattr(sys, name).close()


def test_letters_that_a_stream_does_not_have_are_written_as_codes(monkeypatch):
    held = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(held, "ascii", write_through=True))
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    console.open_streams()
    sys.stdout.write("30° caf\udce9")
    assert held.getvalue() == b"30\\xb0 caf\\udce9"
