"""Measurements: contenders in turns, ratios per round, memory in fresh processes."""

import datetime
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.scores.record import processor

ROOT = Path(__file__).parents[1]
PAUSE = 0.01  # s between turns, so that spinning threads of the last contender go to sleep
LEAST = 2  # rounds in which even the slowest contender takes part
PATIENCE = 10.0  # s; a contender whose total exceeds it drops out
MEBI = 1 << 20
PEERS = ("vtk", "opencv-contrib-python-headless", "OpenImageIO")

Run = Callable[[], object]


class Spread(NamedTuple):
    """Median and quartiles of measurements."""

    median: float
    low: float  # lower quartile
    high: float  # upper quartile
    size: int  # number of values

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Spread of one or more values."""
        low, median, high = np.percentile(values, [25, 50, 75])
        return cls(float(median), float(low), float(high), len(values))

    def times(self, factor: float) -> "Spread":
        """Convert to another unit."""
        return Spread(self.median * factor, self.low * factor, self.high * factor, self.size)


def take_turns(
    runs: Mapping[str, Run],
    rounds: int,
    *,
    ready: Collection[str] = (),
    patience: float = PATIENCE,
    clock: Callable[[], float] = time.perf_counter,
    pause: float = PAUSE,
) -> dict[str, list[float]]:
    """Seconds of each contender in each round, after an uncounted run of each.

    Every round begins with another contender, so that none always follows the same one. A
    contender whose total exceeds its patience drops out, but not before `LEAST` rounds; so item n
    is round n for all. Contenders that are `ready` need no warm-up: if their first run exceeds
    their patience, it is the one that counts.
    """
    names, times = list(runs), {name: list[float]() for name in runs}
    for name, run in runs.items():
        start = clock()
        run()
        if name in ready and clock() - start > patience:
            times[name].append(clock() - start)
    finished = {name for name in names if times[name]}
    for turn in range(rounds):
        first = turn % len(names)
        for name in names[first:] + names[:first]:
            if name in finished or (turn >= LEAST and sum(times[name]) > patience):
                continue
            time.sleep(pause)
            start = clock()
            runs[name]()
            times[name].append(clock() - start)
    return times


def ratio(times: Sequence[float], reference: Sequence[float]) -> Spread:
    """Ratio of times of a contender and the reference, over rounds in which both ran."""
    return Spread.of([a / b for a, b in zip(times, reference, strict=False)])


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Exponent p of the best fit value = factor × sizeᵖ, by least squares of logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def peak_memory() -> float:
    """Peak resident memory of this process, MiB.

    On Linux, `ru_maxrss` includes the parent's peak before it started this process (measured: 788
    MiB for an idle child of a parent with 780), so the kernel's count for this process is used if
    available.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEBI


def child(module: str, **choices: object) -> dict[str, Any]:
    """Result of a module's function `in_child` in a process of its own.

    Raises
    ------
    RuntimeError
        It failed; the message is its last line.
    """
    command = [sys.executable, "-m", "benchmarks.child", module, json.dumps(choices)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if ended.returncode:
        said = ended.stderr.strip().splitlines() or [f"exit status {ended.returncode}"]
        raise RuntimeError(f"{module}: {said[-1]}")
    answer: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return answer


def wall_seconds(command: Sequence[str], environment: Mapping[str, str] | None = None) -> float:
    """Wall time of a command in seconds.

    Raises
    ------
    RuntimeError
        It failed; the message is its last line.
    """
    start = time.perf_counter()
    ended = subprocess.run(
        command,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - start
    if ended.returncode:
        said = ended.stderr.strip().splitlines() or [f"exit status {ended.returncode}"]
        raise RuntimeError(f"{' '.join(command[:3])}: {said[-1]}")
    return seconds


def machine() -> dict[str, str]:
    """Description of the machine and the time of the measurement."""
    versions = {name: _version(name) for name in ("numpy", "numba", *PEERS)}
    load = ", ".join(f"{value:.2f}" for value in os.getloadavg())
    return {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _commit(),
        "processor": f"{processor()}, {_cores()} cores",
        "memory": f"{_memory():.1f} GiB",
        "system": platform.platform(),
        "Python": platform.python_version(),
        **{name: version for name, version in versions.items() if version},
        "load before the start (1, 5, 15 min)": load,
    }


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _memory() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / (1 << 30)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _commit() -> str:
    """Commit that is checked out, and whether there are changes."""
    answers = []
    for command in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "-uno"]):
        try:
            ended = subprocess.run(
                ["git", *command], cwd=ROOT, capture_output=True, text=True, check=True
            )
        except (OSError, subprocess.CalledProcessError):
            return "unknown"
        answers.append(ended.stdout.strip())
    return answers[0] + (" with changes" if answers[1] else "")
