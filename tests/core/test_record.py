"""The record of figures: what fails, what is told and written, and that it is in order."""

import json
import math
from collections import defaultdict
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests import record
from tests.record import (
    LEDGER,
    RECORD,
    Record,
    is_better,
    is_worse,
    read_record,
    rounded,
    unexplained,
    versions,
    written,
)

pytest_plugins = ("pytester",)

ROOT = Path(__file__).parents[2]
TEST = """
import pytest

@pytest.mark.parametrize("n", [1, 2])
def test_figures(record, n):
    record.quality("picture", {quality})
    record.error("depth", {error})
"""


@pytest.fixture
def ended(pytester, monkeypatch):
    """How pytest ends on a test that finds these figures, what it prints, and the record."""
    file = pytester.path / "record.json"
    file.write_text("{}\n")
    monkeypatch.setattr(record, "RECORD", file)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")

    def run(*words, quality, error=0.01):
        pytester.makepyfile(test_it=TEST.format(quality=quality, error=error))
        done = pytester.runpytest_inprocess("-p", "tests.record", *words)
        return int(done.ret), done.stdout.str(), file.read_text()

    return run


def test_figures_are_refused_recorded_held_and_told_when_they_are_gains(ended):
    code, said, kept = ended(quality=41.256)
    assert code == 1
    assert "picture: 41.26 dB is not on record" in said
    assert 'python -m pytest --record "test_it.py::test_figures[1]"' in said
    assert json.loads(kept) == {}

    code, said, kept = ended("--record", quality=41.256, error=0.012345)
    assert code == 0
    assert "4 are on record now" in said
    assert '"test_it.py::test_figures[1] picture": {"dB": 41.26},\n' in kept
    assert '"test_it.py::test_figures[2] depth": {"error": 0.0123},\n' in kept

    for words in ((), ("--record",)):  # what is as good as before is neither told nor written
        code, said, after = ended(*words, quality=40.8, error=0.0134)
        assert (code, after) == (0, kept)
        assert "figures" not in said.replace("test_figures", "")

    for words in ((), ("--record",)):  # a loss is never written
        code, said, after = ended(*words, quality=40.7, error=0.0123)
        assert (code, after) == (1, kept)
        assert "picture: 40.70 dB, but 41.26 dB is on record" in said
        assert 'say why in a "why"' in said
    code, said, _ = ended(quality=41.26, error=0.0137)
    assert code == 1
    assert "depth: an error of 0.0137, but an error of 0.0123 is on record" in said

    code, said, after = ended(quality=42.0, error=0.011)
    assert (code, after) == (0, kept)
    assert "gain: test_it.py::test_figures[1] picture: 42.00 dB, before 41.26 dB" in said
    assert "gain: test_it.py::test_figures[2] depth: an error of 0.011" in said
    ended("--record", quality=42.0, error=0.011)
    assert ended(quality=41.4, error=0.011)[0] == 1


def test_workers_pass_what_they_found_to_the_controller(ended, monkeypatch):
    pytest.importorskip("xdist")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    code, said, kept = ended("-p", "xdist", "-n", "1", "--record", quality=math.pi)
    assert code == 0
    assert "4 are on record now" in said
    assert len(json.loads(kept)) == 4


def test_of_figures_of_one_name_the_worst_counts():
    mine = Record("a", {"a x": {"dB": 40.0}, "a y": {"error": 0.1}})
    for decibels, error in ((60.0, 0.01), (39.6, 0.105), (50.0, 0.05)):
        mine.quality("x", decibels)
        mine.error("y", error)
    assert mine.found == {("x", "dB"): (39.6, 0.0), ("y", "error"): (0.105, 1e-6)}
    with pytest.raises(pytest.fail.Exception, match=r"39\.00 dB, but 40\.00 dB"):
        mine.quality("x", 39.0)
    with pytest.raises(pytest.fail.Exception, match="NaN"):
        mine.quality("x", math.nan)


def test_of_what_is_wrong_two_more_are_chance():
    mine = Record("a", {"a x": {"error": 0.02}})
    mine.error("x", np.arange(100) < 4)
    assert mine.found == {("x", "error"): (0.04, 0.02)}
    with pytest.raises(pytest.fail.Exception, match=r"an error of 0\.05"):
        mine.error("x", np.arange(100) < 5)


def test_beyond_the_rounding_of_floats_nothing_is_better_or_worse():
    assert not is_worse("dB", 120.0, math.inf)
    assert is_worse("dB", 99.0, math.inf)
    assert not is_better("dB", math.inf, 120.0)
    assert is_better("dB", math.inf, 99.0)
    assert not is_worse("error", 9e-7, 0.0)
    assert is_worse("error", 2e-6, 0.0)


def test_a_record_is_written_in_order_with_a_figure_per_line():
    given = {"b": {"dB": math.inf}, "a": {"error": 0.5, "why": "it is 3 × as fast"}}
    text = written(given)
    assert text.splitlines() == [
        "{",
        '  "a": {"error": 0.5, "why": "it is 3 × as fast"},',
        '  "b": {"dB": "inf"}',
        "}",
    ]
    assert read_record(text) == given
    assert rounded("dB", 41.2561) == 41.26
    assert rounded("error", 0.00123456) == 0.00123


def test_a_loss_needs_a_reason():
    before = {"a": {"dB": 40.0}, "b": {"error": 0.1}, "gone": {"dB": 30.0}}
    worse = {"a": {"dB": 38.0}, "b": {"error": 0.2}, "new": {"dB": 1.0}}
    assert unexplained(before, before | {"a": {"dB": 39.9}}) == []
    assert unexplained(before, worse) == ["a", "b"]
    assert unexplained(before, worse | {"a": {"dB": 38.0, "why": "it is faster"}}) == ["b"]
    assert unexplained(before, worse | {"a": {"dB": 38.0, "why": "  "}}) == ["a", "b"]


def test_no_figure_has_become_worse_without_a_reason():
    found = [read_record(text) for text in versions()]
    lost = [key for new, old in pairwise(found) for key in unexplained(old, new)]
    assert lost == []


def test_the_record_is_as_it_would_be_written():
    text = RECORD.read_text(encoding="utf-8")
    entries = read_record(text)
    assert text == written(entries)
    for key, entry in entries.items():
        assert len({"dB", "error"} & set(entry)) == 1, key
        assert set(entry) <= {"dB", "error", "why"}, key


def test_what_is_on_record_is_of_tests_that_exist(request):
    if any("::" in str(argument) for argument in request.config.args):
        pytest.skip("parts of files were collected")
    known = defaultdict(list)
    for node in request.config.stash[LEDGER].collected:
        known[node.partition("::")[0]].append(f"{node} ")
    stale = []
    for key in read_record(RECORD.read_text(encoding="utf-8")):
        file = key.partition("::")[0]
        is_known = key.startswith(tuple(known[file])) if file in known else (ROOT / file).exists()
        if not is_known:
            stale.append(key)
    assert stale == []
