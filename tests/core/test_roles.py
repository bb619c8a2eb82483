"""Static roles: a class plays a body of its own, all others what is played for `object`."""

from typing import Any, NamedTuple

import pytest

from resample.engine.jit import called_role, kernel, plays


class Loud(NamedTuple):
    value: float


class Plain(NamedTuple):
    value: float


@called_role
def said(who: Any, times: float) -> float:
    """What is heard of someone."""
    raise NotImplementedError


@plays(said, object)
def _said(who, times):
    return who.value * times


@plays(said, Loud)
def _shouted(who, times):
    return 10.0 * who.value * times


@kernel
def heard(who: Any, times: float) -> float:
    """What a kernel hears."""
    return said(who, times)


@pytest.mark.parametrize("hear", [said, heard])
def test_a_class_plays_its_own_body_and_others_that_of_object(hear):
    assert hear(Loud(2.0), 3.0) == 60.0
    assert hear(Plain(2.0), 3.0) == 6.0
