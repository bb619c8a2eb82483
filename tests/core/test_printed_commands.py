"""Every command of the documents, and of -h, runs as it is printed, on small files."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from tests import printed
from tests.commands import ended
from tests.core.test_docs import app_of
from tests.core.test_helping import APPS
from tests.core.test_helping import commands as all_commands
from tools.pages import commands

# Pages whose commands other tests run: tests/volume/test_jobs.py, warp3d/test_stereo_photos.py.
ELSEWHERE = ("jobs.md", "headset.md")
# Figures of the paper, which need its volumes or minutes; a plugin that one page writes; and forms.
APART = re.compile(r" figures\b|python |hann:width| \.\.\. |FILE|^resample plugins| fetch\b")
PUBLIC = re.compile(r"\$\(resample-volume fetch (\w+)\)")  # is loaded from the web
EXAMPLES = re.compile(r"^ +(resample[\w-]* (?!demo).*)$", re.MULTILINE)  # of `-h`
HELPED = [
    (Path(program), line)
    for program, command in all_commands()
    for line in EXAMPLES.findall(APPS[program][command].default_command.__doc__.replace("\\\n", ""))
]
LINES = sorted(
    {
        " ".join(PUBLIC.sub(r"\1.nhdr", line).partition(" #")[0].split())
        for page, line in [*commands(), *HELPED]
        if page.name not in ELSEWHERE and not APART.search(line)
    }
)
LARGE = re.compile(r"(?<=--size )\d{3,}(x\d{3,})?")  # sizes, of which less does
FRAMES = re.compile(r" --frames \d+")  # of films, of which two do
FILMS = (".mp4", ".webp", ".gif")


def smaller(found: re.Match[str]) -> str:
    """A part of a size."""
    sides = list(map(int, found[0].split("x")))
    part = 1 << (max(sides) // 160).bit_length()
    return "x".join(str(side // part) for side in sides)


@pytest.mark.some(8)
@pytest.mark.parametrize("line", LINES)
def test_printed_commands_run(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed.write_inputs(line)
    shown: list[Any] = []
    monkeypatch.setattr("resample.view.server.serve", lambda view, **_: shown.append(view))
    program, *words = shlex.split(FRAMES.sub("", LARGE.sub(smaller, line)), comments=True)
    is_film = words[0] in ("animate", "density") and words[words.index("-o") + 1].endswith(FILMS)
    if is_film and "still" not in words and "drive.mp4" not in words:
        words += ["--frames", "2"]
    if "--settings" in words:  # a file that the command before it writes
        Path("look.toml").write_text('transfer = "bone"\n')
    assert ended(app_of(program), *words) == 0
    if "view" in words:
        assert shown
    for option in ("-o", "--output"):
        if option in words:
            made = Path(words[words.index(option) + 1])
            assert any(made.iterdir()) if made.is_dir() else made.stat().st_size > 0
