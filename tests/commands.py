"""Command lines as users run them: what they answer, refuse, import and leave when interrupted."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from resample.command.session import run
from tests.processes import PATIENCE, python

HEAVY = {"numba", "cv2", "OpenImageIO", "matplotlib", "scipy", "SimpleITK", "trimesh", "jinja2"}
HEAVY |= {"PIL", "vtkmodules"}

INTERRUPTIBLE = """
import contextlib, signal, time

signal.signal(signal.SIGINT, signal.default_int_handler)  # shells have background jobs ignore it

def work(*_):
    print("working", flush=True)
    time.sleep(600)
"""


def ended(app, *words: object) -> object:
    """The status that a command ends with."""
    with pytest.raises(SystemExit) as caught:
        run(app, [str(word) for word in words])
    return caught.value.code


def refused(app, capsys, *words: object) -> str:
    """The one line that a command says when it fails, having written nothing."""
    assert not Path("pyproject.toml").exists(), "others write here: take a folder of its own"
    before = sorted(Path().rglob("*"))
    assert ended(app, *words) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("resample: error: ")
    assert error.count("\n") == 1
    assert sorted(Path().rglob("*")) == before
    return error


def strict_json(text: str) -> object:
    """What a text of JSON holds, of which Python reads more than there is."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def imported(module: str, *words: str) -> set[str]:
    """Modules that a process has imported when the command line of `module` has answered."""
    return imported_by_all(module, [list(words)])


def imported_by_all(module: str, lines: list[list[str]]) -> set[str]:
    """Modules that a process has imported when it has answered several command lines."""
    listed = python(
        f"import functools, sys, docstring_parser, {module}, resample.command.session\n"
        # commands share classes of options, whose sources are parsed once here
        "docstring_parser.parse_from_object = functools.cache(docstring_parser.parse_from_object)\n"
        f"for words in {lines}:\n"
        f"    try: resample.command.session.run({module}.app, words)\n"
        "    except SystemExit: pass\n"
        "print('imported', *sys.modules)"
    )
    return set(listed.rpartition("imported")[2].split())


def interrupted(slow: str, application: str, *words: str) -> tuple[int, list[str]]:
    """Status and lines of a command that gets Ctrl-C in mid-work.

    `slow` is Python that puts `work` where the command is to stay.
    """
    main = f"from resample_{application}.cli import main\nmain()\n"
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE + slow + main, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "working\n"
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=PATIENCE)
    lines = [line for line in error.splitlines() if "compiling kernels" not in line]
    return process.returncode, lines


def store(path: str, data, names: tuple[str, ...] = ()) -> None:
    """Write a float picture (H, W, C) with channels of these names."""
    import numpy as np
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(data.shape[1], data.shape[0], data.shape[2], OpenImageIO.FLOAT)
    if names:
        spec.channelnames = names
        spec.alpha_channel = names.index("A") if "A" in names else -1
    target = OpenImageIO.ImageOutput.create(path)
    assert target.open(path, spec)
    assert target.write_image(np.ascontiguousarray(data, np.float32))
    assert target.close()
