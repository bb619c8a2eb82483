"""Runs of commands, and the rows of the table."""

import math
import os
import resource
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
Booleans: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Integers: TypeAlias = NDArray[np.int64]

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("RESAMPLE_TEST_DATA", ROOT / "../shared/data"))
COMMANDS = Path(sys.executable).parent
LEVEL = 0.005  # smaller differences count as none


class AbsentError(Exception):
    """A file of the data, or a peer, is not on this machine."""


class Finding(NamedTuple):
    """A truth, computed a second way."""

    text: str
    holds: bool


class Call(NamedTuple):
    """A command that was run."""

    command: str
    cpu: float  # s, start included; NaN if it failed


@dataclass(frozen=True)
class Row:
    """Line of the table."""

    case: str
    ours: float | None  # None: the command failed
    peer: float | None  # the best peer's, or what is asked; None without a peer
    name: str  # of the best peer, "asked" or "truth"
    unit: str
    sign: int = 1  # 1: more is better, -1: less is, 0: equality is asked
    cpu: float | None = None  # s, of our command
    peer_cpu: float | None = None
    commands: Sequence[str] = ()

    def gap(self) -> float | None:
        """How far ours is ahead of the peer; negative behind it, 0 if level."""
        if self.ours is None or self.peer is None:
            return None
        gap = (self.ours - self.peer) * self.sign if self.sign else -abs(self.ours - self.peer)
        return 0.0 if abs(gap) < (LEVEL if self.sign else 1e-9) else gap

    def is_behind(self) -> bool:
        """Whether the best peer, or what is asked, is missed."""
        gap = self.gap()
        return self.ours is None or (gap is not None and gap < 0)

    def __str__(self) -> str:
        gap = self.gap()
        verdict = "no answer" if self.ours is None else "-" if gap is None else f"{gap:+.2f}"
        numbers = ["-" if one is None else f"{one:.2f}" for one in (self.ours, self.peer, self.cpu)]
        return (
            f"{self.case:60s} {numbers[0]:>9s} {numbers[1]:>9s} {self.unit:7s} {self.name:20s} "
            f"{verdict:>9s} {numbers[2]:>6s}"
        )


@dataclass
class Judge:
    """Runs commands in a folder and collects rows."""

    folder: Path
    data: Path = DATA
    quick: bool = False  # fewer cases
    rows: list[Row] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def file(self, name: str) -> Path:
        """Path of a file of the data.

        Raises
        ------
        AbsentError
            It is not there.
        """
        path = (self.data / name).resolve()
        if not path.exists():
            raise AbsentError(f"{name} is not in {self.data}")
        return path

    def call(self, program: str, *words: object) -> Call:
        """Run `resample-PROGRAM words`, twice if kernels had to be compiled."""
        name = f"resample-{program}"
        shown = shlex.join([name, *(w.name if isinstance(w, Path) else str(w) for w in words)])
        for _ in range(2):
            done, cpu = self._run([str(COMMANDS / name), *map(str, words)])
            if done.returncode:
                say(f"   failed: {shown}: {done.stderr.strip()[-300:]}")
                return Call(shown, math.nan)
            if "compiling kernels" not in done.stderr:
                break
        return Call(shown, cpu)

    def python(self, *words: object) -> tuple[float, str]:
        """Run Python, as users' scripts do: CPU seconds and what was printed."""
        done, cpu = self._run([sys.executable, *map(str, words)])
        if done.returncode:
            raise AbsentError(done.stderr.strip().splitlines()[-1])
        return cpu, done.stdout

    def _run(self, words: list[str]) -> tuple[subprocess.CompletedProcess[str], float]:
        before = _cpu_of_children()
        done = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, check=False)
        return done, _cpu_of_children() - before

    def add(
        self,
        case: str,
        ours: float,
        peers: Mapping[str, float] | None = None,
        *,
        calls: Sequence[Call],
        unit: str = "dB",
        sign: int = 1,
        cpu: float | None = None,
        peer_cpu: float | None = None,
    ) -> None:
        """Add a row. Of `peers`, the best is kept."""
        best = (max if sign >= 0 else min)(peers, key=lambda name: peers[name]) if peers else None
        row = Row(
            case,
            float(ours) if np.isfinite(ours) else None,
            float(peers[best]) if peers and best is not None else None,
            best or "-",
            unit,
            sign,
            cpu if cpu is not None and np.isfinite(cpu) else None,
            peer_cpu,
            tuple(dict.fromkeys(call.command for call in calls)),
        )
        self.rows.append(row)
        say(f"   {row}")

    def skip(self, what: str) -> None:
        """Name what was left out."""
        self.skipped.append(what)
        say(f"   left out: {what}")


def db(image: ArrayLike, truth: ArrayLike, where: Booleans | None = None) -> float:
    """Peak signal-to-noise ratio, dB, of values in 0..1."""
    square = (np.asarray(image, np.float64) - np.asarray(truth, np.float64)) ** 2
    mean = float(np.mean(square if where is None else square[where]))
    return float(-10 * np.log10(max(mean, 1e-12)))


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _cpu_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
