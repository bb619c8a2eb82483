import os
import subprocess
import sys

import pytest
from cyclopts import App
from pydantic import BaseModel, Field

from resample.command.session import run
from tests.commands import ended


class Camera(BaseModel):
    fov: float = Field(gt=0)


class Scene(BaseModel):
    camera: Camera
    name: str


@pytest.fixture
def app() -> App:
    app = App(name="resample")

    @app.command
    def work(times: int = 1) -> None:
        print("worked", times)  # noqa: T201

    @app.command
    def status() -> int:
        return 3

    return app


def failing(error: BaseException) -> App:
    app = App(name="resample")

    @app.default
    def fail() -> None:
        raise error

    return app


def test_success_ends_with_status_zero(app, capsys):
    assert ended(app, "work", "--times", "2") == 0
    assert capsys.readouterr() == ("worked 2\n", "")


def test_a_command_may_set_the_status(app):
    assert ended(app, "status") == 3


def test_help_is_a_success(app, capsys):
    assert ended(app, "--help") == 0
    assert "Usage: resample COMMAND" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("two\n  lines"), "two lines"),
        (ValueError(), "ValueError"),
        (LookupError("unknown filter 'x'"), "unknown filter 'x'"),
        (OSError(13, "Permission denied", "/a/b"), "/a/b: Permission denied"),
        (OSError("a.png is damaged"), "a.png is damaged"),
        (MemoryError(), "not enough memory"),
        (MemoryError("Unable to allocate 3 TiB"), "not enough memory Unable to allocate 3 TiB"),
    ],
    ids=repr,
)
def test_a_users_mistake_is_one_line_and_status_two(error, line, capsys):
    assert ended(failing(error)) == 2
    assert capsys.readouterr() == ("", f"resample: error: {line}\n")


def test_all_fields_that_pydantic_refuses_stand_in_one_line(capsys):
    app = App(name="resample")

    @app.default
    def load() -> None:
        Scene.model_validate({"camera": {"fov": -1}, "name": 3})

    assert ended(app) == 2
    assert capsys.readouterr().err == (
        "resample: error: camera.fov: Input should be greater than 0 (got -1); "
        "name: Input should be a valid string (got 3)\n"
    )


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["wrok"], 'Did you mean "work"?'),
        (["work", "--tims", "3"], "Did you mean --times?"),
        (["work", "--times", "x"], 'unable to convert "x" into int'),
    ],
)
def test_words_that_the_command_line_does_not_know_are_one_line(app, capsys, arguments, hint):
    assert ended(app, *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("resample: error: ")
    assert hint in captured.err
    assert captured.err.count("\n") == 1


def test_interruption_has_the_status_of_shells(capsys):
    assert ended(failing(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == "resample: interrupted\n"


@pytest.mark.parametrize("bug", [TypeError, AssertionError, KeyError, IndexError, AttributeError])
def test_a_bug_shows_its_traceback(bug):
    with pytest.raises(bug):
        run(failing(bug("inside")), [])


@pytest.mark.sweep
def test_a_reader_that_has_seen_enough_is_no_error():
    read_end, write_end = os.pipe()
    os.close(read_end)
    code = (
        "from resample.cli import app; from resample.command.session import run;"
        "run(app, ['plugins'])"
    )
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, stdout=write_end, stderr=subprocess.PIPE, check=False)
    os.close(write_end)
    assert (process.returncode, process.stderr) == (0, b"")


@pytest.mark.parametrize(
    "broken", ['raise ImportError("libGL.so.1: cannot open shared object file")', None]
)
def test_a_broken_or_missing_opencv_is_named_with_what_to_do(tmp_path, broken, capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    if broken is None:
        monkeypatch.setitem(sys.modules, "cv2", None)
    else:
        (tmp_path / "cv2").mkdir()
        (tmp_path / "cv2" / "__init__.py").write_text(broken)
        monkeypatch.syspath_prepend(tmp_path)
    app = App()

    @app.default
    def start() -> None:
        import cv2  # noqa: F401

    with pytest.raises(SystemExit) as caught:
        run(app, [])
    assert caught.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("resample: error: cv2 (OpenCV) cannot be imported: ")
    assert error.endswith("opencv-contrib-python-headless\n")
    assert error.count("\n") == 1


def test_modules_that_are_missing_otherwise_show_where():
    app = App()

    @app.default
    def start() -> None:
        raise ModuleNotFoundError("No module named 'other'", name="other")

    with pytest.raises(ModuleNotFoundError):
        run(app, [])
