"""An animation is killed again and again, and resumed each time."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TIMES = 20
FILM = """
from pathlib import Path

from resample.files.animations import write_film
from resample_volume.command.animation import Flight, Paint, cameras_of, shots
from resample_volume.files.generated import vessel_tree
from resample_volume.rendering import Appearance, Subject

subject = Subject.of(vessel_tree(24), Appearance())
cameras = cameras_of(subject, Flight(frames=12), (32, 32))
frames = shots(subject, cameras, Paint(size=(32, 32)))
print("ready", flush=True)
for name in ("frames", "film.webp"):
    write_film(Path(name), frames, 24, resume=True)
"""


def content(folder: Path) -> dict[str, bytes | None]:
    """Bytes of all files, also hidden ones, and names of folders."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def shown(folder: Path) -> dict[str, bytes | None]:
    """The same without what is hidden."""
    return {
        name: data
        for name, data in content(folder).items()
        if not any(part.startswith(".") for part in Path(name).parts)
    }


def filming(folder: Path) -> "subprocess.Popen[str]":
    """A process that makes the films and is ready to begin."""
    folder.mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-c", FILM], cwd=folder, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def killed(process: "subprocess.Popen[str]", after: float) -> bool:
    """Whether a process still ran after so many seconds; it is then killed."""
    with process:
        try:
            assert process.wait(timeout=after) == 0
        except subprocess.TimeoutExpired:
            process.kill()
            return True
    return False


@pytest.mark.slow
def test_films_killed_at_random_moments_are_resumed_to_the_same_bits(tmp_path, rng):
    assert not killed(filming(tmp_path / "whole"), after=300)  # compiles, once
    whole, folder = content(tmp_path / "whole"), tmp_path / "killed"
    deaths = 0
    while deaths < TIMES:
        if killed(filming(folder), after=rng.uniform(0.0, 0.6)):
            deaths += 1
            assert shown(folder).items() <= whole.items()
        else:
            assert content(folder) == whole
            shutil.rmtree(folder)
    assert not killed(filming(folder), after=300)
    assert content(folder) == whole
