"""The record of all scores: docs/scores.json."""

import datetime
import json
import platform
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.scores.judging import ROOT, Judge, Row

RECORD = ROOT / "docs" / "scores.json"
GROUPS = ("images", "gaussians", "clouds", "volumes", "depth")


class Taken(NamedTuple):
    """Rows of a group, with when and where they were taken."""

    commit: str
    date: str
    processor: str
    yardstick: float  # CPU ms
    spent: float  # CPU s
    skipped: Sequence[str]
    rows: Sequence[Row]


def yardstick() -> float:
    """CPU ms of a fixed job of NumPy, the least of seven."""
    numbers, took = np.random.default_rng(7).random(1 << 18), []
    for _ in range(7):
        start = time.process_time()
        np.argsort(numbers, kind="stable")
        took.append(time.process_time() - start)
    return 1000 * min(took)


def processor() -> str:
    """Name of the processor."""
    facts = Path("/proc/cpuinfo")
    if facts.is_file():
        for line in facts.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def taken(judge: Judge, measure: float, spent: float) -> Taken:
    """What a group's run gives."""
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    edited = "+" if _git("status", "--porcelain", "--", "resample", "apps") else ""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return Taken(commit + edited, today, processor(), measure, spent, judge.skipped, judge.rows)


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def read(path: Path = RECORD) -> dict[str, Taken]:
    """Groups of the record, in their order."""
    if not path.exists():
        return {}
    stored = json.loads(path.read_text(encoding="utf-8"))
    groups = {}
    for group in (group for group in GROUPS if group in stored):
        rows = [Row(**{**row, "commands": (*row["commands"],)}) for row in stored[group]["rows"]]
        groups[group] = Taken(**{**stored[group], "rows": rows})
    return groups


def write(groups: Mapping[str, Taken], path: Path = RECORD) -> None:
    """Write all groups."""
    stored = {
        group: {
            **groups[group]._asdict(),
            "yardstick": round(groups[group].yardstick, 1),
            "spent": round(groups[group].spent),
            "rows": [_short(row) for row in groups[group].rows],
        }
        for group in GROUPS
        if group in groups
    }
    text = json.dumps(stored, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def _short(row: Row) -> dict[str, object]:
    numbers = {
        name: float(f"{value:.6g}") if isinstance(value, float) else value
        for name, value in asdict(row).items()
    }
    return {**numbers, "commands": list(row.commands)}
