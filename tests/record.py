"""What tests measure, held to what is on record in `record.json`: a pytest plugin.

A test takes the fixture `record` and tells what it has found:

    record.quality("picture", psnr(found, truth))  # dB, more is better
    record.error("depth", rms(found, truth))  # less is better
    record.error("wrong pixels", np.abs(found - truth) > 0.1)  # their share

A figure that is worse than the one on record by over 0.5 dB, or by over 10 % of an error, fails.
Gains of as much are told at the end of a run. With `--record`, figures that are not on record and
gains go there; a loss never does: to accept one, edit its line by hand, and say why in a "why".
"""

import json
import math
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

RECORD = Path(__file__).with_name("record.json")
QUALITY, ERROR = "dB", "error"
DECIBELS = 0.5  # that a quality may fall short of the one on record
SHARE = 0.1  # by which an error may exceed the one on record
SAME = (
    100.0  # dB; beyond, pictures differ by the rounding of their floats, which is another elsewhere
)
ROUNDING = 1e-6  # of errors, likewise
FEW = 2  # of what is right or wrong, more or less of which is chance

Entry = dict[str, Any]  # a figure by its kind, and why a worse one was accepted


def read_record(text: str) -> dict[str, Entry]:
    """Entries by the test's id and what it measures; equal pictures have "inf" dB."""
    entries = json.loads(text)
    for entry in entries.values():
        for kind in {QUALITY, ERROR} & entry.keys():
            entry[kind] = float(entry[kind])
    return dict(entries)


