"""What tests cost: `pytest -p tests.costs` records it in COSTS, `python -m tests.costs` sums it up.

Costs are CPU seconds of a case and of the processes that it starts, and of these what its own
process spends compiling. `limits.json` holds how many cases may cost more than a quarter of a
second, and how many specialisations of kernels the tests may need. Both may only fall.
"""

import argparse
import json
import os
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

LIMITS = Path(__file__).with_name("limits.json")
LARGE = 0.25  # CPU seconds, on a machine that does `yardstick` in `USUAL`
USUAL = 0.021  # CPU seconds


class Cost(NamedTuple):
    """CPU seconds of a case."""

    test: str
    spent: float  # by it and by the processes that it starts
    compiling: float  # by its own process, of that
    yard: float  # that `yardstick` took in its worker


def yardstick() -> float:
    """Least CPU time of fixed NumPy work, in which a case's costs are measured."""
    numbers = np.random.default_rng(7).random(1 << 18)
    times = []
    for _ in range(7):
        begin = time.thread_time()
        np.argsort(numbers, kind="stable")  # which no processor has instructions for
        times.append(time.thread_time() - begin)
    return min(times)


_yard: list[float] = []
_compiling = [0.0]
_nested = threading.local()
_is_listening: list[bool] = []


def _listen() -> None:
    """Add up the time of numba's compiler, once numba is there."""
    if _is_listening or "numba" not in sys.modules:
        return
    from numba.core import event

    class Clock(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:  # noqa: ARG002
            _nested.depth = getattr(_nested, "depth", 0) + 1
            if _nested.depth == 1:
                _nested.began = time.thread_time()

        def on_end(self, event: object) -> None:  # noqa: ARG002
            _nested.depth -= 1
            if _nested.depth == 0:
                _compiling[0] += time.thread_time() - _nested.began

    event.register("numba:compile", Clock())
    _is_listening.append(True)


def _spent() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Append a case's costs to the worker's file."""
    if not _yard:
        _yard.append(yardstick())
    _listen()
    begin, compiling = _spent(), _compiling[0]
    try:
        return (yield)
    finally:
        cost = Cost(item.nodeid, _spent() - begin, _compiling[0] - compiling, _yard[0])
        worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
        with (Path(os.environ["COSTS"]) / f"{worker}.jsonl").open("a") as lines:
            lines.write(json.dumps(cost) + "\n")


def recorded(folder: Path) -> list[Cost]:
    """Costs of all cases that workers have recorded in a folder."""
    lines = (line for file in folder.glob("*.jsonl") for line in file.read_text().splitlines())
    return [Cost(*json.loads(line)) for line in lines]


def is_large(cost: Cost) -> bool:
    """Whether a case runs, without compiling, longer than a quick one may."""
    return cost.spent - cost.compiling > LARGE * cost.yard / USUAL


def summed_up(costs: list[Cost]) -> list[str]:
    """A line for each folder of tests."""
    folders = defaultdict(list)
    for cost in costs:
        folders["/".join(cost.test.split("/")[:2])].append(cost)
    lines = [f"{'cases':>7} {'CPU s':>7} {'compiling':>9} {'large':>6}"]
    for name, group in [*sorted(folders.items()), ("all", costs)]:
        spent, compiling = sum(c.spent for c in group), sum(c.compiling for c in group)
        large = sum(map(is_large, group))
        lines.append(f"{len(group):7d} {spent:7.0f} {compiling:9.0f} {large:6d}  {name}")
    return lines


def main() -> int:
    """Print costs of a folder, and check the limits; gives the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.costs")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=0, help="print so many of the largest, too")
    asked = parser.parse_args()
    costs = recorded(asked.folder)
    print("\n".join(summed_up(costs)))
    for cost in sorted(costs, key=lambda c: c.compiling - c.spent)[: asked.cases]:
        print(f"{cost.spent - cost.compiling:7.2f}  {cost.test}")
    large, most = sum(map(is_large, costs)), json.loads(LIMITS.read_text())["large"]
    if large > most:
        print(f"{large} cases take over {LARGE} s, at most {most} may: make one quicker", end="")
        print(", or leave it to `make test-all` (docs/testing.md)")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
