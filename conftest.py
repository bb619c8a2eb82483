"""What all tests share: threads, the search for examples, the real data, random numbers."""

import builtins
import os
from collections import defaultdict
from contextlib import suppress
from pathlib import Path

# Side by side with other workers, each gets its share of the processors; two threads at least, or
# tests of threads would show nothing. Before numba is imported; processes of tests inherit it.
if "PYTEST_XDIST_WORKER_COUNT" in os.environ:
    share = (os.cpu_count() or 1) // int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
    os.environ.setdefault("NUMBA_NUM_THREADS", str(max(2, share)))

# Tests give commands a cache of their own, but kernels are compiled once for all of them.
if "NUMBA_CACHE_DIR" not in os.environ:
    from resample.memory.mapped import folder

    os.environ["NUMBA_CACHE_DIR"] = str(folder() / "kernels")

# Which test is the first to compile a kernel is chance: commands do not say so.
os.environ.setdefault("RESAMPLE_LOG", "warning")

import numpy as np
import pytest

pytest.register_assert_rewrite("tests.bits", "tests.commands")  # they say what differs

pytest_plugins = ("tests.record",)  # figures that may not get worse

DATA = Path(os.environ.get("RESAMPLE_TEST_DATA", Path(__file__).parent / "../shared/data"))

with suppress(ImportError):  # tests of the wheel have pytest alone
    from hypothesis import settings

    # The same examples in every run; `--hypothesis-profile=search` looks for others.
    settings.register_profile("fixed", derandomize=True, deadline=None, database=None)
    settings.register_profile("search", deadline=None, print_blob=True)
    settings.load_profile("fixed")


def real(name: str) -> Path:
    """A folder or file of the real data; tests that want it are skipped where it is absent."""
    path = (DATA / name).resolve()
    if not path.exists():
        pytest.skip(f"{name} is not on this machine (set RESAMPLE_TEST_DATA)")
    return path


@pytest.fixture(autouse=True)
def outside_ipython(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undo what widgets' tests leave in this process, by which astropy takes it for a notebook."""
    monkeypatch.delattr(builtins, "__IPYTHON__", raising=False)


@pytest.hookimpl(tryfirst=True)  # before marks are looked at
def pytest_collection_modifyitems(items: list[pytest.Function]) -> None:
    """Leave to `make test-all` what `each_value` and `some` do not try."""
    tests: defaultdict[str, list[pytest.Function]] = defaultdict(list)
    for item in items:
        if not item.get_closest_marker("sweep"):
            tests[item.nodeid.partition("[")[0]].append(item)
    for cases in tests.values():
        tried = cases
        if cases[0].get_closest_marker("each_value"):
            tried = _with_each_value(cases)
        elif some := cases[0].get_closest_marker("some"):
            tried = _spread(cases, *some.args)
        for case in set(cases).difference(tried):
            case.add_marker(pytest.mark.sweep)


def _with_each_value(cases: list[pytest.Function]) -> list[pytest.Function]:
    """Cases that have each value of each parameter, taken greedily."""
    left = {case: {(k, repr(v)) for k, v in case.callspec.params.items()} for case in cases}
    unseen, tried = set().union(*left.values()), []
    while unseen:
        tried.append(max(left, key=lambda case: len(left[case] & unseen)))
        unseen -= left.pop(tried[-1])
    return tried


def _spread(cases: list[pytest.Function], count: int) -> list[pytest.Function]:
    """So many cases at equal distances, the first among them."""
    count = min(count, len(cases))
    return [cases[n * len(cases) // count] for n in range(count)]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def volumes() -> Path:
    """The folder of real volumes."""
    return real("volumes")