def written(entries: Mapping[str, Entry]) -> str:
    """Text of a record: sorted, and a figure per line."""
    lines = []
    for key, entry in sorted(entries.items()):
        plain = {k: "inf" if v == math.inf else v for k, v in entry.items()}
        lines.append(f"  {json.dumps(key)}: {json.dumps(plain, ensure_ascii=False)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def rounded(kind: str, figure: float) -> float:
    """A figure as it goes on record: hundredths of a decibel, or three digits of an error."""
    return round(figure, 2) if kind == QUALITY else float(f"{figure:.3g}")


def is_worse(kind: str, figure: float, before: float, chance: float = ROUNDING) -> bool:
    """Whether a figure falls short of another by more than what chance explains."""
    if kind == QUALITY:
        return not figure >= min(before, SAME) - DECIBELS
    return not figure <= before * (1 + SHARE) + chance


def is_better(kind: str, figure: float, before: float, chance: float = ROUNDING) -> bool:
    """Whether a figure exceeds another by as much."""
    if kind == QUALITY:
        return min(figure, SAME) > before + DECIBELS
    return figure < before * (1 - SHARE) - chance


def told(kind: str, figure: float) -> str:
    """A figure in words."""
    return f"{figure:.2f} dB" if kind == QUALITY else f"an error of {figure:.3g}"


def unexplained(before: Mapping[str, Entry], after: Mapping[str, Entry]) -> list[str]:
    """Names of entries whose figure has become worse without a "why"."""
    return [
        key
        for key, entry in after.items()
        for kind in {QUALITY, ERROR} & entry.keys() & before.get(key, {}).keys()
        if is_worse(kind, entry[kind], before[key][kind]) and not entry.get("why", "").strip()
    ]


def versions(count: int = 5) -> list[str]:
    """The record as it is and as the last commits left it, newest first; one without a history."""
    name, found = f"tests/{RECORD.name}", [RECORD.read_text(encoding="utf-8")]

    def git(*arguments: str) -> str:
        if shutil.which("git") is None:
            return ""
        command = ("git", *arguments)
        done = subprocess.run(command, cwd=RECORD.parents[1], capture_output=True, check=False)
        return done.stdout.decode() if done.returncode == 0 else ""

    for commit in git("log", f"-{count}", "--format=%H", "--", name).split():
        found += filter(None, [git("show", f"{commit}:{name}")])
    return found


class Record:
    """What one test has found, beside what is on record.

    Parameters
    ----------
    node
        The test's id.
    entries
        The record.
    is_writing
        Whether figures that are not on record are welcome.
    """

    def __init__(self, node: str, entries: Mapping[str, Entry], is_writing: bool = False) -> None:
        self.node, self.entries, self.is_writing = node, entries, is_writing
        # The worst by what it is and its kind, and what of an error is chance.
        self.found: dict[tuple[str, str], tuple[float, float]] = {}

    def quality(self, what: str, decibels: Any) -> None:
        """Fail where a quality is worse than the one on record; of several, the worst counts."""
        __tracebackhide__ = True
        self._judge(what, QUALITY, float(decibels), 0.0)

    def error(self, what: str, error: Any) -> None:
        """Fail where an error is larger than the one on record; of several, the largest counts.

        Of booleans, which say what is wrong, it is the share.
        """
        __tracebackhide__ = True
        given = np.asarray(error)
        if given.dtype.kind == "b":
            self._judge(what, ERROR, float(given.mean()), FEW / given.size)
        else:
            self._judge(what, ERROR, float(given), ROUNDING)

    def _judge(self, what: str, kind: str, figure: float, chance: float) -> None:
        __tracebackhide__ = True  # the line that is shown is the test's
        key = f"{self.node} {what}"
        if math.isnan(figure):
            pytest.fail(f"{what}: NaN")
        worst, one = min if kind == QUALITY else max, (figure, chance)
        self.found[what, kind] = worst(one, self.found.get((what, kind), one))
        before = self.entries.get(key, {}).get(kind)
        if before is None and not self.is_writing:
            pytest.fail(
                f"{what}: {told(kind, figure)} is not on record; this adds it: "
                f'python -m pytest --record "{self.node}", '
                f'and so does make test-all ARGS="--record {self.node.partition("::")[0]}"'
            )
        if before is not None and is_worse(kind, figure, before, chance):
            pytest.fail(
                f"{what}: {told(kind, figure)}, but {told(kind, before)} is on record; to accept "
                f'it, edit the line of tests/{RECORD.name} and say why in a "why" beside the figure'
            )


class Ledger:
    """What all tests have found, in the process that reports it."""

    def __init__(self, config: pytest.Config) -> None:
        self.is_writing = bool(config.getoption("--record"))
        self.is_worker = hasattr(config, "workerinput")
        self.entries = read_record(RECORD.read_text(encoding="utf-8"))
        self.found: list[tuple[str, str, str, float, float]] = []
        self.collected: list[str] = []

    @pytest.hookimpl(tryfirst=True)  # before some are left out
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Note which tests there are: the record holds no others."""
        self.collected = [item.nodeid for item in items]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Take what a test has found from its report, which workers send."""
        if report.when == "teardown" and not self.is_worker:
            for name, value in report.user_properties:
                if name == "record":
                    self.found += [(report.nodeid, *each) for each in value]

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Tell gains and what is not on record yet, and put both there if that is asked for."""
        lines = []
        for node, what, kind, figure, chance in sorted(self.found):
            key = f"{node} {what}"
            before = self.entries.get(key, {}).get(kind)
            if before is None:
                lines.append(f"new: {key}: {told(kind, figure)}")
            elif is_better(kind, figure, before, chance):
                lines.append(f"gain: {key}: {told(kind, figure)}, before {told(kind, before)}")
            else:
                continue
            if self.is_writing:
                self.entries[key] = {kind: rounded(kind, figure)}
        if not lines:
            return
        terminalreporter.section("figures" if self.is_writing else "figures to put on record")
        terminalreporter.write_line("\n".join(lines))
        if self.is_writing:
            RECORD.write_text(written(self.entries), encoding="utf-8")
            terminalreporter.write_line(f"{len(lines)} are on record now, in tests/{RECORD.name}")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that writes."""
    say = "put new figures and gains on record in tests/record.json"
    parser.addoption("--record", action="store_true", help=say)


LEDGER = pytest.StashKey[Ledger]()


def pytest_configure(config: pytest.Config) -> None:
    """Open the record."""
    config.stash[LEDGER] = Ledger(config)
    config.pluginmanager.register(config.stash[LEDGER], "figures on record")


@pytest.fixture
def record(request: pytest.FixtureRequest) -> Iterator[Record]:
    """Figures of this test, beside those on record."""
    ledger = request.config.stash[LEDGER]
    mine = Record(request.node.nodeid, ledger.entries, ledger.is_writing)
    yield mine
    found = [[*name, *figure] for name, figure in mine.found.items()]
    request.node.user_properties.append(("record", found))
