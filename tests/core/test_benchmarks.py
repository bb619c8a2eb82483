"""The code around measurements, on made-up times; and the counts and baselines they rest on."""

import json

import numpy as np
import pytest

from benchmarks import guard
from benchmarks.__main__ import parsed
from benchmarks.measure import LEAST, Spread, exponent, machine, ratio, take_turns
from benchmarks.scenes import floor_matrix
from benchmarks.tables import Section, as_json, document, markdown, number, shown
from resample.measuring.quality import psnr
from tests.processes import python


class Clock:
    """Time that passes only where a contender spends it."""

    def __init__(self):
        self.now = 0.0
        self.order = []

    def __call__(self):
        return self.now

    def spending(self, name, seconds):
        def run():
            self.order.append(name)
            self.now += seconds

        return run


def turns(seconds, rounds, patience=1e9, ready=()):
    """Times of contenders by name, and the order in which they ran."""
    clock = Clock()
    runs = {name: clock.spending(name, each) for name, each in seconds.items()}
    times = take_turns(runs, rounds, ready=ready, patience=patience, clock=clock, pause=0.0)
    return times, "".join(clock.order)


def test_a_spread_is_the_median_between_the_quartiles():
    assert Spread.of([5.0, 1.0, 2.0, 4.0, 3.0]) == Spread(3.0, 2.0, 4.0, 5)


def test_warm_runs_do_not_count():
    times, order = turns({"a": 1.0}, rounds=3)
    assert (len(order), times["a"]) == (4, [1.0, 1.0, 1.0])


def test_every_round_begins_with_another_contender():
    _, order = turns({"a": 1.0, "b": 1.0, "c": 1.0}, rounds=3)
    assert order == "abc" + "abc" + "bca" + "cab"


def test_whoever_is_too_slow_drops_out_after_the_least_rounds():
    times, _ = turns({"fast": 1.0, "slow": 60.0}, rounds=5, patience=50.0)
    assert (len(times["fast"]), len(times["slow"])) == (5, LEAST)


def test_a_slow_run_of_what_needs_no_warming_is_not_repeated():
    times, order = turns({"fast": 1.0, "slow": 60.0}, rounds=2, patience=50.0, ready=["slow"])
    assert (times["slow"], order.count("slow")) == ([60.0], 1)


def test_a_ratio_is_of_rounds_and_not_of_medians():
    assert ratio([2.0, 20.0, 6.0], [1.0, 10.0, 2.0, 9.0]) == Spread(2.0, 2.0, 2.5, 3)


@pytest.mark.parametrize("power", [0.0, 1.0, 1.5])
def test_the_exponent_of_a_power_law_is_found(power):
    sizes = [1e5, 1e6, 1e7, 1e8]
    assert exponent(sizes, [3 * size**power for size in sizes]) == pytest.approx(power, abs=1e-9)


@pytest.mark.sweep
def test_the_peak_of_memory_is_that_of_the_process_alone():
    code = """
import numpy
from benchmarks.measure import child, peak_memory
before = peak_memory()
numpy.ones(100 << 17)  # 100 MiB
alone = child("benchmarks.contest")["peak"]
print(before, peak_memory(), alone)
"""
    before, after, of_child = map(float, python(code).split())
    assert after >= before + 90
    assert of_child < after - 50


@pytest.mark.sweep
def test_the_machine_is_described_by_words_without_gaps():
    assert all(machine().values())


def test_numbers_have_three_digits():
    given = [1234567.0, 123.4, 12.34, 1.234, 0.1234, 1.2e-4, float("inf")]
    assert list(map(number, given)) == [
        *("1,234,567", "123", "12.3", "1.23", "0.123"),
        *("1.20e-04", "∞"),
    ]


def test_a_single_value_has_no_quartiles():
    assert (shown(Spread.of([2.0])), shown(Spread.of([1.0, 3.0]))) == (
        "2.00",
        "2.00 (1.50 to 2.50)",
    )


SECTION = Section(
    "Title", "Text.", [{"": "a", "ms": Spread.of([1.0])}, {"": "b", "dB": 40.0}], ["n"]
)


def test_a_table_has_the_columns_of_all_rows():
    assert markdown(SECTION) == (
        "### Title\n\nText.\n\n|  | ms | dB |\n| --- | --- | --- |\n"
        "| a | 1.00 |  |\n| b |  | 40.0 |\n\n- n\n"
    )


def test_a_document_names_the_command_and_the_machine():
    text = document("make bench", {"date": "today"}, [SECTION])
    assert "make bench" in text
    assert "| date | today |" in text


def test_json_holds_numbers_where_markdown_holds_text():
    endless = Section("", "", [{"dB": float("inf"), "ms": Spread.of([1.0, 3.0])}])
    content = json.loads(json.dumps(as_json("c", {}, [endless]), allow_nan=False))
    row = content["sections"][0]["rows"][0]
    assert row == {"dB": "inf", "ms": {"median": 2.0, "low": 1.5, "high": 2.5, "size": 2}}


def test_an_unknown_group_is_refused_with_the_known_ones(capsys):
    with pytest.raises(SystemExit):
        parsed(["volum"])
    assert "there are growth, " in capsys.readouterr().err


def test_a_floor_fills_its_frame():
    corners = np.array([(0, 0, 1), (64, 0, 1), (36, 64, 1), (28, 64, 1)]).T
    place = floor_matrix(64, 32) @ corners
    expected = [(0, 32, 32, 0), (0, 0, 32, 32)]
    assert place[:2] / place[2] == pytest.approx(np.array(expected), abs=1e-9)


# What the baselines leave out: sheets instead of every splat; 4 × 4 bilinear readings instead of
# exact areas of a sharper spline; silhouettes of whole pixels.
@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        "volume, splats",
        "volume, points",
        "texture",
        pytest.param("depth image", marks=pytest.mark.sweep),
    ],
)
def test_baselines_make_the_same_picture(name, record):
    work = guard.WORKS[name]()
    ours = work.ours()
    image = np.squeeze(ours.rgba if hasattr(ours, "rgba") else ours.image)
    record.quality("picture", psnr(image, work.baseline()))


def test_half_the_recorded_ratio_is_a_regression_and_a_little_more_is_not():
    said = guard.regressions({"a": 4.9, "b": 5.1}, {"a": 10.0, "b": 10.0})
    assert said == ["a: 4.9 times as fast as NumPy, and 10.0 on record"]


def test_a_work_without_a_record_does_not_pass():
    assert "nothing is on record" in guard.regressions({"a": 1.0}, {})[0]


def test_every_work_is_on_record():
    assert set(guard.read_record(guard.RECORD)) == set(guard.WORKS)


@pytest.mark.sweep
@pytest.mark.slow
def test_a_volume_beyond_memory_has_the_bits_of_one_in_memory_and_keeps_its_budget(capsys):
    pytest.importorskip("zarr")
    from benchmarks.scale import main

    assert main(["--size", "96", "--memory", "200MiB", "--workers", "0"]) == 0
    told = capsys.readouterr().out
    assert "the same bits, within 200MiB beside Python and its libraries: True" in told
    assert "8 bricks" in told
