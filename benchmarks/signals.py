"""Commands interrupted or killed at random times: check their files, output and status.

    python -m benchmarks.signals --count 300 --seed 1

Every command first runs to its end; then it is repeated and gets SIGINT, SIGTERM or SIGKILL at a
random time, in one of four cases without compiled kernels. Its target must be complete, absent or
unchanged. There must be no traceback, the status must be that of the signal, and after the next
complete run no hidden file may remain. With `--beside` another command compiles into the same
folder at the same time, which must succeed.
"""

import argparse
import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
PATIENCE = 300  # seconds
EARLIEST = 0.2  # seconds in which Python itself starts
VOLUME, TEXTURE, WARP3D = "resample_volume", "resample_texture", "resample_warp3d"
POINTS = "resample_points"
CORNERS = "4,2 90,4 100,70 2,60"
COMMANDS = {
    "a.png": (VOLUME, "render", "checker-box:size=48", "--size", "96", "-o"),
    "b.png": (TEXTURE, "warp", "photo.png", "--corners", CORNERS, "-o"),
    "c.png": (WARP3D, "render", "photo.png", "depth.npy", "--fov", "60", "--move", "0.1,0,0", "-o"),
    "d.gif": (VOLUME, "animate", "checker-box:size=24", "--size", "48", "--frames", "6", "-o"),
    "e.html": (
        TEXTURE,
        "compare",
        "photo.png",
        "--scene",
        "floor",
        "--methods",
        "paper,hybrid",
        "-o",
    ),
    "f.png": (POINTS, "render", "points.csv", "--camera", "40/20/1.5", "--size", "80", "-o"),
    "g.ome.zarr": (VOLUME, "convert", "volume.npy"),
    "h.png": ("resample", "compare", "photo.png", "-R", "photo.png", "-o"),
}

COMPILING = ("a.png", "b.png", "c.png", "d.gif", "f.png")  # targets of commands with many kernels
LONGER = 8.0  # factor on the time of a run that compiles them


@dataclass(frozen=True)
class Case:
    """One interrupted run."""

    target: str
    number: signal.Signals
    share: float  # of the time of a complete run
    is_compiling: bool  # whether kernels have to be compiled
    is_there: bool  # whether the target exists
    beside: str = ""  # target of an uninterrupted command with the same kernels

    def faults(self, seconds: float) -> Iterator[str]:
        """Run it in this folder; yields what is wrong with the result."""
        target = Path(self.target)
        remove(target)
        if self.is_there and target.suffix != ".zarr":  # stores are not overwritten
            target.write_bytes(b"old")
        before, left = content(target), hidden()
        with tempfile.TemporaryDirectory() as folder:
            kernels = folder if self.is_compiling else None
            with going_on(self.beside, kernels) as faults:
                process = begun(self.target, kernels)
                time.sleep(max(EARLIEST, self.share * seconds))
                process.send_signal(self.number)
                said = process.communicate(timeout=PATIENCE)[1]
        yield from faults
        # Before Python has started, the signal itself ends it, which shells report alike.
        if process.returncode not in (0, STATUS[self.number], -self.number):
            yield f"status {process.returncode}: {said[-300:]}"
        if "Traceback" in said or "Exception" in said:
            yield f"said {said[-900:]}"
        if not is_whole(target) and (process.returncode == 0 or content(target) != before):
            yield "its target is damaged"
        left = hidden() - left - {f".{self.target}.frames"}  # interrupted films are resumed
        if self.number != signal.SIGKILL and left:
            yield f"left {left}"


@contextlib.contextmanager
def going_on(target: str, kernels: str | None) -> Iterator[list[str]]:
    """Run an uninterrupted command, if named; yields a list for its errors."""
    faults: list[str] = []
    if not target:
        yield faults
        return
    remove(Path(target))
    process = begun(target, kernels)
    yield faults
    said = process.communicate(timeout=PATIENCE)[1]
    if process.returncode or not is_whole(Path(target)):
        faults.append(f"{target}, beside it, ended with status {process.returncode}: {said[-300:]}")


