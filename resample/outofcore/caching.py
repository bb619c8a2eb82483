"""Facts about values, kept with them or in a scene."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Memo = dict[tuple[Any, ...], Any]  # by function, arguments and values

_kept: ContextVar[Memo | None] = ContextVar("kept", default=None)


@contextmanager
def memoizing(kept: Memo) -> Iterator[None]:
    """Enable memoization within a block.

    Values must neither change nor be freed while results about them are kept.
    """
    token = _kept.set(kept)
    try:
        yield
    finally:
        _kept.reset(token)


def memo_of(values: Any) -> Memo:
    """Return what is kept about values; without a scene nothing is kept for long."""
    kept: Memo | None = getattr(values, "found", _kept.get())
    return {} if kept is None else kept


def memoized(of: Callable[[Any], Any]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Memoize a function that only depends on values and numbers, in a scene or on the values."""

    def decorated(find: Callable[P, R]) -> Callable[P, R]:
        @wraps(find)
        def found(*args: P.args, **kwargs: P.kwargs) -> R:
            first, *others = args
            kept = memo_of(of(first))
            key = (find, id(of(first)), *others, *sorted(kwargs.items()))
            if key not in kept:
                kept[key] = find(*args, **kwargs)
            result: R = kept[key]
            return result

        return found

    return decorated
