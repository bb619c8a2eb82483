"""Static roles: functions with a body chosen while a kernel is compiled.

The engine owns the loops; their bodies differ between applications. A role is a function
that such a loop calls. The body is chosen by the class of its first argument, a bundle that
the application made or None, so that the machine code has no trace of the choice.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from resample.engine.jit import LANES, compiler, when_compiling

P = ParamSpec("P")
R = TypeVar("R")
Body = Callable[..., Any]


def role(function: Callable[P, R]) -> Callable[P, R]:
    """A function with a body registered (`plays`) for the class of its first argument.

    It becomes a part of the `inner_kernel` that calls it, and likewise makes and gives no arrays.
    """
    return _cast(function, inline="always")


def called_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that is called, as it is too long to be inlined twice."""
    return _cast(function, inline="never", _nrt=False)


def making_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that may allocate arrays."""
    return _cast(function, inline="never")


def lane_role(function: Callable[P, R]) -> Callable[P, R]:
    """A role that is inlined into loops of lanes, like a `lane_step`."""
    return _cast(function, inline="never", fastmath=LANES, forceinline=True)


def _cast(function: Callable[P, R], inline: str, **own: Any) -> Callable[P, R]:
    bodies: dict[type, Body] = {}

    @wraps(function)
    def play(*given: P.args, **named: P.kwargs) -> R:
        body = bodies.get(type(given[0])) or bodies[object]
        return body(*given, **named)  # type: ignore[no-any-return]

    when_compiling(lambda: compiler().define_role(play, bodies, inline, own))
    play.bodies = bodies  # type: ignore[attr-defined]
    play.options = {**own, "inline": inline}  # type: ignore[attr-defined]
    return play


def plays(what: Callable[..., R], of: type) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a role's body for bundles of the class `of`; `object` is all others."""

    def register(body: Callable[P, R]) -> Callable[P, R]:
        what.bodies[of] = body  # type: ignore[attr-defined]
        return body

    return register
