"""Which cases `make test` tries, and which it leaves to `make test-all`."""

from itertools import product
from types import SimpleNamespace

import pytest

from conftest import _spread, _with_each_value


@pytest.mark.parametrize(
    ("count", "tried"), [(1, [0]), (2, [0, 4]), (3, [0, 2, 5]), (20, [*range(8)])]
)
def test_some_cases_lie_at_equal_distances(count, tried):
    assert _spread(list(range(8)), count) == tried


def test_each_value_of_each_parameter_has_a_case_and_few_have_two():
    class Case:
        def __init__(self, **params):
            self.callspec = SimpleNamespace(params=params)

    cases = [Case(a=a, b=b, c=c) for a, b, c in product(range(5), "xyz", (True, False))]
    tried = _with_each_value(cases)
    assert len(tried) == 5
    for name, values in {"a": set(range(5)), "b": set("xyz"), "c": {True, False}}.items():
        assert {case.callspec.params[name] for case in tried} == values