def begun(target: str, kernels: str | None = None) -> subprocess.Popen[str]:
    """Start a command in this folder."""
    return subprocess.Popen(
        [sys.executable, "-m", *COMMANDS[target], target],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ) | ({} if kernels is None else {"NUMBA_CACHE_DIR": kernels}),
    )


def ended(target: str) -> float:
    """Seconds of a complete run, whose target is kept for comparison."""
    remove(Path(target))
    start = time.perf_counter()
    process = begun(target)
    said = process.communicate(timeout=PATIENCE)[1]
    left = hidden() - {f".{name}.frames" for name in COMMANDS if name != target}
    if process.returncode or left:
        raise RuntimeError(f"{target}: {said}, left {left}")
    seconds = time.perf_counter() - start
    kept = Path("whole") / target
    remove(kept)
    Path(target).rename(kept)
    return seconds


def is_whole(target: Path) -> bool:
    """Whether a target equals that of a complete run; times in reports are ignored."""
    if target.suffix == ".html":
        return target.is_file() and target.read_text("utf-8").rstrip().endswith("</html>")
    return content(target) == content(Path("whole") / target)


def content(path: Path) -> dict[str, bytes]:
    """Contents of a file or folder, by name."""
    files = [path] if path.is_file() else path.rglob("*")
    return {str(file.relative_to(path)): file.read_bytes() for file in files if file.is_file()}


def hidden() -> set[str]:
    """Names of hidden files."""
    return {path.name for path in Path().iterdir() if path.name.startswith(".")}


def remove(path: Path) -> None:
    """Remove a file or folder if it exists."""
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


def inputs() -> None:
    """Write the commands' inputs."""
    rng = np.random.default_rng(1)
    levels = rng.integers(0, 255, (80, 120, 3), np.uint8)
    Path("whole").mkdir()
    Image.fromarray(levels).save("photo.png")
    np.save("depth.npy", np.full((80, 120), 2.0, np.float32))
    np.save("volume.npy", rng.integers(0, 255, (70, 70, 70), np.uint8))
    np.savetxt("points.csv", rng.normal(size=(2000, 3)), delimiter=",", header="x,y,z", comments="")


def cases(count: int, seed: int, *, beside: bool) -> Iterator[Case]:
    """Random cases, cycling through all commands and signals."""
    rng = random.Random(seed)  # noqa: S311  no secrets
    for n in range(count):
        target = list(COMMANDS)[n % len(COMMANDS)]
        number = list(STATUS)[n // len(COMMANDS) % len(STATUS)]
        share, is_compiling, is_there = 1.1 * rng.random(), rng.random() < 0.25, rng.random() < 0.5
        if not beside:
            yield Case(target, number, share, is_compiling, is_there)
        elif target in COMPILING:
            other = rng.choice([name for name in COMPILING if name != target])
            # A run without kernels takes many times as long.
            yield Case(target, number, LONGER * share, True, is_there, other)


def main(arguments: Sequence[str]) -> int:
    """Interrupt commands; returns 1 if one misbehaves."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.signals", description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="of runs that are stopped")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one target, such as a.png")
    parser.add_argument("--beside", action="store_true", help="others compile the same meanwhile")
    choices = parser.parse_args(arguments)
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="signals-") as folder, contextlib.chdir(folder):
        inputs()
        seconds = {name: ended(name) for name in COMMANDS if choices.only in (None, name)}
        for case in cases(choices.count, choices.seed, beside=choices.beside):
            if case.target in seconds:
                faults = list(case.faults(seconds[case.target]))
                found[case.number.name] += 1
                found["faults"] += bool(faults)
                for fault in faults:
                    sys.stdout.write(f"{case}: {fault}\n")
                    sys.stdout.flush()
        for name in seconds:
            ended(name)  # removes leftovers of killed runs
    sys.stdout.write(", ".join(f"{count} {name}" for name, count in sorted(found.items())) + "\n")
    return int(found["faults"] > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
