"""Measuring: contenders take turns, ratios are taken round by round, memory in fresh processes."""

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

ROOT = Path(__file__).parents[1]
PAUSE = 0.01  # s between turns: threads that the last contender left spinning go to sleep
LEAST = 2  # rounds that also the slowest contender takes part in
PATIENCE = 10.0  # s; whoever has taken longer than that in all drops out
MEBI = 1 << 20
PEERS = ("vtk", "opencv-contrib-python-headless", "OpenImageIO")

Run = Callable[[], object]


class Spread(NamedTuple):
    """Median and quartiles of what was measured."""

    median: float
    low: float  # a quarter of the values lie below
    high: float  # a quarter lie above
    size: int  # how many values

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Spread of at least one value."""
        low, median, high = np.percentile(values, [25, 50, 75])
        return cls(float(median), float(low), float(high), len(values))

    def times(self, factor: float) -> "Spread":
        """The same in another unit."""
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
    """Seconds of each contender in each round, after a run of each that is not counted.

    Every round begins with another contender, so that none is always behind the same one. A
    contender that has spent its patience drops out, at the earliest after `LEAST` rounds; so item n
    is round n of all. Those that are `ready` have nothing to warm up: if their first run is longer
    than their patience, it is the one that counts.
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
    """How many times as long as the reference a contender took in the rounds both were in."""
    return Spread.of([a / b for a, b in zip(times, reference, strict=False)])


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Power p that fits value = factor × sizeᵖ best, by least squares of logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def peak_memory() -> float:
    """Most memory that this process has had in RAM, MiB.

    Linux counts what a parent had before it started this process into `ru_maxrss` (measured: 788
    MiB for an idle child of a parent with 780), so its own count since then is taken if there is
    one.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEBI


def child(module: str, **choices: object) -> dict[str, Any]:
    """What the function `in_child` of a module answers in a process of its own.

    Raises
    ------
    RuntimeError
        It fails; says what it wrote last.
    """
    command = [sys.executable, "-m", "benchmarks.child", module, json.dumps(choices)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if ended.returncode:
        said = ended.stderr.strip().splitlines() or [f"exit status {ended.returncode}"]
        raise RuntimeError(f"{module}: {said[-1]}")
    answer: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return answer


def wall_seconds(command: Sequence[str], environment: Mapping[str, str] | None = None) -> float:
    """Seconds a command takes from start to end.

    Raises
    ------
    RuntimeError
        It fails; says what it wrote last.
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
    """What a reader must know about where and when this was measured."""
    versions = {name: _version(name) for name in ("numpy", "numba", *PEERS)}
    load = ", ".join(f"{value:.2f}" for value in os.getloadavg())
    return {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _commit(),
        "processor": f"{_processor()}, {_cores()} cores",
        "memory": f"{_memory():.1f} GiB",
        "system": platform.platform(),
        "Python": platform.python_version(),
        **{name: version for name, version in versions.items() if version},
        "load before the start (1, 5, 15 min)": load,
    }


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _memory() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / (1 << 30)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def _commit() -> str:
    """Commit that is checked out, and whether files differ from it."""
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
