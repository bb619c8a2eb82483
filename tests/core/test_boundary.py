"""What steers a command from outside: no value of an option there makes anything be touched.

Python tells of all that it opens, connects to, starts and runs (PEP 578). Libraries in C do not:
of the files that must not be read, the times of access are looked at.
"""

import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from resample import registry
from resample.cameras.calibrations import read_calibration
from resample.cameras.files import viewpoint
from resample.command import flags
from resample.command.applications import check_added
from resample.command.flags import (
    ANGLES,
    LENS,
    Inline,
    OptionTopic,
    about,
    marks_of,
    with_intrinsics,
)
from resample.command.settings import OWN, as_toml, options_of, read_settings
from resample.files.metadata.tags import KEY
from resample.view.views import check_page_options
from resample_texture.command.choices import MATRIX
from resample_texture.geometry.matrices import parse_matrix
from resample_volume.classification.presets import BETWEEN, load_transfer
from resample_volume.command.choices import TRANSFER
from tests.commands import ended
from tests.core.test_settings_of_strangers import all_commands

SEEN = ("open", "socket.", "subprocess.", "os.", "shutil.", "exec", "compile", "ctypes.dlopen")
LINES = ("\n", "\r", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029")
CALLS = ("socket.connect", "socket.getaddrinfo", "subprocess.", "os.system", "os.exec")
_heard: list[tuple[str, tuple[object, ...]]] | None = None


def _listen(event: str, details: tuple[object, ...]) -> None:
    if _heard is not None and event.startswith(SEEN):
        _heard.append((event, details))


sys.addaudithook(_listen)  # for good: hooks cannot be removed


@contextmanager
def untouched(home: Path) -> Iterator[None]:
    """Check that nothing of a folder is touched meanwhile, nobody called and nothing run."""
    global _heard
    files = [path for path in home.rglob("*") if path.is_file()]
    for path in files:
        os.utime(path, (0, path.stat().st_mtime))
    before, _heard = sorted(home.rglob("*")), []
    try:
        yield
    finally:
        heard, _heard = _heard, None
    named = (str(home), home.name)
    for event, details in heard:
        assert not event.startswith(CALLS), (event, details)
        said = [str(each) for each in details[: 1 if event in ("exec", "compile") else 2]]
        assert not any(name in each for name in named for each in said), (event, said)
    assert sorted(home.rglob("*")) == before
    assert [path.name for path in files if path.stat().st_atime != 0] == []


@pytest.fixture
def home(tmp_path, monkeypatch) -> Path:
    """A folder with files that any of the readers would take."""
    place = tmp_path / "precious-things"
    place.mkdir()
    (place / "t.json").write_text('{"points": [[0, "red", 0], [9, "white", 1]]}')
    (place / "t.toml").write_text("azimuth = 40\n")
    (place / "t.yml").write_text("camera_matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n")
    (place / "m.txt").write_text("1 0 0\n0 1 0\n0 0 1\n")
    np.save(place / "m.npy", np.eye(4))
    Image.new("RGB", (8, 8)).save(place / "p.png")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return place


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Address of a server that hangs up."""
    server = socket.create_server(("127.0.0.1", 0))

    def answer() -> None:
        with suppress(OSError):
            while True:
                server.accept()[0].close()

    threading.Thread(target=answer, daemon=True).start()
    yield f"127.0.0.1:{server.getsockname()[1]}"
    server.close()


def baits(home: Path, address: str) -> list[str]:
    """Values that name files, addresses or code, plainly or in disguise."""
    files = [f"{home}/{name}" for name in ("t.json", "t.toml", "t.yml", "m.txt", "m.npy", "p.png")]
    one, away = files[0], f"../{home.name}/t.json"
    disguised = [f"{end}{one}" for end in LINES] + [f"{one}{end}" for end in LINES]
    return [
        *files,
        *disguised,
        *(f"bone+{end}{away}" for end in LINES),
        *(away, f"./{away}", one.upper(), f"{one} ", f" {one}", f"\t{one}", f"{one}\0", f"\0{one}"),
        *(f"file:{one}", f"file://{one}", f"@{one}", f"{one}:0", f"{one}:opacity=0.2", f"={one}"),
        *(f"tcp://{address}", f"http://{address}/t.json", f"s3://{address}/t.toml"),
        *(
            f"red,{one}",
            f"red,none,\n{one}",
            f"gaussian:sigma={one}",
            f"rays:step={one}",
            f"k={one}",
        ),
        *(f"1,0,0\n{one}", f"1,0,0,{home}/m.npy", f"front\n{home}/t.toml", "front\n", "orbit\n"),
        *("", "null", "~", "-", "nan", "\0", 50_000 * "a" + ".json", 50_000 * "1" + "/a.toml"),
        *(f"$(touch {home}/x)", f"`touch {home}/x`", f"|touch {home}/x", "{0.__class__}", "%n"),
        f"__import__('os').system('touch {home}/x')",
        f"sample:bricks:size={one}",
    ]


def look_of(mark: object, values: list[str]) -> list[str]:
    """Values that a boundary lets through."""
    return [value for value in values if about(mark, value) is OptionTopic.APPEARANCE]


READERS = {
    "angles": (ANGLES, viewpoint),
    "angles of commands": (ANGLES, lambda text: flags.viewpoint(text, 30.0, "z")),
    "lens": (LENS, read_calibration),
    "intrinsics": (LENS, lambda text: with_intrinsics("intrinsics", text, "corner")),
    "matrix": (MATRIX, parse_matrix),
    "transfer": (TRANSFER, load_transfer),
    "channels": (
        TRANSFER,
        lambda text: [load_transfer(each.strip()) for each in BETWEEN.split(text)],
    ),
}


@pytest.mark.parametrize("name", READERS)
def test_readers_open_nothing_for_values_that_a_boundary_lets_through(name, home, address):
    mark, reader = READERS[name]
    values = baits(home, address)
    with untouched(home):
        for value in look_of(mark, values):
            with suppress(ValueError, LookupError):
                reader(value)


def test_the_check_of_what_is_touched_sees_what_is_touched(home):
    for touch in (
        lambda: viewpoint(f"{home}/m.txt"),
        (home / "t.json").read_text,
        lambda: socket.create_connection(("127.0.0.1", 9), 1),
        (home / "x").mkdir,
        lambda: exec(f"'{home}'"),
    ):
        with pytest.raises(AssertionError), untouched(home), suppress(OSError, ValueError):
            touch()


def test_gates_leave_out_what_is_not_the_look_and_touch_nothing(home, address):
    """All options of all commands: what pages, widgets and caches of samples say."""
    values = baits(home, address)
    tried = set()
    with untouched(home):
        for name, command in all_commands():
            marks = marks_of(command.default_command)
            for option, mark in marks.items():
                if (option, mark) in tried or option in OWN:
                    continue
                tried.add((option, mark))
                for value in values:
                    may = about(mark, value) is OptionTopic.APPEARANCE
                    assert passes(partial(check_page_options, name, {option: value}, {})) == may
    assert len(tried) > 150


def passes(check) -> bool:
    try:
        check()
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("application", registry.names("apps"))
def test_caches_of_samples_say_the_look_and_touch_nothing(application, home, address):
    app = registry.load("apps", application)
    marks = marks_of(app["render" if "render" in app else "warp"].default_command)
    line = ["render" if "render" in app else "warp"]
    values = baits(home, address)[::5]
    with untouched(home):
        for option, mark in marks.items():
            for value in values:
                is_sample = value.startswith("sample:") and about(mark, value) is OptionTopic.SOURCE
                may = about(mark, value) is OptionTopic.APPEARANCE or is_sample
                assert passes(partial(check_added, app, line, f"--{option}", value)) == may


def carried(kind: str, text: str) -> Path:
    """A file that holds settings."""
    path = Path(f"foreign.{kind}")
    if kind == "toml":
        path.write_text(text)
    elif kind == "png":
        texts = PngImagePlugin.PngInfo()
        texts.add_text(KEY, text)
        Image.new("RGB", (2, 2)).save(path, pnginfo=texts)
    else:
        import OpenImageIO

        spec = OpenImageIO.ImageSpec(2, 2, 3, OpenImageIO.FLOAT)
        spec.attribute(KEY, text)
        target = OpenImageIO.ImageOutput.create(str(path))
        assert target.open(str(path), spec)
        assert target.write_image(np.zeros((2, 2, 3), np.float32))
        assert target.close()
    return path


INLINE = [
    (name, command, key)
    for name, command in all_commands()
    for key, mark in marks_of(command.default_command).items()
    if isinstance(mark, Inline)
]


@pytest.mark.some(3)
@pytest.mark.parametrize("kind", ["toml", "png", "exr"])
@pytest.mark.parametrize(
    ("name", "command", "key"), INLINE, ids=lambda part: part if isinstance(part, str) else ""
)
def test_files_with_settings_say_looks_and_touch_nothing(name, command, key, kind, home, address):
    marks = marks_of(command.default_command)
    options = {key: option for key, option in options_of(command).items() if key not in OWN}
    for value in baits(home, address):
        if kind == "exr" and "\0" in value:
            continue
        path = carried(kind, as_toml(name, {key: value}))
        said: dict[str, object] = {}
        with untouched(home), suppress(ValueError):  # a text that is not UTF-8
            said = read_settings(path, name, options, marks)
        assert key not in said or about(marks[key], value) is OptionTopic.APPEARANCE


RUN = {
    "texture": ["warp", "sample:bricks:size=64", "--size", "16"],
    "volume": ["render", "sample:checker-box:size=16,block=4", "--size", "16"],
    "points": ["render", "sample:knot-points:count=2000", "--size", "16"],
    "warp3d": ["render", "sample:room:size=48", "--size", "16"],
}


@pytest.mark.sweep
@pytest.mark.parametrize("application", RUN)
def test_commands_touch_nothing_for_what_settings_say(application, home, address, capsys):
    """All options whose values are texts, with commands that read, paint and write."""
    app, line = registry.load("apps", application), RUN[application]
    command = app[line[0]]
    marks, name = marks_of(command.default_command), f"resample-{application} {line[0]}"
    ended(app, *line, "-o", "out.png")
    for key, option in options_of(command).items():
        if key in OWN or str not in kinds_of(option.field_info.annotation):
            continue
        for value in look_of(marks[key], baits(home, address))[::4]:
            Path("foreign.toml").write_text(as_toml(name, {key: value}))
            with untouched(home):
                status = ended(app, *line, "--settings", "foreign.toml", "-o", "out.png")
            assert status in (0, 2), (key, value)
            assert capsys.readouterr().err.count("\n") < 8


def kinds_of(annotation: object) -> set[object]:
    """Types in an annotation."""
    parts = getattr(annotation, "__args__", ())
    return {annotation, *parts}
